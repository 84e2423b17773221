"""Checks of what a study says: data, energising, pressures, parameters. Nothing is simulated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.choices import Drive
from commonrail.base.text import quantity
from commonrail.calibration.plausibility import finding
from commonrail.calibration.plausibility.finding import Finding, found
from commonrail.calibration.space import Space
from commonrail.calibration.stable_time_step import longest_for_all
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, widths_of
from commonrail.engine.operating_point import Course, OperatingPoint, Trace
from commonrail.engine.time_step import step_advice
from commonrail.physics.injector import Injector, parameter_quantities
from commonrail.physics.meters import known_quantity

_PRESSURES = (
    ("rail_pressure", "rail pressure", finding.RAIL),
    ("cylinder_pressure", "cylinder pressure", finding.CYLINDER),
    ("return_pressure", "return pressure", finding.RETURN),
)


_DRIVES = {Drive.CURRENT: "drive.peak_current", Drive.VOLTAGE: "drive.boost_voltage"}  # whose ranges a trace keeps


def data_findings(data: DataSet, injector: Injector) -> Iterator[Finding]:
    """Findings about one data set by itself: values, times, pressures, measured drive."""
    yield from signal_findings(data)
    if data.bounds is not None:
        yield from _sampling(data.name, data.bounds)
    yield from _drive(data, injector)
    yield from _energising(data.name, data.points)
    for key, words, usual in _PRESSURES:
        yield from _pressure(data.name, words, [getattr(point, key) for point in data.points], usual)


def injector_findings(injector: Injector) -> Iterator[Finding]:
    """Parameters outside the range that their part declares as usual."""
    for name, q in injector.quantities.items():
        value = injector.values[name]
        if q.usual is not None and not q.is_usual(value):
            yield found(
                "parameter",
                name,
                f"the {q.meaning} is {quantity(value, q.unit, 4)}, and {_range(q.usual, q.unit)} is usual; check its "
                f"unit in the file of {injector.name}.",
            )


def bounds_findings(space: Space) -> Iterator[Finding]:
    """Bounds far outside the usual range of their parameter."""
    for p in space.parameters:
        q = known_quantity(p.name)
        odd = [value for value in (p.lower, p.upper) if not q.is_usual(value, finding.BOUND_SLACK)]
        if q.usual is not None and odd:
            yield found(
                "parameter_bound",
                p.name,
                f"a bound is {quantity(odd[0], q.unit, 4)}, more than {finding.BOUND_SLACK:g} times outside the usual "
                f"{_range(q.usual, q.unit)}; check its unit in the study.",
            )


def step_findings(study: Study) -> Iterator[Finding]:
    """A time step that part of the candidates does not bear."""
    limit = longest_for_all(study.injector, study.space)
    if study.time_step > limit:
        yield found(
            "time_step",
            "time_step",
            f"the step of {quantity(study.time_step, 's')} is too long for the stiffest parameters within the bounds, "
            f'which bear {quantity(limit, "s", 3)}: such candidates fail. {step_advice(limit)} The time step "auto" '
            "chooses it.",
        )


def signal_findings(data: DataSet) -> Iterator[Finding]:
    """No signal at all, or a signal upside down: nothing that is compared with such data says anything."""
    values, what, unit = data.measured, data.what, data.unit
    first = quantity(float(values[0]), unit, 4)
    if not np.any(values):
        yield found("constant", data.name, f"all {len(values)} values of the {what} are zero; check the column.")
    elif len(values) > 1 and np.ptp(values) == 0.0:
        yield found("constant", data.name, f"all {len(values)} values of the {what} are {first}; check the column.")
    elif np.sum(values * widths_of(data)) < 0.0 or -values.min() > values.max():
        yield found(
            "sign",
            data.name,
            f"the {what} is mostly negative: from {quantity(float(values.min()), unit, 4)} to "
            f"{quantity(float(values.max()), unit, 4)}; fuel that is injected counts positive, so reverse the sign or "
            "remove the offset.",
        )


def _sampling(name: str, bounds: Floats) -> Iterator[Finding]:
    interval = float(np.median(np.diff(bounds)))
    if not finding.SAMPLING[0] <= interval <= finding.SAMPLING[1]:
        yield found(
            "sampling",
            name,
            f"its samples are {quantity(interval, 's', 4)} apart, and {_range(finding.SAMPLING, 's')} is usual; check "
            "the unit of its times.",
        )


def _drive(data: DataSet, injector: Injector) -> Iterator[Finding]:
    name = _DRIVES.get(injector.variant.drive)
    drives = [point.drive.value for point in data.points if point.drive is not None]
    if name is None or not drives:
        return
    q = parameter_quantities()[name]
    peak = float(np.max(np.abs(np.concatenate(drives))))
    if q.usual is not None and not q.is_usual(peak):
        yield found(
            "drive",
            data.name,
            f"the measured drive reaches {quantity(peak, q.unit, 4)}, and {_range(q.usual, q.unit)} is usual; check "
            "its unit.",
        )


def _energising(name: str, points: Sequence[OperatingPoint]) -> Iterator[Finding]:
    low, high = finding.ENERGISING
    odd = [pulse.duration for point in points for pulse in point.pulses if not low <= pulse.duration <= high]
    if odd:
        yield found(
            "energising",
            name,
            f"the injector is energised for {quantity(odd[0], 's', 4)}{_others(odd)}, and "
            f"{_range(finding.ENERGISING, 's')} is usual; check the unit of the energising time.",
        )


def _pressure(name: str, words: str, courses: Sequence[Course], usual: tuple[float, float]) -> Iterator[Finding]:
    levels = [float(np.mean(course.value)) if isinstance(course, Trace) else float(course) for course in courses]
    odd = [level for level in levels if not usual[0] <= level <= usual[1]]
    if odd:
        yield found(
            "pressure",
            name,
            f"the {words} is {quantity(odd[0], 'Pa', 4)}{_others(odd)}, and {_range(usual, 'Pa')} is usual; check its "
            "unit.",
        )


def _others(odd: Sequence[float]) -> str:
    return f" (and {len(odd) - 1} more such values)" if len(odd) > 1 else ""


def _range(limits_: tuple[float, float], unit: str) -> str:
    return f"{quantity(limits_[0], unit, 4)} to {quantity(limits_[1], unit, 4)}"
