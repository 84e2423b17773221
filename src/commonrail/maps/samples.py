"""Quantity over energising time at each rail pressure: samples, where they fall, and brackets of a quantity."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.maps.response import Response

__all__ = ["FALL", "Fall", "Line", "falls_of", "knots_of"]


# Spacing of the energising times that are simulated: within the first half millisecond, where the needle turns round
# before its stop, a fall of the quantity is some tens of microseconds wide; later the quantity is nearly a line.
FINE_UNTIL = 500e-6  # [s]
FINE = 12.5e-6  # [s]
SHORTEST = 50e-6  # below it no injector opens its needle [s]
GROWTH = 1.12  # ratio of neighbouring times beyond the fine range

FALL = 0.01e-9  # smallest fall of the quantity that is named [m³]: half the tolerance of the inverse


class Fall(NamedTuple):
    """Energising times between which the quantity falls though the injector is energised longer.

    Attributes
    ----------
    rail_pressure : float
        [Pa].
    start, end : float
        Energising times at the largest and the smallest quantity [s].
    high, low : float
        Quantities there [m³].
    """

    rail_pressure: float
    start: float
    end: float
    high: float
    low: float


class Line(NamedTuple):
    """Samples at one rail pressure [Pa], sorted: energising times [s], volumes [m³] and largest lifts [m].

    A volume is NaN where the simulation failed.
    """

    rail_pressure: float
    time: Floats
    volume: Floats
    lift: Floats

    def joined(self, time: Floats, found: Response) -> Line:
        """Line with more samples.

        Parameters
        ----------
        time : (n,)
            [s].
        found : Response
            Of those times.
        """
        times = np.concatenate([self.time, time])
        order = np.argsort(times, kind="stable")
        volume = np.concatenate([self.volume, found.volume])[order]
        return Line(self.rail_pressure, times[order], volume, np.concatenate([self.lift, found.lift])[order])

    def at(self, times: Floats) -> Response:
        """Samples at times [s] that are among them."""
        places = np.searchsorted(self.time, times)
        return Response(self.volume[places], self.lift[places])


def knots_of(times: Floats) -> Floats:
    """Energising times that are simulated at each rail pressure: an axis and a fine grid up to its end [s]."""
    longest = float(times[-1])
    count = int(np.ceil(np.log(max(longest / FINE_UNTIL, 1.0)) / np.log(GROWTH)))
    coarse = FINE_UNTIL * GROWTH ** np.arange(1, count)
    grid = np.concatenate([np.arange(SHORTEST, FINE_UNTIL + FINE / 2, FINE), coarse])
    # a grid time beside one of the axis would only repeat it
    apart = np.min(np.abs(grid[:, None] - times), axis=1) > FINE / 4
    return np.unique(np.concatenate([times, grid[(grid < longest) & apart]]))


def falls_of(line: Line, smallest: float = FALL) -> Iterator[Fall]:
    """Falls of the quantity along a line, each from its largest to its smallest quantity.

    Parameters
    ----------
    line : Line
    smallest : float
        Smaller falls are passed over [m³].
    """
    sound = np.flatnonzero(np.isfinite(line.volume))
    time, volume = line.time[sound], line.volume[sound]
    peak = trough = 0
    for i in range(1, len(time)):
        if volume[i] <= volume[trough]:
            trough = i
        elif volume[i] - volume[trough] > smallest or volume[i] > volume[peak]:  # it rises again
            yield from _fall(line, time, volume, (peak, trough), smallest)
            peak = trough = i
        if volume[i] >= volume[peak]:
            peak = trough = i
    if len(time):
        yield from _fall(line, time, volume, (peak, trough), smallest)


def _fall(line: Line, time: Floats, volume: Floats, ends: tuple[int, int], smallest: float) -> Iterator[Fall]:
    peak, trough = ends
    if volume[peak] - volume[trough] > smallest:
        times, volumes = time[[peak, trough]].tolist(), volume[[peak, trough]].tolist()
        yield Fall(line.rail_pressure, *times, *volumes)
