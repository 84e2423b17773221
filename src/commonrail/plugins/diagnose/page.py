"""Reports of diagnoses, trims and judgements: verdict, probabilities, comparison with sound parts, trim code."""

from __future__ import annotations

from commonrail.base.chart import MARKERS, Bars, Figure, Panel, Series, points
from commonrail.base.csv_output import comment_line
from commonrail.base.table import LARGE, OPERATING_POINT, SMALL, Cell, Part, Table, table_from_columns, table_from_parts
from commonrail.base.text import join_words, megapascal, percent, to_fixed, to_signed
from commonrail.data.records import MEASURED, MICROSECOND, MM3
from commonrail.plugins.diagnose.judgement import PartJudgement
from commonrail.plugins.diagnose.run import (
    BENCHES,
    FAILS,
    UNDECIDED,
    UNEXPLAINED,
    USUAL,
    Diagnosis,
    MeasuredTest,
    NextTest,
    PossibleDiagnosis,
)
from commonrail.plugins.diagnose.trim import PartTrim
from commonrail.plugins.plans.page import (
    Section,
    bench_html,
    note_synthetic,
    plan_figures,
    plan_lines,
    plan_section,
    plan_tables,
)
from commonrail.plugins.plans.study import State, test_name
from commonrail.report.fit.rules import BAD, CARE, GOOD, Tile
from commonrail.report.presenter import Presenter

LEAST = 0.005  # smallest probability of a diagnosis that a sentence names
FEWEST_BARS = 3
_FAILS = {False: FAILS, True: f"{FAILS}; inside makers’ scatter"}  # key: sound parts scatter as far
WIDEST = 15.0  # standard deviations; a marker farther out is drawn at the edge; chosen


def diagnosis_lines(diagnosis: Diagnosis) -> list[str]:
    """Sentences: verdict, probabilities, and the next test."""
    lines = [f"{diagnosis.data.name}: {_verdict(diagnosis)}{_outside(diagnosis)}"]
    if diagnosis.verdict == UNEXPLAINED:
        return lines
    likely = [d for d in diagnosis.diagnoses if d.probability >= LEAST]
    words = ", ".join(f"{d.name} {_share(d.probability)}" for d in likely)
    lines.append(f"Probabilities: {words}.")
    if diagnosis.next:
        lines.append(_next_sentence(diagnosis.next[0], diagnosis.by_nominal))
    return lines


def _share(value: float) -> str:
    return f"{percent(value, 1 if value < 0.1 or 0.99 < value < 0.9995 else 0)} %"


def _verdict(diagnosis: Diagnosis) -> str:
    best, verdict = diagnosis.diagnoses[0], diagnosis.verdict
    if verdict == UNDECIDED:
        return f"undecided: {' or '.join(diagnosis.leading)}."
    if verdict == UNEXPLAINED:
        nearest = "" if best.name == "sound" else f"; {best.name} is nearest"
        cure = "" if diagnosis.by_nominal else " use the plan's nominal quantities (--nominal),"
        checks = f"Check plan, pressures and noise,{cure} or look for two faults at once."
        return f"no fault of the table explains these quantities{nearest}. {checks}"
    if verdict in ("sound", FAILS):
        return f"{verdict}{', inside makers’ scatter' * (verdict == FAILS)}."
    return f"{best.name}: {best.parameter} {best.size[0]}; 90 %: {best.size[1]} to {best.size[2]}."


def _outside(diagnosis: Diagnosis) -> str:
    """Sentence on the results outside their bands, with a leading space; empty if all are inside."""
    names = [
        f"{test_name(row)} {row.state}{f' ({_FAILS[True]})' * row.usual}"
        for row in diagnosis.tests
        if row.state is not State.INSIDE
    ]
    return f" Outside the band: {join_words(names)}." if names else ""


def _place(item: NextTest) -> str:
    """Measure, rail pressure and energising time of a next test."""
    test = item.test
    time = to_fixed(test.energisings[0].duration, 0, MICROSECOND)
    return f"{test.measure} at {megapascal(test.rail_pressure)} MPa and {time} µs"


def _next_sentence(item: NextTest, nominal: bool) -> str:
    """Next test with its expected quantities; with nominal quantities, also in percent of a sound part."""
    (first, second), expected = item.names, [f"{to_fixed(value, 2, MM3)} mm³" for value in item.expected]
    if nominal and item.sound:
        expected = [
            f"{text} ({to_signed(100.0 * (value / item.sound - 1.0), 1)} % from a sound part)"
            for text, value in zip(expected, item.expected, strict=True)
        ]
    separation = f"{to_fixed(item.separation, 1)} standard deviations apart"
    expectation = f"{expected[0]} if {first}, {expected[1]} if {second}; {separation}"
    if item.decides:
        return f"Next test: {_place(item)}: {expectation}."
    return f"No single test decides; the best is {_place(item)}: {expectation}."


def _distance(row: MeasuredTest, quantity: float) -> float:
    """Distance from the mean of sound parts, in their standard deviations."""
    return (quantity - row.sound) / row.deviation


def _measured_cells(row: MeasuredTest) -> tuple[str, Cell]:
    distance = _distance(row, row.measured)
    size = SMALL if abs(distance) <= USUAL else LARGE
    return to_fixed(row.measured, 2, MM3), Cell(to_signed(distance, 1), size)


def diagnosis_tables(diagnosis: Diagnosis) -> list[Table]:
    """Table of the tests."""
    best = diagnosis.diagnoses[0].name
    parts = [
        Part(("test",), lambda row: (test_name(row),)),
        Part(
            OPERATING_POINT,
            lambda row: (megapascal(row.rail_pressure), to_fixed(row.energising_time, 0, MICROSECOND)),
        ),
        Part(("measured", "st. dev. off"), _measured_cells),
        Part(
            ("sound ± 2 st. dev.",),
            lambda row: (f"{to_fixed(row.sound, 2, MM3)} ± {to_fixed(USUAL * row.deviation, 2, MM3)}",),
        ),
        Part(("plan",), lambda row: ("passes" if row.state is State.INSIDE else _FAILS[row.usual],)),
    ]
    if best != "sound":
        parts.append(Part((f"with {best}",), lambda row: (to_fixed(row.leading, 2, MM3),)))
    return [table_from_parts("Quantities, mm³ per stroke", diagnosis.tests, parts, inputs=OPERATING_POINT)]


def _fault_table(diagnoses: tuple[PossibleDiagnosis, ...]) -> Table:
    return table_from_columns(
        "Diagnoses",
        diagnoses,
        [
            ("diagnosis", lambda d: d.name),
            ("meaning", lambda d: d.meaning),
            ("parameter, middle", lambda d: " ".join((d.parameter, *d.size[:1]))),
            ("probability, %", lambda d: percent(d.probability, 1)),
            ("as far away, %", lambda d: percent(d.fit, 1)),
        ],
        "As far away: share of parts with this fault (best size) that lie farther from their mean than this part.",
        3,
    )


def _probability_figure(diagnosis: Diagnosis) -> Figure:
    """Bars of the probabilities from `LEAST`, and at least the first `FEWEST_BARS`."""
    rows = [d for i, d in enumerate(diagnosis.diagnoses) if i < FEWEST_BARS or d.probability >= LEAST]
    ends = points(100.0 * d.probability for d in rows)
    bars = Bars("probability", "best", points(0.0 for _ in rows), ends)
    panel = Panel("", (), bars=(bars,), rows=tuple(d.name for d in rows), has_legend=False)
    others = len(diagnosis.diagnoses) - len(rows)
    before = f"Prior probability of a sound part: {_share(diagnosis.sound)}; the faults share the rest equally."
    left = f" {others} more have less than {_share(LEAST)} each." if others else ""
    left += " Relative ranking only: no single fault fits." if diagnosis.verdict == UNEXPLAINED else ""
    return Figure("Probabilities", before + left, "probability, %", (panel,))


def quantity_figure(diagnosis: Diagnosis) -> Figure:
    """Measured quantities and quantities of the leading fault, against the band of sound parts."""
    rows, best = diagnosis.tests, diagnosis.diagnoses[0].name
    places = points(float(i) for i in range(len(rows)))

    def series(label: str, look: str, quantities: list[float]) -> Series:
        distances = (_distance(row, quantity) for row, quantity in zip(rows, quantities, strict=True))
        return Series(label, look, points(max(-WIDEST, min(WIDEST, d)) for d in distances), places, MARKERS)

    shown = [series("measured", MEASURED, [row.measured for row in rows])]
    if best != "sound":
        shown.insert(0, series(best, "best", [row.leading for row in rows]))
    band = Bars("95 % of sound parts", "level", points(-USUAL for _ in rows), points(USUAL for _ in rows))
    caption = (
        f"Distance from the mean of sound parts, noise included; markers beyond {WIDEST:.0f} are drawn at the edge."
    )
    panel = Panel("", tuple(shown), bars=(band,), rows=tuple(map(test_name, rows)))
    return Figure("Measured against sound parts", caption, "standard deviations", (panel,))


def diagnosis_figures(diagnosis: Diagnosis) -> list[Figure]:
    """Probabilities, and quantities in standard deviations."""
    return [_probability_figure(diagnosis), quantity_figure(diagnosis)]


def _tiles(diagnosis: Diagnosis) -> list[Tile]:
    best, verdict = diagnosis.diagnoses[0], diagnosis.verdict
    level = CARE if verdict in (UNDECIDED, UNEXPLAINED, FAILS) else GOOD if verdict == "sound" else BAD
    tiles = [Tile("diagnosis", verdict, join_words(diagnosis.leading) if verdict == UNDECIDED else "", level)]
    if verdict == UNEXPLAINED and best.name == "sound":
        return tiles
    if verdict == UNEXPLAINED:
        words = f"only {percent(best.fit, 1)} % of such parts lie as far away"
        return [*tiles, Tile("nearest", best.name, words)]
    tiles.append(Tile("probability", _share(best.probability), f"of {best.name}"))
    if best.size:
        tiles.append(Tile("size", best.size[0], best.parameter))
    return tiles


def diagnosis_section(diagnosis: Diagnosis) -> Section:
    """Section with the probabilities of the faults and the comparison with sound parts."""
    return Section(
        "Diagnosis",
        diagnosis_lines(diagnosis),
        _tiles(diagnosis),
        diagnosis_figures(diagnosis),
        [*diagnosis_tables(diagnosis), _fault_table(diagnosis.diagnoses)],
        "Single faults only. The probabilities rest on estimates of the faults' ranges and of the scatter of sound "
        "parts, and on this model: a model fitted to other data may name another fault.",
        [
            ("Noise of bench and model", _noise(diagnosis.noise)),
            ("Sound before the measurement", _share(diagnosis.sound)),
            *((d.name, f"range and source: {d.source}") for d in diagnosis.diagnoses if d.source),
        ],
    )


def diagnosis_html(diagnosis: Diagnosis, command: str) -> str:
    """Page of a diagnosis, with the command that repeats it."""
    return bench_html(diagnosis.record(), diagnosis.injector, "Diagnosis", [diagnosis_section(diagnosis)], command)


def _noise(noise: float | str) -> str:
    if isinstance(noise, float):
        return f"{percent(noise, 1)} % of a quantity, as stated"
    bench = BENCHES[noise]
    delivery, other, band = (percent(value, 0) for value in bench[:3])
    shares = f"delivery: {delivery} % of it and {band} % of the half band, return: {other} %"
    return f"{noise}: {shares}; {bench.mark}: {bench.source}"


DIAGNOSIS = Presenter(lambda d: note_synthetic(diagnosis_lines(d), d.data), diagnosis_tables, diagnosis_figures)


# A trim on the terminal and as a file.


def corrections_text(trim: PartTrim) -> str:
    """Table of the corrections over the map, as CSV."""
    rows = [f"{p.rail_pressure / 1e6:.10g},{p.energising_time * 1e6:.10g},{p.correction * 1e6:.3f}" for p in trim.map]
    notes = [comment_line(trim.data.synthetic)] if trim.data.synthetic else []
    return "\n".join([*notes, "rail_pressure [MPa],energising_time [us],correction [us]", *rows, ""])


def _code(trim: PartTrim) -> str:
    return f"{trim.code}, in steps of {to_fixed(trim.step, 2, MICROSECOND)} µs."


def trim_lines(trim: PartTrim) -> list[str]:
    """Sentences on a trim: the code, and the scatter that remains."""
    before = sum(p.spread**2 for p in trim.map) ** 0.5
    after = sum(p.left**2 for p in trim.map) ** 0.5
    low, high = (to_signed(1e6 * end(p.correction for p in trim.map), 1) for end in (min, max))
    return [
        f"{trim.data.name}: {_code(trim)}",
        f"Corrections at {len(trim.map)} points of the map: {low} to {high} µs. By a linear model, the trim leaves "
        f"{to_fixed(after / before, 2)} of the scatter of parts within makers' tolerances.",
    ]


def trim_tables(trim: PartTrim) -> list[Table]:
    """Table of the tests with class and correction in each."""
    table = table_from_columns(
        "Tests",
        trim.tests,
        [
            ("test", lambda t: t.name),
            ("rail, MPa", lambda t: megapascal(t.rail_pressure)),
            ("energising, µs", lambda t: to_fixed(t.energising_time, 0, MICROSECOND)),
            ("nominal, mm³", lambda t: to_fixed(t.nominal, 2, MM3)),
            ("measured, mm³", lambda t: to_fixed(t.measured, 2, MM3)),
            ("st. dev. off", lambda t: to_signed(t.distance, 1)),
            ("class", lambda t: to_signed(t.steps, 0)),
            ("correction, µs", lambda t: to_signed(1e6 * t.correction, 1)),
        ],
        inputs=OPERATING_POINT,
    )
    return [table]


def trim_section(trim: PartTrim) -> Section:
    """Code of a part and its corrections."""
    tile = Tile("trim", trim.code, f"steps of {to_fixed(trim.step, 2, MICROSECOND)} µs")
    note = "A trim is for sound parts; it does not replace a repair."
    return Section("Trim", trim_lines(trim), [tile], [], trim_tables(trim), note)


def trim_html(trim: PartTrim, command: str) -> str:
    """Page of a trim, with the command that repeats it."""
    return bench_html(trim.record(), trim.injector, "Trim", [trim_section(trim)], command)


TRIM = Presenter(lambda t: note_synthetic(trim_lines(t), t.data), trim_tables)


# Judgement of a part: test plan, diagnosis and trim.


def judgement_lines(judgement: PartJudgement) -> list[str]:
    """Verdict with the tests outside, causes with their probabilities, next test and trim."""
    diagnosis, verdict = judgement.diagnosis, judgement.verdict
    words, _, *more = plan_lines(judgement.plan)
    fails = verdict == "fail"
    words = _outside(diagnosis).strip() if fails else words
    use = "" if diagnosis.diagnoses[0].name == "sound" else " Repair first: a trim is for sound parts."
    code = f"Trim: {_code(judgement.trim)}{use}" if judgement.trim else f"No trim: {judgement.reason}"
    cause = f"{'Cause' if fails else 'Diagnosis'}: {_verdict(diagnosis)}"
    return [f"{verdict.upper()}. {words}", cause, *diagnosis_lines(diagnosis)[1:], code, *more]


def judgement_html(judgement: PartJudgement, command: str) -> str:
    """Page of a judgement, with the command that repeats it."""
    diagnosis = judgement.diagnosis
    cause, *more = _tiles(diagnosis)
    tiles = [cause._replace(head="likely cause"), *more[:1]]
    if diagnosis.next:
        item = diagnosis.next[0]
        tiles.append(Tile("next test", _place(item), "decides" if item.decides else "decides little"))
    sections = [diagnosis_section(diagnosis), *([trim_section(judgement.trim)] if judgement.trim else [])]
    tiles += [tile for section in sections[1:] for tile in section.tiles]
    words, *lines = judgement_lines(judgement)  # the page prints PASS or FAIL above
    tests = plan_section(judgement.plan)._replace(lines=[words.partition(". ")[2], *lines], tiles=tiles)
    judgement_sections = [tests, *(section._replace(lines=(), tiles=()) for section in sections)]
    injector, verdict = judgement.plan.injector, judgement.verdict
    return bench_html(judgement.record(), injector, "Judgement", judgement_sections, command, verdict)


JUDGEMENT = Presenter(
    lambda j: note_synthetic(judgement_lines(j), j.plan.score.data),
    lambda j: plan_tables(j.plan),
    lambda j: plan_figures(j.plan),
)
