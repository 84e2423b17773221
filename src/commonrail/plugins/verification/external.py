"""Comparison of both engines with the results of an independent program.

The program (SciPy LSODA, method of lines) was written before this project and shares no code with it. It has different
fuel polynomials and keeps the memory of the discharge coefficient through a bounce. Tighter limits would judge that
program instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from importlib import resources
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.calibration.objective import Objective
from commonrail.data.base import DataSet, Role
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.simulator import Simulator
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.solution import Solution
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.plugins.paper.bench import PAPER_OPTIMUM
from commonrail.plugins.verification.closed_forms import Check, check
from commonrail.readers.columns import Column
from commonrail.readers.injector import load_injector
from commonrail.readers.table_sheet import TableSheet, open_table

INTERVAL = 3e-6  # between samples [s]
SHORT = 399e-6  # longest energising time of a short injection [s]
# Limits of volume and rate [%], each for short and longer injections, and of the opening [us].
VOLUME, RATE = (0.3, 0.1), (1.0, 0.4)
OPENING = 0.3


@dataclass(frozen=True)
class Run:
    """One single injection by the independent program; the point's horizon is the end of the rate.

    `volume` [m³]; `opening`: time at which the tip passes 5 um [s]; `rate` (samples,): means over `INTERVAL` [m³/s], if
    available.
    """

    injector: Injector
    point: OperatingPoint
    volume: float
    opening: float
    rate: Floats | None

    @property
    def short(self) -> bool:
        """True if the limits of short injections apply."""
        return self.point.pulses[0].duration <= SHORT


class Gaps(NamedTuple):
    """Engine minus independent program: volume and L1 of the rate [%] (None without a rate), opening [us]."""

    volume: float
    rate: float | None
    opening: float


def by_lanes(run: Run) -> Gaps:
    """Gaps of the fast engine at its default step."""
    return gaps(run, simulate(run.injector, run.point, sample_interval=INTERVAL))


def by_reference(run: Run) -> Gaps:
    """Gaps of the reference with its explicit method."""
    return gaps(run, simulate_reference(run.injector, run.point, INTERVAL, Resolution(method="explicit")))


ENGINES: dict[str, Callable[[Run], Gaps]] = {"lanes": by_lanes, "reference": by_reference}


def gaps(run: Run, solution: Solution) -> Gaps:
    """Distances of a solution from a run; NaN for a failed one."""
    sound = math.nan if solution.status.failed else 1.0
    rate = None
    if run.rate is not None:
        rate = sound * 100.0 * float(np.sum(np.abs(solution.rate - run.rate)) / np.sum(np.abs(run.rate)))
    volume, opening = solution.injected_volume / run.volume - 1.0, solution.opening - run.opening
    return Gaps(sound * 100.0 * volume, rate, sound * 1e6 * opening)


def against_outside(runs: Sequence[Run], pool: Executor) -> list[Check]:
    """Largest gaps of both engines, simulated by a pool of processes."""
    return [
        gap_check
        for engine, simulated in ENGINES.items()
        for gap_check in check_gaps(engine, runs, list(pool.map(simulated, runs)))
    ]


def check_gaps(engine: str, runs: Sequence[Run], gaps: Sequence[Gaps]) -> Iterator[Check]:
    """Checks of the gaps of one engine."""
    for short, what in ((False, "from 400 us"), (True, "short injections")):
        members = [gap for run, gap in zip(runs, gaps, strict=True) if run.short is short]
        rates = [gap.rate for gap in members if gap.rate is not None]
        yield _worst(f"{engine}, volume, {what}", [gap.volume for gap in members], VOLUME[not short], "%")
        yield _worst(f"{engine}, rate, L1, {what}", rates, RATE[not short], "%")
    yield _worst(f"{engine}, opening", [gap.opening for gap in gaps], OPENING, "us")


def _worst(name: str, values: Sequence[float], limit: float, unit: str) -> Check:
    size = np.abs(values)
    detail = f"{len(size)} runs of an independent program, median {np.median(size):.2g} {unit}"
    return check(f"independent program: {name}", float(np.max(size)), limit, unit, detail)


# The objective of a search against the scores of a report: two ways to compute J.
#
# The search sums the misfit inside the loop over steps, for several candidates at once; the report traces each injector
# and samples the trace.

STEP = 1e-6  # [s]
# Both sum the same 1900 steps (rounding 1e-16) in different orders and vector widths.
ROUNDING = 1e-9
LABELS = ("simulated", "all of it")
FACTORS = (0.8, 1.0, 1.3)  # of all stiffnesses
MAP = ((60e6, 250e-6), (100e6, 250e-6), (100e6, 700e-6), (160e6, 700e-6))  # rail pressure [Pa], energising time [s]


def objective_and_scores(injector: Injector) -> list[Check]:
    """J of the search against Σ weight · J of the reported scores, at the nominal and at other fuel temperatures."""
    data: list[DataSet] = [_curve(injector), _map(injector)]
    low, high = injector.fuel.temperature_range
    names, stiffness = [*PAPER_OPTIMUM, FUEL_TEMPERATURE], np.array([injector.values[name] for name in PAPER_OPTIMUM])
    checks = []
    for what, temperatures in (("own temperature", (injector.values[FUEL_TEMPERATURE],)), ("others", (low, high))):
        rows = [[*(factor * stiffness), t] for factor in FACTORS for t in temperatures]
        costs = Objective(injector, names, data, STEP, 1).costs(np.array(rows)).costs
        scores = [_sum_reported_scores(injector.with_values(dict(zip(names, row, strict=True))), data) for row in rows]
        worst = float(np.max(np.abs(costs / np.array(scores) - 1.0)))
        detail = f"J of {len(rows)} candidates, a curve and a map, relative; limit: rounding of 1900 steps, with room"
        checks.append(check(f"objective against scores, {what}", worst, ROUNDING, "1", detail))
    return checks


def _sum_reported_scores(injector: Injector, data: Sequence[DataSet]) -> float:
    simulator = Simulator(injector, (), STEP, 1)
    return sum(data_set.weight * float(data_set.misfit(data_set.score(simulator).values)) for data_set in data)


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
    dead_time = np.zeros(len(points), bool)
    return QuantityData(
        "map", Role.FIT, points, batch.injected_volume[0], 1e-10, 0.02, dead_time, 50.0, *LABELS, by_mass
    )


# Results of the independent program, from the table that ships with the package.

_FOLDER = resources.files("commonrail.plugins.verification") / "external_figures"
_STIFFNESS: Mapping[str, Mapping[str, float]] = {"theoretical": {}, "optimal": PAPER_OPTIMUM}  # of runs.csv


def load_outside() -> tuple[Run, ...]:
    """Read the runs with injectors, points and available rates."""
    with resources.as_file(_FOLDER / "injector.toml") as path:
        theoretical = load_injector(path)
    injectors = {name: theoretical.with_values(values) for name, values in _STIFFNESS.items()}
    rates = _rates()
    samples = len(next(iter(rates.values())))
    numbers = ("rail_pressure", "energising_time", "injected", "opening")
    table = _sheet("runs.csv").take([Column("stiffness"), *(Column(name, "1") for name in numbers)])
    rows = zip(table.texts["stiffness"], *(table.columns[name].tolist() for name in numbers), strict=True)
    return tuple(
        Run(
            injectors[stiffness],
            OperatingPoint(1e6 * rail, 1e-6 * energising, 5e6, 0.5e6, horizon=samples * INTERVAL),
            1e-9 * injected,
            1e-6 * opening,
            rates.get(f"{stiffness} {rail:g} {energising:g}"),
        )
        for stiffness, rail, energising, injected, opening in rows
    )


def _rates() -> dict[str, Floats]:
    """Rates [m³/s] by column: stiffness, rail pressure and energising time."""
    sheet = _sheet("rates.csv")
    names = sheet.names[1:]
    columns = sheet.take([Column(name, "1") for name in names]).columns
    return {name: 1e-6 * columns[name] for name in names}


def _sheet(name: str) -> TableSheet:
    with resources.as_file(_FOLDER / name) as path:
        return open_table(path)
