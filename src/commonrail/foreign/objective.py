"""Objective of a study of a foreign FMU."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.arrays import Floats
from commonrail.calibration.goal import Goal
from commonrail.calibration.objective import Objective, Scores
from commonrail.calibration.prior import Priors
from commonrail.foreign.simulator import FmuSimulator
from commonrail.foreign.statuses import FmuStatus
from commonrail.foreign.study import FmuStudy
from commonrail.kinds import Role

__all__ = ["FmuObjective"]


EXACT = 1e-6  # relative error of a simulation, which solvers of FMUs do not fall below


class FmuObjective(Objective):
    """Σ weight · loss of the residuals in tolerances, over the data with role fit.

    Parameters
    ----------
    study : FmuStudy
    simulator : FmuSimulator
    """

    statuses = FmuStatus

    def __init__(self, study: FmuStudy, simulator: FmuSimulator) -> None:
        self.names, self._reference = study.space.names, study.space.reference
        self.goal = Goal(study.loss, Priors.of(study.space.parameters), scale=study.loss_scale)
        self._fitted = tuple(one for one in study.data if one.role is Role.FIT)
        self.data: tuple[Any, ...] = self._fitted
        self._fmu = simulator

    @property
    def least_cost(self) -> float:
        """Objective that errors of the simulations alone leave: data without noise let costs differ by them alone."""
        sizes = ((d.weight, EXACT * d.measured / d.tolerances) for d in self._fitted)
        return float(sum(weight * np.sum(size**2) for weight, size in sizes))

    @property
    def threads(self) -> int | None:
        """Return None: an FMU is simulated in processes."""
        return None

    @threads.setter
    def threads(self, threads: int | None) -> None:
        """Ignore threads."""

    def own_values(self) -> list[float]:
        """Reference values of the free parameters."""
        return [float(value) for value in self._reference]

    @property
    def injections(self) -> int:
        """Simulations that a candidate takes."""
        return sum(len(one.runs) for one in self._fitted)

    def costs(self, values: Floats) -> Scores:
        """Objective of candidates (n, names); +inf with a status where one of its simulations failed."""
        residuals, statuses = self._found(values)
        costs = np.sum(residuals**2, axis=1)
        if len(self.goal.priors):
            costs = costs + self.goal.priors.costs(values)
        failed = (statuses != FmuStatus.FMU_OK) | ~np.isfinite(costs)
        statuses = np.where(failed & (statuses == FmuStatus.FMU_OK), FmuStatus.FMU_NOT_FINITE, statuses)
        return Scores(np.where(failed, np.inf, costs), statuses.astype(np.int8), len(values) * self.injections)

    def residuals(self, values: Floats) -> Floats:
        """Residuals (n, all values, then priors); NaN in what a failed simulation would have given."""
        return np.concatenate([self._found(values)[0], self.goal.priors.residuals(values)], axis=1)

    def screened(self, values: Floats) -> Floats:
        """Residuals as `residuals` returns them: an FMU has no coarser simulation."""
        return self.residuals(values)

    def linearised(self, values: Floats) -> Floats:
        """Residuals for derivatives at the first candidate, see `Objective.linearised`."""
        found = self._plain(self._fmu.simulate(self._fitted, values).values)
        weights = [self.goal.roots_of_weights(own[0]) if self.goal.bent(own) is not own else 1.0 for own in found]
        parts = [np.sqrt(d.weight) * w * r for d, w, r in zip(self._fitted, weights, found, strict=True)]
        return np.concatenate([*parts, self.goal.priors.residuals(values)], axis=1)

    def _found(self, values: Floats) -> tuple[Floats, NDArray[np.int8]]:
        """Residuals (n, all values) whose squares sum to the loss, and statuses (n,)."""
        simulated = self._fmu.simulate(self._fitted, values)
        found = zip(self._fitted, self._plain(simulated.values), strict=True)
        return np.concatenate([np.sqrt(d.weight) * self.goal.bent(r) for d, r in found], axis=1), simulated.statuses

    def _plain(self, values: Floats) -> list[Floats]:
        """Residuals in tolerances of each data set."""
        edges = np.cumsum([len(one.measured) for one in self._fitted])[:-1]
        return [d.residuals(own) for d, own in zip(self._fitted, np.split(values, edges, axis=1), strict=True)]
