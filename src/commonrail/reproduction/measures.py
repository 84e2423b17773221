"""Measures of curves and searches: edges, phases, convergence, quartiles. Pure functions of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import commonrail as cr
from commonrail.arrays import Floats, IndexArray

__all__ = ["PHASES", "Box", "Edges", "Spread", "box", "edges", "j_by_phase", "ninety_percent", "spread"]


EDGE_SHARE = 0.1  # of the experiment's greatest rate: an injection has begun, or not yet ended, above it
PHASE_LENGTH = 0.4e-3  # Sec. 5 speaks of 0–0.4 ms, the middle, and the descent up to 1.2 ms
PHASES = ("before opening", "0–0.4 ms", "0.4–0.8 ms", "0.8 ms to the end")


class Spread(NamedTuple):
    """Median and quartiles; NaN if there is no finite value."""

    median: float
    q1: float
    q3: float


class Box(NamedTuple):
    """Box plot; minimum and maximum are those of the values within 1.5 interquartile ranges of the box."""

    minimum: float
    q1: float
    median: float
    q3: float
    maximum: float


class Edges(NamedTuple):
    """Begin and end of an injection curve [s]; NaN where there is none."""

    opening: float
    closing: float


def spread(values: ArrayLike) -> Spread:
    """Median and quartiles of the finite values."""
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    if not len(finite):
        return Spread(np.nan, np.nan, np.nan)
    q1, median, q3 = np.percentile(finite, (25.0, 50.0, 75.0))
    return Spread(float(median), float(q1), float(q3))


def box(values: ArrayLike) -> Box:
    """Box plot with outliers suppressed, as the paper's Fig. 5."""
    v = np.asarray(values, float).ravel()
    q1, median, q3 = np.percentile(v, (25.0, 50.0, 75.0))
    reach = 1.5 * (q3 - q1)
    kept = v[(v >= q1 - reach) & (v <= q3 + reach)]
    return Box(float(kept.min()), float(q1), float(median), float(q3), float(kept.max()))


def edges(rate: Floats, bounds: Floats, level: float) -> Edges:
    """First rise and last fall of a curve through a level, linear between the middles of the samples.

    Parameters
    ----------
    rate : (n,)
        [m³/s].
    bounds : (n + 1,)
        Of the samples [s].
    level : float
        [m³/s].
    """
    middle = 0.5 * (bounds[1:] + bounds[:-1])
    above = rate > level
    rises = np.flatnonzero(~above[:-1] & above[1:])
    falls = np.flatnonzero(above[:-1] & ~above[1:])

    def crossing(found: IndexArray, which: int) -> float:
        if not len(found):
            return float("nan")
        i = int(found[which])
        share = (level - rate[i]) / (rate[i + 1] - rate[i])
        return float(middle[i] + share * (middle[i + 1] - middle[i]))

    return Edges(crossing(rises, 0), crossing(falls, -1))


def level_of(measured: Floats) -> float:
    """Level at which edges are read: a share of the experiment's greatest rate."""
    return EDGE_SHARE * float(np.max(measured))


def j_by_phase(rate: Floats, measured: Floats, bounds: Floats, opening: float) -> Floats:
    """Parts of J [mm³/ms] in the phases of `PHASES`; they add up to J.

    Parameters
    ----------
    rate, measured : (n,)
        [m³/s].
    bounds : (n + 1,)
        Of the samples [s].
    opening : float
        Of the experiment [s]; phases count from it.
    """
    middle = 0.5 * (bounds[1:] + bounds[:-1])
    phase = np.digitize(middle - opening, (0.0, PHASE_LENGTH, 2.0 * PHASE_LENGTH))
    error = np.abs(rate - measured) * 1e6
    return np.array([float(np.sum(error[phase == i])) for i in range(len(PHASES))])


def ninety_percent(history: Sequence[cr.Generation]) -> float:
    """First generation at which 90 % of what the search gains over its initial population is reached."""
    best = np.array([g.best for g in history])
    if not np.isfinite(best[[0, -1]]).all():
        return float("nan")
    return float(np.argmax(best <= best[0] - 0.9 * (best[0] - best[-1])))
