"""Reports of diagnoses, trims and judgements: verdict, probabilities, comparison with sound parts, trim code."""

from __future__ import annotations

from commonrail.base.chart import MARKERS, Bars, Figure, Panel, Series, points
from commonrail.base.csv_output import comment_line
from commonrail.base.table import LARGE, OPERATING_POINT, SMALL, Cell, Part, Table, table_from_columns, table_from_parts
from commonrail.base.text import join_words, megapascal, percent, to_fixed, to_signed
from commonrail.data.records import MEASURED, MICROSECOND, MM3, Record
from commonrail.plugins.diagnose.run import BENCHES, FAILS, UNDECIDED, UNEXPLAINED, USUAL
from commonrail.plugins.plans.page import (
    Section,
    bench_html,
    plan_figures,
    plan_lines,
    plan_section,
    plan_tables,
    test_name,
)
from commonrail.plugins.plans.study import State
from commonrail.report.fit.rules import BAD, CARE, GOOD, Tile
from commonrail.report.presenter import Presenter

LEAST = 0.005  # smallest probability of a diagnosis that a sentence names
FEWEST_BARS = 3
_FAILS = {False: FAILS, True: f"{FAILS}; inside makers’ scatter"}  # by whether sound parts scatter as far
WIDEST = 15.0  # standard deviations beyond which a marker stays at the edge; chosen


def diagnosis_lines(record: Record) -> list[str]:
    """Sentences: verdict, probabilities, and the next test."""
    lines = [f"{record['plan']}: {_verdict(record)}{_outside(record)}"]
    if record["verdict"] == UNEXPLAINED:
        return lines + ([record["synthetic"]] if record["synthetic"] else [])
    likely = [d for d in record["diagnoses"] if d["probability"] >= LEAST]
    words = ", ".join(f"{d['name']} {_share(d['probability'])}" for d in likely)
    lines.append(f"Probabilities: {words}.")
    if record["next"]:
        lines.append(_next_sentence(record["next"][0], record["nominal"]))
    return lines + ([record["synthetic"]] if record["synthetic"] else [])


def _share(value: float) -> str:
    return f"{percent(value, 1 if value < 0.1 or 0.99 < value < 0.9995 else 0)} %"


def _verdict(record: Record) -> str:
    best, verdict = record["diagnoses"][0], record["verdict"]
    if verdict == UNDECIDED:
        return f"undecided: {' or '.join(record['leading'])}."
    if verdict == UNEXPLAINED:
        nearest = "" if best["name"] == "sound" else f"; {best['name']} is nearest"
        cure = "" if record["nominal"] else " use the plan's nominal quantities (--nominal),"
        checks = f"Check plan, pressures and noise,{cure} or look for two faults at once."
        return f"no fault of the table explains these quantities{nearest}. {checks}"
    if verdict in ("sound", FAILS):
        return f"{verdict}{', inside makers’ scatter' * (verdict == FAILS)}."
    return f"{best['name']}: {best['parameter']} {best['size'][0]}; 90 %: {best['size'][1]} to {best['size'][2]}."


def _outside(record: Record) -> str:
    """Sentence on the results outside their bands, with a leading space; empty if all are inside."""
    names = [
        f"{test_name(row)} {row['state']}{f' ({_FAILS[True]})' * row['usual']}"
        for row in record["tests"]
        if row["state"] != State.INSIDE.value
    ]
    return f" Outside the band: {join_words(names)}." if names else ""


def _place(item: Record) -> str:
    """Measure, rail pressure and energising time of a next test."""
    what = "return" if item["measure"] == "return" else "delivery"
    return (
        f"{what} at {megapascal(item['rail_pressure'])} MPa and {to_fixed(item['energising_time'], 0, MICROSECOND)} µs"
    )


def _next_sentence(item: Record, nominal: bool) -> str:
    """Next test with its expected quantities; with nominal quantities, also in percent of a sound part."""
    (first, second), values = item["names"], item["expected"]
    expected = [f"{to_fixed(value, 2, MM3)} mm³" for value in values]
    if nominal and item["sound"]:
        expected = [
            f"{text} ({to_signed(100.0 * (value / item['sound'] - 1.0), 1)} % from a sound part)"
            for text, value in zip(expected, values, strict=True)
        ]
    separation = f"{to_fixed(item['separation'], 1)} standard deviations apart"
    expectation = f"{expected[0]} if {first}, {expected[1]} if {second}; {separation}"
    if item["tells"]:
        return f"Next test: {_place(item)}: {expectation}."
    return f"No single test decides; the best is {_place(item)}: {expectation}."


def _distance(row: Record, key: str) -> float:
    return float((row[key] - row["sound"]) / row["deviation"])


def _test_table(record: Record) -> Table:
    best = record["diagnoses"][0]["name"]

    def measured_cells(row: Record) -> tuple[str, Cell]:
        distance = _distance(row, "measured")
        return to_fixed(row["measured"], 2, MM3), Cell(
            to_signed(distance, 1), SMALL if abs(distance) <= USUAL else LARGE
        )

    parts = [
        Part(("test",), lambda row: (test_name(row),)),
        Part(
            OPERATING_POINT,
            lambda row: (megapascal(row["rail_pressure"]), to_fixed(row["energising_time"], 0, MICROSECOND)),
        ),
        Part(("measured", "st. dev. off"), measured_cells),
        Part(
            ("sound ± 2 st. dev.",),
            lambda row: (f"{to_fixed(row['sound'], 2, MM3)} ± {to_fixed(USUAL * row['deviation'], 2, MM3)}",),
        ),
        Part(("plan",), lambda row: (_FAILS[row["usual"]] if row["state"] != State.INSIDE.value else "passes",)),
    ]
    if best != "sound":
        parts.append(Part((f"with {best}",), lambda row: (to_fixed(row["leading"], 2, MM3),)))
    return table_from_parts("Quantities, mm³ per stroke", record["tests"], parts, inputs=OPERATING_POINT)


def diagnosis_tables(record: Record) -> list[Table]:
    """Table of the tests."""
    return [_test_table(record)]


def _fault_table(record: Record) -> Table:
    return table_from_columns(
        "Diagnoses",
        record["diagnoses"],
        [
            ("diagnosis", "name"),
            ("meaning", "meaning"),
            ("parameter, middle", lambda d: " ".join((d["parameter"], *d["size"][:1]))),
            ("probability, %", lambda d: percent(d["probability"], 1)),
            ("as far away, %", lambda d: percent(d["fit"], 1)),
        ],
        "As far away: share of parts with this fault that lie farther from their mean than these results (best size).",
        3,
    )


def probability_figure(record: Record) -> Figure:
    """Bars of the probabilities from `LEAST`, and at least the first `FEWEST_BARS`."""
    rows = [d for i, d in enumerate(record["diagnoses"]) if i < FEWEST_BARS or d["probability"] >= LEAST]
    ends = points(100.0 * d["probability"] for d in rows)
    bars = Bars("probability", "best", points(0.0 for _ in rows), ends)
    panel = Panel("", (), bars=(bars,), rows=tuple(d["name"] for d in rows), has_legend=False)
    others = len(record["diagnoses"]) - len(rows)
    before = f"Prior probability of a sound part: {_share(record['sound'])}; the faults share the rest equally."
    left = f" {others} more have less than {_share(LEAST)} each." if others else ""
    left += " Relative ranking only: no single fault fits." if record["verdict"] == UNEXPLAINED else ""
    return Figure("Probabilities", before + left, "probability, %", (panel,))


def quantity_figure(record: Record) -> Figure:
    """Measured quantities, and those of the leading fault, against the band of sound parts."""
    rows, best = record["tests"], record["diagnoses"][0]["name"]
    places = points(float(i) for i in range(len(rows)))
    shown = [("leading", best, "best")] * (best != "sound") + [("measured", "measured", MEASURED)]
    distances = {key: points(max(-WIDEST, min(WIDEST, _distance(row, key))) for row in rows) for key, *_ in shown}
    series = tuple(Series(label, look, distances[key], places, MARKERS) for key, label, look in shown)
    band = Bars("95 % of sound parts", "level", points(-USUAL for _ in rows), points(USUAL for _ in rows))
    caption = (
        f"Distance from the mean of sound parts, noise included; markers beyond {WIDEST:.0f} are drawn at the edge."
    )
    panel = Panel("", series, bars=(band,), rows=tuple(map(test_name, rows)))
    return Figure("Measured against sound parts", caption, "standard deviations", (panel,))


def diagnosis_figures(record: Record) -> list[Figure]:
    """Probabilities, and quantities in standard deviations."""
    return [probability_figure(record), quantity_figure(record)]


def _tiles(record: Record) -> list[Tile]:
    best, verdict = record["diagnoses"][0], record["verdict"]
    level = CARE if verdict in (UNDECIDED, UNEXPLAINED, FAILS) else GOOD if verdict == "sound" else BAD
    tiles = [Tile("diagnosis", verdict, join_words(record["leading"]) if verdict == UNDECIDED else "", level)]
    if verdict == UNEXPLAINED and best["name"] == "sound":
        return tiles
    if verdict == UNEXPLAINED:
        words = f"only {percent(best['fit'], 1)} % of such parts lie as far away"
        return [*tiles, Tile("nearest", best["name"], words)]
    tiles.append(Tile("probability", _share(best["probability"]), f"of {best['name']}"))
    if best["size"]:
        tiles.append(Tile("size", best["size"][0], best["parameter"]))
    return tiles


def diagnosis_section(record: Record) -> Section:
    """Section with the probabilities of the faults and the comparison with sound parts."""
    return Section(
        "Diagnosis",
        diagnosis_lines({**record, "synthetic": ""}),  # a banner of the page has it
        _tiles(record),
        diagnosis_figures(record),
        [_test_table(record), _fault_table(record)],
        "Single faults only. The probabilities rest on estimates of the faults' ranges and of the scatter of sound "
        "parts, and on this model: a model fitted to other data may name another fault.",
        [
            ("Noise of bench and model", _noise(record["noise"])),
            ("Sound before the measurement", _share(record["sound"])),
            *((d["name"], f"range and source: {d['source']}") for d in record["diagnoses"] if d["source"]),
        ],
    )


def diagnosis_html(record: Record, command: str) -> str:
    """Page of a diagnosis, with the command that repeats it."""
    return bench_html(record, "Diagnosis", [diagnosis_section(record)], command)


def _noise(noise: float | str) -> str:
    if noise not in BENCHES:
        return f"{percent(noise, 1)} % of a quantity, as stated"
    bench = BENCHES[str(noise)]
    delivery, other, band = (percent(value, 0) for value in bench[:3])
    shares = f"{delivery} % of a delivery and {band} % of its half band, {other} % of a return"
    return f"{noise}: {shares}; {bench.mark}: {bench.source}"


DIAGNOSIS = Presenter.of_record(diagnosis_lines, diagnosis_tables, diagnosis_figures)


# A trim on the terminal and as a file.


def corrections_text(record: Record) -> str:
    """Table of the corrections over the map, as CSV."""
    rows = [
        f"{point['rail_pressure'] / 1e6:.10g},{point['energising_time'] * 1e6:.10g},{point['correction'] * 1e6:.3f}"
        for point in record["points"]
    ]
    notes = [comment_line(record["synthetic"])] if record["synthetic"] else []
    return "\n".join([*notes, "rail_pressure [MPa],energising_time [us],correction [us]", *rows, ""])


def _code(record: Record) -> str:
    return f"{record['code']}, in steps of {to_fixed(record['step'], 2, MICROSECOND)} µs."


def trim_lines(record: Record) -> list[str]:
    """Sentences on a trim: the code, and the scatter that remains."""
    points = record["points"]
    before, after = (sum(p[key] ** 2 for p in points) ** 0.5 for key in ("spread", "left"))
    ends = [f(p["correction"] for p in points) for f in (min, max)]
    low, high = (to_signed(1e6 * value, 1) for value in ends)
    return [
        f"{record['plan']}: {_code(record)}",
        f"Corrections at {len(points)} points of the map: {low} to {high} µs. By a linear model, the trim leaves "
        f"{to_fixed(after / before, 2)} of the scatter of parts within makers' tolerances.",
        *([record["synthetic"]] if record["synthetic"] else []),
    ]


def trim_table(record: Record) -> Table:
    """Tests with the classes of the part."""
    return table_from_columns(
        "Tests",
        record["tests"],
        [
            ("test", "test"),
            ("rail, MPa", lambda t: megapascal(t["rail_pressure"])),
            ("energising, µs", lambda t: to_fixed(t["energising_time"], 0, MICROSECOND)),
            ("nominal, mm³", lambda t: to_fixed(t["nominal"], 2, MM3)),
            ("measured, mm³", lambda t: to_fixed(t["measured"], 2, MM3)),
            ("st. dev. off", lambda t: to_signed(t["distance"], 1)),
            ("class", lambda t: to_signed(t["class"], 0)),
            ("correction, µs", lambda t: to_signed(1e6 * t["correction"], 1)),
        ],
        inputs=OPERATING_POINT,
    )


def trim_section(record: Record) -> Section:
    """Code of a part and its corrections."""
    tile = Tile("trim", record["code"], f"steps of {to_fixed(record['step'], 2, MICROSECOND)} µs")
    note = "A trim is for sound parts; it does not replace a repair."
    return Section("Trim", trim_lines({**record, "synthetic": ""}), [tile], [], [trim_table(record)], note)


def trim_html(record: Record, command: str) -> str:
    """Page of a trim, with the command that repeats it."""
    return bench_html(record, "Trim", [trim_section(record)], command)


TRIM = Presenter.of_record(trim_lines, lambda record: [trim_table(record)], lambda _: [])


# A part judged: all three.


def judgement_lines(record: Record) -> list[str]:
    """Verdict with the tests outside, causes with their probabilities, next test and trim."""
    diagnosis, trimmed = record["diagnosis"], record["trim"]
    words, _, *more = plan_lines({**record["plan"], "synthetic": ""})
    words = _outside(diagnosis).strip() if record["verdict"] == "fail" else words
    use = "" if diagnosis["diagnoses"][0]["name"] == "sound" else " Repair first: a trim is for sound parts."
    code = f"Trim: {_code(trimmed)}{use}" if trimmed else f"No trim: {record['reason']}"
    cause = f"{'Cause' if record['verdict'] == 'fail' else 'Diagnosis'}: {_verdict(diagnosis)}"
    causes = diagnosis_lines({**diagnosis, "synthetic": ""})[1:]
    verdict = f"{record['verdict'].upper()}. {words}"
    return [verdict, cause, *causes, code, *more, *filter(None, [record["synthetic"]])]


def judgement_html(record: Record, command: str) -> str:
    """Page of a judgement, with the command that repeats it."""
    diagnosis, trimmed = record["diagnosis"], record["trim"]
    cause, *more = _tiles(diagnosis)
    tiles = [cause._replace(head="likely cause"), *more[:1]]
    if diagnosis["next"]:
        item = diagnosis["next"][0]
        tiles.append(Tile("next test", _place(item), "decides" if item["tells"] else "decides little"))
    words, *lines = judgement_lines({**record, "synthetic": ""})  # the page prints PASS or FAIL above
    tests = plan_section(record["plan"])._replace(lines=[words.partition(". ")[2], *lines])
    sections = [diagnosis_section(diagnosis), *([trim_section(trimmed)] if trimmed else [])]
    tests = tests._replace(tiles=[*tiles, *(tile for section in sections[1:] for tile in section.tiles)])
    judgement_sections = [tests, *(section._replace(lines=(), tiles=()) for section in sections)]
    return bench_html(record, "Judgement", judgement_sections, command)


JUDGEMENT = Presenter.of_record(
    judgement_lines, lambda record: plan_tables(record["plan"]), lambda record: plan_figures(record["plan"])
)
