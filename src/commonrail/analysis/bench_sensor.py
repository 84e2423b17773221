"""Measuring chain: limited bandwidth, noise and resolution of a signal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from commonrail.arrays import Floats
from commonrail.observation.low_pass import LowPass, first_order
from commonrail.observation.meter import Meter

__all__ = ["Sensor"]


PASSES = 2  # low-passes in a row


@dataclass(frozen=True)
class Sensor:
    """A measuring chain: two equal first-order low-passes in a row, then Gaussian noise, then rounding.

    Attributes
    ----------
    bandwidth : float
        Corner frequency of each low-pass [Hz]; infinite for none.
    noise : float
        Standard deviation of a sample, in the signal's unit; independent from sample to sample.
    resolution : float
        Step of the digital signal in the same unit; zero for none.
    """

    bandwidth: float = math.inf
    noise: float = 0.0
    resolution: float = 0.0

    def of_means(self, signal: Floats, interval: float, rng: np.random.Generator) -> Floats:
        """Shown signal of one that was zero before, given as means.

        Parameters
        ----------
        signal : (n,)
        interval : float
            Length of each mean [s].
        rng : Generator
            Of the noise.
        """
        return self._shown(self._passed(signal, 0.0, interval), rng)

    def of_values(self, signal: Floats, interval: float, rng: np.random.Generator) -> Floats:
        """Shown signal of one that rested at its first value before, given as values.

        Parameters
        ----------
        signal : (n,)
        interval : float
            Time between values [s].
        rng : Generator
            Of the noise.
        """
        return self._shown(self._passed(signal, float(signal[0]), interval), rng)

    def as_meter(self, name: str) -> Meter:
        """The low-passes as a meter of a fit; noise and resolution are no part of it."""
        return Meter(name, {} if math.isinf(self.bandwidth) else {"cutoff": self.bandwidth}, LowPass.CASCADE, PASSES)

    def _passed(self, signal: Floats, rest: float, interval: float) -> Floats:
        """Signal behind the low-passes."""
        for _ in range(PASSES):
            signal = first_order(signal, 2.0 * math.pi * self.bandwidth * interval, rest)
        return signal

    def _shown(self, signal: Floats, rng: np.random.Generator) -> Floats:
        noisy = signal + self.noise * rng.standard_normal(len(signal))
        return np.asarray(np.round(noisy / self.resolution) * self.resolution) if self.resolution > 0.0 else noisy
