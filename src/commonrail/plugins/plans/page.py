"""Test plans in reports: table of the tests, picture of the tolerance fields, sentences, page of one model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from commonrail.base.chart import MARKERS, Bars, Figure, Panel, Series
from commonrail.base.record import from_record
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
from commonrail.physics.injector import Injector
from commonrail.plugins.plans.data import PlanData
from commonrail.plugins.plans.record import JudgedQuantity, PlanRecord, PlanRow
from commonrail.plugins.plans.run import SIMULATED, PlanResult
from commonrail.plugins.plans.study import Measure, State, test_name, without_rate
from commonrail.report.data.view import Merit, Models, Plotted, Shown, View
from commonrail.report.figure import drawings
from commonrail.report.fit.rules import BAD, CARE, GOOD, Tile
from commonrail.report.html import render
from commonrail.report.presenter import Presenter

LEVELS = {"pass": GOOD, "fail": BAD, "open": CARE}
WIDEST = 4.0  # half bands beyond which a marker is drawn at the edge of the picture; chosen
_NOTE = (
    f"Distances from the nominal quantity in half bands, ±1 at the limits: {SIGNS[SMALL]} inside, {SIGNS[LARGE]} "
    "outside. In the rms, a test with one limit counts only its excess."
)


class PlanView(View):
    """Tables, figures and sentences of test plans."""

    def operating_point(self, data: Record) -> Record:
        """Operating point of the first test."""
        first: Record = data["rows"][0]
        return first

    def merit(self, data: Sequence[Record], label: str = JUDGED) -> Merit:
        """Number of tests inside their bands."""
        plans = [from_record(PlanRecord, d) for d in data]
        best, start = (sum(plan.inside.get(key, 0) for plan in plans) for key in (label, "start"))
        rms = several([plan.rms.get(label) for plan in plans], lambda v: to_fixed(v, 2))
        words = f"tests inside their bands (start {start}), rms {rms} half bands"
        return Merit(f"{best} of {sum(len(plan.rows) for plan in plans)}", words)

    def leading(self, data: Sequence[Record]) -> tuple[str, list[Mapping[str, Any]]]:
        """Root mean square distances of the tests."""
        return "the least distance from the nominal quantities", [d["rms"] for d in data]

    def tables(self, data: Sequence[Record], texts: Texts) -> list[Table]:
        """Tests of each plan."""
        return [
            plan_table(from_record(PlanRecord, d), {label: texts[label] for label in texts if self.has(d, label)})
            for d in data
        ]

    def compared_tables(self, data: Sequence[Record], labels: Sequence[str]) -> list[Table]:
        """Tests of each plan."""
        return [plan_table(from_record(PlanRecord, d), {label: label for label in labels}) for d in data]

    def figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """Tolerance fields and distances."""
        return [plan_figure(from_record(PlanRecord, data), plotted.models)]

    compared_figures = figures


VIEW = PlanView()


def _times(row: PlanRow) -> str:
    """Energising times in µs: 800, or "250 + 600, dwell 900"."""
    first = to_fixed(row.energising_time, 0, MICROSECOND)
    if row.second is None:
        return first
    dwell, last = (to_fixed(time, 0, MICROSECOND) for time in row.second)
    return f"{first} + {last}, dwell {dwell}"


def _cells(quantity: JudgedQuantity | None) -> tuple[Cell, Cell]:
    """Quantity, and its distance with the sign of its state."""
    if quantity is None:
        return Cell(MISSING), Cell(MISSING)
    size = SMALL if quantity.state is State.INSIDE else LARGE
    return Cell(to_fixed(quantity.value, 2, MM3)), Cell(to_signed(quantity.distance, 2), size)


def plan_table(plan: PlanRecord, texts: Texts) -> Table:
    """Table of the tests: band, quantity and distance of each label, and of the bench if it has results.

    `texts`: headings by label.
    """
    parts = [
        Part(("test",), lambda row: (test_name(row),)),
        Part(OPERATING_POINT, lambda row: (megapascal(row.rail_pressure), _times(row))),
        Part(("band",), lambda row: (row.band,)),
        Part(
            [head for text in texts.values() for head in (text, f"distance, {text}")],
            lambda row: (cell for label in texts for cell in _cells(row.models.get(label))),
        ),
    ]
    if plan.verdict:
        parts.append(Part(("bench", "distance, bench"), lambda row: _cells(row.bench)))
    return table_from_parts(f"Tests of {plan.name}, mm³ per stroke", plan.rows, parts, _NOTE, inputs=OPERATING_POINT)


def plan_figure(plan: PlanRecord, models: Models) -> Figure:
    """Tolerance field of each test in half bands, with models and bench as markers."""
    rows = plan.rows
    places = tuple(float(i) for i in range(len(rows)))
    series = [
        Series(m.text, m.look, tuple(_clip_to_picture(r.models.get(k)) for r in rows), places, MARKERS, m.family)
        for k, m in models.items()
    ]
    series.append(Series("bench", MEASURED, tuple(_clip_to_picture(row.bench) for row in rows), places, MARKERS))
    shown = tuple(s for s in series if any(x is not None for x in s.x))
    reach = max([1.5, *(abs(x) for s in shown for x in s.x if x is not None)])
    names = []
    for row in rows:
        values = [row.models[k].value if k in row.models else None for k in models]
        values += [] if row.bench is None else [row.bench.value]
        names.append(f"{test_name(row)}: {' · '.join(to_fixed(value, 2, MM3) for value in values)}")
    # without a lower limit the bar begins at a quantity of zero
    start = tuple(-1.0 if row.lower is not None else 0.0 if row.nominal is None else -reach for row in rows)
    end = tuple(reach if row.upper is None else 1.0 for row in rows)
    return Figure(
        f"Tolerance fields of {plan.name}",
        f"Bars are what passes, zero is the nominal quantity; a marker beyond {WIDEST:.0f} half bands is at the edge. "
        f"Numbers: {join_words([s.label for s in shown])}, mm³.",
        "distance, half bands",  # short, for a telephone
        (Panel("", shown, bars=(Bars("tolerance field", "level", start, end),), rows=tuple(names)),),
    )


def _clip_to_picture(quantity: JudgedQuantity | None) -> float | None:
    distance = None if quantity is None else number(quantity.distance)
    return None if distance is None else max(-WIDEST, min(WIDEST, distance))


# One model on one plan: sentences, the first screen, the page.


def plan_lines(result: PlanResult) -> list[str]:
    """Sentences on the model, the part on the bench, failed tests and returns without a stroke rate."""
    plan = result.judged
    rms = to_fixed(plan.rms[SIMULATED], 2)
    lines = [
        f"{result.injector.name}: {plan.inside[SIMULATED]} of {count_noun(len(plan.rows), 'test')} of {plan.name} "
        f"inside the band{'' if rms == MISSING else f', rms {rms} half bands'}."
        f"{_outside([(row, row.models[SIMULATED]) for row in plan.rows])}"
    ]
    if plan.verdict:
        lines.insert(0, _part_sentence(plan))
    lines += [result.hint] if result.hint else []
    lines += [f"{test_name(row)} has no number: {row.reason}" for row in plan.rows if row.reason]
    without = [test_name(row) for row in plan.rows if row.measure is Measure.RETURN and not row.stroke_rate]
    return lines + ([without_rate(without)] if without else [])


def _part_sentence(plan: PlanRecord) -> str:
    """Sentence on the verdict on the part on the bench; empty without a result."""
    measured = [(row, row.bench) for row in plan.rows if row.bench is not None]
    sentences = {
        "fail": f"The part fails.{_outside(measured)}",
        "open": f"The part is inside in {count_noun(len(measured), 'test')}; {len(plan.rows) - len(measured)} have no "
        "result.",
        "pass": f"The part passes: all {count_noun(len(plan.rows), 'test')} inside the band.",
    }
    return sentences[plan.verdict] if plan.verdict else ""


def _outside(rows: Sequence[tuple[PlanRow, JudgedQuantity]]) -> str:
    """Addition to a sentence: the tests outside, with their distances."""
    texts = [
        f"{test_name(row)} {quantity.state} ({to_signed(quantity.distance, 1)})"
        for row, quantity in rows
        if quantity.state is not State.INSIDE
    ]
    return f" Outside: {', '.join(texts)}." if texts else ""


def plan_tables(result: PlanResult) -> list[Table]:
    """Table of the tests."""
    return [plan_table(result.judged, {SIMULATED: SIMULATED})]


def _tiles(plan: PlanRecord) -> list[Tile]:
    inside, count = plan.inside[SIMULATED], len(plan.rows)
    tiles = [Tile("model", f"{inside} of {count}", "tests inside", GOOD if inside == count else BAD)]
    return tiles + ([Tile("part", plan.verdict, _part_sentence(plan), LEVELS[plan.verdict])] if plan.verdict else [])


def plan_figures(result: PlanResult) -> list[Figure]:
    """Tolerance fields."""
    return [plan_figure(result.judged, {SIMULATED: Shown(SIMULATED, JUDGED)})]


class Section(NamedTuple):
    """Section of the page of a part: lines and tiles of the first screen, figures and tables."""

    heading: str
    lines: Sequence[str]
    tiles: Sequence[Tile]
    figures: Sequence[Figure]
    tables: Sequence[Table]
    note: str
    facts: Sequence[tuple[str, str]] = ()


def plan_section(result: PlanResult) -> Section:
    """Section with the tests, and model and part in their bands."""
    first = result.judged.rows[0]
    return Section(
        "Tests",
        plan_lines(result),
        _tiles(result.judged),
        plan_figures(result),
        plan_tables(result),
        "A band is an acceptance limit, not a measurement; a wide band is easily met.",
        [
            (
                "Cylinder and return pressure",
                f"{pressure(first.cylinder_pressure)} and {pressure(first.return_pressure)}",
            ),
            ("Time step", f"{to_fixed(result.time_step, 2, MICROSECOND)} µs"),
        ],
    )


def bench_html(
    record: Record, injector: Injector, kind: str, sections: Sequence[Section], command: str, verdict: str | None = None
) -> str:
    """Page of a part on the bench: record, injector, verdict if any, sections, and the command that repeats it."""
    shown = [s._asdict() | {"drawings": drawings(s.figures, name=s.heading.lower())} for s in sections]
    return render(
        "bench.html",
        package=__package__,
        record=record,
        kind=kind,
        judged=(verdict.upper(), LEVELS[verdict]) if verdict else None,
        lines=[line for section in sections for line in section.lines],
        tiles=[tile for section in sections for tile in section.tiles],
        first=next(iter(shown[0]["drawings"]), None),
        sections=shown,
        synthetic=[text for text in (injector.synthetic, record["synthetic"]) if text],
        commands=[("To repeat it", command)],
        facts=[
            ("Model of a sound part", f"{injector.title or injector.name} ({injector.variant.label})"),
            *(fact for section in sections for fact in section.facts),
        ],
    )


def plan_html(result: PlanResult, command: str) -> str:
    """Page of a model on a plan, and of a part if the bench measured one."""
    sections = [plan_section(result)]
    return bench_html(result.record(), result.injector, "Test plan", sections, command, result.judged.verdict)


def note_synthetic(lines: Sequence[str], data: PlanData) -> list[str]:
    """Lines for the terminal, which has no banner, with the synthetic mark of the plan if there is one."""
    return [*lines, *filter(None, [data.synthetic])]


PLAN = Presenter(lambda r: note_synthetic(plan_lines(r), r.score.data), plan_tables, plan_figures)
