"""An injector on a test plan: every test simulated and judged by its band."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from commonrail.base.arguments import Quantity, instance, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import SimulationError
from commonrail.compiler.target import package_versions
from commonrail.data.simulator import Simulator
from commonrail.engine.status import Status
from commonrail.engine.time_step import DEFAULT_STEP, check_step
from commonrail.physics.injector import Injector
from commonrail.plugins.plans.data import PlanData, PlanScore
from commonrail.plugins.plans.page import SIMULATED
from commonrail.plugins.plans.study import BENCH_PRESSURES, TestPlan, load_plan


@dataclass(frozen=True, repr=False)
class PlanResult(Shown):
    """Simulated quantities of a plan's tests beside their bands.

    Attributes
    ----------
    injector : Injector
    score : PlanScore
        Its `data` has the tests, its `values` the quantities per stroke (n,) [m³], NaN where one failed, and its
        `states` their places in the bands.
    reasons : tuple of str, length n
        Why a test has no number; empty where it has one.
    time_step : float
        [s].
    """

    presenter = "commonrail.plugins.plans.page:PLAN"

    injector: Injector
    score: PlanScore
    reasons: tuple[str, ...]
    time_step: float

    @property
    def distances(self) -> Floats:
        """Distances from the nominal quantities (n,) in half bands."""
        return self.score.data.bands.distance(self.score.values)

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI units."""
        injector, data = self.injector, self.score.data.record({SIMULATED: self.score})
        for row, reason in zip(data["rows"], self.reasons, strict=True):
            row["reason"] = reason
        texts = {key: getattr(injector, key) for key in ("name", "title", "synthetic")}
        return {
            "schema": 1,
            "kind": "plan",
            "title": f"Test plan: {injector.name}",
            "software": package_versions(),
            "injector": texts | {"variant": injector.variant.label},
            "time_step": self.time_step,
            "data": {"name": self.score.data.name, **data},
        }


def run_plan(
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
        Strokes [1/s], or text such as ``"1000 1/min"``, of tests that state none: between two strokes the guides leak
        at rail pressure, which a return collects.
    cylinder_pressure, return_pressure : float or str
        [Pa], or texts with units; by default of an injector bench, 0.5 and 0.1 MPa.
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
    data = PlanData.of(plan.at_stroke_rate(stroke_rate), injector, (cylinder_pressure, return_pressure), plan.name)
    simulator = Simulator(injector, (), step, thread_count(threads))
    score = data.score(simulator)
    failed = np.flatnonzero(np.isnan(score.values)).tolist()
    statuses = simulator.once([data.points[i] for i in failed]).status[0] if failed else ()
    reasons = {i: Status(int(status)).sentence for i, status in zip(failed, statuses, strict=True)}
    if len(failed) == len(data.tests):
        raise SimulationError(f"No test of {plan.name} could be simulated. {reasons[0]}")
    return PlanResult(injector, score, tuple(reasons.get(i, "") for i in range(len(data.tests))), step)
