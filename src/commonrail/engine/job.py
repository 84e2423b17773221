"""Memory of a run of the fast engines: its input, the working rows of its blocks, and its output."""

from __future__ import annotations

from collections import namedtuple
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arrays import Floats, Ints
from commonrail.base.choices import Actuation, Precision
from commonrail.compiler.table import REAL, WHOLE, Array, address, floats, wholes
from commonrail.physics.fuel_kernel import FuelCoefficients
from commonrail.physics.law import CACHE_LINE, layout_of
from commonrail.physics.model import Inputs, Waves
from commonrail.physics.variants import Variant, model_of, wiring

NEVER = 1 << 62  # step of a turn that is not reached


class Vector(NamedTuple):
    """Width of a block in candidates, and type of its numbers."""

    lanes: int
    real: Any

    @property
    def precision(self) -> Precision:
        """Name of the type."""
        return Precision.F64 if self.real is np.float64 else Precision.F32


# One register of 512 bits: docs/decisions/0011-the-widest-registers.md.
VECTORS = {
    Precision.F64: Vector(8, np.float64),
    Precision.F32: Vector(16, np.float32),
}


class Courses(NamedTuple):
    """Boundary conditions at each operating point.

    Each clock of `Inputs`, the time since the current energising began or ended, is the time minus an origin. When the
    next energising begins, both origins switch to it.
    """

    # (points, 3): rail, cylinder and return pressure at time zero [Pa], constant for a point without a trace
    settings: Floats
    steps: Ints  # (points,) int
    earliest_end: Ints  # (points,) int: first step at which an injection may have ended
    times: Floats  # (clocks, steps): starts of the steps [s]
    clock: Ints  # (points,) int: row of a point's `times`
    first: Ints  # (points,) int: index of a point's first turn, which is in step 0
    turns: Ints  # (turns,) int: steps of the turns; each point's list ends with the sentinel `NEVER`
    origins: Floats  # (turns, 4): origins from a turn on, and the two clocks in its own step [s]
    # (points,) int: row of a point's `traces`, −1 if all its pressures are constant and no trace drives it
    trace: Ints
    # (traces, steps, 4): means over each step of rail, cylinder and return pressure [Pa] and of the drive's trace
    traces: Floats

    @property
    def inputs(self) -> Floats:
        """Fields of `Inputs` in every step, (points, steps, 6), as a table."""
        inputs = np.zeros((len(self.steps), self.times.shape[1], len(Inputs._fields)))
        for point, steps in enumerate(self.steps.tolist()):
            point_inputs, times = inputs[point, :steps], self.times[self.clock[point]]
            point_inputs[:, :3] = self.settings[point]
            if self.trace[point] >= 0:
                point_inputs[:, :4] = self.traces[self.trace[point], :steps]
            turn = int(self.first[point])
            while self.turns[turn] < steps:
                here, following = int(self.turns[turn]), min(int(self.turns[turn + 1]), steps)
                point_inputs[here:following, 4:] = times[here:following, None] - self.origins[turn, :2]
                point_inputs[here, 4:] = self.origins[turn, 2:]
                turn += 1
        return inputs


class Job(NamedTuple):
    """All arrays of a run."""

    theta: Floats  # (candidates, parameters + fuel coefficients)
    courses: Any  # or `cuda_kernel.Table` on a GPU
    # (blocks, lanes) int: Operating point and candidate of each lane. All lanes of a block have the same `times`
    points: Ints
    candidates: Ints
    dt: float  # [s]
    ring: int  # slots of a ring buffer, a power of two above the longest delay
    check_every: int  # steps between checks of health and rest
    # checks for which needle and valve must have rested before a simulation ends; 0: it runs to its horizon
    checks_at_rest: int


class Samples(NamedTuple):
    """Samples of a rate to compare with, at each operating point."""

    bound_count: Ints  # (points,) int
    due: Ints  # (points, bounds) int: step in which a sample ends
    samples: Floats  # (points, bounds, 4): fields of `Sample`
    density: Floats  # (1 or candidates, points): as in `lanes.Misfit`


class Shape(NamedTuple):
    """Sizes for which a kernel was made; it refuses others."""

    # of the working memory
    rows: Any
    lanes: Any
    columns: Any  # of theta
    size: Any  # bytes of a number


class Scratch(NamedTuple):
    """Memory of one thread: working rows, rings of the waves, origins of the clocks."""

    work: Any
    waves: Any
    origins: Any


class LoopArguments(NamedTuple):
    """Arguments of the loop, which simulates every `stride`th block from `first` on."""

    shape: Any
    job: Any
    samples: Any
    trace: Any  # (blocks or 0, steps + 1, rows, lanes)
    out: Any  # (blocks, lanes, figures)
    scratch: Any
    first: Any
    stride: Any


LOOP_ARGUMENTS = LoopArguments(
    shape=Shape(*[WHOLE] * 4),
    job=Job(
        theta=floats(2),
        courses=Courses(
            settings=floats(2),
            steps=wholes(1),
            earliest_end=wholes(1),
            times=floats(2),
            clock=wholes(1),
            first=wholes(1),
            turns=wholes(1),
            origins=floats(2),
            trace=wholes(1),
            traces=floats(3),
        ),
        points=wholes(2),
        candidates=wholes(2),
        dt=REAL,
        ring=WHOLE,
        check_every=WHOLE,
        checks_at_rest=WHOLE,
    ),
    samples=Samples(wholes(1), wholes(2), floats(3), floats(2)),
    trace=floats(4),
    out=floats(3),
    scratch=Scratch(Array(REAL, 1), Array(REAL, 1), floats(1)),
    first=WHOLE,
    stride=WHOLE,
)


def scratch_for(shape: Shape, ring: int, real: Any) -> Scratch:
    """Memory of one thread, aligned to cache lines, since a vector as long as one would straddle two.

    `ring`: slots of a ring.
    """
    lanes = shape.lanes
    return Scratch(
        _allocate_aligned(shape.rows * lanes, real),
        _allocate_aligned(max(3 * ring, shape.columns) * lanes, real),
        _allocate_aligned(2 * lanes, np.float64),
    )


def _allocate_aligned(count: int, real: Any) -> NDArray[Any]:
    size = np.dtype(real).itemsize
    padded = np.empty(count + CACHE_LINE // size, real)
    first = -(address(padded) // size) % (CACHE_LINE // size)
    return padded[first : first + count]


# Working rows of a block, each as wide as its lanes, by name.
#
# Coefficients, state, leaving and arriving waves, and the progress of each lane, at one pointer.


class Progress(NamedTuple):
    """Progress of each lane; instants are in steps, zero means absent."""

    # mass injected [kg] before the step, and at the end of the last sample
    injected_before: float
    injected_at_sample: float
    absolute: float  # sums of the samples' errors [m³/s], and of their squares [(m³/s)²]
    squared: float
    density: float  # converts the mass of a sample to a volume [kg/m³]
    greatest_lift: float  # of the tip [m]
    opening: float  # instants
    last_closing: float
    first_closing: float
    is_open: float  # 1 while the needle counts as open
    injected_at_lift: float  # mass injected when the tip last left its seat [kg]
    tip_before: float  # lift of the tip before the step [m]
    crossing: float  # 1 if it has passed the seat, or become open or closed, in the step
    checks_at_rest: float  # checks for which it has rested
    injected_at_check: float  # mass injected at the last check [kg]
    has_ended: float  # 1 once the lane has ended
    longest_contact: float  # of a bouncing needle or valve, in steps
    farthest_lift: float  # beyond the stop [m]
    earliest_end: float  # first step at which the injection may have ended
    steps: float  # number of steps
    clock_turns: float  # turns of the clocks so far


class Working(NamedTuple):
    """All rows. A wave arrives between two slots of its ring, after a delay of whole steps and a fraction."""

    coefficients: Any
    state: Any
    leaving: Waves
    arriving: Waves
    arriving_before: Waves
    inputs: Inputs
    progress: Progress
    delay_steps: Waves
    delay_fraction: Waves


# rows that the loop reads by itself: single ones of the state, first ones of groups
_BOTH = {
    "injected": "nozzle.injected",
    "returned": "cumulative_flows.returned",
    "supplied": "cumulative_flows.supplied",
    "sac_pressure": "sac.pressure",
    "accumulation_pressure": "accumulation.fuel.pressure",
}
_STATE = {
    Actuation.SERVO: _BOTH
    | {
        "control_pressure": "control_chamber.fuel.pressure",
        "return_pressure": "return_line.pressure",
        "valve_lift": "valve.lift",
    },
    # The armature replaces the valve. No control chamber must refill before the injection has ended,
    # and there is no return line: its wave is constant.
    Actuation.DIRECT: _BOTH
    | {
        "control_pressure": "accumulation.fuel.pressure",
        "return_pressure": "accumulation.fuel.pressure",
        "valve_lift": "body.z.armature",
    },
}
_DELAYS = {
    Actuation.SERVO: {"feed_delay": "coefficients.delays.feed", "back_delay": "coefficients.delays.back"},
    Actuation.DIRECT: {"feed_delay": "coefficients.delays.feed", "back_delay": "coefficients.delays.feed"},
}
_LOOP = {
    **{name: name for name in Working._fields if name not in ("coefficients", "progress")},
    **{name: f"inputs.{name}" for name in ("cylinder", "since_start", "since_end")},
    **{name: f"progress.{name}" for name in Progress._fields},
}


def _paths(actuation: Actuation) -> dict[str, str]:
    """Rows that the loop reads, by the names it uses."""
    return _LOOP | {name: f"state.{path}" for name, path in _STATE[actuation].items()} | _DELAYS[actuation]


FUEL = layout_of(FuelCoefficients)
Rows = namedtuple("Rows", ("lanes", *_paths(Actuation.SERVO), "tip", "top", "end"))  # type: ignore[misc]


def make_rows(variant: Variant, lanes: int) -> Any:
    """`Rows` of a variant: number of lanes, rows by name, and number of rows."""
    body, model = wiring(variant).body, model_of(variant.actuation)
    choices = (("coefficients", model.Coefficients), ("state", model.State), ("body", body.State))
    rows = layout_of(Working, choices)
    ends = (rows.row(f"state.body.{name}") for name in (body.TIP, body.TOP))
    return Rows(lanes, *map(rows.row, _paths(variant.actuation).values()), *ends, len(rows.paths))  # type: ignore[call-arg]


@cache
def shape_of(variant: Variant, vector: Vector) -> Shape:
    """Sizes of the memory of a block."""
    columns = len(wiring(variant).parameters.paths) + len(FUEL.paths)
    return Shape(make_rows(variant, vector.lanes).end, vector.lanes, columns, np.dtype(vector.real).itemsize)


class Outcome(NamedTuple):
    """Figures of the simulations of a run, (candidates, points).

    `opening`, `closing` and `first_closing` are in steps (NaN if absent); masses in kg; `absolute` and
    `squared` are the weighted sums of the samples' errors [m³/s], [(m³/s)²]; `sound` is 1 for a run that stayed
    finite and inside its stops, `closed_at_start` for needle and valve at rest before energising, `closed_at_end` for
    a needle on its seat and a SAC that had emptied when the simulation ended.
    """

    injected: Any
    returned: Any
    supplied: Any
    opening: Any
    closing: Any
    greatest_lift: Any
    absolute: Any
    squared: Any
    sound: Any
    closed_at_start: Any
    closed_at_end: Any
    first_closing: Any


FIGURE: Any = Outcome._make(range(len(Outcome._fields)))  # column of each figure in `out`, (lanes, figures)
