"""Trim of a part: corrections of its energising time over the map, from a few tests.

At a test the correction is (nominal − measured quantity) over the nominal slope dQ/dt, rounded to whole steps: these
numbers are the part's code. Elsewhere it is the best linear prediction from the code (as in kriging),

    z = C_zx (C_xx + R)⁻¹ x,

with the covariances C of the corrections that drawn sound parts need, and the noise R of bench and steps. The matrix
belongs to the type, the code to the part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from typing import Annotated, Any, NamedTuple

import numpy as np

from commonrail.base.arguments import Limits, Quantity, amount, array, instance, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import InputError, SimulationError
from commonrail.base.hooks import note
from commonrail.base.record import Key, to_record
from commonrail.base.text import join_words, to_signed
from commonrail.data.records import record_head
from commonrail.engine.operating_point import Energising
from commonrail.engine.time_step import DEFAULT_STEP, check_step
from commonrail.physics.injector import Injector
from commonrail.plugins.diagnose.evidence import RESOLUTION, moments, regress_on_first
from commonrail.plugins.diagnose.faults import FaultTable, Parts
from commonrail.plugins.diagnose.run import (
    MAKER,
    PlanBench,
    bench_noise,
    nominal_factors,
    read_noise,
    read_table,
    sound_parts,
    take_measured_tests,
)
from commonrail.plugins.plans.data import PlanData
from commonrail.plugins.plans.run import InjectorFacts
from commonrail.plugins.plans.study import BENCH_PRESSURES, Measure, PlanTest, TestPlan, load_plan

STEP = 2e-6  # energising time per class [s]; chosen
STEPS = Limits(1e-8, 1e-4, (0.1e-6, 50e-6), ("us",))
ASIDE = 20e-6  # change of the energising time to both sides for the nominal slope [s], longer than ripples; chosen
LEAST_SLOPE = 1e-6  # least slope of a quantity over the energising time that can be trimmed [m³/s], 1 mm³/ms; chosen
FAR = 3.0  # standard deviations of measured sound parts beyond which a result gives a warning; chosen
DRAWS = 256  # sound parts of the regression
GRID = 5  # default number of rail pressures and of energising times of the map


class Trimming(NamedTuple):
    """Regression of the corrections over the map on the corrections at the tests; it belongs to the type.

    `gain` (points, tests) [1]; `slopes` of tests and points (tests + points,) [m³/s]; `spread` and `left` (points,):
    standard deviations of the quantities of sound parts before and after the trim [m³], by the linear model;
    `deviation` (tests,): standard deviations of measured quantities of sound parts [m³].
    """

    gain: Floats
    slopes: Floats
    spread: Floats
    left: Floats
    deviation: Floats


class TrimTest(NamedTuple):
    """Test that gives a class of the code: quantities [m³], `distance` in standard deviations, `correction` [s]."""

    name: Annotated[str, Key("test")]
    rail_pressure: float
    energising_time: float
    measured: float
    nominal: float
    distance: float
    steps: Annotated[int, Key("class")]
    correction: float


class CorrectedPoint(NamedTuple):
    """Point of the map with its correction [s]; `spread` and `left` as in `Trimming` [m³]."""

    rail_pressure: float
    energising_time: float
    correction: float
    spread: float
    left: float


@dataclass(frozen=True, repr=False)
class PartTrim(Shown):
    """Trim of a part.

    Attributes
    ----------
    injector : Injector
    data : PlanData
        Tests that give the code.
    nominal : (tests,)
        Quantities of a sound part as drawn [m³].
    classes : (tests,)
        Code of the part: corrections at the tests in steps.
    step : float
        Of the energising time [s].
    points : tuple of PlanTest
        Points of the map that can be trimmed.
    corrections : (points,)
        To be added to the energising time at the points [s].
    trimming : Trimming
    distances : (tests,)
        Distances of the measured quantities from a sound part, in standard deviations of measured sound parts.
    """

    presenter = "commonrail.plugins.diagnose.page:TRIM"

    injector: Injector
    data: PlanData
    nominal: Floats
    classes: Floats
    step: float
    points: tuple[PlanTest, ...]
    corrections: Floats
    trimming: Trimming
    distances: Floats

    @property
    def code(self) -> str:
        """Classes in the order of the tests, such as "VL −3, EM +1"."""
        return ", ".join(f"{t.name} {int(c):+d}" for t, c in zip(self.data.tests, self.classes, strict=True))

    def __post_init__(self) -> None:
        """Refuse a correction that leaves no energising time."""
        tests, added = (*self.data.tests, *self.points), (*(self.classes * self.step).tolist(), *self.corrections)
        for test, correction in zip(tests, added, strict=True):
            if correction + test.energisings[0].duration <= 0.0:
                raise InputError(
                    f"{self.data.name}: at {test.name} the correction of {to_signed(1e6 * correction, 0)} µs would "
                    "leave no energising time; check the column bench, or find the fault with `commonrail diagnose`."
                )

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI units."""
        facts: dict[str, object] = {
            "injector": InjectorFacts.of(self.injector),
            "plan": self.data.name,
            "step": self.step,
            "code": self.code,
            "tests": self.tests,
            "points": self.map,
        }
        return record_head("trim", f"Trim: {self.data.name}", self.data.synthetic) | to_record(facts)

    @cached_property
    def tests(self) -> tuple[TrimTest, ...]:
        """Tests with the classes of the part."""
        columns = (self.nominal, self.distances, self.classes, self.classes * self.step)
        rows = zip(self.data.tests, *(column.tolist() for column in columns), strict=True)
        return tuple(
            TrimTest(
                name=test.name,
                rail_pressure=test.rail_pressure,
                energising_time=test.energisings[0].duration,
                measured=test.bench or 0.0,
                nominal=nominal,
                distance=distance,
                steps=int(steps),
                correction=correction,
            )
            for test, nominal, distance, steps, correction in rows
        )

    @cached_property
    def map(self) -> tuple[CorrectedPoint, ...]:
        """Corrections at the points of the map."""
        columns = (self.corrections, self.trimming.spread, self.trimming.left)
        rows = zip(self.points, *(column.tolist() for column in columns), strict=True)
        return tuple(CorrectedPoint(p.rail_pressure, p.energisings[0].duration, *values) for p, *values in rows)


def trim(
    injector: Injector,
    results: TestPlan | str | PathLike[str],
    *,
    step: Quantity = STEP,
    rail_pressures: Sequence[float] | None = None,
    energising_times: Sequence[float] | None = None,
    faults: FaultTable | str | PathLike[str] | None = None,
    noise: float | str = MAKER,
    nominal: bool = False,
    cylinder_pressure: Quantity = BENCH_PRESSURES[0],
    return_pressure: Quantity = BENCH_PRESSURES[1],
    time_step: Quantity = DEFAULT_STEP,
    threads: int | None = None,
) -> PartTrim:
    """Derive a part's code from its deliveries at a few tests, and correct its energising time over the map.

    Parameters
    ----------
    injector : Injector
        A sound part as drawn.
    results : TestPlan or path
        Test plan with a column bench; deliveries of one energising are used.
    step : float or str
        Step of a class [s].
    rail_pressures, energising_times : sequence of float, optional
        Axes of the map [Pa], [s]; default: five values each over the range of the tests.
    faults, noise, nominal, cylinder_pressure, return_pressure, time_step, threads
        As in `diagnose`.

    Raises
    ------
    InputError, ConfigurationError
        If a file cannot be read, fewer than two deliveries have a result, a test cannot be trimmed, or an argument has
        the wrong type.
    SimulationError
        If sound parts cannot be simulated.
    """
    instance(injector, Injector, "injector")
    size, deviation = amount(step, "s", "step of a class", STEPS), read_noise(noise)
    plan = results if isinstance(results, TestPlan) else load_plan(results)
    used = tuple(t for t in plan.tests if t.measure is Measure.DELIVERY and len(t.energisings) == 1)
    if (count := sum(test.bench is not None for test in used)) < 2:
        raise InputError(
            f"{plan.name}: only {count} of the deliveries of one energising have a result in the column bench; two are "
            "needed."
        )
    data = take_measured_tests(replace(plan, tests=used), injector, (cylinder_pressure, return_pressure))
    grid = _grid(data, rail_pressures, energising_times)
    bench = PlanBench(injector, data, check_step(time_step), thread_count(threads))
    usable, drawn, trimming = regression(bench, grid, read_table(faults), deviation, size)
    sound = drawn * nominal_factors(data, drawn) if nominal else drawn
    measured = np.array([test.bench for test in data.tests], float)
    classes = np.round((sound - measured) / (sound / drawn * trimming.slopes[: len(sound)]) / size)
    corrections = trimming.gain @ (classes * size)
    distances = (measured - sound) / (sound / drawn * trimming.deviation)
    far = [f"{t.name} ({to_signed(d, 1)})" for t, d in zip(data.tests, distances.tolist(), strict=True) if abs(d) > FAR]
    if far:
        note(
            f"{data.name}: {join_words(far)} {'is' if len(far) == 1 else 'are'} more than {FAR:g} standard deviations "
            "off a sound part; check the results, or find the fault with `commonrail diagnose` before you trim."
        )
    return PartTrim(
        injector=injector,
        data=data,
        nominal=sound,
        classes=classes,
        step=size,
        points=tuple(grid[k] for k in usable),
        corrections=corrections,
        trimming=trimming,
        distances=distances,
    )


def _grid(data: PlanData, pressures: Sequence[float] | None, times: Sequence[float] | None) -> tuple[PlanTest, ...]:
    """Points of the map as tests; default: over the plan's range."""

    def axis(requested: Sequence[float] | None, plan_values: list[float], unit: str, what: str) -> list[float]:
        values = (
            np.linspace(min(plan_values), max(plan_values), GRID)
            if requested is None
            else array(requested, unit, what, 1)
        )
        return list(dict.fromkeys(np.asarray(values, float).tolist()))

    p = axis(pressures, [t.rail_pressure for t in data.tests], "Pa", "rail_pressures")
    t = axis(times, [t.energisings[0].duration for t in data.tests], "s", "energising_times")
    pairs = [(a, b) for a in p for b in t]
    return tuple(PlanTest(f"{a / 1e6:g} MPa, {b * 1e6:g} us", a, (Energising(0.0, b),), upper=1.0) for a, b in pairs)


def regression(
    bench: PlanBench, grid: Sequence[PlanTest], table: FaultTable, noise: float | str, step: float
) -> tuple[list[int], Floats, Trimming]:
    """Usable points of the grid, quantities of the drawn part at the tests (tests,) [m³], and the regression.

    `InputError` if a test cannot be trimmed: the nominal quantity is zero or does not rise with the energising time.
    """
    injector, n = bench.injector, len(bench.data.tests)
    tests = (*bench.data.tests, *grid)
    slopes, middle = _slopes(bench, tests)
    good = (slopes > LEAST_SLOPE) & (middle > RESOLUTION)
    for i in np.flatnonzero(~good[:n]).tolist():
        raise InputError(
            f"{bench.data.name}: the nominal quantity of the test {tests[i].name} hardly rises with the energising "
            "time, so it cannot be trimmed; remove the test from the table."
        )
    usable = [i for i in range(len(grid)) if good[n + i]]
    if not usable:
        raise InputError(f"No point of the map can be trimmed: {_reasons(slopes[n:], middle[n:])}.")
    if len(usable) < len(grid):
        reasons = _reasons(slopes[n:], middle[n:])
        note(f"{len(grid) - len(usable)} of {len(grid)} points of the map are omitted: {reasons}.")
    use = [*range(n), *(n + i for i in usable)]
    parts, centre = sound_parts(injector, table, DRAWS)
    grid_moments = moments(parts, centre, bench.at([tests[i] for i in use])(parts))
    if grid_moments is None:
        raise SimulationError(f"Hardly any sound part can be simulated at the tests of {bench.data.name}.")
    mean, scatter = grid_moments
    slopes, bench_deviation = slopes[use], bench_noise(bench.data.tests, noise).deviation(mean[:n])
    needed = scatter / np.outer(slopes, slopes)
    needed[:n, :n] += np.diag((bench_deviation / slopes[:n]) ** 2 + step**2 / 12.0)
    gain, left = regress_on_first(needed, n)
    spread = np.asarray(np.sqrt(np.diag(scatter)), float)
    after = np.asarray(np.sqrt(np.maximum(left, 0.0)) * slopes[n:])
    measured = np.asarray(np.hypot(spread[:n], bench_deviation))
    return usable, middle[:n], Trimming(gain, slopes, spread[n:], after, measured)


def _reasons(slopes: Floats, middle: Floats) -> str:
    """Reasons why points cannot be trimmed, with remedies, from nominal slopes and quantities (points,)."""
    failed = ~np.isfinite(slopes + middle)
    none = ~failed & (middle <= RESOLUTION)
    flat = ~failed & ~none & (slopes <= LEAST_SLOPE)
    words = {
        "a sound part cannot be simulated (take shorter energising times or other pressures)": failed,
        "a sound part does not inject (take longer energising times)": none,
        "the nominal quantity hardly rises with the energising time": flat,
    }
    return join_words([f"at {np.count_nonzero(which)} {text}" for text, which in words.items() if which.any()])


def _slopes(bench: PlanBench, tests: Sequence[PlanTest]) -> tuple[Floats, Floats]:
    """Nominal slopes dQ/dt [m³/s] and quantities [m³] of the drawn part at tests."""
    drawn, n = Parts((), np.empty((1, 0))), len(tests)
    times = [test.energisings[0].duration for test in tests]
    shifted = [
        replace(test, energisings=(Energising(0.0, max(time + aside, 0.1 * time)),))
        for aside in (-ASIDE, 0.0, ASIDE)
        for test, time in zip(tests, times, strict=True)
    ]
    low, middle, high = bench.at(shifted)(drawn)[0].reshape(3, n)
    return (high - low) / (2.0 * ASIDE), middle
