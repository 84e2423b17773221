"""Diagnoses, trims and judgements in reports: verdict, probabilities, quantities beside sound parts, code."""

from __future__ import annotations

from commonrail.base.chart import MARKERS, Bars, Figure, Panel, Series, points
from commonrail.base.csv_output import comment_line
from commonrail.base.table import LARGE, OPERATING_POINT, SMALL, Cell, Part, Table, table_from_columns, table_from_parts
from commonrail.base.text import join_words, megapascal, percent, to_fixed, to_signed
from commonrail.data.records import MEASURED, MICROSECOND, MM3, Record
from commonrail.plugins.diagnose.run import BENCHES, FAILS, USUAL
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

LEAST = 0.005  # probability from which a diagnosis is named in a sentence
FEWEST_BARS = 3
_FAILS = {False: FAILS, True: f"{FAILS}; inside makers’ scatter"}  # of a result, and of one as sound parts have
WIDEST = 15.0  # standard deviations beyond which a marker stays at the edge; chosen


def diagnosis_lines(record: Record) -> list[str]:
    """Sentences: verdict, probabilities, and the next test."""
    lines = [f"{record['plan']}: {_verdict(record)}{_outside(record)}"]
    if record["verdict"] == "unexplained":
        return lines + ([record["synthetic"]] if record["synthetic"] else [])
    likely = [d for d in record["diagnoses"] if d["probability"] >= LEAST]
    rest = sum(d["probability"] for d in record["diagnoses"] if d not in likely)
    words = ", ".join(f"{d['name']} {_share(d['probability'])}" for d in likely)
    lines.append(f"Probabilities: {words}; all others together {_share(rest)}.")
    if record["next"]:
        lines.append(_next_sentence(record["next"][0], record["nominal"]))
    return lines + ([record["synthetic"]] if record["synthetic"] else [])


def _share(value: float) -> str:
    return f"{percent(value, 1 if value < 0.1 or 0.99 < value < 0.9995 else 0)} %"


def _verdict(record: Record) -> str:
    best, verdict = record["diagnoses"][0], record["verdict"]
    if verdict == "cannot be told":
        return f"cannot be told: {' or '.join(record['leading'])}."
    if verdict == "unexplained":
        nearest = "" if best["name"] == "sound" else f"; {best['name']} is nearest"
        cure = "" if record["nominal"] else " take nominal quantities of the plan (--nominal),"
        checks = f"Check plan, pressures and noise,{cure} or look for two faults at once."
        return f"nothing in the table of faults explains these quantities{nearest}. {checks}"
    if verdict in ("sound", FAILS):
        return f"{verdict}{', inside makers’ scatter' * (verdict == FAILS)}."
    return f"{best['name']}: {best['parameter']} {best['size'][0]}; 90 %: {best['size'][1]} to {best['size'][2]}."


def _outside(record: Record) -> str:
    """Sentence, with a space before it, on the results outside their bands; empty without one."""
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
    """The test and what is expected; beside nominal quantities those of the model are no more than relative."""
    (first, second), (first_value, other) = item["names"], item["expected"]
    at = _place(item)
    expected = f"{to_fixed(first_value, 2, MM3)} mm³ if {first}, {to_fixed(other, 2, MM3)} mm³ if {second}"
    if nominal and item["sound"]:
        away = (f"{to_signed(100.0 * (value / item['sound'] - 1.0), 1)} %" for value in (first_value, other))
        expected = f"{expected} by the model alone ({' and '.join(away)} from a sound part)"
    separation = f"{to_fixed(item['separation'], 1)} standard deviations apart"
    if item["tells"]:
        return f"Next test: {at}; expected {expected}, {separation}."
    return f"No single test tells {first} and {second} apart; the best is {at}: {expected}, {separation}."


def _distance(row: Record, key: str) -> float:
    return float((row[key] - row["sound"]) / row["deviation"])


def _test_table(record: Record) -> Table:
    best = record["diagnoses"][0]["name"]

    def measured(row: Record) -> tuple[str, Cell]:
        far = _distance(row, "measured")
        return to_fixed(row["measured"], 2, MM3), Cell(to_signed(far, 1), SMALL if abs(far) <= USUAL else LARGE)

    parts = [
        Part(("test",), lambda row: (test_name(row),)),
        Part(
            OPERATING_POINT,
            lambda row: (megapascal(row["rail_pressure"]), to_fixed(row["energising_time"], 0, MICROSECOND)),
        ),
        Part(("measured", "st. dev. off"), measured),
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
        "As far away: share of such parts that lie farther from their mean than these quantities, at the best size.",
        3,
    )


def probability_figure(record: Record) -> Figure:
    """Bars of the probabilities that are not negligible, and of the next ones up to `FEWEST_BARS`."""
    rows = [d for i, d in enumerate(record["diagnoses"]) if i < FEWEST_BARS or d["probability"] >= LEAST]
    ends = points(100.0 * d["probability"] for d in rows)
    bars = Bars("probability", "best", points(0.0 for _ in rows), ends)
    panel = Panel("", (), bars=(bars,), rows=tuple(d["name"] for d in rows), has_legend=False)
    others = len(record["diagnoses"]) - len(rows)
    before = f"Before the measurement sound had {_share(record['sound'])}, the faults the rest in equal parts."
    left = f" {others} more have less than {_share(LEAST)} each." if others else ""
    left += " Nothing fits: they are not to be believed." if record["verdict"] == "unexplained" else ""
    return Figure("Probabilities", before + left, "probability, %", (panel,))


def quantity_figure(record: Record) -> Figure:
    """Measured quantities and those of the leading fault beside the band of sound parts."""
    rows, best = record["tests"], record["diagnoses"][0]["name"]
    places = points(float(i) for i in range(len(rows)))
    shown = [("leading", best, "best")] * (best != "sound") + [("measured", "measured", MEASURED)]
    distances = {key: points(max(-WIDEST, min(WIDEST, _distance(row, key))) for row in rows) for key, *_ in shown}
    series = tuple(Series(label, look, distances[key], places, MARKERS) for key, label, look in shown)
    band = Bars("95 % of sound parts", "level", points(-USUAL for _ in rows), points(USUAL for _ in rows))
    caption = f"Distances from the mean of sound parts, with noise; a marker beyond {WIDEST:.0f} is at the edge."
    panel = Panel("", series, bars=(band,), rows=tuple(map(test_name, rows)))
    return Figure("Measured beside sound parts", caption, "standard deviations", (panel,))


def diagnosis_figures(record: Record) -> list[Figure]:
    """Probabilities, and quantities in standard deviations."""
    return [probability_figure(record), quantity_figure(record)]


def _tiles(record: Record) -> list[Tile]:
    best, verdict = record["diagnoses"][0], record["verdict"]
    level = CARE if verdict in ("cannot be told", "unexplained", FAILS) else GOOD if verdict == "sound" else BAD
    tiles = [Tile("diagnosis", verdict, join_words(record["leading"]) if verdict == "cannot be told" else "", level)]
    if verdict != "unexplained":
        tiles.append(Tile("probability", _share(best["probability"]), f"of {best['name']}"))
    if best["size"]:
        tiles.append(Tile("size", best["size"][0], best["parameter"]))
    return tiles


def diagnosis_section(record: Record) -> Section:
    """Probabilities of the faults, and quantities beside those of sound parts."""
    return Section(
        "Diagnosis",
        diagnosis_lines({**record, "synthetic": ""}),  # a banner of the page has it
        _tiles(record),
        diagnosis_figures(record),
        [_test_table(record), _fault_table(record)],
        "One fault at a time is judged. Ranges of faults and scatter of sound parts are estimates; the probabilities "
        "hold as far as these estimates do, and for this model: one fitted to other data may name another fault.",
        [
            ("Noise of bench and model", _noise(record["noise"])),
            ("Sound before the measurement", _share(record["sound"])),
            *((d["name"], f"range and source: {d['source']}") for d in record["diagnoses"] if d["source"]),
        ],
    )


def diagnosis_html(record: Record, command: str) -> str:
    """Page of a diagnosis, with the command that makes it again."""
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
    """Sentences on a trim: the code, and what it leaves of the scatter."""
    points = record["points"]
    before, after = (sum(p[key] ** 2 for p in points) ** 0.5 for key in ("spread", "left"))
    ends = [f(p["correction"] for p in points) for f in (min, max)]
    low, high = (to_signed(1e6 * value, 1) for value in ends)
    return [
        f"{record['plan']}: {_code(record)}",
        f"Corrections at {len(points)} points of the map: {low} to {high} µs. A linear model estimates that parts "
        f"within makers' tolerances then scatter by {to_fixed(after / before, 2)} of what they do without a trim.",
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
    note = "A trim is for sound parts and no repair."
    return Section("Trim", trim_lines({**record, "synthetic": ""}), [tile], [], [trim_table(record)], note)


def trim_html(record: Record, command: str) -> str:
    """Page of a trim, with the command that makes it again."""
    return bench_html(record, "Trim", [trim_section(record)], command)


TRIM = Presenter.of_record(trim_lines, lambda record: [trim_table(record)], lambda _: [])


# A part judged: all three.


def judgement_lines(record: Record) -> list[str]:
    """Verdict, tests outside, causes with their probabilities, next test and trim."""
    diagnosis, trimmed = record["diagnosis"], record["trim"]
    _, words, *more = plan_lines({**record["plan"], "synthetic": ""})
    words = f"The part fails.{_outside(diagnosis)}" if record["verdict"] == "fail" else words
    use = "" if diagnosis["diagnoses"][0]["name"] == "sound" else " A trim is for sound parts: repair comes first."
    code = f"Trim: {_code(trimmed)}{use}" if trimmed else f"No trim: {record['reason']}"
    cause = f"{'Cause' if record['verdict'] == 'fail' else 'Diagnosis'}: {_verdict(diagnosis)}"
    causes = diagnosis_lines({**diagnosis, "synthetic": ""})[1:]
    return [record["verdict"].upper(), words, cause, *causes, code, *more, *filter(None, [record["synthetic"]])]


def judgement_html(record: Record, command: str) -> str:
    """Page of a judgement, with the command that makes it again."""
    diagnosis, trimmed = record["diagnosis"], record["trim"]
    cause, *more = _tiles(diagnosis)
    tiles = [cause._replace(head="likely cause"), *more[: diagnosis["verdict"] != "unexplained"]]
    if diagnosis["next"]:
        item = diagnosis["next"][0]
        tiles.append(Tile("next test", _place(item), "tells most" if item["tells"] else "tells little"))
    tests = plan_section(record["plan"])._replace(lines=judgement_lines({**record, "synthetic": ""})[1:])
    sections = [diagnosis_section(diagnosis), *([trim_section(trimmed)] if trimmed else [])]
    tests = tests._replace(tiles=[*tiles, *(tile for section in sections[1:] for tile in section.tiles)])
    judgement_sections = [tests, *(section._replace(lines=(), tiles=()) for section in sections)]
    return bench_html(record, "Judgement", judgement_sections, command)


JUDGEMENT = Presenter.of_record(
    judgement_lines, lambda record: plan_tables(record["plan"]), lambda record: plan_figures(record["plan"])
)
