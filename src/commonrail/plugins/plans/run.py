"""Simulate an injector at the tests of a plan and judge each quantity by its band."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import Quantity, instance, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import CommonrailError, SimulationError
from commonrail.base.record import to_record
from commonrail.data.records import record_head
from commonrail.data.simulator import Simulator
from commonrail.engine.status import Status
from commonrail.engine.time_step import DEFAULT_STEP, check_step
from commonrail.physics.injector import Injector
from commonrail.plugins.plans.data import PlanData, PlanScore
from commonrail.plugins.plans.record import PlanRecord
from commonrail.plugins.plans.study import BENCH_PRESSURES, Measure, PlanTest, State, TestPlan, load_plan

SIMULATED = "simulated"  # label of the one model of `commonrail plan`


class InjectorFacts(NamedTuple):
    """Injector of a record."""

    name: str
    title: str
    synthetic: str
    variant: str

    @classmethod
    def of(cls, injector: Injector) -> InjectorFacts:
        """Facts of an injector."""
        return cls(injector.name, injector.title, injector.synthetic, injector.variant.label)


@dataclass(frozen=True, repr=False)
class PlanResult(Shown):
    """Simulated quantities of a plan's tests, with their places in the bands.

    Attributes
    ----------
    injector : Injector
    score : PlanScore
        Its `data` has the tests, its `values` the quantities per stroke (n,) [m³], NaN where one failed, and its
        `states` their places in the bands.
    reasons : tuple of str, length n
        Reason why a test has no number; empty if it has one.
    time_step : float
        [s].
    hint : str
        Sentence on a wrong unit that would explain the deliveries; empty if no wrong unit does.
    """

    presenter = "commonrail.plugins.plans.page:PLAN"

    injector: Injector
    score: PlanScore
    reasons: tuple[str, ...]
    time_step: float
    hint: str = ""

    @property
    def distances(self) -> Floats:
        """Distances from the nominal quantities (n,) in half bands."""
        return self.score.data.bands.distance(self.score.values)

    @cached_property
    def judged(self) -> PlanRecord:
        """Tests with the simulated quantities, under the label `SIMULATED`, and those of the bench."""
        return self.score.data.judge({SIMULATED: self.score}, self.reasons)

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI units."""
        data = self.score.data.record({SIMULATED: self.score}, self.reasons)
        facts: dict[str, object] = {
            "injector": InjectorFacts.of(self.injector),
            "time_step": self.time_step,
            "hint": self.hint,
            "verdict": self.judged.verdict,
        }
        head = record_head("plan", f"Test plan: {self.injector.name}", self.score.data.synthetic)
        return head | to_record(facts) | {"data": data}


# Factors that a wrong unit causes: 1000 (g for mg), with or without the density of diesel fuel, 0.83 g/cm³ (mass for
# volume).
_WRONG_UNITS = tuple(power * density for power in (1e3, 1e-3) for density in (1.0, 0.83, 1.0 / 0.83))


def _unit_hint(plan: TestPlan, score: PlanScore, pressures: tuple[Quantity, Quantity], simulator: Simulator) -> str:
    """Hint at a wrong unit if no delivery is inside and another unit would bring most inside; else empty."""
    at = [i for i, test in enumerate(plan.tests) if test.measure is Measure.DELIVERY]
    tests, values = [score.data.tests[i] for i in at], score.values[at]

    def inside(quantities: Floats, tests: Sequence[PlanTest]) -> int:
        return sum(test.state(value) is State.INSIDE for test, value in zip(tests, quantities.tolist(), strict=True))

    if len(at) < 2 or inside(values, tests):
        return ""
    for factor in _WRONG_UNITS:
        if 2 * inside(values * factor, tests) > len(at):
            return f"The simulated deliveries times {factor:.4g} would be inside: check the unit of the quantities."
    for factor, words in ((10.0, "ten times the"), (0.1, "a tenth of the")):
        with suppress(CommonrailError):  # pressures outside the range of the model
            moved = tuple(replace(plan.tests[i], rail_pressure=factor * plan.tests[i].rail_pressure) for i in at)
            data = PlanData.of(replace(plan, tests=moved), simulator.injector, pressures, plan.name)
            if 2 * inside(data.score(simulator).values, data.tests) > len(at):
                return f"At {words} rail pressures most deliveries would be inside: check their unit, bar or MPa."
    return ""


def plan(
    injector: Injector,
    plan: TestPlan | str | PathLike[str],
    *,
    stroke_rate: Quantity | None = None,
    cylinder_pressure: Quantity = BENCH_PRESSURES[0],
    return_pressure: Quantity = BENCH_PRESSURES[1],
    time_step: Quantity = DEFAULT_STEP,
    threads: int | None = None,
) -> PlanResult:
    """Simulate an injector at the tests of a plan, and judge each quantity by its band.

    Parameters
    ----------
    injector : Injector
    plan : TestPlan or path
        A path is read by `load_plan`.
    stroke_rate : float or str, optional
        Strokes [1/s], or text such as ``"1000 1/min"``, for tests that do not state it: between two strokes the guides
        leak into the return at rail pressure.
    cylinder_pressure, return_pressure : float or str
        [Pa], or texts with units; default: an injector bench, 0.5 and 0.1 MPa.
    time_step : float or str
        [s], or text.
    threads : int, optional
        All usable processors by default; the result does not depend on it.

    Raises
    ------
    InputError, ConfigurationError
        If the plan cannot be read, or does not suit the injector.
    SimulationError
        If no test can be simulated.
    """
    instance(injector, Injector, "injector")
    step = check_step(time_step)
    plan = load_plan(plan) if isinstance(plan, str | PathLike) else instance(plan, TestPlan, "plan")
    plan, pressures = plan.at_stroke_rate(stroke_rate), (cylinder_pressure, return_pressure)
    data = PlanData.of(plan, injector, pressures, plan.name, synthetic=plan.synthetic)
    simulator = Simulator(injector, (), step, thread_count(threads))
    score = data.score(simulator)
    failed = np.flatnonzero(np.isnan(score.values)).tolist()
    statuses = simulator.once([data.points[i] for i in failed]).status[0] if failed else ()
    reasons = {i: Status(int(status)).sentence for i, status in zip(failed, statuses, strict=True)}
    if len(failed) == len(data.tests):
        raise SimulationError(f"No test of {plan.name} could be simulated. {reasons[0]}")
    hint = _unit_hint(plan, score, pressures, simulator)
    return PlanResult(injector, score, tuple(reasons.get(i, "") for i in range(len(data.tests))), step, hint)
