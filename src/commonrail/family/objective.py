"""Objective of several parts that are fitted together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.arrays import Floats, IndexArray
from commonrail.calibration.goal import Goal, Loss
from commonrail.calibration.objective import Objective, Scores
from commonrail.calibration.prior import Priors
from commonrail.calibration.search import goal_of
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study
from commonrail.family.sharing import Sharing
from commonrail.kinds import Role, of_role

__all__ = ["FamilyObjective"]


class FamilyObjective(Objective):
    """Sum of the parts' objectives, and the squared pulls of the priors of the joint parameters.

    Each part simulates its own candidates in its own batches; candidates that are the same for a part, as most are that
    differ in another part's own parameters alone, are simulated once.

    Parameters
    ----------
    studies : sequence of Study
        One for each part.
    sharing : Sharing
    space : Space
        Of the joint parameters, with their priors.
    threads : int or None
    """

    def __init__(self, studies: Sequence[Study], sharing: Sharing, space: Space, threads: int | None = None) -> None:
        self.sharing, self.names, self._reference = sharing, sharing.names, space.reference
        self.parts = [_objective(study, threads) for study in studies]
        conditions = tuple(condition for study in studies for condition in study.conditions)
        self.goal = Goal(studies[0].loss, Priors.of(space.parameters), conditions, scale=studies[0].loss_scale)
        self.data = tuple(data for part in self.parts for data in part.data)
        self.simulator = self.parts[0].simulator

    @property
    def threads(self) -> int | None:
        """Threads that simulate; all usable processors if None."""
        return self.parts[0].threads

    @threads.setter
    def threads(self, threads: int | None) -> None:
        for part in self.parts:
            part.threads = threads

    def own_values(self) -> list[float]:
        """Reference values of the joint parameters [SI]."""
        return [float(value) for value in self._reference]

    def costs(self, values: Floats) -> Scores:
        """Objective of joint candidates (n, names), SI; one that is simulated once for several counts for each."""
        total, statuses = self.goal.priors.costs(values), np.zeros(len(values), np.int8)
        for part, (own, which) in zip(self.parts, self._distinct(values), strict=True):
            scores = part.costs(own)
            total = total + scores.costs[which]
            statuses = np.where(statuses == 0, scores.statuses[which], statuses).astype(np.int8)
        return Scores(total, statuses, len(values) * self.injections)

    def residuals(self, values: Floats) -> Floats:
        """Residuals (n, those of all parts, then priors)."""
        found = [p.residuals(own)[which] for p, (own, which) in zip(self.parts, self._distinct(values), strict=True)]
        return np.concatenate([*found, self.goal.priors.residuals(values)], axis=1)

    def screened(self, values: Floats) -> Floats:
        """Residuals as `residuals` returns them, in f32 and at the time step of the screening."""
        found = [p.screened(own)[which] for p, (own, which) in zip(self.parts, self._distinct(values), strict=True)]
        return np.concatenate([*found, self.goal.priors.residuals(values)], axis=1)

    def linearised(self, values: Floats) -> Floats:
        """Residuals for derivatives at the first candidate, see `Objective.linearised`."""
        if self.goal.loss is not Loss.SOFT_L1:
            return self.residuals(values)
        found = [part.linearised(self.sharing.of_part(k, values)) for k, part in enumerate(self.parts)]
        return np.concatenate([*found, self.goal.priors.residuals(values)], axis=1)

    def _distinct(self, values: Floats) -> list[tuple[Floats, IndexArray]]:
        """For each part its candidates, each once, and which of them belongs to each joint candidate."""
        found = []
        for k in range(len(self.parts)):
            own, which = np.unique(self.sharing.of_part(k, values), axis=0, return_inverse=True)
            found.append((own, which.reshape(-1)))
        return found


def _objective(study: Study, threads: int | None) -> Objective:
    """Objective of a part's fit data without priors: those of the joint parameters count once."""
    goal = goal_of(study)._replace(priors=Priors())
    names, fit = study.space.names, of_role(study.data, Role.FIT)
    how = study.time_step, threads, study.precision
    return Objective(study.injector, names, fit, *how, goal=goal, same_bits=study.same_bits)
