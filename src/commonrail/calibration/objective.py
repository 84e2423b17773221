"""Goal of a search, and misfit between an injector and measured data, for whole populations at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum, StrEnum
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arguments import amount, instance, instances, known_names
from commonrail.base.arrays import Bools, Floats
from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.parameter import Condition, Priors, broken, check_condition, distances_past
from commonrail.calibration.space import Space
from commonrail.data.base import DataSet, Term, is_metered
from commonrail.data.registry import get_kinds, in_order
from commonrail.data.simulator import Candidates, Simulator
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK, Status
from commonrail.engine.time_step import TIME_STEPS
from commonrail.physics.injector import Injector
from commonrail.physics.meters import is_of_meter
from commonrail.physics.variants import RETURN, reader_of, unread_inputs


class Loss(StrEnum):
    """Loss on the data that a search makes small."""

    KINDS = "kinds"
    """J that each kind of data defines: the paper's sum of |error| for a curve, the soft-L1 sum for a map."""

    SQUARES = "squares"
    """Sum of the squared residuals, for maps in units of their tolerances."""

    SOFT_L1 = "soft_l1"
    """Sum of 2 s² (sqrt(1 + (r/s)²) − 1) of the residuals r with a scale s: r² for small ones, 2 s |r| for large."""


class Goal(NamedTuple):
    """Rules of the objective besides the data: loss, and priors whose squared residuals are added to it.

    A candidate that does not meet one of the conditions loses, whatever its loss. `screening_step` is the time step [s]
    of the simulations that screen candidates in f32; None: time step of the search. `scale` is s of the loss
    `Loss.SOFT_L1`, in units of the residuals. A point outside `space` costs +inf and is not simulated.
    """

    loss: Loss = Loss.KINDS
    priors: Priors = Priors()
    conditions: tuple[Condition, ...] = ()
    screening_step: float | None = None
    scale: float = 1.0
    space: Space | None = None

    def bent(self, residuals: Floats) -> Floats:
        """Residuals (n, m) whose squares sum to the loss; unchanged unless the loss is soft L1.

        r sqrt(2/(1 + sqrt(1 + (r/s)²))), whose square is 2 s² (sqrt(1 + (r/s)²) − 1) without cancellation of digits.
        """
        if self.loss is not Loss.SOFT_L1:
            return residuals
        return np.asarray(residuals * np.sqrt(2.0 / (1.0 + _root(residuals, self.scale))))

    def roots_of_weights(self, residuals: Floats) -> Floats:
        """Roots (m,) of the weights that the soft-L1 loss gives residuals (m,).

        The weight is the slope of the loss in r², 1/sqrt(1 + (r/s)²): residuals far beyond s hardly count in standard
        errors.
        """
        return np.asarray(1.0 / np.sqrt(_root(residuals, self.scale)))


def _root(residuals: Floats, scale: float) -> Floats:
    return np.asarray(np.sqrt(1.0 + (residuals / scale) ** 2))


PLAIN = Goal()


def check_parts(injector: Injector, data: Sequence[DataSet], conditions: Sequence[Condition]) -> None:
    """Refuse (`ConfigurationError`) data and conditions about parts that the injector lacks."""
    for condition in conditions:
        check_condition(injector, condition)
    for data_set in data:
        if data_set.has_return and RETURN in unread_inputs(injector.variant):
            cure = f"take a model with {reader_of(RETURN)}, or remove these data"
            raise ConfigurationError(f"{injector.name} has no return line for the data {data_set.name}; {cure}.")


# Misfit between an injector and measured data, for whole populations at once.

NOT_SIMULATED = -1  # in place of a status


class Scores(NamedTuple):
    """Scores of candidates: costs (n,), +inf for a failed simulation, and the number of injections simulated.

    A status is the value of `Status` of the first failed operating point, or OK.
    """

    costs: Floats
    statuses: NDArray[np.int8]
    simulations: int


class FitObjective(Protocol):
    """Function that a fit minimises: costs and residuals of candidates (n, names), SI."""

    @property
    def statuses(self) -> type[IntEnum]:
        """Statuses that `costs` returns."""

    @property
    def goal(self) -> Goal:
        """Loss and priors."""

    @property
    def data(self) -> Sequence[Any]:
        """Fitted data sets."""

    @property
    def injections(self) -> int:
        """Simulations that a candidate takes."""

    @property
    def least_cost(self) -> float:
        """Objective below which a difference is one of rounding, not of the fit."""

    def costs(self, values: Floats) -> Scores:
        """Costs of candidates."""

    def residuals(self, values: Floats) -> Floats:
        """Residuals for least squares (n, those of the data, then of the priors), NaN where a simulation failed."""

    def screened(self, values: Floats) -> Floats:
        """Residuals as `residuals` returns them, of a coarser and quicker simulation where there is one."""

    def linearised(self, values: Floats) -> Floats:
        """Residuals for derivatives at the first candidate and for standard errors."""

    def why_failed(self, status: Any) -> str:
        """Sentence on a status of failed candidates, with its cure."""


class Objective:
    """Objective of a set of data: Σ weight · J over the data sets, and the squared pulls of the priors.

    J is as the kinds of data define it, the sum of the squared residuals, or their soft-L1 sum. `Study.objective`
    returns the objective of a study.

    Parameters
    ----------
    injector : Injector
        Gives the values that do not vary.
    names : sequence of str
        Parameters that vary.
    data : sequence of DataSet
        All of one role.
    time_step : float
        [s].
    threads : int or None
    precision : Precision
        Precision of the costs. Residuals for least squares, of which small differences are taken, and costs of curves
        measured through a meter are always f64.
    goal : Goal
        Loss, priors of the parameters that vary, and how candidates are screened.
    same_bits : bool
        As in `Simulator`.

    Attributes
    ----------
    statuses : type of IntEnum
        Names of the statuses that `costs` returns.
    """

    statuses: type[IntEnum] = Status

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
        self.injector, self.names = instance(injector, Injector, "injector"), tuple(names)
        self.time_step = time_step = amount(time_step, "s", "time step", TIME_STEPS)
        known_names([n for n in names if not is_of_meter(n)], injector.quantities, "names", "nozzle.hole_diameter")
        self.precision, self.goal = precision, goal
        self.simulator = Simulator(injector, names, time_step, threads, same_bits=same_bits)
        coarse = goal.screening_step or time_step
        self._screening = Simulator(injector, names, coarse, threads, precision=Precision.F32, same_bits=same_bits)
        self._costing = Simulator(injector, names, time_step, threads, precision=precision, same_bits=same_bits)
        data_sets = in_order(instances(data, DataSet, "data"))  # type: ignore[type-abstract]
        if len({d.role for d in data_sets}) > 1:
            raise ConfigurationError(
                "The data of an objective must have one role, and these are for fit and for validation; take "
                "study.objective(), or the data of one role."
            )
        check_parts(injector, data_sets, goal.conditions)
        self._points = tuple(condition.point for condition in goal.conditions)
        # drop ideal meters
        self.data = tuple(
            d if d.meter is None or is_metered(d, self.simulator) else d.changed(meter=None) for d in data_sets
        )
        kinds = get_kinds(d.kind for d in self.data)
        groups = ((kind, [d for d in self.data if d.kind == kind.kind]) for kind in kinds)
        self._terms = [term for kind, group in groups for term in kind.terms(group, time_step)]

    def use_threads(self, threads: int | None) -> None:
        """Simulate with so many threads; all usable processors if None."""
        self.simulator.threads = threads

    @property
    def least_cost(self) -> float:
        """Objective at which rounding dominates; 0 here."""
        return 0.0

    @property
    def injections(self) -> int:
        """Single injections that a candidate takes."""
        return sum(len(data.simulated_points) for data in self.data) + len(self.goal.conditions)

    def why_failed(self, status: Status) -> str:
        """Sentence on a status of failed candidates, with its cure."""
        return f"{status.sentence} Check the start values with `commonrail simulate`."

    def costs(self, values: Floats) -> Scores:
        """Objective of candidates (n, names), SI."""
        if self.goal.space is None or (inside := self.goal.space.satisfies(values)).all():
            return self._costs(values)
        costs, statuses = np.full(len(values), np.inf), np.full(len(values), NOT_SIMULATED, np.int8)
        simulations = 0
        if inside.any():
            costs[inside], statuses[inside], simulations = self._costs(values[inside])
        return Scores(costs, statuses, simulations)

    def _costs(self, values: Floats) -> Scores:
        total = np.zeros(len(values))
        statuses = np.zeros(len(values), np.int8)
        for term in self._terms if self.goal.loss is not Loss.SOFT_L1 else ():
            batch = _batch_of(self, term, values)
            losses = term.squares if self.goal.loss is Loss.SQUARES else term.misfits
            total += np.sum(losses(batch, Candidates(self.simulator, values)) * term.weights, axis=1)
            statuses = _first_failures(statuses, batch.status, term.failed(batch.status))
        if self.goal.loss is Loss.SOFT_L1:
            total += np.sum(self._of_data(self._costing, values, self.goal.bent) ** 2, axis=1)
            lost = ~np.isfinite(total)  # simulate again for the statuses
            for term in self._terms if lost.any() else ():
                status = _batch_of(self, term, values[lost]).status
                statuses[lost] = _first_failures(statuses[lost], status, term.failed(status))
        if self._points:
            batch = self.simulator.batch(self._points, values, self.precision)
            lost = broken(self.goal.conditions, batch, distances_past(self.goal.conditions, self.simulator, values))
            total[lost.any(axis=1)] = np.inf
            reasons = np.where(batch.status == OK, Status.CONDITION_NOT_MET, batch.status)
            statuses = _first_failures(statuses, reasons, lost)
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
        batches = ((term, _batch_of(self, term, values)) for term in self._terms)
        return np.concatenate([term.misfits(batch, candidates) for term, batch in batches], axis=1)

    def residuals(self, values: Floats) -> Floats:
        """Residuals for least squares (n, all samples and points, then priors).

        The residuals of a data set are scaled by the root of its weight; for a loss of squares or soft L1, their
        squares sum to the loss. They are NaN for a candidate that violates a condition.
        """
        return self._residuals(self.simulator, values)

    def screened(self, values: Floats) -> Floats:
        """Residuals as `residuals` returns them, in f32 and at the time step of the screening."""
        return self._residuals(self._screening, values)

    def _residuals(self, simulator: Simulator, values: Floats) -> Floats:
        of_data = self._of_data(simulator, values, self.goal.bent)  # their squares sum to the loss
        residuals = np.concatenate([of_data, self.goal.priors.residuals(values)], axis=1)
        if self._points:
            conditions, batch = self.goal.conditions, simulator.batch(self._points, values)
            lost = broken(conditions, batch, distances_past(conditions, simulator, values))
            residuals[lost.any(axis=1)] = np.nan
        return residuals

    def _of_data(self, simulator: Simulator, values: Floats, law: Callable[[Floats], Floats]) -> Floats:
        """Residuals (n, all samples and points); `law` transforms each data set before its weight is applied."""
        simulator.threads = self.simulator.threads
        residuals = []
        for d in self.data:
            of_set = d.residuals(d.simulated(simulator, values))
            root = np.sqrt(d.weight)
            residuals.append(of_set if self.goal.loss is not Loss.SOFT_L1 else root * law(of_set / root))
        return np.concatenate(residuals, axis=1)

    def linearised(self, values: Floats) -> Floats:
        """Residuals as `residuals` returns them, for derivatives at the first candidate and standard errors.

        If the loss weights residuals by size, each residual is multiplied by the root of its weight at the first
        candidate.
        """
        if self.goal.loss is not Loss.SOFT_L1:
            return self.residuals(values)
        of_data = self._of_data(
            self.simulator, values, lambda residuals: residuals * self.goal.roots_of_weights(residuals[0])
        )
        return np.concatenate([of_data, self.goal.priors.residuals(values)], axis=1)


def _batch_of(objective: Objective, term: Term, values: Floats) -> Batch:
    """Candidates at the points of a term, with the objective's precision."""
    return objective.simulator.batch(term.points, values, objective.precision, term.misfit, to_horizon=term.to_horizon)


def _first_failures(
    statuses: NDArray[np.int8], point_statuses: NDArray[np.integer[Any]], failed: Bools
) -> NDArray[np.int8]:
    """Statuses (n,) in which OK is replaced by the status of the first failed point."""
    if not failed.any():
        return statuses
    first = point_statuses[np.arange(len(point_statuses)), np.argmax(failed, axis=1)].astype(np.int8)
    return np.where(failed.any(axis=1) & (statuses == OK), first, statuses)
