"""Disturbance of the pressure that does not come from the injection: noise, pump, waves of neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, toeplitz
from scipy.optimize import minimize

from commonrail.base.arrays import Floats

LEAST = 12  # samples of a quiet stretch from which anything is learnt
MEAN, TREND = 2e6, 1e9  # standard deviations of the unknown mean [Pa] and slope [Pa/s]: both as good as free
IMPOSSIBLE = 1e12  # cost of what is no covariance


class Disturbance(NamedTuple):
    """Gaussian disturbance of a pressure.

    Attributes
    ----------
    noise : float
        Standard deviation of an averaged sample [Pa].
    rate, memory : float
        Standard deviation [Pa/s] and correlation time [s] of the rate at which pump and other users change the
        pressure.
    wave, frequency, decay : float
        Standard deviation [Pa], frequency [Hz] and correlation time [s] of waves.
    """

    noise: float
    rate: float
    memory: float
    wave: float
    frequency: float
    decay: float

    def covariance(self, time: Floats) -> Floats:
        """Covariance (samples, samples) [Pa²] at evenly spaced times (samples,) [s].

        The rate is an Ornstein-Uhlenbeck process; its integral from the first sample on has the covariance of
        Uhlenbeck and Ornstein (1930), Phys. Rev. 36, 823. Mean and slope are as good as free.
        """
        t = time - time[0]
        m, fade = self.memory, np.exp(-t / self.memory)
        pumped = 2.0 * m * np.minimum(t[:, None], t) + m**2 * (fade[:, None] + fade - 1.0 - toeplitz(fade))
        wave = toeplitz(np.exp(-t / self.decay) * np.cos(2.0 * np.pi * self.frequency * t))
        return np.asarray(
            MEAN**2
            + TREND**2 * np.outer(t, t)
            + self.rate**2 * pumped
            + self.wave**2 * wave
            + self.noise**2 * np.eye(len(t))
        )


def learn(stretches: Sequence[Floats], spacing: float, noise: float | None = None) -> Disturbance:
    """Disturbance of the largest likelihood of quiet stretches, by SciPy's Nelder-Mead search.

    Parameters
    ----------
    stretches : sequence of (samples,)
        Averaged pressure in which nothing of the injector is open [Pa].
    spacing : float
        Between samples [s].
    noise : float, optional
        Of an averaged sample, where it is known [Pa].
    """
    usable = [one for one in stretches if len(one) >= LEAST]
    if not usable:
        return Disturbance(noise or 0.1e6, 0.5e9, 2e-3, 0.02e6, 1e3, 1e-3)  # estimates [E]
    length = min(len(one) for one in usable)
    table = np.array([one[-length:] - one[-length:].mean() for one in usable])
    time = np.asarray(spacing * np.arange(length), float)
    design = np.vander(time, 3)
    fits = np.linalg.lstsq(design, table.T, rcond=None)[0]
    rest = table - (design @ fits).T
    white = float(np.median(np.abs(np.diff(rest, 2)))) / 0.6745 / np.sqrt(6.0)  # of a normal distribution
    power = np.mean(np.abs(np.fft.rfft(rest)) ** 2, axis=0)[2:]
    size = max(float(np.sqrt(np.mean(rest**2))), white, 1.0)
    slope = max(float(np.sqrt(np.mean(fits[1] ** 2))), size / time[-1])
    first = [white, slope, time[-1], 0.5 * size, (2 + np.argmax(power)) / (length * spacing), 2e-3]

    def made(p: Any) -> Disturbance:
        figures = np.exp(np.clip(p, -50.0, 50.0)).tolist()
        return Disturbance(noise or max(figures[0], 0.3 * white, 1.0), *figures[1:])

    def cost(p: Any) -> float:
        found = made(p)
        if not (spacing < found.memory < 1.0 and spacing < found.decay < 0.1 and found.frequency < 0.4 / spacing):
            return IMPOSSIBLE
        try:
            factor, low = cho_factor(found.covariance(time), lower=True)
        except LinAlgError:
            return IMPOSSIBLE
        squares = np.sum(table.T * cho_solve((factor, low), table.T))
        return float(len(table) * np.log(np.diag(factor)).sum() + 0.5 * squares)

    best = minimize(
        cost,
        np.log(np.maximum(first, 1e-9)),
        method="Nelder-Mead",
        options={"maxiter": 500, "xatol": 0.02, "fatol": 0.1},
    )
    return made(np.asarray(best.x))
