"""Injector stepped by its caller: for control design, co-simulation, and hardware in the loop."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import Quantity, flag, instance, number
from commonrail.base.arrays import Floats
from commonrail.base.choices import Actuation, Boundary
from commonrail.base.errors import ConfigurationError, SimulationError
from commonrail.engine.loop import CoursePlan, Loop, make_loop
from commonrail.engine.operating_point import LONGEST, OperatingPoint
from commonrail.engine.plan import coefficients_at
from commonrail.engine.solution import all_channels
from commonrail.engine.status import Status
from commonrail.engine.time_step import DEFAULT_STEP, check_step, longest_step, step_advice
from commonrail.physics.injector import Injector
from commonrail.physics.variants import COMMAND, Variant
from commonrail.plugins.stepper.inputs import COLUMNS, UNITS, Overrides, read_names, refuse_pressures, refuse_unread
from commonrail.plugins.stepper.linear import LinearModel, Operation, linearise

ROUNDING = 1e-6  # relative difference from a whole number of time steps that counts as rounding
_CLOSED = ("tip", "valve_lift")  # rows that are below zero while needle and valve are seated
_PRESSURES = {
    "control_pressure": "control_chamber.fuel.pressure",
    "accumulation_pressure": "accumulation.fuel.pressure",
    "sac_pressure": "sac.pressure",
    "return_pressure": "return_line.pressure",
}


class SavedState(NamedTuple):
    """State of a `Stepper` at one instant: steps taken, memory of the loop, inputs set by the caller."""

    steps: int
    memory: Floats
    overrides: Overrides


class Stepper:
    """Injector at rest, to be stepped by its caller.

    It runs the loop of `simulate` with the same time step, and gives the same values except for rounding.

    Parameters
    ----------
    injector : Injector
    point : OperatingPoint
        Its initial pressures set the state at rest. Its energisings, and traces of pressures and drive, apply
        until the caller sets others. The voltage or current trace of an injector driven by one may be
        missing: the coil is then dead until the caller sets it.
    time_step : float or str
        Inner time step [s], or text such as ``"1 us"``.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong kind or beyond its limits.
    SimulationError
        If needle or valve do not rest on their seats, or the time step is too long for the injector.

    Examples
    --------
    >>> import commonrail as cr
    >>> s = cr.Stepper(cr.load_injector("virtual-lino-2016"), cr.OperatingPoint("160 MPa", "700 us"))
    >>> while s.time < 500e-6:
    ...     out = s.step("10 us")
    >>> out["needle_lift"] > 50e-6
    True
    """

    def __init__(self, injector: Injector, point: OperatingPoint, time_step: Quantity = DEFAULT_STEP) -> None:
        self.injector = instance(injector, Injector, "injector")
        self.time_step = check_step(time_step)
        self._variant = injector.wired()
        self._plan = CoursePlan(injector, instance(point, OperatingPoint, "point"), self.time_step)
        prepared = self._plan.prepared
        self._theta = prepared.row[None]
        self._ring = self._plan.ring
        self._loop: Loop = make_loop(self._variant)
        self._coefficients = coefficients_at(injector, prepared.points[0], self.time_step)
        self._channels = partial(_channels, self._coefficients, self._variant, self._loop)
        self._settings = np.array([*prepared.courses.settings[0], self.time_step])
        longest = longest_step(injector, self._theta[0], prepared.medium)
        if self.time_step > longest:
            raise SimulationError(f"{injector.name}: {Status.STEP_UNSTABLE.sentence} {step_advice(longest)}")
        self.reset()

    def reset(self) -> None:
        """Return to rest at the time and the pressures of the operating point's start."""
        self._steps, self._overrides = 0, Overrides()
        self._memory = np.zeros(self._loop.size(self._ring))
        self._march(self._memory, np.empty((0, 6)))
        rows = self._loop.rows
        if not all(self._memory[getattr(rows, name)] < 0.0 for name in _CLOSED):
            raise SimulationError(f"{self.injector.name}: {Status.NOT_CLOSED_AT_START.sentence}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle arguments and state: the loop is machine code of this process."""
        return type(self), (self.injector, self._plan.prepared.points[0], self.time_step), self.save()

    @property
    def time(self) -> float:
        """Instant reached [s]."""
        return float(self._plan.instants(self._steps, 1)[0])

    @property
    def states(self) -> dict[str, float]:
        """State by dotted name, SI."""
        first = self._loop.rows.state
        return {name: float(self._memory[first + i]) for i, name in enumerate(self._loop.state)}

    @property
    def channels(self) -> dict[str, float]:
        """Channels of a `Solution` at this instant, SI, by name."""
        return self._channels(self._memory, self._inputs(max(self._steps - 1, 0), 1)[0])

    def step(
        self,
        duration: Quantity,
        *,
        command: bool | None = None,
        rail_pressure: Quantity | None = None,
        cylinder_pressure: Quantity | None = None,
        return_pressure: Quantity | None = None,
        voltage: Quantity | None = None,
        current: Quantity | None = None,
    ) -> dict[str, float]:
        """Advance the injector.

        Inputs hold until changed.

        Parameters
        ----------
        duration : float or str
            [s]; a whole number of time steps.
        command : bool, optional
            True energises the coil from now on, False ends it; replaces the operating point's energisings.
        rail_pressure, cylinder_pressure, return_pressure : float or str, optional
            [Pa]. The rail pressure applies at the inlet of an ideal rail only.
        voltage, current : float or str, optional
            [V], [A], for an injector driven by a voltage or a current trace.

        Returns
        -------
        outputs : dict of str to float
            "time" [s]; "mass_rate", the mean of this call [kg/s]; "injected_mass" and "returned_mass" since the start
            [kg]; then `channels`.

        Raises
        ------
        ConfigurationError
            If the duration is not a whole number of time steps, or an input is beyond its limits or not read by this
            injector; the state is then unchanged.
        SimulationError
            If the simulation fails; the state is then unchanged.
        """
        count = _count_steps(duration, self.time_step)
        quantities = {
            "rail_pressure": rail_pressure,
            "cylinder_pressure": cylinder_pressure,
            "return_pressure": return_pressure,
            "voltage": voltage,
            "current": current,
        }
        overrides = self._merge_overrides(
            {name: value for name, value in quantities.items() if value is not None}, command
        )
        inputs = self._inputs(self._steps, count, overrides)
        refuse_pressures(self.injector, inputs)
        memory = self._memory.copy()
        self._march(memory, inputs)
        _refuse_failed(self.injector, self._loop.rows, memory)
        before = self._memory[self._loop.rows.injected]
        self._memory, self._overrides = memory, overrides
        self._steps += count
        injected, returned = memory[self._loop.rows.injected], memory[self._loop.rows.returned]
        return {
            "time": self.time,
            "mass_rate": float(injected - before) / (count * self.time_step),
            "injected_mass": float(injected),
            "returned_mass": float(returned),
            **self._channels(memory, inputs[-1]),
        }

    def save(self) -> SavedState:
        """Return a copy of the state, for `restore`."""
        return SavedState(self._steps, self._memory.copy(), self._overrides.copy())

    def restore(self, state: SavedState) -> None:
        """Return to a saved state, of this stepper or of another with the same injector, pressures and time step.

        Parameters
        ----------
        state : SavedState

        Raises
        ------
        ConfigurationError
            If the state has another type, belongs to a different stepper, or was not returned by `save`, for example
            with NaN.
        """
        instance(state, SavedState, "state")
        if np.shape(state.memory) != self._memory.shape:
            raise ConfigurationError(
                "The state belongs to a stepper with another model variant, pipe or time step; use an equal stepper."
            )
        memory = np.asarray(state.memory)
        sound = memory.dtype == np.float64 and isinstance(state.overrides, Overrides) and isinstance(state.steps, int)
        if not (sound and state.steps >= 0 and np.isfinite(memory).all()):
            raise ConfigurationError(
                "The state is damaged: it holds numbers that are not finite, or other content than a state of save; "
                "restore one that save returned, unchanged."
            )
        self._steps = state.steps
        self._memory, self._overrides = memory.copy(), state.overrides.copy()

    __setstate__ = restore

    def linearise(
        self, sample: Quantity, inputs: Sequence[str] = ("rail_pressure",), outputs: Sequence[str] = ("mass_rate",)
    ) -> LinearModel:
        """Linearise the next sample at the present state: x' = A x + B u, y = C x + D u in deviations.

        Parameters
        ----------
        sample : float or str
            Sampling interval of the linear model [s]; a whole number of time steps.
        inputs : sequence of str
            Of "rail_pressure", "cylinder_pressure", "return_pressure", "voltage", "current".
        outputs : sequence of str
            Of "mass_rate" (mean over the sample) and the names of `channels` (at its end).

        Raises
        ------
        ConfigurationError
            If a name is unknown or not read by this injector, or the names are not a list.
        """
        count = _count_steps(sample, self.time_step)
        inputs = read_names(inputs, tuple(COLUMNS), "input")
        for name in inputs:
            refuse_unread(self.injector, name)
        outputs = read_names(outputs, ("mass_rate", *self.channels), "output")
        operation = Operation(
            self._loop,
            self._memory,
            self._ring,
            self._steps,
            self._inputs(self._steps, count),
            self._march,
            self._channels,
            self._coefficients,
            self._variant,
        )
        return linearise(operation, self.time_step, inputs, outputs)

    def _merge_overrides(self, quantities: dict[str, Any], command: bool | None) -> Overrides:
        """Merge the present overrides with new quantities and a command."""
        overrides = self._overrides.copy()
        for name, value in quantities.items():
            refuse_unread(self.injector, name)
            overrides.values[COLUMNS[name]] = number(value, UNITS.get(name, "Pa"), name.replace("_", " "))
        if command is not None:
            refuse_unread(self.injector, COMMAND)
            planned = self._plan.inputs(self._steps, 1)[0]
            lasts = planned[4] if planned[4] >= 0.0 > planned[5] else -1.0
            overrides.command(flag(command, "command"), self.time, float(lasts))
        return overrides

    def _inputs(self, first: int, count: int, overrides: Overrides | None = None) -> Floats:
        inputs = self._plan.inputs(first, count)
        (overrides or self._overrides).apply(inputs, self._plan.instants(first, count))
        return inputs

    def _march(self, memory: Floats, inputs: Floats) -> None:
        """Advance a memory from the present step; without inputs put it to rest."""
        self._loop.march(memory, self._ring, self._steps, self._theta, self._settings, inputs)


def _count_steps(duration: Quantity, time_step: float) -> int:
    """Number of time steps [s] that a duration has."""
    seconds = number(duration, "s", "duration of a step")
    if seconds > LONGEST:
        raise ConfigurationError(
            f"The duration of a step must be at most {LONGEST:g} s, and {seconds:g} s was given; take several."
        )
    steps = seconds / time_step
    count = round(steps)
    if count < 1 or abs(steps - count) > ROUNDING * count:
        raise ConfigurationError(
            f"The duration must be a whole number of time steps of {time_step * 1e6:g} µs, "
            f"and {seconds * 1e6:g} µs is {steps:.4g} of them."
        )
    return count


def _refuse_failed(injector: Injector, rows: Any, memory: Floats) -> None:
    """Refuse a state that is not finite or lies beyond the stops."""
    state = memory[rows.state : rows.leaving]
    if not np.isfinite(state).all():
        raise SimulationError(f"{injector.name}: {Status.NOT_FINITE.sentence}")
    if max(abs(memory[rows.tip]), abs(memory[rows.top])) > memory[rows.farthest_lift]:
        raise SimulationError(f"{injector.name}: {Status.RAN_AWAY.sentence}")


def _channels(c: Any, variant: Variant, loop: Loop, memory: Floats, u: Floats) -> dict[str, float]:
    """Channels of a `Solution` after a step with the inputs `u`."""
    first = loop.rows.state
    states = {name: memory[first + i : first + i + 1] for i, name in enumerate(loop.state)}
    pressures = {name: states[path] for name, path in _PRESSURES.items() if path in states}
    volume = variant.boundary is Boundary.VOLUME and variant.actuation is Actuation.SERVO
    pressures["rail_pressure"] = states["rail.pressure"] if volume else u[:1]
    channels = all_channels(c, variant, states, pressures, u[1:2])
    return {name: float(values[0]) for name, values in channels.items()}
