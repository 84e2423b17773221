"""Operating point around which a sweep moves, and the points of many combinations at once."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import NamedTuple, overload

import numpy as np

from commonrail.arguments import Limits
from commonrail.arrays import Bools, Floats
from commonrail.engine.operating_point import (
    ENERGISING_TIMES,
    LONGEST,
    OTHER_PRESSURES,
    RAIL_PRESSURES,
    Energising,
    OperatingPoint,
)
from commonrail.maps.response import Conditions

__all__ = ["Base", "Points"]


AFTER = 5e-3  # simulated after the last energising; it ends early once the needle has closed [s]


class Base(NamedTuple):
    """Operating point around which a sweep moves; SI values.

    Attributes
    ----------
    rail_pressure : float
        [Pa].
    energising_time : float
        Of the injection, or of the second of two [s].
    first_energising_time : float
        Of the first of two injections; 0 for a single one [s].
    dwell : float
        End of the first energising to the start of the second [s].
    conditions : Conditions
    """

    rail_pressure: float
    energising_time: float
    first_energising_time: float
    dwell: float
    conditions: Conditions

    def point(self, changed: Mapping[str, float], alone: bool = False) -> OperatingPoint:
        """Operating point with some variables changed.

        Parameters
        ----------
        changed : mapping of str to float
            Values by the names of `OPERATING`.
        alone : bool
            With the first of two injections alone.
        """
        own = self._asdict() | self.conditions._asdict() | dict(changed)
        first, second = own["first_energising_time"], own["energising_time"]
        pulses = [(0.0, first)] if first > 0.0 else []
        if not alone:
            pulses.append((first + own["dwell"] if pulses else 0.0, second))
        end = pulses[-1][0] + pulses[-1][1]
        pressures = own["rail_pressure"], own["cylinder_pressure"], own["return_pressure"]
        return OperatingPoint(pressures[0], tuple(pulses), *pressures[1:], horizon=end + AFTER)

    def points(self, changed: Mapping[str, Floats], count: int, alone: bool = False) -> Points:
        """Operating points as `point` makes each of them, in a tenth of the time, and made when they are needed.

        All values are compared with the limits of operating points at once. A point outside is made by `point`, which
        says what is wrong with it.

        Parameters
        ----------
        changed : mapping of str to (count,)
            Values by the names of `OPERATING`.
        count : int
        alone : bool
            With the first of two injections alone.
        """
        own = self._asdict() | self.conditions._asdict() | dict(changed)
        names = ("rail_pressure", "cylinder_pressure", "return_pressure")
        pressures = [np.broadcast_to(np.asarray(own[name], float), count) for name in names]
        first, second, dwell = (
            np.broadcast_to(np.asarray(own[name], float), count)
            for name in ("first_energising_time", "energising_time", "dwell")
        )
        before = first > 0.0
        start = np.where(before, first + dwell, 0.0)
        end = np.where(alone, first, start + second)
        sound = _within(pressures[0], RAIL_PRESSURES) & _within(first, ENERGISING_TIMES) & (end + AFTER <= LONGEST)
        for pressure in pressures[1:]:
            sound &= _within(pressure, OTHER_PRESSURES) & (pressure < pressures[0])
        sound &= before if alone else _within(second, ENERGISING_TIMES) & (start >= np.where(before, first, 0.0))
        others = {
            int(i): self.point({name: float(values[i]) for name, values in changed.items()}, alone)
            for i in np.flatnonzero(~sound)
        }
        return Points(np.stack([*pressures, first, start, second, end + AFTER], axis=1), alone, others)


class Points(Sequence[OperatingPoint]):
    """Operating points of many combinations; those of a slice are made when it is taken.

    Parameters
    ----------
    rows : (points, 7)
        Checked values: three pressures, first energising, start and length of the last, horizon.
    alone : bool
        With the first of two injections alone.
    others : mapping of int to OperatingPoint
        Points that are not made of their rows.
    """

    def __init__(self, rows: Floats, alone: bool, others: Mapping[int, OperatingPoint]) -> None:
        self._rows, self._alone, self._others = rows, alone, others

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, index: int) -> OperatingPoint: ...
    @overload
    def __getitem__(self, index: slice) -> list[OperatingPoint]: ...
    def __getitem__(self, index: int | slice) -> OperatingPoint | list[OperatingPoint]:
        if isinstance(index, int):
            return self[index : index + 1 or None][0]
        places = range(len(self))[index]
        rows = zip(places, self._rows[index].tolist(), strict=True)
        return [self._others.get(i) or _made(row, self._alone) for i, row in rows]

    @property
    def last_starts(self) -> Floats:
        """Starts of the last energisings [s]."""
        return np.asarray(self._rows[:, 4])


def _within(values: Floats, limits: Limits) -> Bools:
    return np.asarray((values >= limits.low) & (values <= limits.high))


def _made(row: Sequence[float], alone: bool) -> OperatingPoint:
    """Operating point of checked values: three pressures, first energising, start and length of the last, horizon."""
    rail, cylinder, back, first, start, second, horizon = row
    before = (_energising(0.0, first),) if first > 0.0 else ()
    point = object.__new__(OperatingPoint)
    point.__dict__.update(
        rail_pressure=rail,
        energisings=before if alone else (*before, _energising(start, second)),
        cylinder_pressure=cylinder,
        return_pressure=back,
        drive=None,
        horizon=horizon,
        start=0.0,
    )
    return point


@functools.lru_cache(maxsize=10_000)
def _energising(start: float, duration: float) -> Energising:
    """Energising of checked values: the points of a sweep share most of theirs."""
    return Energising._make((start, duration))
