"""Arrays that a run of the fast engines is given: operating points, candidates, samples to compare with."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from commonrail.arrays import Floats, Ints
from commonrail.choices import Precision
from commonrail.injector.model import Inputs


class Vector(NamedTuple):
    """Width of a block in candidates, and the type of its numbers."""

    lanes: int
    real: Any

    @property
    def precision(self) -> Precision:
        """Name of the type."""
        return Precision.F64 if self.real is np.float64 else Precision.F32


class Courses(NamedTuple):
    """Boundary conditions at each operating point.

    The clocks of `Inputs`, times since the current energising has begun and has ended, are the time less two origins.
    These turn to those of the next energising in the step in which that one begins.

    Attributes
    ----------
    settings : (points, 3)
        Rail, cylinder and return pressure at time zero [Pa], and throughout where a point has no trace.
    steps : (points,) int
    earliest_end : (points,) int
        First step at which an injection may have ended.
    times : (clocks, steps)
        Starts of the steps [s].
    clock : (points,) int
        Row of a point's `times`.
    first : (points,) int
        Place of a point's first turn, which is in step 0.
    turns : (turns,) int
        Steps of the turns; behind those of each point one that is never reached.
    origins : (turns, 4)
        Origins from a turn on, and the two clocks in its own step [s].
    trace : (points,) int
        Row of a point's `traces`, −1 where all its pressures are constant and no trace drives it.
    traces : (traces, steps, 4)
        Means over each step of rail, cylinder and return pressure [Pa] and of the drive's trace.
    """

    settings: Floats
    steps: Ints
    earliest_end: Ints
    times: Floats
    clock: Ints
    first: Ints
    turns: Ints
    origins: Floats
    trace: Ints
    traces: Floats

    @property
    def inputs(self) -> Floats:
        """Fields of `Inputs` in every step, (points, steps, 6), for what reads them from a table."""
        inputs = np.zeros((len(self.steps), self.times.shape[1], len(Inputs._fields)))
        for point, steps in enumerate(self.steps.tolist()):
            own, times = inputs[point, :steps], self.times[self.clock[point]]
            own[:, :3] = self.settings[point]
            if self.trace[point] >= 0:
                own[:, :4] = self.traces[self.trace[point], :steps]
            turn = int(self.first[point])
            while self.turns[turn] < steps:
                here, following = int(self.turns[turn]), min(int(self.turns[turn + 1]), steps)
                own[here:following, 4:] = times[here:following, None] - self.origins[turn, :2]
                own[here, 4:] = self.origins[turn, 2:]
                turn += 1
        return inputs


class Job(NamedTuple):
    """All that a run needs, as arrays.

    Attributes
    ----------
    theta : (candidates, parameters + fuel coefficients)
    courses : Courses
        Or those of another machine, such as `cuda_kernel.Table`.
    points, candidates : (blocks, lanes) int
        Operating point and candidate of each lane. All lanes of a block have the same `times`.
    dt : float
        [s].
    ring : int
        Slots of a ring buffer, a power of two above the longest delay.
    check_every : int
        Steps between checks of health and rest.
    checks_at_rest : int
        Checks for which needle and valve must have rested before a simulation ends; 0: it runs to its horizon.
    """

    theta: Floats
    courses: Any
    points: Ints
    candidates: Ints
    dt: float
    ring: int
    check_every: int
    checks_at_rest: int


class Samples(NamedTuple):
    """Samples of a rate to compare with, at each operating point.

    Attributes
    ----------
    bound_count : (points,) int
    due : (points, bounds) int
        Step in which a sample ends.
    samples : (points, bounds, 4)
        Fields of `Sample`.
    density : (1 or candidates, points)
        As in `lanes.Misfit`.
    """

    bound_count: Ints
    due: Ints
    samples: Floats
    density: Floats
