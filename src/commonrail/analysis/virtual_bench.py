"""Virtual test bench: injection curves of a declared, hidden truth, in place of data that were never published.

The truth is richer than any model that is fitted to it: the paper's optimal stiffnesses, guide friction on
every mass, a finer pipe, and a rate meter with limited bandwidth, noise and resolution. It runs on the
reference engine, so a fit never meets its own discretisation. Everything it gives is synthetic.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.injector.definition import Injector

Floats = NDArray[np.float64]

# Table 1, "optimal" [N/m]
PAPER_OPTIMUM = {
    "plunger_needle.k1": 3.03e8,
    "plunger_needle.k2": 8.26e7,
    "plunger_needle.k3": 8.35e7,
    "plunger_needle.k4": 1.41e8,
    "plunger_needle.k5": 1.05e8,
    "plunger_needle.k6": 3.50e8,
    "plunger_needle.k7": 6.44e7,
}


@dataclass(frozen=True)
class RateMeter:
    """Observer of the rate: second-order low-pass, Gaussian noise, resolution. All [E].

    Attributes
    ----------
    bandwidth : float
        Corner frequency [Hz].
    noise : float
        Standard deviation [m³/s].
    resolution : float
        Step of the digital signal [m³/s].
    """

    bandwidth: float = 60e3
    noise: float = 0.30e-6
    resolution: float = 0.01e-6

    def observe(self, rate: Floats, interval: float, rng: np.random.Generator) -> Floats:
        """What the meter shows for samples `interval` [s] apart."""
        shown = _low_pass(rate, interval, self.bandwidth) + rng.normal(0.0, self.noise, len(rate))
        return np.asarray(np.round(shown / self.resolution) * self.resolution)


@dataclass(frozen=True)
class Truth:
    """The declared truth of the bench.

    Attributes
    ----------
    values : dict of str to float
        Parameters that differ from the injector that is fitted [SI].
    coulomb, viscous : tuple of 9 floats
        Guide friction on masses 1…9 [N], [N s/m]; larger on cylinders 1, 4 and 6, where clearances are small.
    cells : (int, int)
        Finite volumes of feed pipe and return line.
    meter : RateMeter
    """

    values: dict[str, float] = field(default_factory=lambda: dict(PAPER_OPTIMUM))
    coulomb: tuple[float, ...] = (1.5, 0.5, 0.3, 1.0, 1.0, 0.3, 1.5, 1.0, 0.0)
    viscous: tuple[float, ...] = (1.0, 0.3, 0.2, 0.6, 0.6, 0.2, 1.0, 0.6, 0.0)
    cells: tuple[int, int] = (480, 120)
    meter: RateMeter = RateMeter()


class Curve(NamedTuple):
    """One injection curve of the bench: ends of the sample intervals [s] and shown rate [m³/s]."""

    rail_pressure: float
    time: Floats
    rate: Floats


def bench_curves(
    injector: Injector,
    rail_pressures: tuple[float, ...],
    energising_time: float,
    seed: int,
    truth: Truth | None = None,
    samples: int = 520,
    interval: float = 3e-6,
) -> list[Curve]:
    """Injection curves of the truth behind an injector.

    Parameters
    ----------
    injector : Injector
        What a fit starts from; `truth.values` replace some of its values.
    rail_pressures : tuple of float
        [Pa]; each curve draws its noise from its own stream of `seed`.
    energising_time : float
        [s].
    seed : int
    truth : Truth, optional
    samples : int
    interval : float
        [s].
    """
    truth = truth or Truth()
    hidden = injector.with_values(truth.values)
    friction = np.column_stack((truth.coulomb, truth.viscous))
    resolution = Resolution(truth.cells)
    curves = []
    for rail, child in zip(rail_pressures, np.random.SeedSequence(seed).spawn(len(rail_pressures)), strict=True):
        point = OperatingPoint(rail, energising_time, horizon=samples * interval)
        solution = simulate_reference(hidden, point, interval, resolution, friction)
        shown = truth.meter.observe(solution.rate, interval, np.random.default_rng(child))
        curves.append(Curve(rail, solution.time[1:], shown))
    return curves


def _low_pass(signal: Floats, interval: float, corner: float) -> Floats:
    """Two first-order low-passes in a row, each exact for a signal constant over a sample."""
    keep = np.exp(-2.0 * np.pi * corner * interval)
    out = signal
    for _ in range(2):
        state, passed = 0.0, np.empty_like(out)
        for k, value in enumerate(out):
            # mean over the interval of the filter's answer to a constant input
            decay = (1.0 - keep) / (2.0 * np.pi * corner * interval)
            passed[k] = value + (state - value) * decay
            state = value + (state - value) * keep
        out = passed
    return out
