"""Analytic rates of injection: straight pieces, whose means between bounds are exact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.engine.operating_point import Energising
from commonrail.plugins.features.rate_trace import RateTrace

SAMPLE = 5e-6  # [s]
PEAK = 50e-6  # [m³/s]


def straight(
    time: Sequence[float],
    rate: Sequence[float],
    begin: float = -200e-6,
    end: float = 2e-3,
    sample: float = SAMPLE,
    energisings: Sequence[tuple[float, float]] = (),
) -> RateTrace:
    """Means of a rate that is linear between times [s], zero before and after them.

    The samples begin a third of a sample after `begin`, so that no corner lies on a bound.
    """
    bounds = np.arange(begin, end, sample) + sample / 3.0
    knots = np.array(time)
    values = np.array(rate)
    before = np.concatenate(([0.0], np.cumsum(np.diff(knots) * 0.5 * (values[1:] + values[:-1]))))
    inside = np.clip(bounds, knots[0], knots[-1])
    i = np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, len(knots) - 2)
    into = inside - knots[i]
    slope = (values[i + 1] - values[i]) / (knots[i + 1] - knots[i])
    volume = before[i] + into * (values[i] + 0.5 * slope * into)
    pulses = tuple(Energising(*pair) for pair in energisings)
    return RateTrace(bounds, np.diff(volume) / np.diff(bounds), energisings=pulses)


def trapezoid(**more: object) -> RateTrace:
    """Ramps of 150 and 100 us, from 300 to 1000 us, energised from 0 to 700 us."""
    corners = (300e-6, 450e-6, 900e-6, 1000e-6)
    return straight(corners, (0.0, PEAK, PEAK, 0.0), energisings=[(0.0, 700e-6)], **more)  # type: ignore[arg-type]


def noisy(trace: RateTrace, share: float, seed: int) -> RateTrace:
    """The trace with white noise whose standard deviation is a share of the peak."""
    noise = share * PEAK * np.random.default_rng(seed).normal(size=len(trace.rate))
    return RateTrace(trace.bounds, trace.rate + noise, trace.unit, trace.energisings)
