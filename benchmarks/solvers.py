"""Other solvers on the reference's compiled right-hand side: SciPy's, and SUNDIALS' CVODE through scikit-sundae.

Each is called as its manual says, with the band of the Jacobian where it can use one, and calls back into Python; what
that costs follows from the counted evaluations. The drive's switchings are followed exactly, as in the reference. The
call back is as lean as it can be made: what the reference engine spends on its own convenience is not theirs to pay.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import diags

from commonrail.base.arrays import Floats
from commonrail.engine.operating_point import OperatingPoint, Trace, courses
from commonrail.engine.reference import Instants, Model, Resolution, solution
from commonrail.engine.solution import Solution
from commonrail.physics.injector import Injector

__all__ = ["CvodeModel", "PeerModel", "ScipyMethod", "ScipyModel", "solve_with"]

ScipyMethod = Literal["LSODA", "BDF", "Radau", "RK45", "DOP853"]
MOST_STEPS = 1_000_000  # of CVODE between two samples
EVENTS = 4  # of `Model.events`; the last ends a solve
SAME = 1e-13  # times nearer than this are one [s]: CVODE refuses to step so far
MOST_EVALUATIONS = 1_000_000  # of a simulation: ten times as many as any needs; LSODA may stick after a kink


class Counted(NamedTuple):
    """A simulation and how often it evaluated the right-hand side; 0 where evaluations are not counted."""

    solution: Solution
    evaluations: int


class _Stuck(Exception):
    """A solver makes no progress."""


class PeerModel(Model):
    """The reference's model and solver with a lean right-hand side, and a count of evaluations."""

    def __init__(self, injector: Injector, point: OperatingPoint, resolution: Resolution) -> None:
        super().__init__(injector, point, resolution, None)
        self.evaluations = 0
        super().slopes(point.start, self.start)  # loads the kernel and sets the courses that are constant
        places = zip((0, 1, 2, 6), courses(point), strict=True)
        self._traces = [(k, np.array(c.time), np.array(c.value)) for k, c in places if isinstance(c, Trace)]

    def slopes(self, t: float, y: Floats) -> Floats:
        """The right-hand side: the kernel itself, and only those courses that change."""
        self.evaluations += 1
        if self.evaluations > MOST_EVALUATIONS:
            raise _Stuck
        for k, time, value in self._traces:
            self.outside[k] = np.interp(t, time, value)
        self.y[:] = y
        self.evaluate()
        return self.dy.copy()

    def tolerances(self) -> dict[str, Any]:
        """Relative and absolute."""
        return {"rtol": self.resolution.relative, "atol": self.scales() * self.resolution.relative}


class ScipyModel(PeerModel):
    """One of SciPy's solvers."""

    def __init__(
        self, injector: Injector, point: OperatingPoint, resolution: Resolution, method: ScipyMethod = "LSODA"
    ) -> None:
        super().__init__(injector, point, resolution)
        self.options: dict[str, Any] = {"method": method}
        if method == "LSODA":
            self.options |= {"lband": self.band, "uband": self.band}
        elif method in ("BDF", "Radau"):
            n, width = len(self.start), 2 * self.band + 1
            self.options["jac_sparsity"] = diags([1.0] * width, range(-self.band, self.band + 1), shape=(n, n))

    def solve(self, start: float, stop: float, y: Floats, inside: Floats) -> Any:
        """Between two switchings."""
        at = np.append(inside, stop) if not len(inside) or inside[-1] < stop else inside
        options = self.options | self.tolerances() | {"t_eval": at, "events": self.events()}
        result = solve_ivp(
            self.slopes,
            (start, stop),
            y,
            first_step=min(1e-10, stop - start),
            max_step=self.resolution.longest_step,
            **options,
        )
        if result.status == 0:
            self.last = result.y[:, -1].copy()
        return result


class CvodeModel(PeerModel):
    """SUNDIALS' CVODE: BDF, Newton's iteration with a banded Jacobian by differences."""

    def solve(self, start: float, stop: float, y: Floats, inside: Floats) -> Any:
        """Between two switchings."""
        from sksundae.cvode import CVODE

        functions = self.events()

        # CVODE lends its own memory, read-only: the compiled functions take writable arrays
        def rates(t: float, y: Floats, dy: Floats) -> None:
            dy[:] = self.slopes(t, y.copy())

        def events(t: float, y: Floats, values: Floats) -> None:
            values[:] = [function(t, y) for function in functions]

        events.terminal, events.direction = [False, False, False, True], [1, -1, 1, 1]  # type: ignore[attr-defined]
        solver = CVODE(
            rates,
            method="BDF",
            linsolver="band",
            lband=self.band,
            uband=self.band,
            first_step=min(1e-10, stop - start),
            max_step=self.resolution.longest_step,
            max_num_steps=MOST_STEPS,
            eventsfn=events,
            num_events=len(functions),
            **self.tolerances(),
        )
        if stop - start < SAME:
            self.last = y
            return _answer(np.tile(y, (len(inside), 1)))
        first = int(np.searchsorted(inside, start + SAME))  # samples before it are the start itself
        last = int(np.searchsorted(inside, stop - SAME))
        at = np.concatenate(([start], inside[first:last], [stop]))
        answer = solver.solve(at, y)
        return self._as_scipy(answer, np.vstack([np.tile(y, (first, 1)), answer.y[np.isin(answer.t, at[1:])]]))

    def _as_scipy(self, answer: Any, rows: Floats) -> Any:
        """CVODE's answer in the form of `solve_ivp`'s, with the samples' states in rows."""
        times: list[Floats] = [np.empty(0)] * EVENTS
        states: list[Floats] = [np.empty((0, len(self.start)))] * EVENTS
        if answer.i_events is not None:
            for k in range(EVENTS):
                which = answer.i_events[:, k] != 0
                times[k], states[k] = answer.t_events[which], answer.y_events[which]
        self.last = np.array(answer.y[-1])
        return _answer(rows, times, states, bool(answer.success))


def _answer(rows: Floats, times: Any = ((),) * EVENTS, states: Any = ((),) * EVENTS, success: bool = True) -> Any:
    """Parts of a result of `solve_ivp` that `Model.run` uses; of the times of the samples only their number."""
    switched = int(len(times[-1]) > 0)
    return SimpleNamespace(
        success=success, status=switched, t=range(len(rows)), y=rows.T, t_events=times, y_events=states
    )


def solve_with(model: PeerModel, interval: float) -> Counted:
    """Simulate the model's point and sample it; a solver that sticks leaves a solution that is not finite."""
    samples = round(model.point.duration / interval)
    time: Floats = np.asarray(model.point.start + interval * np.arange(samples + 1), float)
    try:
        ran = model.run(time)
    except _Stuck:
        nothing = np.full((len(time), len(model.start)), np.nan)
        ran = nothing, Instants(), False
    return Counted(solution(model, time, *ran), model.evaluations)
