"""The loop that the lanes run, for one lane whose memory is its caller's, and the inputs of its coming steps."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import sequence, shown
from commonrail.base.arrays import Floats
from commonrail.base.choices import Drive
from commonrail.base.errors import ConfigurationError
from commonrail.engine.block import (
    FUEL,
    Memory,
    any_vectors,
    copy_number,
    make_advance,
    make_begin,
    make_wave_transport,
)
from commonrail.engine.job import MAXIMUM_STEPS
from commonrail.engine.operating_point import Course, OperatingPoint, Trace
from commonrail.engine.plan import Prepared, make_job, prepare
from commonrail.engine.recorder import make_rows
from commonrail.engine.status import check_inputs
from commonrail.physics.injector import Injector
from commonrail.physics.law import FLUSH_TINY, KEEP_ALL, KEEP_NONE
from commonrail.physics.model import Inputs, Setting
from commonrail.physics.variants import Variant, kernel_name, wiring

# Inputs of the steps to come: what the operating point plans, and what the caller has said instead.


# Inputs that a caller may hold, and their columns among `Inputs`.
COLUMNS = {"rail_pressure": 0, "cylinder_pressure": 1, "return_pressure": 2, "voltage": 3, "current": 3}
PRESSURES = tuple(COLUMNS)[:3]
_TRACED = {Drive.VOLTAGE: "voltage", Drive.CURRENT: "current"}
NEVER = -1.0  # on the clocks of an energising that has not begun or not ended [s]


class Held:
    """Inputs that the caller holds until he says otherwise: values by column, and the command of the energising.

    Attributes
    ----------
    values : dict of int to float
    on : bool or None
        None as long as the operating point's energisings count.
    since, until : float
        Instants of the last rising and of the last falling edge [s], NaN before them.
    """

    def __init__(self) -> None:
        self.values: dict[int, float] = {}
        self.on: bool | None = None
        self.since, self.until = math.nan, math.nan

    def copy(self) -> Held:
        """A copy that changes by itself."""
        twin = Held()
        twin.values, twin.on, twin.since, twin.until = dict(self.values), self.on, self.since, self.until
        return twin

    def command(self, on: bool, now: float, planned_since: float) -> None:
        """Switch the energising on or off.

        `now`: instant [s]; `planned_since`: time for which the operating point's energising lasts already [s], negative
        where none does.
        """
        if self.on is None and planned_since >= 0.0:
            self.on, self.since = True, now - planned_since
        if on and not self.on:
            self.since = now
        elif not on and self.on:
            self.until = now
        self.on = on

    def apply(self, inputs: Floats, now: Floats) -> None:
        """Write what is held over the planned inputs.

        `inputs`: (steps, 6); `now` (steps,): beginnings of the steps [s].
        """
        for column, value in self.values.items():
            inputs[:, column] = value
        if self.on is not None:
            begun, ended = not math.isnan(self.since), not (self.on or math.isnan(self.until))
            inputs[:, 4] = now - self.since if begun else NEVER
            inputs[:, 5] = now - self.until if ended else NEVER


class CoursePlan:
    """Inputs that the operating point plans, for any step, also beyond its horizon.

    Parameters
    ----------
    injector : Injector
    point : OperatingPoint
    dt : float
        [s].

    Attributes
    ----------
    prepared : Prepared
        Of the point, with a trace of zeros for a drive whose trace the caller gives.
    """

    def __init__(self, injector: Injector, point: OperatingPoint, dt: float) -> None:
        check_inputs(injector, point)
        if injector.variant.drive in _TRACED and point.drive is None:
            point = replace(point, drive=Trace((point.start, point.start + 1.0), (0.0, 0.0)))
        self.prepared: Prepared = prepare(injector, [point], dt)
        self._courses: tuple[Course | None, ...] = (
            point.rail_pressure,
            point.cylinder_pressure,
            point.return_pressure,
            point.drive if injector.variant.drive in _TRACED else None,
        )
        self._table: Floats = self.prepared.courses.inputs[0]

    @property
    def ring(self) -> int:
        """Slots of the rings of waves, enough for any number of steps."""
        courses = self.prepared.courses._replace(steps=np.array([MAXIMUM_STEPS]))
        return make_job(self.prepared._replace(courses=courses), self.prepared.row[None], False, 1).ring

    def instants(self, first: int, count: int) -> Floats:
        """Beginnings of steps [s]."""
        return np.asarray(self.prepared.begin[0] + self.prepared.dt * np.arange(first, first + count))

    def inputs(self, first: int, count: int) -> Floats:
        """Inputs of steps `first` to `first` + `count` − 1: (steps, 6)."""
        last = len(self._table) - 1
        steps = np.arange(first, first + count)
        found: Floats = self._table[np.minimum(steps, last)]
        beyond = steps > last
        if beyond.any():
            dt, begin = self.prepared.dt, self.instants(first, count)[beyond]
            for column, course in enumerate(self._courses):
                if isinstance(course, Trace):
                    found[beyond, column] = course.mean(begin, begin + dt)
            if self.prepared.points[0].pulses:
                found[beyond, 4:] += (dt * (steps[beyond] - last))[:, None]
        return found


def refuse_pressures(injector: Injector, inputs: Floats) -> None:
    """Refuse boundary pressures that the fuel or the parts' laws do not cover.

    `inputs`: (steps, 6). Raises ConfigurationError if one lies outside the fuel's range, or cylinder or return pressure
    reach the rail's.
    """
    low, high = injector.fuel.pressure_range
    for name, column in zip(PRESSURES, inputs.T, strict=False):
        words = name.replace("_", " ")
        if not (low <= column.min() and column.max() <= high):
            worst = column.min() if column.min() < low else column.max()
            raise ConfigurationError(
                f"The {words} is {worst * 1e-6:g} MPa, but the fuel {injector.fuel.name} is declared from "
                f"{low * 1e-6:g} to {high * 1e-6:g} MPa; give a pressure inside this range."
            )
        if name != PRESSURES[0] and not (column < inputs[:, 0]).all():
            raise ConfigurationError(f"The {words} must stay below the rail pressure; correct one of them.")


def traced_input(injector: Injector) -> str | None:
    """Input of an injector that is driven by a measured trace, "voltage" or "current"; else None."""
    return _TRACED.get(injector.variant.drive)


def names_of(value: object, known: tuple[str, ...], what: str) -> tuple[str, ...]:
    """Read a list of names; `known`: to choose from; `what`: "input" or "output"."""
    names = sequence(value, f"{what}s", f'["{known[0]}"]')
    for name in names:
        if not isinstance(name, str) or name not in known:
            raise ConfigurationError(f"There is no {what} {shown(name)}; choose from {', '.join(known)}.")
    return tuple(names)


# The loop that the lanes run, for one lane whose memory is its caller's: put at rest, and taken on by given inputs.


class Loop(NamedTuple):
    """Compiled functions of a variant, and where its memory holds its state."""

    # function (memory, ring, first, theta, settings, inputs): without `inputs` it puts the memory to rest; else it
    # takes one step for each row of them, the first of them with the number `first`
    march: Callable[..., Any]
    rows: Any
    # names of the rows of the state, which begin at `rows.state`; behind them are the three waves that leave
    state: tuple[str, ...]
    parameters: int  # length of `theta`

    def size(self, ring: int) -> int:
        """Numbers in the memory of an injector whose rings have so many slots."""
        return int(self.rows.end) + max(3 * ring, self.parameters)


@functools.cache
def make_loop(variant: Variant) -> Loop:
    """`Loop` of a variant, compiled (or loaded from the cache) at its first call."""
    wired, rows = wiring(variant), make_rows(variant, 1)
    from commonrail.compiler.numba import kernel

    march = kernel(make_march(variant, rows), f"stepper: {kernel_name(variant)}")
    return Loop(march, rows, wired.state.paths, len(wired.parameters.paths) + len(FUEL.paths))


def make_march(variant: Variant, rows: Any) -> Callable[..., None]:
    """The loop over steps, to be compiled; `rows`: of one lane."""
    from commonrail.compiler.numba import exchange_rounding

    begin, advance = make_begin(variant, rows), make_advance(variant, rows, any_vectors)
    arrive, leave = make_wave_transport(rows, copy_number)
    size, order = rows.end, (0, 0)  # point and candidate of the one lane

    def march(memory, ring, first, theta, settings, inputs):  # type: ignore[no-untyped-def]
        mode = exchange_rounding(FLUSH_TINY, KEEP_ALL)
        held, dt = Memory(memory[:size], memory[size:], ring), settings[3]
        if inputs.shape[0] == 0:
            at_rest = Setting(settings[0], settings[1], settings[2], dt)
            begin(held, theta, order, at_rest, np.empty((1, 12)))
        for i in range(inputs.shape[0]):
            u = inputs[i]
            arrive(held, first + i, True)
            advance(held.work, float(first + i + 1), Inputs(u[0], u[1], u[2], u[3], u[4], u[5]), dt)
            leave(held, first + i)
        exchange_rounding(mode, KEEP_NONE)

    return march
