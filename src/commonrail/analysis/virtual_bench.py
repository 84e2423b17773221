"""Virtual test bench: injection curves of a declared, hidden truth, in place of data that were never published.

The truth is richer than any model that is fitted to it (`truth`), and it runs on the reference engine, so a fit
never meets its own discretisation. A curve is one shot: rail pressure, energising time and boost voltage deviate from
what was asked for, and rate and inlet pressure are seen through sensors. The fit sees the two sensors' signals and
the energising time that was asked for. Everything the bench gives is synthetic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from commonrail.analysis.truth import Truth
from commonrail.arguments import instance, number, settle, whole
from commonrail.arrays import Floats
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import simulate_reference
from commonrail.engine.solution import Solution
from commonrail.engine.time_step import check_step
from commonrail.errors import SimulationError
from commonrail.injector.definition import Injector
from commonrail.units import to_text

__all__ = ["INTERVAL", "PAPER_OPTIMUM", "SAMPLES", "Bench", "Curve", "Truth", "bench_curve"]


# Table 1 of the paper, "optimal" [N/m]
PAPER_OPTIMUM = {
    "plunger_needle.k1": 3.03e8,
    "plunger_needle.k2": 8.26e7,
    "plunger_needle.k3": 8.35e7,
    "plunger_needle.k4": 1.41e8,
    "plunger_needle.k5": 1.05e8,
    "plunger_needle.k6": 3.50e8,
    "plunger_needle.k7": 6.44e7,
}

SAMPLES, INTERVAL = 520, 3e-6  # Sec. 5: 520 samples; their spacing [s] is ours


@dataclass(frozen=True)
class Bench:
    """A hidden truth that is measured, the injector as drawn that is fitted to it, and the time step of the fit.

    Attributes
    ----------
    truth : Truth
    injector : Injector
    time_step : float
        [s].

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, or the time step does not lie between 1 ns and 100 us.
    """

    truth: Truth
    injector: Injector
    time_step: float

    def __post_init__(self) -> None:
        instance(self.truth, Truth, "truth of the bench")
        instance(self.injector, Injector, "injector of the bench")
        settle(self, time_step=check_step(self.time_step))


class Curve(NamedTuple):
    """One injection curve of the bench.

    Attributes
    ----------
    rail_pressure : float
        Asked for [Pa].
    time : (520,)
        Ends of the samples [s].
    rate : (520,)
        Shown by the rate meter, means over the samples [m³/s].
    trace_time : (520,)
        [s].
    rail : (520,)
        Pressure at the injector's inlet, shown by its sensor at `trace_time` [Pa].
    """

    rail_pressure: float
    time: Floats
    rate: Floats
    trace_time: Floats
    rail: Floats


def bench_curve(truth: Truth, injector: Injector, rail_pressure: float, energising_time: float, seed: int) -> Curve:
    """Rate and inlet pressure of one shot on the virtual test bench, as its sensors show them.

    The same arguments give the same curve, whatever else is drawn and on however many threads.

    Parameters
    ----------
    truth : Truth
    injector : Injector
        Which the truth alters, and from which a fit starts.
    rail_pressure : float
        Asked for [Pa]; with `seed`, the key of the random numbers.
    energising_time : float
        Asked for [s].
    seed : int
        Of scatter and noise.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, the truth does not fit the injector, or a deviation leaves no sensible
        operating point.
    SimulationError
        If the truth cannot be simulated.
    """
    instance(truth, Truth, "truth")
    instance(injector, Injector, "injector")
    rail_pressure = number(rail_pressure, "Pa", "rail pressure")
    energising_time = number(energising_time, "s", "energising time")
    seed = whole(seed, "seed")
    streams = np.random.SeedSequence((seed, round(rail_pressure))).spawn(3)
    operation, rate_meter, rail_sensor = map(np.random.default_rng, streams)
    shot = _shoot(truth, injector, rail_pressure, energising_time, operation)
    rate = truth.rate_meter.of_means(shot.rate, INTERVAL, rate_meter)
    rail = truth.rail_sensor.of_values(shot.channels["inlet_pressure"], INTERVAL, rail_sensor)
    return Curve(rail_pressure, shot.time[1:], rate, shot.time[1:], rail[1:])


def _shoot(
    truth: Truth, injector: Injector, rail_pressure: float, energising_time: float, rng: np.random.Generator
) -> Solution:
    """The injection as it is, with its own deviations."""
    scatter, (rail, duration, boost) = truth.scatter, rng.standard_normal(3)
    hidden = truth.hidden(injector)
    boosted = hidden.values["drive.boost_voltage"] + scatter.boost_voltage * boost
    point = OperatingPoint(
        rail_pressure + scatter.rail_pressure * rail,
        energising_time + scatter.energising_time * duration,
        horizon=SAMPLES * INTERVAL,
    )
    friction = np.column_stack((truth.friction.coulomb, truth.friction.viscous))
    shot = simulate_reference(
        hidden.with_values({"drive.boost_voltage": boosted}), point, INTERVAL, truth.resolution, friction
    )
    if shot.status.failed:
        raise SimulationError(f"{truth.name} at {to_text(rail_pressure, 'Pa')}: {shot.sentence}")
    return shot
