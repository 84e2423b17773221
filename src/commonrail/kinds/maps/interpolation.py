"""Interpolation of a quantity map: the trivial model that a calibrated one has to beat."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Bools, Floats

__all__ = ["SCALES", "Interpolation", "Rule", "interpolate", "interpolate_line", "pchip_slopes"]


# Exponents of the rail pressure in which an interpolation is linear: p, and √p, which the flow of an orifice follows.
SCALES: Mapping[str, float] = {"p": 1.0, "√p": 0.5}
SAME = 1e-9  # relative difference within which two pressures or times are one


class Rule(StrEnum):
    """Rule by which quantities are interpolated, in energising time and between rail pressures."""

    LINEAR = "linear"
    PCHIP = "PCHIP"
    """Piecewise cubic with continuous slope that is monotone where the points are (Fritsch and Butland 1984)."""


class Interpolation(NamedTuple):
    """Interpolated values (n,), and which of them are extrapolated (n,)."""

    values: Floats
    extrapolated: Bools


def interpolate(
    known: Floats, at: Floats, exponent: float = 1.0, rules: tuple[Rule, Rule] = (Rule.LINEAR, Rule.LINEAR)
) -> Interpolation:
    """Quantities by interpolation of known ones: in energising time at each rail pressure, then in pressure.

    For a map that is bilinear in energising time and in the power of the rail pressure all rules are exact. Beyond the
    known points the nearest two are continued as a line, and no quantity is less than zero.

    Parameters
    ----------
    known : (m, 3)
        Rail pressure [Pa], energising time [s] and quantity [m³]; one or more rows. Values at the same place are
        averaged.
    at : (n, 2)
        Rail pressures [Pa] and energising times [s] that are asked for.
    exponent : float
        Power of the rail pressure, see `SCALES`.
    rules : (Rule, Rule)
        In energising time and in pressure.
    """
    in_time, in_pressure = (_RULES[rule] for rule in rules)
    lines = {rail: _line(known[_near(known[:, 0], rail), 1:]) for rail in _distinct(known[:, 0])}
    rails = np.array(sorted(lines))
    values, extrapolated = np.empty(len(at)), np.empty(len(at), bool)
    for i, (rail, time) in enumerate(at.tolist()):
        found = [in_time(*lines[float(one)], time) for one in rails]
        value, beyond = in_pressure(rails**exponent, np.array([v for v, _ in found]), rail**exponent)
        around = [found[k][1] for k in _around(rails, rail)]
        values[i], extrapolated[i] = max(value, 0.0), beyond or any(around)
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


def _interpolate_curve(x: Floats, y: Floats, at: float) -> tuple[float, bool]:
    """As `interpolate_line`, on the cubic of `pchip_slopes` between the first and the last point."""
    line, outside = interpolate_line(x, y, at)
    if outside or len(x) < 3:
        return line, outside
    low, high = _around(x, at)
    slopes, width = pchip_slopes(x, y), x[high] - x[low]
    u = (at - x[low]) / width
    bend = (1.0 - u) * (slopes[low] * width - (y[high] - y[low])) - u * (slopes[high] * width - (y[high] - y[low]))
    return float(line + u * (1.0 - u) * bend), outside


def pchip_slopes(x: Floats, y: Floats) -> Floats:
    """Slopes (m,) of the monotone cubic through three points or more, rising in x (Fritsch and Butland 1984).

    Inside, the weighted harmonic mean of both neighbouring slopes, or zero at an extremum; at an end, that of the
    parabola through three points, limited so that the cubic stays monotone.
    """
    width = np.diff(x)
    slope = np.diff(y) / width
    found = np.zeros(len(x))
    for k in range(1, len(x) - 1):
        if slope[k - 1] * slope[k] > 0.0:
            before, behind = 2.0 * width[k] + width[k - 1], width[k] + 2.0 * width[k - 1]
            found[k] = (before + behind) / (before / slope[k - 1] + behind / slope[k])
    found[0] = _end_slope(width[0], width[1], slope[0], slope[1])
    found[-1] = _end_slope(width[-1], width[-2], slope[-1], slope[-2])
    return found


def _end_slope(width: float, following: float, slope: float, next_slope: float) -> float:
    """Slope at an end, of the width and slope there and of those of the interval beside it."""
    found = ((2.0 * width + following) * slope - width * next_slope) / (width + following)
    if found * slope <= 0.0:
        return 0.0
    steep = slope * next_slope <= 0.0 and abs(found) > 3.0 * abs(slope)
    return 3.0 * slope if steep else found


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


_RULES: Mapping[Rule, Callable[[Floats, Floats, float], tuple[float, bool]]] = {
    Rule.LINEAR: interpolate_line,
    Rule.PCHIP: _interpolate_curve,
}


def _near(values: Floats, value: float) -> Bools:
    return np.isclose(values, value, rtol=SAME, atol=0.0)


def _distinct(values: Floats) -> Floats:
    """Values in rising order, those within rounding of one another once."""
    rising = np.sort(values)
    return np.asarray(rising[np.concatenate([[True], np.diff(rising) > SAME * rising[1:]])])
