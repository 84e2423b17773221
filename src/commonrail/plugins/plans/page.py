"""Test plans in reports: table of the tests, picture of the tolerance fields, sentences, page of one model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from commonrail.base.chart import MARKERS, Bars, Figure, Panel, Series
from commonrail.base.hooks import note
from commonrail.base.table import LARGE, OPERATING_POINT, SIGNS, SMALL, Cell, Part, Table, table_from_parts
from commonrail.base.text import (
    MISSING,
    count_noun,
    join_words,
    megapascal,
    number,
    pressure,
    several,
    to_fixed,
    to_signed,
)
from commonrail.data.records import JUDGED, MEASURED, MICROSECOND, MM3, Record, Texts
from commonrail.plugins.plans.study import Measure, PlanTest, State
from commonrail.report.data.view import Merit, Models, Plotted, Shown, View
from commonrail.report.figure import drawings
from commonrail.report.fit.rules import BAD, CARE, GOOD, Tile
from commonrail.report.html import render
from commonrail.report.presenter import Presenter

SIMULATED = "simulated"  # label of the one model of `commonrail plan`
LEVELS = {"pass": GOOD, "fail": BAD, "open": CARE}
WIDEST = 4.0  # half bands beyond which a marker is drawn at the edge of the picture; chosen
_NOTE = (
    f"Distances from the nominal quantity in half bands, ±1 at the limits: {SIGNS[SMALL]} inside, {SIGNS[LARGE]} "
    "outside. In their rms a test with one limit counts only its excess."
)


class PlanView(View):
    """Tables, figures and sentences of test plans."""

    def operating_point(self, data: Record) -> Record:
        """Operating point of the first test."""
        first: Record = data["rows"][0]
        return first

    def merit(self, data: Sequence[Record], label: str = JUDGED) -> Merit:
        """Number of tests inside their bands."""
        best, start = (sum(d["inside"].get(key, 0) for d in data) for key in (label, "start"))
        rms = several([d["rms"].get(label) for d in data], lambda v: to_fixed(v, 2))
        words = f"tests inside their bands (start {start}), rms {rms} half bands"
        return Merit(f"{best} of {sum(len(d['rows']) for d in data)}", words)

    def leading(self, data: Sequence[Record]) -> tuple[str, list[Mapping[str, Any]]]:
        """Root mean square distances of the tests."""
        return "the least distance from the nominal quantities", [d["rms"] for d in data]

    def tables(self, data: Sequence[Record], texts: Texts) -> list[Table]:
        """Tests of each plan."""
        return [plan_table(d, {label: texts[label] for label in texts if self.has(d, label)}) for d in data]

    def compared_tables(self, data: Sequence[Record], labels: Sequence[str]) -> list[Table]:
        """Tests of each plan."""
        return [plan_table(d, {label: label for label in labels}) for d in data]

    def figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """Tolerance fields and distances."""
        return [plan_figure(data, plotted.models)]

    compared_figures = figures


VIEW = PlanView()


def test_name(row: Record) -> str:
    """Name of a test, with the measure if it is the return."""
    return f"{row['test']} (return)" if row["measure"] == Measure.RETURN.value else str(row["test"])


def _times(row: Record) -> str:
    """Energising times in µs: 800, or "250 + 600, dwell 900"."""
    first, second = to_fixed(row["energising_time"], 0, MICROSECOND), row["second"]
    if second is None:
        return first
    dwell, last = (to_fixed(second[key], 0, MICROSECOND) for key in ("dwell", "energising_time"))
    return f"{first} + {last}, dwell {dwell}"


def _cells(value_record: Record) -> Iterator[Cell]:
    """Quantity, and its distance with the sign of its state."""
    yield Cell(to_fixed(value_record.get("value"), 2, MM3))
    size = SMALL if value_record.get("state") == State.INSIDE.value else LARGE
    yield Cell(to_signed(value_record.get("distance"), 2), size if value_record else "")


def plan_table(data: Record, texts: Texts) -> Table:
    """Table of the tests: band, quantity and distance of each label, and of the bench if it has results.

    `data`: record of a plan; `texts`: headings by label.
    """
    parts = [
        Part(("test",), lambda row: (test_name(row),)),
        Part(OPERATING_POINT, lambda row: (megapascal(row["rail_pressure"]), _times(row))),
        Part(("band",), lambda row: (row["band"],)),
        Part(
            [head for text in texts.values() for head in (text, f"distance, {text}")],
            lambda row: (cell for label in texts for cell in _cells(row["found"].get(label, {}))),
        ),
    ]
    if any(row["bench"] for row in data["rows"]):
        parts.append(Part(("bench", "distance, bench"), lambda row: _cells(row["bench"] or {})))
    return table_from_parts(
        f"Tests of {data['name']}, mm³ per stroke", data["rows"], parts, _NOTE, inputs=OPERATING_POINT
    )


def plan_figure(data: Record, models: Models) -> Figure:
    """Tolerance field of each test in half bands, with models and bench as markers."""
    rows = data["rows"]
    places = tuple(float(i) for i in range(len(rows)))
    series = [
        Series(m.text, m.look, tuple(_clip_to_picture(r["found"].get(k, {})) for r in rows), places, MARKERS, m.family)
        for k, m in models.items()
    ]
    series.append(
        Series("bench", MEASURED, tuple(_clip_to_picture(row["bench"] or {}) for row in rows), places, MARKERS)
    )
    shown = tuple(s for s in series if any(x is not None for x in s.x))
    reach = max([1.5, *(abs(x) for s in shown for x in s.x if x is not None)])
    records = [[*(row["found"].get(k, {}) for k in models), *([row["bench"]] if row["bench"] else [])] for row in rows]
    names = tuple(
        f"{test_name(row)}: {' · '.join(to_fixed(r.get('value'), 2, MM3) for r in values)}"
        for row, values in zip(rows, records, strict=True)
    )
    # a quantity with an upper limit alone begins at nothing
    start = tuple(-1.0 if r["lower"] is not None else 0.0 if r["nominal"] is None else -reach for r in rows)
    end = tuple(reach if row["upper"] is None else 1.0 for row in rows)
    return Figure(
        f"Tolerance fields of {data['name']}",
        f"Bars are what passes, zero is the nominal quantity; a marker beyond {WIDEST:.0f} half bands is at the edge. "
        f"Numbers: {join_words([s.label for s in shown])}, mm³.",
        "distance, half bands",  # short, for a telephone
        (Panel("", shown, bars=(Bars("tolerance field", "level", start, end),), rows=names),),
    )


def _clip_to_picture(value_record: Record) -> float | None:
    distance = number(value_record.get("distance"))
    return None if distance is None else max(-WIDEST, min(WIDEST, distance))


# One model on one plan: sentences, the first screen, the page.


def plan_lines(record: Record) -> list[str]:
    """Sentences on the model, the part on the bench, failed tests and returns without a stroke rate."""
    data = record["data"]
    rows = data["rows"]
    inside, rms = data["inside"][SIMULATED], to_fixed(data["rms"][SIMULATED], 2)
    simulated_rows = [(row, row["found"][SIMULATED]) for row in rows]
    lines = [
        f"{record['injector']['name']}: {inside} of {count_noun(len(rows), 'test')} of {data['name']} inside the band"
        f"{'' if rms == MISSING else f', rms {rms} half bands'}.{_outside(simulated_rows)}"
    ]
    if any(row["bench"] for row in rows):
        lines.insert(0, part_verdict(rows)[1])
    lines += [record["hint"]] if record["hint"] else []
    lines += [f"{test_name(row)} has no number: {row['reason']}" for row in rows if row["reason"]]
    without = [test_name(row) for row in rows if row["measure"] == Measure.RETURN.value and not row["stroke_rate"]]
    if without:
        lines.append(without_rate(without))
    return lines + ([record["synthetic"]] if record["synthetic"] else [])


def without_rate(names: Sequence[str]) -> str:
    """Sentence on returns without a stroke rate."""
    lack = "lacks" if len(names) == 1 else "lack"
    return f"Without a stroke rate {join_words(names)} {lack} what the guides leak until the next stroke."


def note_without_rate(name: str, tests: Sequence[PlanTest]) -> None:
    """Note returns of a plan without a stroke rate."""
    if names := [f"{t.name} (return)" for t in tests if t.measure is Measure.RETURN and t.stroke_rate is None]:
        note(f"{name}: {without_rate(names)} State stroke_rate.")


def part_verdict(rows: Sequence[Record]) -> tuple[str, str]:
    """Verdict on the part on the bench (pass, fail or open), and its sentence."""
    measured_rows = [(row, row["bench"]) for row in rows if row["bench"]]
    if outside := _outside(measured_rows):
        return "fail", f"The part fails.{outside}"
    if len(measured_rows) < len(rows):
        return (
            "open",
            f"The part is inside in {count_noun(len(measured_rows), 'test')}; "
            f"{len(rows) - len(measured_rows)} have no result.",
        )
    return "pass", f"The part passes: all {count_noun(len(rows), 'test')} inside the band."


def _outside(rows: Sequence[tuple[Record, Record]]) -> str:
    """Addition to a sentence: the tests outside, with their distances."""
    texts = [
        f"{test_name(row)} {f['state']} ({to_signed(f['distance'], 1)})"
        for row, f in rows
        if f["state"] != State.INSIDE
    ]
    return f" Outside: {', '.join(texts)}." if texts else ""


def plan_tables(record: Record) -> list[Table]:
    """Table of the tests."""
    return [plan_table(record["data"], {SIMULATED: SIMULATED})]


def _tiles(data: Record) -> list[Tile]:
    rows, inside = data["rows"], data["inside"][SIMULATED]
    tiles = [Tile("model", f"{inside} of {len(rows)}", "tests inside", GOOD if inside == len(rows) else BAD)]
    word, words = part_verdict(rows)
    return [*tiles, Tile("part", word, words, LEVELS[word])] if any(row["bench"] for row in rows) else tiles


def plan_figures(record: Record) -> list[Figure]:
    """Tolerance fields."""
    return [plan_figure(record["data"], {SIMULATED: Shown(SIMULATED, JUDGED)})]


class Section(NamedTuple):
    """Section of the page of a part: lines and tiles of the first screen, figures and tables."""

    heading: str
    lines: Sequence[str]
    tiles: Sequence[Tile]
    figures: Sequence[Figure]
    tables: Sequence[Table]
    note: str
    facts: Sequence[tuple[str, str]] = ()


def plan_section(record: Record) -> Section:
    """Section with the tests, and model and part in their bands."""
    data = record["data"]
    pressures = [pressure(data["rows"][0][key]) for key in ("cylinder_pressure", "return_pressure")]
    return Section(
        "Tests",
        plan_lines({**record, "synthetic": ""}),  # a banner of the page has it
        _tiles(data),
        plan_figures(record),
        plan_tables(record),
        "A band is an acceptance limit, not a measurement; a wide band is easily met.",
        [
            ("Cylinder and return pressure", " and ".join(pressures)),
            ("Time step", f"{to_fixed(record['time_step'], 2, MICROSECOND)} µs"),
        ],
    )


def bench_html(record: Record, kind: str, sections: Sequence[Section], command: str) -> str:
    """Page of a part on the bench: verdict of its record (if any), sections, and the command that repeats it."""
    injector, verdict = record["injector"], record.get("verdict")
    model = f"{injector['title'] or injector['name']} ({injector['variant']})"
    shown = [s._asdict() | {"drawings": drawings(s.figures, name=s.heading.lower())} for s in sections]
    return render(
        "bench.html",
        package=__package__,
        record=record,
        kind=kind,
        judged=(verdict.upper(), LEVELS[verdict]) if verdict in LEVELS else None,
        lines=[line for section in sections for line in section.lines],
        tiles=[tile for section in sections for tile in section.tiles],
        first=next(iter(shown[0]["drawings"]), None),
        sections=shown,
        synthetic=[text for text in (injector["synthetic"], record["synthetic"]) if text],
        commands=[("To repeat it", command)],
        facts=[("Model of a sound part", model), *(fact for section in sections for fact in section.facts)],
    )


def plan_html(record: Record, command: str) -> str:
    """Page of a model on a plan, and of a part if the bench measured one."""
    return bench_html(record, "Test plan", [plan_section(record)], command)


PLAN = Presenter.of_record(plan_lines, plan_tables, plan_figures)
