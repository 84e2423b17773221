"""Measuring plan in reports, terminal and notebooks: tables, sentences, figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.base.chart import MARKERS, Chart, Figure, Panel, Points, Series, points
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import MISSING, count_noun, pressure, quantity, significant, to_fixed, to_signed
from commonrail.calibration.study import Study
from commonrail.data.base import Role
from commonrail.data.records import MICROSECOND, MPA
from commonrail.engine.operating_point import OperatingPoint
from commonrail.physics.meters import known_quantity
from commonrail.plugins.next.run import Measurement, MeasurementPlan
from commonrail.plugins.next.settings import Criterion
from commonrail.plugins.next.study import locate
from commonrail.report.analysis import result_html
from commonrail.report.fit.rules import Tile
from commonrail.report.parameter_names import describe_parameters
from commonrail.report.presenter import Array, Arrays, Presenter, in_common_unit

TILES = 5  # measurements on the first screen

_AIMS = {
    Criterion.V: "root mean square of the standard deviations of predictions",
    Criterion.D: "geometric mean of the standard errors of the parameters along the axes of their region",
    Criterion.A: "root mean square of the relative standard errors of the parameters",
}


def plan_tables(plan: MeasurementPlan) -> list[Table]:
    """Measurements in order, and standard errors before and after them."""
    measurements: list[Column] = [
        ("kind", lambda m: m.candidate.kind),
        ("p, MPa", lambda m: to_fixed(m.place[0], 1, 1e-6)),
        ("dwell, µs", lambda m: to_fixed(m.place[2], 0, 1e6) if len(m.candidate.point.pulses) > 1 else MISSING),
        ("ET, µs", lambda m: to_fixed(m.place[1], 0, 1e6)),
        ("cost", lambda m: significant(m.candidate.cost, 3)),
        ("expected, mm³", lambda m: significant(m.value, 3, 1e9)),
        ("st. dev. before, mm³", lambda m: significant(m.deviation, 2, 1e9)),
        ("factor", lambda m: to_fixed(m.factor, 3)),
    ]
    errors: list[Column] = [
        ("parameter", lambda name: name),
        ("now", lambda name: quantity(plan.before[name], known_quantity(name).unit, 3)),
        ("with the plan", lambda name: quantity(plan.after[name], known_quantity(name).unit, 3)),
        ("ratio", lambda name: to_fixed(plan.after[name] / plan.before[name], 3)),
    ]
    note = (
        f"Factor: {_AIMS[plan.settings.criterion]}, with the measurements up to this row, relative to before the plan."
    )
    bounds = "A parameter that is known only by its bounds counts as uniformly distributed."
    return [
        table_from_columns("Next measurements", plan.measurements, measurements, note),
        table_from_columns("Standard errors at the best values", plan.before, errors, bounds),
    ]


_KINDS = {"quantities": "a quantity", "rate": "a rate curve", "return quantities": "a return quantity"}


def plan_headline(plan: MeasurementPlan) -> str:
    """Cost and gain of the plan, whether it is worth measuring, and the gain by other kinds of measurement."""
    texts = [f"{count_noun(len(plan.measurements), 'measurement')} at cost {plan.cost:g}"]
    for last in plan.measurements[-1:]:
        aims = "predictions" if plan.settings.criterion is Criterion.V else "the parameters"
        widest = describe_parameters(plan.before).get(plan.widest, plan.widest)
        texts.append(f"the widest interval, of {widest}, becomes {_fall(last.ratio)} narrower")
        texts.append(f"{aims} become {_fall(last.factor)} less uncertain")
        texts += [] if plan.is_worth_measuring else ["not worth measuring"]
    for measurement in plan.alternatives:
        texts.append(
            f"{_KINDS[measurement.candidate.kind]} at {_where(measurement)} "
            f"would narrow the interval by {_fall(measurement.ratio)}"
        )
    return f"{'; '.join(texts)}."


def _fall(ratio: float) -> str:
    return f"{to_fixed(1.0 - ratio, 0, 100.0)} %"


def _where(measurement: Measurement) -> str:
    rail, time, _ = measurement.place
    return f"{pressure(rail)}, {to_fixed(time, 0, MICROSECOND)} µs"


def plan_lines(plan: MeasurementPlan) -> list[str]:
    """Sentences on gain, cost and missing measurements."""
    lines = [plan_headline(plan)]
    if len(plan.measurements) < plan.settings.points:
        asked = count_noun(plan.settings.points, "measurement")
        lines.append(
            f"Only {len(plan.measurements)} of {asked}: no other candidate adds information within the budget and the "
            "distance between points; state more rail pressures or energising times, or a smaller distance."
        )
    if plan.failed:
        lines.append(f"{plan.failed} simulations of candidates failed; they are omitted.")
    return lines


def plan_notes(plan: MeasurementPlan) -> list[str]:
    """Sentences on the number of candidates and on assumptions."""
    return [f"Chosen from {plan.candidates} candidates.", *plan.notes]


def plan_html(plan: MeasurementPlan, study: Study) -> str:
    """Page of a plan for a study."""
    fitted = [point for data in study.data if data.role is Role.FIT for point in data.points]
    return result_html(
        "Plan",
        study,
        plan_lines(plan),
        plan_tiles(plan),
        plan_figures(plan, fitted),
        plan_tables(plan),
        plan_notes(plan),
    )


def plan_tiles(plan: MeasurementPlan) -> list[Tile]:
    """Tiles of the first measurements, with the gain up to each."""
    tiles = []
    for k, measurement in enumerate(plan.measurements[:TILES], 1):
        several = len(measurement.candidate.point.pulses) > 1
        dwell = f"dwell {to_fixed(measurement.place[2], 0, 1e6)} µs; " if several else ""
        words = f"{dwell}standard deviation {to_signed(100.0 * (measurement.factor - 1.0), 0)} % up to here"
        tiles.append(Tile(f"{k}. {measurement.candidate.kind}", _where(measurement), words))
    return tiles


def plan_figures(plan: MeasurementPlan, measured: Sequence[OperatingPoint] = ()) -> list[Chart]:
    """Figure of the planned among the fitted operating points (`measured`); empty for an empty plan."""

    def coordinates(places: Sequence[OperatingPoint]) -> tuple[Points, Points]:
        located = [locate(point) for point in places]
        return points(time * MICROSECOND for _, time, _ in located), points(rail * MPA for rail, _, _ in located)

    planned = [measurement.candidate.point for measurement in plan.measurements]
    series = [Series("planned", "best", *coordinates(planned), MARKERS, 1)]  # squares among discs
    series += [Series("fitted", "measured", *coordinates(measured), MARKERS)] if measured else []
    panel = Panel("rail pressure, MPa", tuple(series))
    return [Figure("Where to measure", "", "energising time, µs", (panel,))] if planned else []


def _arrays(plan: MeasurementPlan) -> Arrays:
    """Measurements in their order."""
    rows, axis = plan.measurements, ("measurement",)
    units = {"rail_pressure": "Pa", "energising_time": "s", "dwell": "s", "expected": "m3", "deviation": "m3"}
    columns = {
        "kind": [row.candidate.kind for row in rows],
        "rail_pressure": [row.place[0] for row in rows],
        "energising_time": [row.place[1] for row in rows],
        "dwell": [row.place[2] for row in rows],
        "cost": [row.candidate.cost for row in rows],
        "expected": [row.value for row in rows],
        "deviation": [row.deviation for row in rows],
        "factor": [row.factor for row in rows],
    }
    values = {
        name: in_common_unit(axis, column, units[name]) if name in units else Array(axis, np.array(column))
        for name, column in columns.items()
    }
    return Arrays({"measurement": Array(axis, np.arange(1, len(rows) + 1))}, values, "Next measurements")


PLAN = Presenter(lambda plan: [*plan_lines(plan), *plan_notes(plan)], plan_tables, plan_figures, _arrays)
