"""Tables and sentences of a measuring plan, and what notebooks show of it."""

from __future__ import annotations

import numpy as np

from commonrail.base.table import Table, tabulated
from commonrail.base.text import counted, fixed, quantity, significant
from commonrail.physics.meters import known_quantity
from commonrail.plugins.next.run import Measurement, Plan
from commonrail.plugins.next.study import Criterion, place_of
from commonrail.report.presenter import Array, Arrays, Presenter, in_common_unit

_AIMS = {
    Criterion.V: "root mean square of the standard deviations of predictions",
    Criterion.D: "geometric mean of the standard errors of the parameters along the axes of their region",
    Criterion.A: "root mean square of the relative standard errors of the parameters",
}


def plan_tables(plan: Plan) -> list[Table]:
    """Measurements in order, and standard errors before and after them."""
    rows = list(enumerate(plan.measurements, 1))
    note = (
        f"Factor: {_AIMS[plan.settings.criterion]}, with this measurement and those above it, over that before; "
        f"averaged over {plan.settings.draws} draws of the parameters."
    )
    first = tabulated(
        "Next measurements",
        rows,
        [
            ("kind", lambda row: row[1].candidate.kind),
            ("p, MPa", lambda row: fixed(place_of(row[1].candidate.point)[0], 1, 1e-6)),
            ("dwell, µs", lambda row: _dwell(row[1])),
            ("ET, µs", lambda row: fixed(place_of(row[1].candidate.point)[1], 0, 1e6)),
            ("cost", lambda row: significant(row[1].candidate.cost, 3)),
            ("expected, mm³", lambda row: significant(row[1].value, 3, 1e9)),
            ("st. dev. before, mm³", lambda row: significant(row[1].deviation, 2, 1e9)),
            ("factor", lambda row: fixed(row[1].factor, 3)),
        ],
        note,
    )
    second = tabulated(
        "Standard errors at the best values",
        list(plan.before.items()),
        [
            ("parameter", lambda item: item[0]),
            ("now", lambda item: quantity(item[1], known_quantity(item[0]).unit, 3)),
            ("with the plan", lambda item: quantity(plan.after[item[0]], known_quantity(item[0]).unit, 3)),
            ("ratio", lambda item: fixed(plan.after[item[0]] / item[1], 3)),
        ],
        "What is known by bounds alone counts as a uniform distribution.",
    )
    return [first, second]


def plan_lines(plan: Plan) -> list[str]:
    """Cost, number of candidates, and what the plan takes for granted."""
    lines = [f"cost {plan.cost:g}; chosen from {plan.candidates} candidates"]
    if len(plan.measurements) < plan.settings.points:
        asked = counted(plan.settings.points, "measurement")
        lines.append(
            f"{len(plan.measurements)} of the {asked} asked for: no other candidate tells more within the budget and "
            "the distance between points; state more rail pressures or energising times, or a smaller distance."
        )
    if plan.failed:
        lines.append(f"{plan.failed} pairs of a candidate and a draw could not be simulated; they count as no news.")
    return lines + list(plan.notes)


def _dwell(one: Measurement) -> str:
    return fixed(place_of(one.candidate.point)[2], 0, 1e6) if len(one.candidate.point.pulses) > 1 else "–"


def _first_line(found: Plan) -> str:
    """Number of measurements, cost and gain."""
    gain = f"; standard deviation times {fixed(found.measurements[-1].factor, 3)}" if found.measurements else ""
    return f"{counted(len(found.measurements), 'measurement')} at cost {found.cost:g}{gain}"


def _arrays(found: Plan) -> Arrays:
    """Measurements in their order."""
    ones = found.measurements
    places = np.array([place_of(one.candidate.point) for one in ones]).reshape(-1, 3)
    axis = ("measurement",)
    values = {
        "kind": Array(axis, np.array([one.candidate.kind for one in ones])),
        "rail_pressure": in_common_unit(axis, places[:, 0], "Pa"),
        "energising_time": in_common_unit(axis, places[:, 1], "s"),
        "dwell": in_common_unit(axis, places[:, 2], "s"),
        "cost": Array(axis, np.array([one.candidate.cost for one in ones])),
        "expected": in_common_unit(axis, [one.value for one in ones], "m3"),
        "deviation": in_common_unit(axis, [one.deviation for one in ones], "m3"),
        "factor": Array(axis, np.array([one.factor for one in ones])),
    }
    return Arrays({"measurement": Array(axis, np.arange(1, len(ones) + 1))}, values, "Next measurements")


PLAN = Presenter(lambda plan: [_first_line(plan), *plan_lines(plan)], plan_tables, arrays=_arrays)
