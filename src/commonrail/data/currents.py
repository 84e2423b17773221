"""Energisings in the current of a coil: peak and hold of any driver, sampled about as fast as they are long.

A command begins at the foot of the current's rise. It ends where the last steep fall begins, at whatever level the
current has just before. Where samples are too few for a straight line, an edge is the middle of its rise or fall less
half of its duration: samples fall evenly into the edges of a record, so that their mean number tells their duration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_closing

from commonrail.base.arrays import Bools, Floats

RISEN, SIGNIFICANT = 0.1, 5.0  # share of the range, and standard deviations of the noise, beyond which a current flows
PAUSE = 50e-6  # shorter pauses of a current are its noise [s]
STEEP, SETTLED = 0.7, 0.75  # shares of the level before, to which a steep fall leads in a sample, and a plateau keeps
ALIKE = 0.5  # share of the steepest step of a fall or rise above which its neighbours belong to it
FINEST = 5e-6  # time over which faster samples are averaged [s]
QUICK = 60e-6  # longest fall, or two samples [s]
SHARE, LEAST = 0.6, 5e-6  # largest error of a duration: a share of the sampling interval, and a time [s]; of a trial


class Reading(NamedTuple):
    """Energising as read from a current.

    `start` and `duration` [s]; `error`: that of 95 % of durations is smaller [s], infinite where no end was found.
    """

    start: float
    duration: float
    error: float


class _Edges(NamedTuple):
    """Middle of the rise, samples in it, its foot; middle of the fall, samples in it, its top: times [s] or NaN."""

    rise: float = np.nan
    rising: float = np.nan
    foot: float = np.nan
    fall: float = np.nan
    falling: float = np.nan
    top: float = np.nan


def flow_of(time: Floats, value: Floats) -> tuple[Floats, Bools]:
    """Current less its level at rest (samples,) [A], and whether it flows, without pauses of noise."""
    low = value[value <= 0.5 * (value.min() + value.max())]
    current = value - np.median(low)
    noise = 1.4826 * float(np.median(np.abs(low - np.median(low))))  # of a normal distribution
    high = current > max(RISEN * float(current.max()), SIGNIFICANT * noise)
    wide = max(int(PAUSE / float(np.median(np.diff(time)))), 1)
    return current, np.asarray(binary_closing(np.pad(high, wide), np.ones(wide))[wide:-wide], bool)


def read_energisings(time: Floats, value: Floats) -> list[Reading]:
    """Energisings of a current `value` at evenly spaced times (samples,) [s], in order.

    One that the record cuts reaches a sampling interval beyond its edge.
    """
    many = max(int(FINEST / float(np.median(np.diff(time)))), 1)
    time, value = (array[: len(array) // many * many].reshape(-1, many).mean(axis=1) for array in (time, value))
    if len(time) < 2:
        return []  # shorter than two averages: no edge to be read
    current, on = flow_of(time, value)
    step, n = float(np.median(np.diff(time))), len(time)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]))).reshape(-1, 2).tolist()
    peak = float(np.median([current[a:b].max() for a, b in ends] or [0.0]))
    rows = np.array([_edges(time, current, a, b, peak) if a > 0 and b < n else _Edges() for a, b in ends])
    if not len(rows):
        return []
    rise, rising, foot, fall, falling, top = rows.T
    whole = np.isfinite(rise + fall)
    long = [step * float(np.mean(many[whole])) / 0.8 if whole.any() else 0.0 for many in (rising, falling)]
    start = np.where(np.isfinite(foot), foot, rise - 0.5 * long[0])
    end = np.where(np.isfinite(top), top, fall - 0.5 * long[1])
    first, last = (np.array(column) for column in zip(*ends, strict=True))
    begun = np.where(np.isfinite(start), start, time[first] - step)
    ended = np.where(whole, end, time[np.minimum(last, n - 1)] + step * (last == n))
    error = np.where(whole | (first == 0) | (last == n), SHARE * step + LEAST, np.inf)
    return [Reading(*row) for row in np.column_stack([begun, ended - begun, error]).tolist()]


def _edges(time: Floats, current: Floats, first: int, end: int, peak: float) -> _Edges:
    """Edges of the current that flows in the samples from `first` to before `end`; no fall where none is steep."""
    step, own = float(time[1] - time[0]), current[first - 1 : end + 1]
    at, peak = time[first - 1 : end + 1], min(peak, float(own.max()))
    k = int(np.argmax(own >= 0.5 * peak)) - 1
    risen = np.arange(max(int(np.argmax(own >= 0.9 * peak)), 1))
    low = risen[(own[risen] > 0.1 * peak) & (own[risen] < 0.6 * peak)]
    low = low[: max(3, len(low) // 2)]  # a rise bends
    rising = float(np.count_nonzero(own[risen] > 0.1 * peak))
    foot = _crossing(at, own, low, 0.0) if len(low) > 1 else np.nan
    edges = _Edges(_between(at, own, k, 0.5 * peak), rising, foot)
    drop = -np.diff(own)
    wide = max(round(4.0 * FINEST / step), 1)
    steep = np.flatnonzero((own[wide:] <= STEEP * own[:-wide]) & (own[:-wide] >= 2.0 * RISEN * peak))
    if not len(steep):
        return edges
    f = q = int(steep[-1]) + int(np.argmax(drop[steep[-1] : steep[-1] + wide]))
    while f > 1 and drop[f - 1] >= ALIKE * drop[f : q + 1].max():
        f -= 1
    level = own[f]
    after = own[f:]
    if (q + 1 - f) * step > max(2.01 * step, QUICK) or own[f - 1] > level / SETTLED or after.min() > 0.5 * level:
        return edges
    k = f + int(np.argmax(after <= 0.5 * level)) - 1
    falling = float(np.count_nonzero((after > 0.1 * level) & (after < 0.9 * level)))
    top = _crossing(at, own, np.arange(f + 1, q + 1), level) if q - f > 1 else np.nan
    return edges._replace(fall=_between(at, own, k, 0.5 * level), falling=falling, top=top)


def _between(time: Floats, current: Floats, k: int, level: float) -> float:
    """Time at which a current passes a level between samples k and k + 1 [s]."""
    return float(time[k] + (level - current[k]) / (current[k + 1] - current[k]) * (time[k + 1] - time[k]))


def _crossing(time: Floats, current: Floats, samples: np.ndarray, level: float) -> float:
    """Time at which the straight line through some samples passes a level [s]."""
    slope, base = np.polyfit(time[samples] - time[0], current[samples], 1)
    return float(time[0] + (level - base) / slope)
