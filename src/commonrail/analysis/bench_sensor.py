"""Measuring chain: limited bandwidth, noise and resolution of a signal."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Sensor"]

Floats = NDArray[np.float64]


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
        return self._shown(_twice(_low_pass_of_means, signal, 0.0, self._decay(interval)), rng)

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
        return self._shown(_twice(_low_pass_of_values, signal, float(signal[0]), self._decay(interval)), rng)

    def _decay(self, interval: float) -> float:
        """Interval in time constants of a low-pass."""
        return 2.0 * math.pi * self.bandwidth * interval

    def _shown(self, signal: Floats, rng: np.random.Generator) -> Floats:
        noisy = signal + self.noise * rng.standard_normal(len(signal))
        return np.asarray(np.round(noisy / self.resolution) * self.resolution) if self.resolution > 0.0 else noisy


def _twice(low_pass: Callable[[Floats, float, float], Floats], signal: Floats, rest: float, decay: float) -> Floats:
    return signal if math.isinf(decay) else low_pass(low_pass(signal, rest, decay), rest, decay)


def _low_pass_of_means(signal: Floats, state: float, decay: float) -> Floats:
    """Means over the intervals, exact for an input that is constant over each."""
    keep, mean = math.exp(-decay), -math.expm1(-decay) / decay
    passed = np.empty_like(signal)
    for k, value in enumerate(signal):
        passed[k] = value + (state - value) * mean
        state = value + (state - value) * keep
    return passed


def _low_pass_of_values(signal: Floats, state: float, decay: float) -> Floats:
    """Values at the samples, exact for an input that is linear between them."""
    keep = math.exp(-decay)
    passed = np.empty_like(signal)
    passed[0], before = state, float(signal[0])
    for k, value in enumerate(signal[1:], start=1):
        lag = (value - before) / decay
        state = value - lag + (state - before + lag) * keep
        passed[k], before = state, value
    return passed
