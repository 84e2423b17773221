"""The paper's differential evolution, DE/rand/1/bin, Eq. (17) to (20)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from commonrail.calibration.optimisers.base import (
    Best,
    Counts,
    Trials,
    check_origin,
    clean_costs,
    origin,
    restore_generator,
)
from commonrail.calibration.optimisers.evolution_settings import (
    EvolutionSettings,
    InitialSampling,
)
from commonrail.calibration.optimisers.operators import crossover, draw, mutate
from commonrail.calibration.optimisers.treatments import Treated, treat, wins
from commonrail.calibration.sampling import reference_start, sample_feasible, sample_uniform
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError, StudyError

__all__ = ["DifferentialEvolution"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


class DifferentialEvolution:
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

    phase = "evolution"

    def __init__(
        self,
        space: Space,
        rng: np.random.Generator,
        settings: EvolutionSettings | None = None,
        start: ArrayLike | None = None,
    ) -> None:
        self.space = space
        self.settings = settings or EvolutionSettings()
        self._rng = rng
        if start is None and self.settings.initial is InitialSampling.REFERENCE:
            start = reference_start(space)
        self._start = _check_start(space, start, self.settings.members)
        self._generation = 0
        self._unit = np.empty((0, space.dimension))
        self._costs = np.empty(0)
        self._violations = np.empty(0)
        self._counts = Counts()
        self._pending: tuple[Treated, Mapping[str, Any]] | None = None

    @property
    def steps(self) -> int:
        """Generations told, the initial population included."""
        return self._generation

    @property
    def total(self) -> int:
        """Generations wanted, the initial population included."""
        return 1 + self.settings.generations

    @property
    def finished(self) -> bool:
        """Whether G_max generations have followed the initial population."""
        return self._generation > self.settings.generations

    @property
    def reason(self) -> str:
        """Why the search has stopped; empty while it has not."""
        if not self.finished:
            return ""
        return f"all {self.settings.generations} generations after the initial population are done"

    @property
    def population(self) -> FloatArray:
        """Members (n, d), SI; no rows before the first `tell`."""
        return self.space.from_unit(self._unit)

    @property
    def costs(self) -> FloatArray:
        """Costs (n,) of the members; +inf where the simulation failed or there was none."""
        return self._costs.copy()

    @property
    def counts(self) -> Counts:
        """Slots, simulations and failures so far."""
        return self._counts

    @property
    def best(self) -> Best:
        """The best feasible member; the centre of the space, at +inf, until one has succeeded."""
        winner = int(np.argmin(self._costs)) if len(self._costs) else -1
        if winner < 0 or self._costs[winner] == np.inf:
            return Best(self.space.centre.copy(), np.inf)
        return Best(self.space.from_unit(self._unit[winner]), float(self._costs[winner]))

    def ask(self) -> Trials:
        """Return one generation of trials, the same ones until they are answered.

        Raises
        ------
        StudyError
            If the search has finished.
        """
        if self.finished:
            raise StudyError(f"the search has finished ({self.reason}): read its best member")
        if self._pending is None:
            before = self._rng.bit_generator.state
            treated = self._first() if self._generation == 0 else self._next()
            self._pending = (treated, before)
        treated, _ = self._pending
        return Trials(treated.x.copy(), treated.simulate)

    def tell(self, answers: ArrayLike) -> None:
        """Take the costs (n,) of the generation asked for and select its survivors, Eq. (20).

        Raises
        ------
        StudyError
            If nothing was asked for, or there is not one cost for each trial.
        """
        if self._pending is None:
            raise StudyError("costs were told before any trials were asked for: ask first")
        trial, _ = self._pending
        told = clean_costs(answers, trial.simulate)
        self._counts = self._counts.plus(told, trial.simulate)
        if self._generation == 0:
            self._unit, self._costs, self._violations = trial.unit, told, trial.violation
        else:
            self._select(trial, told)
        self._generation += 1
        self._pending = None

    def _select(self, trial: Treated, told: FloatArray) -> None:
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

        def redraw(members: IntArray) -> FloatArray:
            return self._rng.random((len(members), self.settings.redraws, d))

        unit = self.space.to_unit(sample)
        return treat(self.settings.treatment, self.space, centre, unit, redraw)

    def _next(self) -> Treated:
        """One generation of trials."""

        def redraw(members: IntArray) -> FloatArray:
            times = self.settings.redraws
            trials = self._trials(np.repeat(members, times))
            return trials.reshape(len(members), times, -1)

        trials = self._trials(np.arange(self.settings.members))
        return treat(self.settings.treatment, self.space, self._unit, trials, redraw)

    def _trials(self, members: IntArray) -> FloatArray:
        """Raw trials (k, d) for `members` (k,)."""
        draws = draw(self._rng, members, self._unit.shape, self.settings.factor)
        mutants = mutate(self._unit, draws)
        return crossover(self._unit[members], mutants, draws, self.settings.crossover)

    def state(self) -> dict[str, Any]:
        """The search as it was before any unanswered `ask`: arrays, numbers, generator's state."""
        now = self._rng.bit_generator.state
        return {
            **self._origin(),
            "generation": self._generation,
            "unit": self._unit.copy(),
            "costs": self._costs.copy(),
            "violations": self._violations.copy(),
            "counts": asdict(self._counts),
            "rng": dict(now if self._pending is None else self._pending[1]),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state`; trials asked for but not answered are asked for again.

        Raises
        ------
        ConfigurationError
            If the state belongs to another method, space or settings, or another generator.
        """
        check_origin(state, self._origin())
        restore_generator(self._rng, state)
        members, dimension = self.settings.members, self.space.dimension
        shapes = [np.shape(state[name]) for name in ("unit", "costs", "violations")]
        if shapes != [(members, dimension), (members,), (members,)] and state["generation"] > 0:
            raise ConfigurationError(f"state: its population is not one of {members} members; take a whole state")
        self._generation = int(state["generation"])
        shape = (-1, self.space.dimension)
        self._unit = np.array(state["unit"], dtype=float).reshape(shape)
        self._costs = np.array(state["costs"], dtype=float)
        self._violations = np.array(state["violations"], dtype=float)
        self._counts = Counts(**state["counts"])
        self._pending = None
        inside = np.all(np.abs(self._unit - 0.5) <= 0.5 + 1e-9)  # to unit coordinates and back rounds
        if not (inside and np.all(self._costs > -np.inf) and np.all(self._violations >= 0.0)):
            raise ConfigurationError("state: its population lies outside the bounds or has costs that are no numbers")
        if not all(isinstance(count, int) and count >= 0 for count in asdict(self._counts).values()):
            raise ConfigurationError("state: its counts are no whole numbers")

    def _origin(self) -> dict[str, Any]:
        """What a state must share with this search; more generations may be wanted of that one."""
        settings = asdict(self.settings)
        del settings["generations"]
        return origin("differential_evolution", self.space, settings=[str(value) for value in settings.values()])


def _check_start(space: Space, start: ArrayLike | None, members: int) -> FloatArray:
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
