"""Energisings in the current of a coil: peak and hold of any driver, sampled at 200 kHz or more.

A command begins at the foot of the current's rise. It ends where the last steep fall begins, at whatever level the
current has just before. A reading whose duration is not known to `LIMIT` is refused.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_closing

from commonrail.base.arrays import Bools, Floats

RISEN, SIGNIFICANT = 0.1, 5.0  # share of the range, and standard deviations of the noise, beyond which a current flows
PAUSE = 50e-6  # shorter pauses of a current are its noise [s]
FINEST = 5e-6  # time over which faster samples are averaged [s]
WINDOW, STEEP, ALIKE = (
    20e-6,
    0.7,
    0.65,
)  # a steep fall leads in the window [s] to this share; share of its largest slope
LIMIT = 5e-6  # largest error of a duration [s]; chosen
FOOT, CURVED = 0.05, 0.65  # shares of an edge between which its time is a parabola of the share
EQUAL = 1.2  # ratio of heights up to which edges have one shape
BENT = 0.3  # share of a fall's slope that the current may have before it
FEWEST = 8  # free samples from which on the shape of an edge is a parabola
SAMPLES = 1.4  # on an edge, at least: fewer do not tell whether they lie on it
LEAST = 2e-6  # error of an edge that a line leaves, a parabola half of it; besides two standard deviations [s]


class Reading(NamedTuple):
    """Energising as read from a current.

    `start` and `duration` [s]; `error`: largest one of the duration [s], infinite where it is not known to `LIMIT`.
    """

    start: float
    duration: float
    error: float


def find_flow(time: Floats, value: Floats) -> tuple[Floats, Bools]:
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
    many = max(int(FINEST / float(np.median(np.diff(time))) * (1.0 + 1e-6)), 1)
    time, value = (array[: len(array) // many * many].reshape(-1, many).mean(axis=1) for array in (time, value))
    if len(time) < 2:
        return []  # shorter than two averages: no edge to be read
    current, on = find_flow(time, value)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]))).reshape(-1, 2).tolist()
    complete = [(first, end) for first, end in ends if first > 0 and end < len(time)]
    rises = [_rise(time, current, first, end) for first, end in complete]
    falls = [_fall(time, current, first, end) for first, end in complete]
    step, readings = float(np.median(np.diff(time))), list[Reading]()
    edges = iter(zip(_corners(rises), _corners(falls), strict=True))
    for first, end in ends:
        if (first, end) in complete:
            (start, early), (stop, late) = next(edges)
            error = early + late
            if not error <= LIMIT:
                start, stop, error = float(time[first]), float(time[end]), np.inf
        else:
            start, stop = float(time[first]) - step, float(time[min(end, len(time) - 1)]) + step * (end == len(time))
            error = LIMIT
        readings.append(Reading(start, stop - start, error))
    return readings


class _Edge(NamedTuple):
    """Samples about an edge of a height [A]: times (n,) [s] and shares (n,) of it, which leave zero at its corner."""

    time: Floats
    share: Floats
    height: float


def _rise(time: Floats, current: Floats, first: int, end: int) -> _Edge:
    near = slice(max(first - 3, 0), end)
    height = float(current[near].max())
    return _Edge(time[near], current[near] / height, height)


def _fall(time: Floats, current: Floats, first: int, end: int) -> _Edge:
    """Last steep fall of the current that flows in the samples from `first` to before `end`; empty without one."""
    flowing, at = current[first : end + 1], time[first : end + 1]
    wide = max(round(WINDOW / float(time[1] - time[0])), 1)
    drop = flowing[:-wide] - flowing[wide:]
    steep = np.flatnonzero((drop >= (1.0 - STEEP) * flowing[:-wide]) & (flowing[:-wide] >= 2.0 * RISEN * flowing.max()))
    top = int(steep[-1]) if len(steep) else 0
    while top > 0 and drop[top - 1] >= ALIKE * drop[top : steep[-1] + 1].max():
        top -= 1
    level = float(flowing[max(top - 1, 0) : top + 1].mean())
    if top < wide or flowing[top:].min() > 0.5 * level or drop[top - wide] > BENT * drop[top:].max():
        return _Edge(np.empty(0), np.empty(0), level)
    return _Edge(at[top - 1 :], 1.0 - flowing[top - 1 :] / level, level)


def _corners(edges: list[_Edge]) -> list[tuple[float, float]]:
    """Corners of edges [s] and their errors [s]; edges of about one height have one shape.

    A pilot that is cut near the peak falls for longer than a main from its hold.
    """
    groups = list[list[int]]()
    for i in sorted(range(len(edges)), key=lambda i: edges[i].height):
        if not groups or edges[i].height > EQUAL * edges[groups[-1][0]].height:
            groups.append([])
        groups[-1].append(i)
    corners = [(np.nan, np.inf)] * len(edges)
    for group in groups:
        for i, corner in zip(group, _corners_of_shape([edges[i] for i in group]), strict=True):
            corners[i] = corner
    return corners


def _corners_of_shape(edges: list[_Edge]) -> list[tuple[float, float]]:
    """Corners of edges of one shape [s], and their errors [s]: infinite where the samples do not tell them.

    The time since the corner is a parabola of the share, of few samples a line, the same in all edges: least squares
    with a corner of each.
    """
    on = [_on_edge(edge) for edge in edges]
    counts = [len(time) for time, _ in on if len(time)]
    free = sum(counts) - len(counts)
    order = 2 if free >= 2 + FEWEST else 1
    free -= order
    if free < max(2, len(counts) * (SAMPLES - 1.0) - order):
        return [(np.nan, np.inf)] * len(edges)
    terms = [share[:, None] ** np.arange(1, order + 1) for _, share in on]
    within = np.concatenate([powers - powers.mean(axis=0) for powers in terms if len(powers)])
    centred_time = np.concatenate([time - time.mean() for time, _ in on if len(time)])
    inverse = np.linalg.pinv(within.T @ within)
    bend = inverse @ within.T @ centred_time
    deviation = 2.0 * (1.0 + 2.0 / free) * float(np.sqrt(np.sum((centred_time - within @ bend) ** 2) / free))
    corners = list[tuple[float, float]]()
    for (time, _), powers in zip(on, terms, strict=True):
        corner, error = np.nan, np.inf
        if len(time):
            middle = powers.mean(axis=0)
            corner = float(np.mean(time - powers @ bend))
            error = LEAST / order + deviation * float(np.sqrt(1.0 / len(time) + middle @ inverse @ middle))
        corners.append((corner, error))
    return corners


def _on_edge(edge: _Edge) -> tuple[Floats, Floats]:
    """Times and shares of the samples on an edge."""
    end = int(np.argmax(edge.share > CURVED)) if len(edge.share) else 0
    first = int(np.flatnonzero(np.concatenate([[-1.0], edge.share[:end]]) <= FOOT)[-1])
    return edge.time[first:end], edge.share[first:end]
