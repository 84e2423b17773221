"""Linear model of the next sample, by central differences in every number that the step reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import integer
from commonrail.base.arrays import Floats
from commonrail.base.choices import Actuation, Boundary
from commonrail.base.errors import ConfigurationError
from commonrail.base.units import to_text
from commonrail.engine.loop import Loop
from commonrail.physics.flow import contents
from commonrail.physics.model import Waves
from commonrail.physics.variants import Variant
from commonrail.plugins.stepper.inputs import COLUMNS

# Rows that are not states of the linear model: sums that nothing reads, the PWM's transistor, which jumps, and values
# that follow from the density in a volume. The density is a state next to the mass, because the walls move.
_SUMS = ("nozzle.injected", "cumulative_flows.returned", "cumulative_flows.supplied", "drive.conducting")
_OF_DENSITY = ("pressure", "stiffness")
# Step of a difference by the last part of a name: absolute [SI], and relative to the value.
_STEPS = {
    "mass": (0.0, 1e-5),
    "density": (0.0, 1e-5),
    "pressure": (1e3, 0.0),
    "pressure_before": (1e3, 0.0),
    "cavity": (1e-11, 0.0),
    "flow": (1e-6, 0.0),
    "flux": (1e-10, 1e-7),
    "velocity": (1e-5, 0.0),
    "v": (1e-5, 0.0),
    "gain": (1e-5, 0.0),
    "z": (1e-9, 0.0),
    "load": (1e-3, 0.0),
    "lift": (1e-9, 0.0),
    "lift_reached": (1e-9, 0.0),
    "waves": (1e3, 0.0),
    "voltage": (1e-3, 0.0),
    "current": (1e-4, 0.0),
}
KINK = 0.01  # share by which the slopes on both sides may differ


class Operation(NamedTuple):
    """State to linearise, and functions that continue from a similar state."""

    loop: Loop
    memory: Floats  # (numbers,)
    ring: int  # slots of a ring of waves
    steps: int  # simulated so far
    inputs: Floats  # (steps of a sample, 6)
    march: Callable[[Floats, Floats], None]  # function (memory, inputs)
    channels: Callable[[Floats, Floats], Mapping[str, float]]  # function (memory, inputs of the last step), by name
    # coefficients and variant of the injector
    coefficients: Any
    variant: Variant


@dataclass(frozen=True, repr=False)
class LinearModel:
    """Linear model of deviations from the simulated course over one sample.

    Attributes
    ----------
    a, b, c, d : matrices
        x(k+1) = A x(k) + B u(k), y(k) = C x(k) + D u(k); y(k) belongs to the sample that u(k) drives.
    errors : dict of str to matrix
        Estimated error of each matrix "a", "b", "c", "d": a third of the change when all differences double, and half
        the jump of the slope at the state. A reduced model has "impulse" (outputs, inputs): largest deviation of the
        unit impulse response from the full model.
    states, inputs, outputs : tuple of str
        Names of rows and columns. Waves in the pipes are states ``waves.down[-3]``: sent three steps ago.
    sample : float
        [s].
    kinks : tuple of str
        States and inputs with a kink: the slope of a state or an output jumps by more than 1 % of the largest change
        that any difference causes, for example at a seat, a stop or the vapour pressure. The linear model then holds on
        one side only. Smaller kinks are not listed; `errors` include their jump.
    """

    a: Floats
    b: Floats
    c: Floats
    d: Floats
    errors: dict[str, Floats]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sample: float
    kinks: tuple[str, ...]

    def __repr__(self) -> str:
        kinks = f", {len(self.kinks)} kinks" if self.kinks else ""
        return (
            f"LinearModel({len(self.states)} states, {', '.join(self.inputs)} to {', '.join(self.outputs)}, "
            f"sample {to_text(self.sample, 's')}{kinks})"
        )

    def reduce(self, order: int, samples: int = 400) -> LinearModel:
        """Reduce to few states by balanced truncation over a finite number of samples.

        The kept states are the most controllable and observable within `samples` (finite-horizon Gramians, which
        exist for unstable models too), from the singular values of the Hankel matrix C A^(i+k) B. Inputs and outputs
        are scaled by their largest impulse response, which makes the result independent of units.

        Raises
        ------
        ConfigurationError
            If the order is not a whole number from 1 to the number of states, or exceeds the number of samples.
        """
        order, samples = integer(order, "order", 1), integer(samples, "samples", 1)
        if not order <= min(len(self.states), samples):
            raise ConfigurationError(
                f"order: at most {min(len(self.states), samples)} states can be kept, not {order}."
            )
        impulse = self._impulse(samples)
        rows = 1.0 / np.maximum(np.abs(impulse).max(axis=(0, 2)), np.finfo(float).tiny)
        columns = 1.0 / np.maximum(np.abs(rows[:, None] * impulse).max(axis=(0, 1)), np.finfo(float).tiny)
        reach, show = [self.b * columns], [self.c.T * rows]
        for _ in range(samples - 1):
            reach.append(self.a @ reach[-1])
            show.append(self.a.T @ show[-1])
        controlled, observed = np.hstack(reach), np.hstack(show)
        u, sigma, vt = np.linalg.svd(observed.T @ controlled, full_matrices=False)
        rank = min(order, int(np.sum(sigma > sigma[0] * np.finfo(float).eps * len(sigma))))
        root = np.sqrt(sigma[:rank])
        into, out = controlled @ vt[:rank].T / root, (u[:, :rank] / root).T @ observed.T
        names = tuple(f"balanced[{i}]" for i in range(rank))
        reduced = replace(self, a=out @ self.a @ into, b=out @ self.b, c=self.c @ into, states=names, errors={})
        return replace(reduced, errors={"impulse": np.abs(reduced._impulse(samples) - impulse).max(axis=0)})

    def _impulse(self, samples: int) -> Floats:
        """Outputs (samples, outputs, inputs) to a unit impulse of each input."""
        x, response = self.b, [self.d]
        for _ in range(samples - 1):
            response.append(self.c @ x)
            x = self.a @ x
        return np.array(response)

    def respond(self, inputs: Floats) -> Floats:
        """Outputs (samples, outputs) of the linear model, from zero, to inputs (samples, inputs)."""
        x, response = np.zeros(len(self.states)), np.empty((len(inputs), len(self.outputs)))
        for k, u in enumerate(np.asarray(inputs, float)):
            response[k] = self.c @ x + self.d @ u
            x = self.a @ x + self.b @ u
        return response


class _Coordinate(NamedTuple):
    """A number to change: name, place in the memory or column of the inputs, and difference."""

    name: str
    at: int
    step: float


def linearise(o: Operation, dt: float, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> LinearModel:
    """Compute the linear model of a sample."""
    states = _states(o, o.steps)
    after = [coordinate.at for coordinate in _states(o, o.steps + len(o.inputs))]
    driven = [_Coordinate(name, COLUMNS[name], _difference(name, 0.0)) for name in inputs]

    def course(change: float, of: _Coordinate, is_input: bool) -> Floats:
        memory, u = o.memory.copy(), o.inputs.copy()
        if is_input:
            u[:, of.at] += change
        else:
            _perturb_density(memory, o, of, memory[of.at] + change)
        o.march(memory, u)
        gain = memory[o.loop.rows.injected] - o.memory[o.loop.rows.injected]
        values = {"mass_rate": float(gain) / (len(u) * dt), **o.channels(memory, u[-1])}
        return np.concatenate([memory[after], [values[name] for name in outputs]])

    middle = course(0.0, states[0], False)
    columns, errors = [], []
    curvatures = []
    for is_input, coordinates in ((False, states), (True, driven)):
        for coordinate in coordinates:
            up, down, high, low = (course(k * coordinate.step, coordinate, is_input) for k in (1.0, -1.0, 2.0, -2.0))
            near, far = (up - down) / (2.0 * coordinate.step), (high - low) / (4.0 * coordinate.step)
            curvature = up - 2.0 * middle + down  # change of slope times the difference
            # Without a kink the curvature is four times as large over twice the difference. Kinks do not affect central
            # slopes.
            jump = np.abs(4.0 * curvature - (high - 2.0 * middle + low)) / (2.0 * coordinate.step)
            columns.append((4.0 * near - far) / 3.0)
            errors.append(np.abs(near - far) / 3.0 + 0.5 * jump)
            curvatures.append(np.abs(curvature))
    coordinates = [*states, *driven]
    n = len(states)
    slopes, wrong = np.array(columns).T, np.array(errors).T
    return LinearModel(
        *_split_blocks(slopes, n),
        dict(zip("abcd", _split_blocks(wrong, n), strict=True)),
        tuple(coordinate.name for coordinate in states),
        inputs,
        outputs,
        len(o.inputs) * dt,
        _kinks(coordinates, slopes, np.array(curvatures).T),
    )


def _split_blocks(matrix: Floats, n: int) -> tuple[Floats, Floats, Floats, Floats]:
    return matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]


def _kinks(coordinates: list[_Coordinate], slopes: Floats, curvatures: Floats) -> tuple[str, ...]:
    """Names of the coordinates whose difference bends an output by more than `KINK` of the move it causes."""
    moved = np.abs(slopes) * np.array([coordinate.step for coordinate in coordinates])
    scale = np.maximum(moved.max(axis=1, keepdims=True), np.finfo(float).tiny)
    worst = np.max(curvatures / scale, axis=0)
    return tuple(coordinate.name for coordinate, share in zip(coordinates, worst, strict=True) if share > KINK)


def _states(o: Operation, steps: int) -> list[_Coordinate]:
    """Coordinates of the state after some steps: rows, and slots of the rings with waves that have not arrived."""
    first, coordinates = o.loop.rows.state, []
    ideal = o.variant.boundary is Boundary.IDEAL
    for i, path in enumerate(o.loop.state):
        volume, _, field = path.rpartition(".")
        follows = field in _OF_DENSITY and f"{volume}.density" in o.loop.state
        if not (follows or path in _SUMS or (ideal and path.startswith("rail."))):
            coordinates.append(_Coordinate(path, first + i, _difference(path, o.memory[first + i])))
    for wave, name in enumerate(Waves._fields[: 2 if o.variant.actuation is Actuation.DIRECT else 3]):
        start = o.loop.rows.end + wave * o.ring
        delay = int(o.memory[o.loop.rows.delay_steps + wave])
        for ago in range(1, delay + 2):
            # the last step has moved a wave older than the delay out of its slot
            at = start + ((steps - ago) & (o.ring - 1)) if ago <= delay else o.loop.rows.arriving + wave
            coordinates.append(_Coordinate(f"waves.{name}[-{ago}]", at, _difference("waves", 0.0)))
    return coordinates


def _difference(name: str, value: float) -> float:
    parts = name.split(".")
    limits = next((_STEPS[suffix] for suffix in reversed(parts) if suffix in _STEPS), None)
    if limits is None:
        limits = next(step for suffix, step in _STEPS.items() if parts[-1].endswith(suffix))
    absolute, relative = limits
    return max(absolute, relative * abs(float(value)))


def _perturb_density(memory: Floats, o: Operation, of: _Coordinate, value: float) -> None:
    """Write a number; with the density in a volume also the values that follow from it."""
    memory[of.at] = value
    if of.name.endswith(".density"):
        volume = contents(o.coefficients.fuel, value, 1.0)  # for a volume of one cubic metre
        for field in _OF_DENSITY:
            row = o.loop.state.index(f"{of.name.removesuffix('density')}{field}")
            memory[o.loop.rows.state + row] = getattr(volume, field)
