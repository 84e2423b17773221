"""Misfit between an injector and measured data, for whole populations at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.conditions import broken
from commonrail.calibration.goal import PLAIN, Goal, Loss
from commonrail.choices import Precision
from commonrail.engine.status import OK, Status
from commonrail.injector.definition import Injector
from commonrail.kinds import KINDS, DataSet, in_order
from commonrail.kinds.metering import meters_of
from commonrail.kinds.simulator import Candidates, Simulator
from commonrail.observation.signal import given_values

__all__ = ["Objective", "Scores"]

Floats = NDArray[np.float64]


class Scores(NamedTuple):
    """Outcome of candidates.

    Attributes
    ----------
    costs : (n,)
        Objective, +inf where a simulation failed.
    statuses : (n,) int8
        Value of `Status`: of the first operating point that failed, OK if none did.
    simulations : int
        Single injections that it took.
    """

    costs: Floats
    statuses: NDArray[np.int8]
    simulations: int


class Objective:
    """Objective of a set of data: Σ weight · J over the data sets, and the squared pulls of the priors.

    J is as the kinds of data define it, or the sum of the squared residuals.

    Parameters
    ----------
    injector : Injector
        Gives the values that do not vary.
    names : sequence of str
        Parameters that vary.
    data : sequence of DataSet
    time_step : float
        [s].
    threads : int or None
    precision : Precision
        Of the costs; the residuals for least squares, which are differences of small changes, are f64 always, and so
        are the costs of curves that are seen through a meter.
    goal : Goal
        Loss, priors of the parameters that vary, and how candidates are screened.
    same_bits : bool
        As in `Simulator`.
    """

    def __init__(
        self,
        injector: Injector,
        names: Sequence[str],
        data: Sequence[DataSet],
        time_step: float,
        threads: int | None = None,
        precision: Precision = Precision.F64,
        *,
        goal: Goal = PLAIN,
        same_bits: bool = False,
    ) -> None:
        self.injector, self.names, self.time_step = injector, tuple(names), time_step
        self.precision, self.goal = precision, goal
        self.simulator = Simulator(injector, names, time_step, threads, same_bits=same_bits)
        coarse = goal.screening_step or time_step
        self._screening = Simulator(injector, names, coarse, threads, precision=Precision.F32, same_bits=same_bits)
        self._points = tuple(condition.point for condition in goal.conditions)
        self.data = tuple(self._without_neutral_meter(d) for d in in_order(data))
        groups = ((kind, [d for d in self.data if d.kind == name]) for name, kind in KINDS.items())
        self._terms = [term for kind, group in groups if group for term in kind.terms(group, time_step)]

    def _without_neutral_meter(self, data: DataSet) -> DataSet:
        """The data set itself, or without its meter if that shows what it is given."""
        return data if data.meter is None or data.is_metered(self.simulator) else data.with_meter(None)

    @property
    def threads(self) -> int | None:
        """Threads that simulate; all usable processors if None."""
        return self.simulator.threads

    @threads.setter
    def threads(self, threads: int | None) -> None:
        self.simulator.threads = threads

    def own_values(self) -> list[float]:
        """Values of the parameters that vary as injector and meters have them [SI]."""
        meters = {
            meter.parameter(key): float(value[0])
            for meter in meters_of(self.data)
            for key, value in given_values(meter, {}, 1).items()
        }
        return [self.injector.values[n] if n in self.injector.values else meters[n] for n in self.names]

    @property
    def injections(self) -> int:
        """Single injections that a candidate takes."""
        return sum(data.injections for data in self.data) + len(self.goal.conditions)

    def costs(self, values: Floats) -> Scores:
        """Objective of candidates (n, names), SI."""
        total = np.zeros(len(values))
        statuses = np.zeros(len(values), np.int8)
        for term in self._terms:
            batch = self.simulator.batch(term.points, values, self.precision, term.misfit)
            losses = term.squares if self.goal.loss is Loss.SQUARES else term.misfits
            total += np.sum(losses(batch, Candidates(self.simulator, values)) * term.weights, axis=1)
            _note_failures(statuses, batch.status, term.failed(batch.status))
        if self._points:
            batch = self.simulator.batch(self._points, values, self.precision)
            lost = broken(self.goal.conditions, batch)
            total[lost.any(axis=1)] = np.inf
            _note_failures(statuses, np.where(batch.status == OK, Status.CONDITION_NOT_MET, batch.status), lost)
        if len(self.goal.priors):
            total += self.goal.priors.costs(values)
        finite = np.isfinite(total)
        if not finite.all():
            statuses[~finite & (statuses == OK)] = Status.NOT_FINITE
            total = np.where(finite, total, np.inf)
        return Scores(total, statuses, len(values) * self.injections)

    def misfits(self, values: Floats) -> Floats:
        """J of each data set, (n, data sets) in the order of `data`, without weights; NaN for a failed simulation."""
        candidates = Candidates(self.simulator, values)
        batches = ((t, self.simulator.batch(t.points, values, self.precision, t.misfit)) for t in self._terms)
        return np.concatenate([term.misfits(batch, candidates) for term, batch in batches], axis=1)

    def residuals(self, values: Floats) -> Floats:
        """Residuals for least squares (n, all samples and points, then priors).

        Those of a data set are scaled by the root of its weight; of a candidate that does not meet a condition they are
        NaN.
        """
        return self._residuals(self.simulator, values)

    def screened(self, values: Floats) -> Floats:
        """Residuals as `residuals` returns them, in f32 and at the time step of the screening."""
        return self._residuals(self._screening, values)

    def _residuals(self, simulator: Simulator, values: Floats) -> Floats:
        simulator.threads = self.threads
        found = [d.residuals(d.simulated(simulator, values)) for d in self.data]
        residuals = np.concatenate([*found, self.goal.priors.residuals(values)], axis=1)
        if self._points:
            residuals[broken(self.goal.conditions, simulator.batch(self._points, values)).any(axis=1)] = np.nan
        return residuals


def _note_failures(statuses: NDArray[np.int8], found: NDArray[np.integer[Any]], failed: NDArray[np.bool_]) -> None:
    """Put the first status (n, points) that failed where there is none yet (n,)."""
    if failed.any():
        first = found[np.arange(len(found)), np.argmax(failed, axis=1)]
        np.copyto(statuses, first.astype(np.int8), where=failed.any(axis=1) & (statuses == OK))
