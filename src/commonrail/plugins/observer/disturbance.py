"""Disturbance of the pressure from sources other than the injection: noise, pump, waves of neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, toeplitz
from scipy.optimize import minimize

from commonrail.base.arrays import Floats

LEAST = 12  # samples of a quiet stretch that are needed for an estimate
MEAN, TREND = 2e6, 1e9  # standard deviations of the unknown mean [Pa] and slope [Pa/s], wide enough to be free
HIGHEST = 0.4  # frequency of a wave times the spacing of samples; higher frequencies count as noise
LOWEST = 2.0  # periods of a wave in a stretch; slower changes belong to the rate
# The rate of pressure change may vary by this share in some stretches even if all look steady: a pump synchronous with
# the injections reverses at the same point of every shot. Chosen [E].
VARYING, LONGEST = 0.3, 10.0
SLOW = 8.0  # start of one of the searches, in periods of a wave per stretch; the other starts at the periodogram's peak
IMPOSSIBLE = 1e12  # cost of a matrix that is not a covariance


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
        Uhlenbeck and Ornstein (1930), Phys. Rev. 36, 823. Mean and slope are practically free.
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
    """Estimate a disturbance by maximum likelihood from quiet stretches: the better of two L-BFGS-B searches.

    Parameters
    ----------
    stretches : sequence of (samples,)
        Averaged pressure while the injector is closed [Pa].
    spacing : float
        Between samples [s].
    noise : float, optional
        Of an averaged sample, if known [Pa].
    """
    usable = [stretch for stretch in stretches if len(stretch) >= LEAST]
    if not usable:
        return Disturbance(noise or 0.1e6, 0.5e9, 2e-3, 0.02e6, 1e3, 1e-3)  # estimates [E]
    length = min(len(stretch) for stretch in usable)
    table = np.array([stretch[-length:] - stretch[-length:].mean() for stretch in usable])
    time = np.asarray(spacing * np.arange(length), float)
    design = np.vander(time, 3)
    fits = np.linalg.lstsq(design, table.T, rcond=None)[0]
    rest = table - (design @ fits).T
    white = max(float(np.median(np.abs(np.diff(rest, 2)))) / 0.6745 / np.sqrt(6.0), 1.0)  # of a normal distribution
    power, tones = np.mean(np.abs(np.fft.rfft(rest)) ** 2, axis=0), np.fft.rfftfreq(length, spacing)
    inner = (tones > LOWEST / time[-1]) & (tones < HIGHEST / spacing)
    peak = float(tones[inner][np.argmax(power[inner])])
    slope = max(float(np.sqrt(np.mean(fits[1] ** 2))), white / time[-1])
    bounds = [
        (0.3 * white, 3.0 * white),
        (VARYING * slope, 1e2 * slope),
        (2.0 * spacing, LONGEST * time[-1]),
        (1e-2 * white, 1e2 * white),
        (LOWEST / time[-1], HIGHEST / spacing),
        (spacing, 0.1),
    ]

    def make_disturbance(p: Floats) -> Disturbance:
        figures = np.exp(p).tolist()
        return Disturbance(noise or figures[0], *figures[1:])

    def cost(p: Floats) -> float:
        try:
            factor, low = cho_factor(make_disturbance(p).covariance(time), lower=True)
        except LinAlgError:
            return IMPOSSIBLE
        squares = np.sum(table.T * cho_solve((factor, low), table.T))
        return float(len(table) * np.log(np.diag(factor)).sum() + 0.5 * squares)

    searches = []
    size = float(np.sqrt(np.mean(rest**2)))
    for frequency, wave in ((peak, 0.5 * size), (SLOW / time[-1], 0.1 * white)):
        first = [white, slope, time[-1], wave, frequency, 0.5 * time[-1]]
        start = np.log(np.clip(first, *np.transpose(bounds)))  # a dead signal has no wave
        limits = np.log(bounds)
        searches.append(minimize(cost, start, method="L-BFGS-B", bounds=limits, options={"maxiter": 60, "ftol": 1e-7}))
    return make_disturbance(np.asarray(min(searches, key=lambda search: float(search.fun)).x))
