"""The paper's differential evolution, DE/rand/1/bin, Eq. (17) to (20)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import array, enum_member, number, settle
from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.optimisers.base import (
    MOST_GENERATIONS,
    MOST_MEMBERS,
    Best,
    Optimiser,
    Registered,
    Trials,
    Work,
    check_counts,
    count,
    inside,
)
from commonrail.calibration.space import Space, reference_start, sample_feasible, sample_uniform

# The operators of DE/rand/1/bin, Eq. (18) and (19): draws first, then pure functions of them.


class Draws(NamedTuple):
    """The random numbers behind k trials of d parameters.

    `others` (3, k) are the members r1, r2, r3; `factor` (k, d) is F; `chance` (k, d) is the
    rnd of Eq. (19); `forced` (k,) is j_rand.
    """

    others: IndexArray
    factor: Floats
    chance: Floats
    forced: IndexArray


def draw(
    rng: np.random.Generator,
    members: IndexArray,
    population: tuple[int, ...],
    factor: tuple[float, float],
) -> Draws:
    """Draw everything that one mutation and crossover needs.

    `members` (k,) int: parents; `population` (n, d): shape of the population, n >= 4; `factor` (float, float): range of
    F. r1, r2, r3 are drawn from as many numbers as there are members left to choose from, and then shifted past those
    already taken, in ascending order: uniform over all ordered triples of other members, without a loop or a repeat.
    """
    size, dimension = population
    count = len(members)
    others = np.empty((3, count), np.intp)
    taken: list[IndexArray] = [members]  # in ascending order for each member
    for k, other in enumerate(others):
        other[:] = rng.integers(0, size - len(taken), count)
        for earlier in taken:
            other += other >= earlier
        if k < 2:
            taken = _sorted_with(taken, other)
    low, high = factor
    return Draws(
        others=others,
        factor=low + (high - low) * rng.random((count, dimension)),
        chance=rng.random((count, dimension)),
        forced=rng.integers(0, dimension, count),
    )


def _sorted_with(ascending: list[IndexArray], further: IndexArray) -> list[IndexArray]:
    """One more row in the ascending order of each column."""
    rows = []
    for row in ascending:
        rows.append(np.minimum(row, further))
        further = np.maximum(row, further)
    return [*rows, further]


def mutate(population: Floats, draws: Draws) -> Floats:
    """Mutants (k, d) of a population (n, d): v = x_r1 + F (x_r2 - x_r3), Eq. (18)."""
    first, second, third = population[draws.others]
    return np.asarray(first + draws.factor * (second - third))


def crossover(parents: Floats, mutants: Floats, draws: Draws, rate: float) -> Floats:
    """Trials (k, d): the mutant's value where rnd <= CR or j = j_rand, else the parent's (19).

    `parents`, `mutants` (k, d); `rate`: CR.
    """
    taken = draws.chance <= rate
    taken[np.arange(len(taken)), draws.forced] = True
    return np.where(taken, mutants, parents)


# Treatments of trials that break bounds or constraints.
#
# The paper does not say what it did. Of the draws in its box 0.3 % keep the ordering, so the choice
# decides how many of the slots are simulated at all. Each treatment here has a name, to be recorded
# with the result, and one signature: `Treated` from the space, the parents and the raw trials.

Redraw = Callable[[IndexArray], Floats]
"""Further raw trials (k, times, d) for the members (k,), in unit coordinates."""


class Treatment(StrEnum):
    """Named treatments of trials that break bounds or constraints."""

    REJECT = "reject"
    """A trial outside bounds or constraints is not simulated and its parent stays."""

    REPAIR = "repair"
    """Bounds: reflection. Orderings: values sorted along the chain. Whatever is then still broken:
    moved towards the parent, as far as the last feasible point between them."""

    FEASIBILITY_RULES = "feasibility_rules"
    """Bounds: reflection. Constraints: feasible beats infeasible, less violation beats more (Deb
    2000, Lampinen 2002); an infeasible trial is not simulated but may replace an infeasible
    parent. In a population that is feasible from the start no infeasible trial ever wins."""

    RESAMPLE = "resample"
    """The mutation is drawn again up to a number of times; if none is feasible, repair."""


class Treated(NamedTuple):
    """Trials (n, d) in unit coordinates, their violation (n,), and the trials in SI.

    Violation 0: feasible, to be simulated. Finite: compared with the parent's. +inf: rejected.
    """

    unit: Floats
    violation: Floats
    x: Floats

    @property
    def simulate(self) -> Bools:
        """Mask of the trials (n,) to be simulated."""
        return np.asarray(self.violation == 0.0)


def treat(treatment: Treatment, space: Space, parents: Floats, trials: Floats, redraw: Redraw) -> Treated:
    """Apply a treatment to raw trials.

    `treatment`: which one; `space`: bounds and constraints; `parents` (n, d): the members that the trials would
    replace, unit coordinates. Repair and resampling need them feasible, and keep them so; `trials` (n, d): trials after
    mutation and crossover, unit coordinates; `redraw`: more raw trials for some of the members; used by resampling
    only.
    """
    return _TREATMENTS[treatment](space, parents, trials, redraw)


def reflect(unit: Floats) -> Floats:
    """Reflect unit coordinates once at the bound they cross: enough for F <= 1; clip the rest."""
    folded = 1.0 - np.abs(1.0 - np.abs(unit))
    return np.asarray(np.minimum(np.maximum(folded, 0.0), 1.0))


def wins(trial: tuple[Floats, Floats], parent: tuple[Floats, Floats]) -> Bools:
    """Mask of the trials (n,) that replace their parents: Eq. (20), extended by the rules of feasibility.

    Both arguments are costs (n,) and violations (n,). A feasible trial wins with a finite cost
    not above the parent's, or over any infeasible parent; an infeasible one only over a parent
    that violates as much or more. Without violations this is f(u) <= f(x), and +inf never wins.
    """
    (cost, violation), (parent_cost, parent_violation) = trial, parent
    cheaper = np.isfinite(cost) & ((parent_violation > 0.0) | (cost <= parent_cost))
    closer = np.isfinite(violation) & (violation <= parent_violation)
    return np.asarray(np.where(violation == 0.0, cheaper, closer))


def _reject(space: Space, parents: Floats, trials: Floats, redraw: Redraw) -> Treated:
    x = space.from_unit(trials)
    return Treated(trials, np.where(space.satisfies(x), 0.0, np.inf), x)


def _rules(space: Space, parents: Floats, trials: Floats, redraw: Redraw) -> Treated:
    unit = reflect(trials)
    x = space.from_unit(unit)
    return Treated(unit, space.violation(x), x)


def _repair(space: Space, parents: Floats, trials: Floats, redraw: Redraw) -> Treated:
    unit = reflect(trials)
    x = space.from_unit(unit)
    broken = np.flatnonzero(~space.satisfies(x))
    if len(broken):
        unit[broken], x[broken] = _mended(space, parents, x, broken)
    return Treated(unit, np.zeros(len(unit)), x)


def _resample(space: Space, parents: Floats, trials: Floats, redraw: Redraw) -> Treated:
    unit = trials.copy()
    broken = np.flatnonzero(~_feasible(space, unit))
    if len(broken):
        further = redraw(broken)
        feasible = _feasible(space, further)
        has_feasible = feasible.any(axis=1)
        first = feasible.argmax(axis=1)
        unit[broken[has_feasible]] = further[has_feasible, first[has_feasible]]
    return _repair(space, parents, unit, redraw)


def _mended(space: Space, parents: Floats, trials: Floats, broken: IndexArray) -> tuple[Floats, Floats]:
    """The `broken` (k,) of trials (n, d) sorted, then pulled to their parents: in unit coordinates and SI (k, d)."""
    x = trials.take(broken, axis=0)
    for chain in space.rows.chains:
        x[:, chain] = np.sort(x[:, chain], axis=1)
    x = np.minimum(np.maximum(x, space.lower), space.upper)
    if not space.satisfies(x).all():
        x = space.pull_back(space.from_unit(parents[broken]), x)
    unit = np.minimum(np.maximum(space.to_unit(x), 0.0), 1.0)
    x = space.from_unit(unit)
    # The way to unit coordinates and back rounds: the parent stands in where that tips a row.
    tipped = ~space.satisfies(x)
    if tipped.any():
        unit[tipped] = parents[broken[tipped]]
        x[tipped] = space.from_unit(unit[tipped])
    return unit, x


def _feasible(space: Space, unit: Floats) -> Bools:
    return space.satisfies(space.from_unit(unit))


_TREATMENTS: dict[Treatment, Callable[[Space, Floats, Floats, Redraw], Treated]] = {
    Treatment.REJECT: _reject,
    Treatment.REPAIR: _repair,
    Treatment.FEASIBILITY_RULES: _rules,
    Treatment.RESAMPLE: _resample,
}


# Settings of differential evolution; the defaults are the paper's.

FEWEST_MEMBERS = 4  # a mutation combines three members other than the parent
MOST_REDRAWS = 1000


class InitialSampling(StrEnum):
    """Sampling of the initial population."""

    FEASIBLE = "feasible"
    """Uniformly where bounds and constraints hold, by `sample_feasible`."""

    UNIFORM = "uniform"
    """Uniformly in the bounds, Eq. (17), then treated as trials are."""

    REFERENCE = "reference"
    """As FEASIBLE, with the reference values (the paper's theoretical ones) in place of the first draw."""


@dataclass(frozen=True)
class EvolutionSettings:
    """Settings of `DifferentialEvolution`; the defaults are the paper's (70, 50).

    Parameters
    ----------
    members : int
        Population size N_pop, at least 4.
    generations : int
        Generations G_max after the initial population: (1 + G_max) N_pop slots in all.
    crossover : float
        CR of Eq. (19), from 0 to 1.
    factor : tuple of float
        Range that F of Eq. (18) is drawn from, anew for each member and parameter.
    treatment : Treatment
        What becomes of trials that break bounds or constraints.
    initial : InitialSampling
        How the initial population is drawn.
    redraws : int
        Mutations drawn again for an infeasible trial at most, if `treatment` resamples.

    Raises
    ------
    ConfigurationError
        If a number lies outside its range, or is not whole where it counts something.
    """

    size: ClassVar[str] = "{generations} generations of {members} members"  # in words, of a report

    members: int = count(50, MOST_MEMBERS, FEWEST_MEMBERS)
    generations: int = count(70, MOST_GENERATIONS)
    crossover: float = 0.8
    factor: tuple[float, float] = (0.4, 1.0)
    treatment: Treatment = Treatment.REPAIR
    initial: InitialSampling = InitialSampling.FEASIBLE
    redraws: int = count(10, MOST_REDRAWS, 1)

    def __post_init__(self) -> None:
        factor = array(self.factor, "1", "factor", 1).tolist()
        if len(factor) != 2:
            raise ConfigurationError(f"factor = {self.factor} must be a range of two numbers, such as (0.4, 1.0).")
        check_counts(self)
        settle(
            self,
            crossover=number(self.crossover, "1", "crossover"),
            factor=tuple(factor),
            treatment=enum_member(self.treatment, Treatment, "treatment"),
            initial=enum_member(self.initial, InitialSampling, "initial"),
        )
        if not 0.0 <= self.crossover <= 1.0:
            raise ConfigurationError(f"crossover = {self.crossover:g} must lie between 0 and 1.")
        if not 0.0 < self.factor[0] <= self.factor[1] <= 2.0:
            raise ConfigurationError(
                f"factor = {self.factor[0]:g} to {self.factor[1]:g} must be an ascending range above 0 and not above 2."
            )

    @property
    def slots(self) -> int:
        """Trials offered in all, (1 + G_max) N_pop."""
        return (1 + self.generations) * self.members


def check_initial(settings: EvolutionSettings, space: Space) -> None:
    """Refuse to start from reference values that break a bound or a constraint.

    Raises `ConfigurationError` if they do, and the settings' `initial` asks for them.
    """
    if settings.initial is InitialSampling.REFERENCE:
        reference_start(space)


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
    ended = "all {generations} generations after the initial population are done"

    def __init__(
        self,
        space: Space,
        rng: np.random.Generator,
        settings: EvolutionSettings | None = None,
        start: ArrayLike | None = None,
    ) -> None:
        super().__init__(space, rng, settings or EvolutionSettings())
        if start is None and self.settings.initial is InitialSampling.REFERENCE:
            start = reference_start(space)
        self._start = _check_start(space, start, self.settings.members)
        self._unit, self._violations = np.empty((0, space.dimension)), np.empty(0)

    def _step(self) -> Work:
        """One generation: trials, and the selection of the survivors, Eq. (20)."""
        trial = self._next() if self.steps else self._first()
        costs = yield Trials(trial.x, trial.simulate)
        if self.steps:
            better = wins((costs, trial.violation), (self.costs, self._violations))
            costs = np.where(better, costs, self.costs)
            trial = Treated(
                np.where(better[:, None], trial.unit, self._unit),
                np.where(better, trial.violation, self._violations),
                trial.x,
            )
        self._take(trial.unit, costs, trial.violation)

    def _take(self, unit: Floats, costs: Floats, violations: Floats) -> None:
        """Take members (n, d), their costs (n,) and violations (n,) as the population."""
        self._unit, self.costs, self._violations = unit, costs, violations
        self.population = self.space.from_unit(unit)
        winner = int(np.argmin(costs)) if len(costs) else -1
        if winner >= 0 and costs[winner] < np.inf:
            self.best = Best(self.space.from_unit(unit[winner]), float(costs[winner]))

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

    def _kept(self) -> dict[str, Any]:
        return {"unit": self._unit.copy(), "costs": self.costs.copy(), "violations": self._violations.copy()}

    def _restore(self, state: Mapping[str, Any]) -> None:
        members = self.settings.members if self.steps else 0
        unit, costs, violations = (np.array(state[name], dtype=float) for name in ("unit", "costs", "violations"))
        if [a.shape for a in (unit, costs, violations)] != [(members, self.space.dimension), (members,), (members,)]:
            raise ConfigurationError(
                f"state: its population is not one of {members} members; use an intact state", code="damaged-state"
            )
        if not (inside(unit) and np.all(costs > -np.inf) and np.all(violations >= 0.0)):
            raise ConfigurationError(
                "state: its population lies outside the bounds or has costs that are no numbers", code="damaged-state"
            )
        self._take(unit, costs, violations)


def _check_start(space: Space, start: ArrayLike | None, members: int) -> Floats:
    points = np.empty((0, space.dimension)) if start is None else np.atleast_2d(np.asarray(start))
    if points.ndim != 2 or points.shape[1] != space.dimension or len(points) > members:
        raise ConfigurationError(
            f"start: an array of shape {points.shape} was given, expected at most {members} rows "
            f"of {space.dimension} values",
            code="wrong-shape",
        )
    refused = np.flatnonzero(~space.satisfies(points))
    if len(refused):
        raise ConfigurationError(
            f"start: row {refused[0] + 1} breaks the bounds or a constraint, correct or remove it",
            code="infeasible-start",
        )
    return points.astype(float)


REGISTERED = Registered(
    DifferentialEvolution,
    EvolutionSettings,
    {"initial": check_initial},
    citation="Storn & Price 1997; Lino et al. 2016, Eq. (17) to (20)",
)
