"""Noises of virtual benches, none of which the likelihood assumes but the white one; eight of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["NOISES", "DrawnNoise"]

Floats = NDArray[np.float64]

CUTOFF = 12e3  # of each of the two filters of a meter's amplifier [Hz]
WARM = 400  # samples after which a filter has forgotten its begin
ABSOLUTE, RELATIVE = 0.02e-6, 0.01  # standard deviation [m³/s] and share of the rate, as shots scatter
DELAY = 0.5e-6  # standard deviation of a stated delay [s]


class DrawnNoise(NamedTuple):
    """Noise of a bench.

    Attributes
    ----------
    errors : function of Generator, rate (n,) [m³/s], interval [s] and standard deviation [m³/s]
        Errors (n,) of the samples [m³/s].
    delay : float
        Standard deviation of the bench's delay, which the study states [s].
    """

    errors: Callable[[np.random.Generator, Floats, float, float], Floats]
    delay: float = 0.0


def _white(rng: np.random.Generator, rate: Floats, interval: float, sigma: float) -> Floats:
    return sigma * rng.standard_normal(len(rate))


def _student(rng: np.random.Generator, rate: Floats, interval: float, sigma: float) -> Floats:
    """Three degrees of freedom, whose variance is 3."""
    return sigma * rng.standard_t(3, len(rate)) / np.sqrt(3.0)


def _autoregressive(rng: np.random.Generator, rate: Floats, interval: float, sigma: float) -> Floats:
    noise = rng.standard_normal(len(rate))
    for i in range(1, len(noise)):
        noise[i] = 0.9 * noise[i - 1] + np.sqrt(1.0 - 0.81) * noise[i]
    return sigma * noise


def _filtered(rng: np.random.Generator, rate: Floats, interval: float, sigma: float) -> Floats:
    """White noise after two filters of first order, scaled to the standard deviation that they leave of it."""
    past = np.exp(-2.0 * np.pi * CUTOFF * interval)
    noise = rng.standard_normal(len(rate) + WARM)
    for _ in range(2):
        for i in range(1, len(noise)):
            noise[i] = past * noise[i - 1] + (1.0 - past) * noise[i]
    # variance of the sum of (k + 1) past^k (1 - past)² times independent samples
    left = (1.0 - past) ** 4 * (1.0 + past**2) / (1.0 - past**2) ** 3
    return sigma * noise[WARM:] / np.sqrt(left)


def _proportional(rng: np.random.Generator, rate: Floats, interval: float, sigma: float) -> Floats:
    return (ABSOLUTE + RELATIVE * np.abs(rate)) * rng.standard_normal(len(rate))


def _drifting(rng: np.random.Generator, rate: Floats, interval: float, sigma: float) -> Floats:
    """White noise and a slow sine of half a period to one and a half, of equal root mean square."""
    turns = np.arange(len(rate)) / len(rate) * rng.uniform(0.5, 1.5) + rng.uniform(0.0, 1.0)
    return sigma * (rng.standard_normal(len(rate)) + np.sqrt(2.0) * np.sin(2.0 * np.pi * turns))


def _outliers(rng: np.random.Generator, rate: Floats, interval: float, sigma: float) -> Floats:
    """One sample in ten eight times as large."""
    return sigma * rng.standard_normal(len(rate)) * np.where(rng.random(len(rate)) < 0.1, 8.0, 1.0)


NOISES: Mapping[str, DrawnNoise] = {
    "white": DrawnNoise(_white),
    "student": DrawnNoise(_student),
    "autoregressive": DrawnNoise(_autoregressive),
    "filtered": DrawnNoise(_filtered),
    "proportional": DrawnNoise(_proportional),
    "drifting": DrawnNoise(_drifting),
    "delay": DrawnNoise(_white, DELAY),
    "outliers": DrawnNoise(_outliers),
}
