"""Interpolation of a quantity map: the trivial model that a calibrated one has to beat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["SCALES", "Interpolation", "interpolate", "interpolate_line"]

Floats = NDArray[np.float64]

# Exponents of the rail pressure in which an interpolation is linear: p, and √p, which the flow of an orifice follows.
SCALES: Mapping[str, float] = {"p": 1.0, "√p": 0.5}
SAME = 1e-9  # relative difference within which two pressures or times are one


class Interpolation(NamedTuple):
    """Interpolated values (n,), and which of them are extrapolated (n,)."""

    values: Floats
    extrapolated: NDArray[np.bool_]


def interpolate(known: Floats, at: Floats, exponent: float = 1.0) -> Interpolation:
    """Quantities by interpolation of known ones: in energising time at each rail pressure, then in pressure.

    Linear in energising time and in a power of the rail pressure; for a map that is bilinear in them it is exact.
    Beyond the known points the nearest two are continued, and no quantity is less than zero.

    Parameters
    ----------
    known : (m, 3)
        Rail pressure [Pa], energising time [s] and quantity [m³]; one or more rows. Values at the same place are
        averaged.
    at : (n, 2)
        Rail pressures [Pa] and energising times [s] that are asked for.
    exponent : float
        Power of the rail pressure, see `SCALES`.
    """
    lines = {rail: _line(known[_near(known[:, 0], rail), 1:]) for rail in _distinct(known[:, 0])}
    rails = np.array(sorted(lines))
    values, extrapolated = np.empty(len(at)), np.empty(len(at), bool)
    for i, (rail, time) in enumerate(at.tolist()):
        around = _around(rails, rail)
        found = [interpolate_line(*lines[float(rails[k])], time) for k in around]
        value, beyond = interpolate_line(rails[around] ** exponent, np.array([v for v, _ in found]), rail**exponent)
        values[i], extrapolated[i] = max(value, 0.0), beyond or any(outside for _, outside in found)
    return Interpolation(values, extrapolated)


def interpolate_line(x: Floats, y: Floats, at: float) -> tuple[float, bool]:
    """Value between the two nearest points, and True if it is extrapolated; one point alone is taken as constant.

    Parameters
    ----------
    x : (m,)
        Places, rising.
    y : (m,)
        Values there.
    at : float
        Place that is asked for.
    """
    outside = not x[0] * (1.0 - SAME) <= at <= x[-1] * (1.0 + SAME)
    if len(x) == 1:
        return float(y[0]), outside
    low, high = _around(x, at)
    return float(y[low] + (at - x[low]) / (x[high] - x[low]) * (y[high] - y[low])), outside


def _around(x: Floats, at: float) -> Sequence[int]:
    """Places in x of the two neighbours of a value, or of the nearest two beyond the ends."""
    if len(x) == 1:
        return [0]
    high = int(np.clip(np.searchsorted(x, at), 1, len(x) - 1))
    return [high - 1, high]


def _line(pairs: Floats) -> tuple[Floats, Floats]:
    """Rising places of pairs (m, 2), and the mean value at each."""
    x = _distinct(pairs[:, 0])
    return x, np.array([pairs[_near(pairs[:, 0], place), 1].mean() for place in x])


def _near(values: Floats, value: float) -> NDArray[np.bool_]:
    return np.isclose(values, value, rtol=SAME, atol=0.0)


def _distinct(values: Floats) -> Floats:
    """Values in rising order, those within rounding of one another once."""
    rising = np.sort(values)
    return np.asarray(rising[np.concatenate([[True], np.diff(rising) > SAME * rising[1:]])])
