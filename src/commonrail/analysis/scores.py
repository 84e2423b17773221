"""The objective of a search against the scores of a report: two ways to one J.

The search adds up its misfit inside the loop over steps, several candidates at once; the report traces each injector
and samples it afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.analysis.closed_forms import Check, check
from commonrail.analysis.virtual_bench import PAPER_OPTIMUM
from commonrail.calibration.objective import Objective
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector
from commonrail.kinds import DataSet, QuantityData, RateData, Role
from commonrail.kinds.simulator import Simulator

STEP = 1e-6  # [s]
# The loop and the traced run add up the same 1900 steps, of rounding 1e-16, in another order and with other vectors.
ROUNDING = 1e-9
LABELS = ("simulated", "all of it")
FACTORS = (0.8, 1.0, 1.3)  # of all stiffnesses
MAP = ((60e6, 250e-6), (100e6, 250e-6), (100e6, 700e-6), (160e6, 700e-6))  # rail pressure [Pa], energising time [s]


def objective_and_scores(injector: Injector) -> list[Check]:
    """J of the search against Σ weight · J of the reported scores, at the fuel's own and at another temperature."""
    data: list[DataSet] = [_curve(injector), _map(injector)]
    low, high = injector.fuel.temperature_range
    names = [*PAPER_OPTIMUM, FUEL_TEMPERATURE]
    checks = []
    for what, temperatures in (("own temperature", (injector.values[FUEL_TEMPERATURE],)), ("others", (low, high))):
        rows = [_row(injector, factor, t) for factor in FACTORS for t in temperatures]
        costs = Objective(injector, names, data, STEP, 1).costs(np.array(rows)).costs
        scores = [_reported(injector.with_values(dict(zip(names, row, strict=True))), data) for row in rows]
        worst = float(np.max(np.abs(costs / np.array(scores) - 1.0)))
        detail = f"J of {len(rows)} candidates, a curve and a map, relative; limit: rounding of 1900 steps, with room"
        checks.append(check(f"objective against scores, {what}", worst, ROUNDING, "1", detail))
    return checks


def _row(injector: Injector, factor: float, temperature: float) -> list[float]:
    return [*(factor * injector.values[name] for name in PAPER_OPTIMUM), temperature]


def _reported(injector: Injector, data: Sequence[DataSet]) -> float:
    simulator = Simulator(injector, (), STEP, 1)
    return sum(one.weight * float(one.misfit(one.score(simulator).values)) for one in data)


def _curve(injector: Injector) -> RateData:
    """Rate of the paper's optimal stiffness."""
    point = OperatingPoint(160e6, 700e-6, horizon=1.9e-3)
    shot = simulate(injector.with_values(PAPER_OPTIMUM), point, sample_interval=3e-6)
    return RateData("curve", Role.FIT, point, shot.time, shot.rate, 1.5, *LABELS)


def _map(injector: Injector) -> QuantityData:
    """Quantities of the paper's optimal stiffness, half of them measured by mass."""
    points = tuple(OperatingPoint(pressure, time) for pressure, time in MAP)
    batch = simulate_batch(injector.with_values(PAPER_OPTIMUM), points, time_step=STEP)
    by_mass = np.array([np.nan, np.nan, 800.0, 800.0])
    none = np.zeros(len(points), bool)
    return QuantityData("map", Role.FIT, points, batch.injected_volume[0], 1e-10, 0.02, none, 50.0, *LABELS, by_mass)
