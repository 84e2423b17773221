"""The paper's differential evolution, DE/rand/1/bin, Eq. (17) to (20)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from commonrail.arrays import Floats, IndexArray
from commonrail.calibration.optimisers.base import Best, Optimiser, Trials
from commonrail.calibration.optimisers.evolution_settings import EvolutionSettings, InitialSampling
from commonrail.calibration.optimisers.operators import crossover, draw, mutate
from commonrail.calibration.optimisers.treatments import Treated, treat, wins
from commonrail.calibration.sampling import reference_start, sample_feasible, sample_uniform
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError

__all__ = ["DifferentialEvolution"]


class DifferentialEvolution(Optimiser):
    """DE/rand/1/bin with F ~ U(0.4, 1) for every member and parameter, Eq. (17) to (20).

    A generation is asked for, and told, as a whole: every trial of it stems from the population
    of the generation before. The search moves in unit coordinates. F multiplies differences one
    parameter at a time, so for linear scales that is Eq. (18) in SI itself.

    Parameters
    ----------
    space : Space
        Parameters, bounds, constraints.
    rng : numpy.random.Generator
        Source of every draw.
    settings : EvolutionSettings, optional
        The defaults are the paper's.
    start : (k, d) array, optional
        Points, SI, that take the place of the first k <= members draws of the initial population; by default the
        reference values of the space if the settings' `initial` says so, otherwise none.

    Raises
    ------
    ConfigurationError
        If a point of `start`, or the reference where it is to start, does not satisfy the space; or if there are too
        many.
    """

    method, phase = "differential evolution", "evolution"

    def __init__(
        self,
        space: Space,
        rng: np.random.Generator,
        settings: EvolutionSettings | None = None,
        start: ArrayLike | None = None,
    ) -> None:
        super().__init__(space, rng)
        self.settings = settings or EvolutionSettings()
        if start is None and self.settings.initial is InitialSampling.REFERENCE:
            start = reference_start(space)
        self._start = _check_start(space, start, self.settings.members)
        self._unit = np.empty((0, space.dimension))
        self._costs = self._violations = np.empty(0)
        self._trial = Treated(self._unit, self._violations, self._unit)

    @property
    def total(self) -> int:
        """Generations wanted, the initial population included."""
        return 1 + self.settings.generations

    @property
    def _ended(self) -> str:
        return f"all {self.settings.generations} generations after the initial population are done"

    @property
    def population(self) -> Floats:
        """Members (n, d), SI; no rows before the first `tell`."""
        return self.space.from_unit(self._unit)

    @property
    def costs(self) -> Floats:
        """Costs (n,) of the members; +inf where the simulation failed or there was none."""
        return self._costs.copy()

    @property
    def best(self) -> Best:
        """The best feasible member; the centre of the space, at +inf, until one has succeeded."""
        winner = int(np.argmin(self._costs)) if len(self._costs) else -1
        if winner < 0 or self._costs[winner] == np.inf:
            return Best(self.space.centre.copy(), np.inf)
        return Best(self.space.from_unit(self._unit[winner]), float(self._costs[winner]))

    def _propose(self) -> Trials:
        """One generation."""
        self._trial = self._next() if self.steps else self._first()
        return Trials(self._trial.x, self._trial.simulate)

    def _take(self, trials: Trials, told: Floats) -> None:
        """Select the survivors, Eq. (20)."""
        if self.steps:
            self._select(self._trial, told)
        else:
            self._unit, self._costs, self._violations = self._trial.unit, told, self._trial.violation

    def _select(self, trial: Treated, told: Floats) -> None:
        better = wins((told, trial.violation), (self._costs, self._violations))
        self._unit = np.where(better[:, None], trial.unit, self._unit)
        self._costs = np.where(better, told, self._costs)
        self._violations = np.where(better, trial.violation, self._violations)

    def _first(self) -> Treated:
        """The initial population, treated from the centre of the space."""
        n, d = self.settings.members, self.space.dimension
        uniform = self.settings.initial == InitialSampling.UNIFORM
        sample = (sample_uniform if uniform else sample_feasible)(self.space, n, self._rng)
        sample[: len(self._start)] = self._start
        centre = np.tile(self.space.to_unit(self.space.centre), (n, 1))

        def redraw(members: IndexArray) -> Floats:
            return self._rng.random((len(members), self.settings.redraws, d))

        unit = self.space.to_unit(sample)
        return treat(self.settings.treatment, self.space, centre, unit, redraw)

    def _next(self) -> Treated:
        """One generation of trials."""

        def redraw(members: IndexArray) -> Floats:
            times = self.settings.redraws
            trials = self._trials(np.repeat(members, times))
            return trials.reshape(len(members), times, -1)

        trials = self._trials(np.arange(self.settings.members))
        return treat(self.settings.treatment, self.space, self._unit, trials, redraw)

    def _trials(self, members: IndexArray) -> Floats:
        """Raw trials (k, d) for `members` (k,)."""
        draws = draw(self._rng, members, self._unit.shape, self.settings.factor)
        mutants = mutate(self._unit, draws)
        return crossover(self._unit[members], mutants, draws, self.settings.crossover)

    def _origin(self) -> dict[str, Any]:
        settings = asdict(self.settings)
        del settings["generations"]  # more may be wanted of the search that goes on
        return super()._origin() | {"settings": [str(value) for value in settings.values()]}

    def _kept(self) -> dict[str, Any]:
        return {"unit": self._unit.copy(), "costs": self._costs.copy(), "violations": self._violations.copy()}

    def _restore(self, state: Mapping[str, Any]) -> None:
        members = self.settings.members if self.steps else 0
        arrays = {name: np.array(state[name], dtype=float) for name in ("unit", "costs", "violations")}
        if [a.shape for a in arrays.values()] != [(members, self.space.dimension), (members,), (members,)]:
            raise ConfigurationError(f"state: its population is not one of {members} members; take a whole state")
        self._unit, self._costs, self._violations = arrays.values()
        inside = np.all(np.abs(self._unit - 0.5) <= 0.5 + 1e-9)  # to unit coordinates and back rounds
        if not (inside and np.all(self._costs > -np.inf) and np.all(self._violations >= 0.0)):
            raise ConfigurationError("state: its population lies outside the bounds or has costs that are no numbers")


def _check_start(space: Space, start: ArrayLike | None, members: int) -> Floats:
    points = np.empty((0, space.dimension)) if start is None else np.atleast_2d(np.asarray(start))
    if points.ndim != 2 or points.shape[1] != space.dimension or len(points) > members:
        raise ConfigurationError(
            f"start: an array of shape {points.shape} was given, expected at most {members} rows "
            f"of {space.dimension} values"
        )
    refused = np.flatnonzero(~space.satisfies(points))
    if len(refused):
        raise ConfigurationError(f"start: row {refused[0] + 1} breaks the bounds or a constraint, correct or remove it")
    return points.astype(float)
