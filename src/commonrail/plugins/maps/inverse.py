"""Inverse of a quantity map: find the energising time of a quantity by simulation, not by interpolation.

Each cell has a bracket of two simulated energising times, which Chandrupatla's method (Advances in Engineering Software
28, 1997) narrows. All open cells of a round are simulated at once. A cell is finished when the simulated quantity meets
its target; so every cell without a special state is confirmed by a simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Bools, Floats, IndexArray, Ints
from commonrail.plugins.maps.choices import Beyond, CellState, Several
from commonrail.plugins.maps.response import Line, Response, find_falls

# Responses (n,) of lines, given by their indices (n,), at energising times (n,) [s].
Simulate = Callable[[IndexArray, Floats], Response]

Cell = tuple[int, int]  # pressure, quantity

TOLERANCE = 0.01e-9  # of a delivered quantity [m³]
NARROWEST = 10e-9  # bracket width below which a missed quantity counts as skipped [s]; control units resolve 100 ns
INSIDE = 0.02  # least distance of the next time from both ends, as a share of the bracket: each round narrows it
ROUNDS = 500  # to spread times into neighbours with several brackets; more than the cells of an axis


class Rules(NamedTuple):
    """Rules for cells with several energising times and for unreachable cells."""

    several: Several = Several.NEIGHBOURS
    beyond: Beyond = Beyond.EXTRAPOLATE


class Inverse(NamedTuple):
    """Energising times (pressures, quantities) [s], delivered volumes [m³], largest lifts [m], and states.

    A missing time is NaN, and so are volume and lift of cells that were not simulated.
    """

    energising_time: Floats
    delivered: Floats
    lift: Floats
    state: Ints


class _Cells(NamedTuple):
    """Open cells (n,): places (2, n), target volumes, simulated times [s] and their misses (3, n) [m³].

    The first two times enclose the target volume; the third is the one that was replaced last.
    """

    place: IndexArray
    target: Floats
    time: Floats
    miss: Floats

    def only(self, mask: Bools) -> _Cells:
        """Cells of a mask."""
        return _Cells(self.place[:, mask], self.target[mask], self.time[:, mask], self.miss[:, mask])


def sample_lines(simulate: Simulate, rail_pressure: Floats, times: Floats) -> list[Line]:
    """Simulate lines at rail pressures (n,) [Pa] and the same energising times (m,) [s]."""
    shape = len(rail_pressure), len(times)
    response = simulate(np.repeat(np.arange(shape[0]), shape[1]), np.tile(times, shape[0]))
    samples = zip(rail_pressure.tolist(), response.volume.reshape(shape), response.lift.reshape(shape), strict=True)
    return [Line(pressure, times, volume, lift) for pressure, volume, lift in samples]


def invert(simulate: Simulate, lines: list[Line], quantity: Floats, rules: Rules) -> tuple[Inverse, list[Line]]:
    """Find energising times for quantities (k,) [m³] on lines; return them and the lines with the new samples.

    `simulate` takes indices of lines (n,) and energising times (n,) [s]. Consecutive lines with increasing rail
    pressure belong to one map: they are neighbours.
    """
    shape = len(lines), len(quantity)
    number = np.full(shape, np.nan)
    inverse = Inverse(number, number.copy(), number.copy(), np.full(shape, int(CellState.FAILED)))
    brackets: dict[Cell, Floats] = {}
    for i, j in np.ndindex(shape):
        around = _brackets(inverse, (i, j), lines[i], float(quantity[j]), rules.beyond)
        if len(around):
            brackets[i, j] = around
    if brackets:
        branch = _branches(brackets, [line.rail_pressure for line in lines], shape, rules.several)
        place = np.array(list(brackets), np.intp).T
        around = np.array([brackets[cell][branch[cell]] for cell in brackets]).transpose(1, 2, 0)
        lines = _search(simulate, inverse, lines, _Cells(place, quantity[place[1]], around[0], around[1]))
    for row, line in enumerate(lines):  # a quantity inside a fall has several energising times
        for fall in find_falls(line):
            inside = (quantity >= fall.low) & (quantity <= fall.high) & (inverse.state[row] == CellState.REACHED)
            inverse.state[row, inside] = CellState.SEVERAL
    return inverse, lines


def _brackets(inverse: Inverse, cell: Cell, line: Line, target: float, beyond: Beyond) -> Floats:
    """Find the brackets (n, 2, 3) of a cell, one for each time at which the quantity rises past `target` [m³].

    Each has three times and their misses, as in `_Cells`. Empty if the cell needs no search.
    """
    none = np.empty((0, 2, 3))
    if target == 0.0:
        inverse.energising_time[cell] = inverse.delivered[cell] = 0.0
        inverse.state[cell] = CellState.ZERO
        return none
    sound = np.isfinite(line.volume)
    if not sound.any():
        return none
    time = np.concatenate([[0.0], line.time[sound]])
    miss = np.concatenate([[0.0], line.volume[sound]]) - target
    at = np.flatnonzero((miss[:-1] < 0.0) & (miss[1:] >= 0.0))
    if not len(at):
        inverse.energising_time[cell], inverse.state[cell] = _beyond(time, miss, beyond), CellState.BEYOND
    places = np.stack([at, at + 1, np.maximum(at - 1, 0)], axis=1)
    return np.stack([time[places], miss[places]], axis=1)


def _branches(
    brackets: Mapping[Cell, Floats], rail_pressure: list[float], shape: tuple[int, int], several: Several
) -> dict[Cell, int]:
    """Choose the bracket of each cell by the rule.

    NEIGHBOURS: the expected time of a cell with several brackets is the mean of its neighbours over rail pressure and
    quantity, starting from cells with one bracket. The rule takes the bracket nearest to the expected time, among
    brackets after the time of the next smaller quantity.
    """
    if several is not Several.NEIGHBOURS:
        return {cell: 0 if several is Several.SHORTEST else len(around) - 1 for cell, around in brackets.items()}
    times = {cell: _chord(around) for cell, around in brackets.items()}
    expected, open_ = np.full(shape, np.nan), np.zeros(shape, bool)
    for cell, candidates in times.items():
        expected[cell] = candidates[0] if len(candidates) == 1 else np.nan
        open_[cell] = len(candidates) > 1
    same_map = np.diff(rail_pressure) > 0.0
    for _ in range(ROUNDS if open_.any() else 0):
        around = np.full((4, *shape), np.nan)
        around[0, 1:][same_map], around[1, :-1][same_map] = expected[:-1][same_map], expected[1:][same_map]
        around[2, :, 1:], around[3, :, :-1] = expected[:, :-1], expected[:, 1:]
        count = np.isfinite(around).sum(axis=0)
        expected = np.where(open_ & (count > 0), np.nansum(around, axis=0) / np.maximum(count, 1), expected)
    branch, last = dict[Cell, int](), dict[int, float]()
    for (i, j), candidates in times.items():
        distance = np.abs(candidates - np.nan_to_num(expected[i, j]))
        branch[i, j] = int(np.argmin(np.where(candidates >= last.get(i, 0.0), distance, np.inf)))
        last[i] = float(candidates[branch[i, j]])
    return branch


def _chord(brackets: Floats) -> Floats:
    """Times (n,) [s] at which straight lines through the first two points of brackets (n, 2, 3) meet the target."""
    (t0, t1), (m0, m1) = brackets[:, 0, :2].T, brackets[:, 1, :2].T
    return np.asarray(t0 - m0 * (t1 - t0) / (m1 - m0))


def _beyond(time: Floats, miss: Floats, rule: Beyond) -> float:
    """Energising time of an unreachable quantity, by the rule."""
    if rule is Beyond.EMPTY:
        return float("nan")
    slope = (miss[-1] - miss[-2]) / (time[-1] - time[-2]) if len(time) > 2 else 0.0
    if rule is Beyond.HOLD or not slope > 0.0:
        return float(time[-1])
    return float(time[-1] - miss[-1] / slope)


def _search(simulate: Simulate, inverse: Inverse, lines: list[Line], cells: _Cells) -> list[Line]:
    """Search all open cells in `inverse`; return the lines with the samples that were simulated."""
    simulated: list[tuple[IndexArray, Floats, Response]] = []
    while cells.place.size:
        near, far, _ = cells.time
        narrow = np.abs(far - near) <= NARROWEST
        time = np.where(narrow, np.maximum(near, far), near + _share(cells, first=not simulated) * (far - near))
        response = simulate(cells.place[0], time)
        simulated.append((cells.place[0], time, response))
        miss = response.volume - cells.target
        done = (np.abs(miss) <= TOLERANCE) | narrow | ~np.isfinite(miss)
        _store(inverse, cells.only(done), time[done], response.only(done))
        cells = _narrow(cells, time, miss).only(~done)
    rows, times = (np.concatenate([s[i] for s in simulated]) for i in (0, 1))
    both = Response(*(np.concatenate([getattr(s[2], name) for s in simulated]) for name in ("volume", "lift")))
    return [line.add_samples(times[rows == row], both.only(rows == row)) for row, line in enumerate(lines)]


def _share(cells: _Cells, first: bool) -> Floats:
    """Share of the way from the first to the second time at which each cell is simulated next.

    Inverse quadratic interpolation if the three points are smooth enough, else one half (in the first round the
    chord).
    """
    (x1, x2, x3), (f1, f2, f3) = cells.time, cells.miss
    with np.errstate(divide="ignore", invalid="ignore"):
        xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
        smooth = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
        curved = f1 / (f2 - f1) * f3 / (f2 - f3) + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        share = np.where(smooth, curved, f1 / (f1 - f2) if first else 0.5)
    return np.asarray(np.clip(share, INSIDE, 1.0 - INSIDE))


def _narrow(cells: _Cells, time: Floats, miss: Floats) -> _Cells:
    """Shrink the brackets: the simulated time becomes the first end, and the replaced end the third point."""
    same = (miss < 0.0) == (cells.miss[0] < 0.0)

    def shift(new: Floats, old: Floats) -> Floats:
        return np.stack([new, np.where(same, old[1], old[0]), np.where(same, old[0], old[1])])

    return cells._replace(time=shift(time, cells.time), miss=shift(miss, cells.miss))


def _store(inverse: Inverse, cells: _Cells, time: Floats, response: Response) -> None:
    """Write finished cells into `inverse`."""
    at = cells.place[0], cells.place[1]
    sound = np.isfinite(response.volume)
    inverse.energising_time[at] = np.where(sound, time, np.nan)
    inverse.delivered[at], inverse.lift[at] = response.volume, response.lift
    met = np.abs(response.volume - cells.target) <= TOLERANCE
    inverse.state[at] = np.select([~sound, met], [int(CellState.FAILED), int(CellState.REACHED)], int(CellState.JUMP))
