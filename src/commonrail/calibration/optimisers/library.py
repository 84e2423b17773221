"""CMA-ES: evolution by a normal distribution whose mean, step and covariance adapt to the objective."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from commonrail.base.arguments import number, settle, whole
from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.errors import ConfigurationError
from commonrail.base.linear import singular
from commonrail.calibration.optimisers.base import (
    MOST_GENERATIONS,
    MOST_MEMBERS,
    Best,
    Members,
    Trials,
    diverse_members,
)
from commonrail.calibration.optimisers.evolution import Treatment, treat
from commonrail.calibration.optimisers.stepwise import Stepwise, Work, asked
from commonrail.calibration.space import Space, sample_feasible
from commonrail.physics.elementary import exp, log, norm, product

LARGEST_STEP = 1.0  # standard deviation, in widths of the bounds
FEWEST = 4


@dataclass(frozen=True)
class CovarianceSettings:
    """Settings of `CovarianceStrategy`.

    Parameters
    ----------
    members : int
        Draws of a generation, at least 4.
    generations : int
        Generations after the first one.
    step : float
        Standard deviation at the beginning, in widths of the bounds.

    Raises
    ------
    ConfigurationError
        If a number lies outside its range, or is not whole where it counts something.
    """

    size: ClassVar[str] = "{generations} generations of {members} members"  # in words, of a report

    # "most" is what a study file may ask for
    members: int = field(default=16, metadata={"most": MOST_MEMBERS})
    generations: int = field(default=220, metadata={"most": MOST_GENERATIONS})
    step: float = 0.2

    def __post_init__(self) -> None:
        settle(
            self,
            members=whole(self.members, "members", FEWEST, MOST_MEMBERS),
            generations=whole(self.generations, "generations", 0, MOST_GENERATIONS),
            step=number(self.step, "1", "step"),
        )
        if not 0.0 < self.step <= LARGEST_STEP:
            raise ConfigurationError(f"step = {self.step:g} must lie above 0 and not above {LARGEST_STEP:g}.")


class _Rates(NamedTuple):
    """Weights of the better half and learning rates, by the formulas of Hansen (2016), Table 1."""

    weights: Floats
    effective: float
    path: float
    one: float
    many: float
    step_path: float
    damping: float
    expected: float

    @classmethod
    def of(cls, members: int, d: int) -> _Rates:
        half = members // 2
        raw = log(0.5 * (members + 1)) - log(np.arange(1, half + 1))
        weights = raw / np.sum(raw)
        mu = 1.0 / float(np.sum(weights * weights))
        step_path = (mu + 2.0) / (d + mu + 5.0)
        one = 2.0 / ((d + 1.3) ** 2 + mu)
        return cls(
            weights,
            mu,
            (4.0 + mu / d) / (d + 4.0 + 2.0 * mu / d),
            one,
            min(1.0 - one, 2.0 * (mu - 2.0 + 1.0 / mu) / ((d + 2.0) ** 2 + mu)),
            step_path,
            1.0 + 2.0 * max(0.0, float(np.sqrt((mu - 1.0) / (d + 1.0))) - 1.0) + step_path,
            float(np.sqrt(d)) * (1.0 - 1.0 / (4.0 * d) + 1.0 / (21.0 * d * d)),
        )


class CovarianceStrategy(Stepwise):
    """(μ/μ_w, λ)-CMA-ES (Hansen 2016, arXiv:1604.00772), without its active part and without restarts.

    Draws outside bounds or constraints are repaired, and the distribution learns from the repaired ones. It starts from
    the best of its first generation, which is drawn from all that is feasible.

    Parameters
    ----------
    space : Space
    rng : numpy.random.Generator
        Source of every draw.
    settings : CovarianceSettings, optional
    """

    method, phase = "CMA-ES", "evolution"

    def __init__(self, space: Space, rng: np.random.Generator, settings: CovarianceSettings | None = None) -> None:
        self.settings = settings or CovarianceSettings()
        super().__init__(space, rng, self.settings)
        d = space.dimension
        self._rates = _Rates.of(self.settings.members, d)
        self._members = Members.none(d)
        self._mean, self._width = space.to_unit(space.centre), self.settings.step
        self._paths, self._covariance = np.zeros((2, d)), np.eye(d)  # of the step, of the covariance

    @property
    def population(self) -> Floats:
        """Draws (n, d) of the last generation, SI."""
        return self.space.from_unit(self._members.unit)

    @property
    def costs(self) -> Floats:
        """Costs (n,) of these draws."""
        return self._members.costs.copy()

    def _axes(self) -> tuple[Floats, Floats]:
        """Standard deviations (d,) of the distribution with step 1, and their directions (d, d), one a row."""
        values, directions = singular(self._covariance)
        return np.sqrt(np.maximum(values, 1e-30)), directions

    def _step(self) -> Work:
        """Draws, of which the better half adapts the distribution."""
        unit, trials = self._draws()
        told = yield trials
        self._offer(trials.x, told)
        self._members = Members(unit, told)
        half = self._members.sorted()
        used = half.unit[: len(self._rates.weights)]
        if not np.isfinite(half.costs[: len(used)]).all():
            return  # too few could be simulated to learn from
        if self.steps == 0:
            self._mean = used[0].copy()
        else:
            self._adapt((used - self._mean) / self._width)

    def _draws(self) -> tuple[Floats, Trials]:
        """Points (n, d) in unit coordinates, feasible ones at first, then repaired draws, and their question."""
        count, d = self.settings.members, self.space.dimension
        if self.steps == 0:
            x = sample_feasible(self.space, count, self._rng)
            return np.clip(self.space.to_unit(x), 0.0, 1.0), asked(x)
        deviations, directions = self._axes()

        def drawn(number_of: int) -> Floats:
            normal = self._rng.standard_normal((number_of, d))
            return np.asarray(self._mean + self._width * product(normal * deviations, directions))

        anchor = np.tile(self._mean, (count, 1))
        treated = treat(Treatment.REPAIR, self.space, anchor, drawn(count), lambda few: drawn(len(few))[:, None])
        return treated.unit, Trials(treated.x, treated.simulate)

    def _adapt(self, moves: Floats) -> None:
        """Adapt mean, paths, covariance and step to the better half of the moves (μ, d), in steps, the best first."""
        r, d = self._rates, self.space.dimension
        move = np.sum(r.weights[:, None] * moves, axis=0)
        deviations, directions = self._axes()
        white = product(product(move[None, :], directions.T) / deviations, directions)[0]
        share = np.sqrt(r.step_path * (2.0 - r.step_path) * r.effective)
        step_path = (1.0 - r.step_path) * self._paths[0] + share * white
        reach = np.sqrt(1.0 - (1.0 - r.step_path) ** (2 * (self.steps + 1)))
        calm = norm(step_path) / reach < (1.4 + 2.0 / (d + 1.0)) * r.expected
        path = (1.0 - r.path) * self._paths[1] + calm * np.sqrt(r.path * (2.0 - r.path) * r.effective) * move
        lost = (1.0 - calm) * r.one * r.path * (2.0 - r.path)
        rank = product((r.weights[:, None] * moves).T, moves)
        covariance = (1.0 - r.one - r.many + lost) * self._covariance + r.one * np.outer(path, path) + r.many * rank
        growth = float(exp(min(1.0, (r.step_path / r.damping) * (norm(step_path) / r.expected - 1.0))))
        self._mean = self._feasible(self._mean + self._width * move)
        self._width = min(self._width * growth, LARGEST_STEP)
        self._paths, self._covariance = np.stack([step_path, path]), 0.5 * (covariance + covariance.T)

    def _feasible(self, mean: Floats) -> Floats:
        """The new mean (d,), or the last feasible point on the way to it."""
        space = self.space
        wanted = space.from_unit(np.clip(mean, 0.0, 1.0))
        inside = space.pull_back(space.from_unit(self._mean)[None, :], wanted[None, :])
        unit = np.clip(space.to_unit(inside[0]), 0.0, 1.0)
        return unit if space.satisfies(space.from_unit(unit)) else self._mean

    def _kept(self) -> dict[str, Any]:
        return {
            **self._members.kept(),
            "mean": self._mean.copy(),
            "step": float(self._width),
            "paths": self._paths.copy(),
            "covariance": self._covariance.copy(),
            "best": self._best.x.copy(),
            "cost": self._best.cost,
        }

    def _restore(self, state: Mapping[str, Any]) -> None:
        d = self.space.dimension
        members = Members.of(state, d)
        mean, paths, covariance, best = (
            np.array(state[name], dtype=float) for name in ("mean", "paths", "covariance", "best")
        )
        step = float(state["step"])
        shapes = (mean.shape, paths.shape, covariance.shape, best.shape)
        if shapes != ((d,), (2, d), (d, d), (d,)) or not 0.0 < step <= LARGEST_STEP:
            raise ConfigurationError("state: its distribution is not whole; take a whole state")
        self._members, self._best = members, Best(best, float(state["cost"]))
        self._mean, self._width, self._paths, self._covariance = mean, step, paths, covariance


# Nelder–Mead: simplices that reflect, expand, contract and shrink, several side by side.

MOST_STARTS = 1000
COLLAPSED = 1e-7  # size of a simplex, in widths of the bounds, below which a new one begins


@dataclass(frozen=True)
class NelderMeadSettings:
    """Settings of `NelderMead`.

    Parameters
    ----------
    members : int
        Draws, of which the good ones that lie apart begin simplices.
    generations : int
        Moves of each simplex.
    starts : int
        Simplices side by side.
    edge : float
        First edges, in widths of the bounds.

    Raises
    ------
    ConfigurationError
        If a number lies outside its range, or is not whole where it counts something.
    """

    size: ClassVar[str] = (
        "{starts} simplices from {members} draws, {generations} moves at most"  # in words, of a report
    )

    # "most" is what a study file may ask for
    members: int = field(default=64, metadata={"most": MOST_MEMBERS})
    generations: int = field(default=500, metadata={"most": MOST_GENERATIONS})
    starts: int = field(default=4, metadata={"most": MOST_STARTS})
    edge: float = 0.1

    def __post_init__(self) -> None:
        settle(
            self,
            members=whole(self.members, "members", 1, MOST_MEMBERS),
            generations=whole(self.generations, "generations", 0, MOST_GENERATIONS),
            starts=whole(self.starts, "starts", 1, MOST_STARTS),
            edge=number(self.edge, "1", "edge"),
        )
        if not 0.0 < self.edge <= 0.5:
            raise ConfigurationError(f"edge = {self.edge:g} must lie above 0 and not above 0.5.")


class NelderMead(Stepwise):
    """Simplices of Nelder and Mead (1965) with the coefficients of Gao and Han (2012), which suit many parameters.

    A step is one move of every simplex: reflected vertices are one batch, expanded or contracted ones a second, those
    of simplices that shrink a third. A vertex outside bounds or constraints is pulled back towards the best one of its
    simplex. A simplex that has collapsed begins again from another draw.

    Parameters
    ----------
    space : Space
    rng : numpy.random.Generator
        Source of every draw.
    settings : NelderMeadSettings, optional
    """

    method, phase = "Nelder-Mead", "simplices"

    def __init__(self, space: Space, rng: np.random.Generator, settings: NelderMeadSettings | None = None) -> None:
        self.settings = settings or NelderMeadSettings()
        super().__init__(space, rng, self.settings)
        d = space.dimension
        self._vertices, self._costs = np.empty((0, d + 1, d)), np.empty((0, d + 1))  # of each simplex, by rising cost

    @property
    def population(self) -> Floats:
        """Vertices (n, d) of all simplices, SI."""
        return self.space.from_unit(self._vertices.reshape(-1, self.space.dimension))

    @property
    def costs(self) -> Floats:
        """Costs (n,) of the vertices."""
        return self._costs.ravel().copy()

    def _step(self) -> Work:
        """Draws at first, then moves; every point may be the best."""
        work = self._move() if self.steps else self._draw()
        trials = next(work)
        while True:
            told = yield trials
            self._offer(trials.x, told)
            try:
                trials = work.send(told)
            except StopIteration:
                return

    def _draw(self) -> Work:
        """Draws, and a simplex about each of the good ones that lie apart."""
        x = sample_feasible(self.space, self.settings.members, self._rng)
        costs = yield asked(x)
        unit = np.clip(self.space.to_unit(x), 0.0, 1.0)
        chosen = diverse_members(unit, costs, self.settings.starts)
        starts = unit[chosen] if len(chosen) else unit[: self.settings.starts]
        own = costs[chosen] if len(chosen) else costs[: self.settings.starts]
        d = self.space.dimension
        edges = np.where(starts + self.settings.edge <= 1.0, self.settings.edge, -self.settings.edge)
        corners = self._pulled(starts[:, None, :], starts[:, None, :] + edges[:, :, None] * np.eye(d))
        told = yield asked(self.space.from_unit(corners.reshape(-1, d)))
        self._sort(
            np.concatenate([starts[:, None, :], corners], axis=1),
            np.concatenate([own[:, None], told.reshape(-1, d)], axis=1),
        )

    def _move(self) -> Work:
        """One move of every simplex."""
        d = self.space.dimension
        expand, contract, shrink = 1.0 + 2.0 / max(d, 2), 0.75 - 0.5 / max(d, 2), 1.0 - 1.0 / max(d, 2)
        vertices, costs = self._vertices.copy(), self._costs.copy()
        centre = np.sum(vertices[:, :-1], axis=1) / d
        away = centre - vertices[:, -1]
        reflected = self._pulled(vertices[:, 0], centre + away)
        first = yield asked(self.space.from_unit(reflected))
        second_worst = costs[:, -2] if d > 1 else costs[:, 0]
        plain = (first >= costs[:, 0]) & (first < second_worst)
        length = np.where(first < costs[:, 0], expand, np.where(first < costs[:, -1], contract, -contract))
        other = self._pulled(vertices[:, 0], centre + length[:, None] * away)
        again = np.full(len(first), np.inf)
        if not plain.all():
            again[~plain] = yield asked(self.space.from_unit(other[~plain]))
        takes_other = ~plain & (again < np.minimum(first, costs[:, -1]))
        takes_first = ~takes_other & (first < second_worst)
        vertices[takes_other, -1], costs[takes_other, -1] = other[takes_other], again[takes_other]
        vertices[takes_first, -1], costs[takes_first, -1] = reflected[takes_first], first[takes_first]
        failed = ~(takes_other | takes_first)
        if failed.any():
            best = vertices[failed, :1]
            moved = self._anew(best, vertices[failed, 1:], shrink)
            told = yield asked(self.space.from_unit(moved.reshape(-1, d)))
            vertices[failed, 1:], costs[failed, 1:] = moved, told.reshape(-1, d)
        self._sort(vertices, costs)

    def _anew(self, best: Floats, others: Floats, shrink: float) -> Floats:
        """Vertices (k, d, d) shrunk towards the best (k, 1, d); about another draw where they have collapsed."""
        moved = best + shrink * (others - best)
        collapsed = np.max(np.abs(others - best), axis=(1, 2)) < COLLAPSED
        if collapsed.any():
            d = self.space.dimension
            x = sample_feasible(self.space, d * int(collapsed.sum()), self._rng)
            moved[collapsed] = np.clip(self.space.to_unit(x), 0.0, 1.0).reshape(-1, d, d)
        return self._pulled(best, moved)

    def _pulled(self, anchor: Floats, unit: Floats) -> Floats:
        """Points (…, d), or the last feasible ones on the way from feasible anchors (…, d), unit coordinates."""
        space = self.space
        flat = np.clip(unit, 0.0, 1.0).reshape(-1, space.dimension)
        start = np.broadcast_to(anchor, unit.shape).reshape(flat.shape)
        if space.constrained:
            inside = np.clip(space.to_unit(space.pull_back(space.from_unit(start), space.from_unit(flat))), 0.0, 1.0)
            flat = np.where(space.satisfies(space.from_unit(inside))[:, None], inside, start)
        return flat.reshape(unit.shape)

    def _sort(self, vertices: Floats, costs: Floats) -> None:
        order = np.argsort(costs, axis=1, kind="stable")
        self._vertices = np.take_along_axis(vertices, order[:, :, None], axis=1)
        self._costs = np.take_along_axis(costs, order, axis=1)

    def _kept(self) -> dict[str, Any]:
        members = Members(self._vertices.reshape(-1, self.space.dimension), self._costs.ravel())
        return {**members.kept(), "best": self._best.x.copy(), "cost": self._best.cost}

    def _restore(self, state: Mapping[str, Any]) -> None:
        d = self.space.dimension
        members, best = Members.of(state, d), np.array(state["best"], dtype=float)
        if len(members.costs) % (d + 1) or best.shape != (d,):
            raise ConfigurationError("state: its simplices are not whole; take a whole state")
        self._vertices, self._costs = members.unit.reshape(-1, d + 1, d), members.costs.reshape(-1, d + 1)
        self._best, self._work = Best(best, float(state["cost"])), None


# L-SHADE: differential evolution that learns F and CR from its successes, with a population that shrinks.

# Values of Tanabe and Fukunaga (2014).
MEMORY = 6
BEST_SHARE = 0.11  # of the members, from which a trial takes its direction
ARCHIVE = 2.6  # members that were replaced and are kept, for each member
SPREAD = 0.1  # of F and CR about their memory


@dataclass(frozen=True)
class SuccessHistorySettings:
    """Settings of `SuccessHistoryEvolution`.

    Parameters
    ----------
    members : int
        Members at the beginning, at least 4.
    generations : int
        Generations after the initial population.
    shrinking : int
        Generations over which the population shrinks linearly to 4 members; 0 for a constant one.

    Raises
    ------
    ConfigurationError
        If a number lies outside its range, or is not whole.
    """

    size: ClassVar[str] = "{generations} generations of {members} members at first"  # in words, of a report

    # "most" is what a study file may ask for
    members: int = field(default=96, metadata={"most": MOST_MEMBERS})
    generations: int = field(default=70, metadata={"most": MOST_GENERATIONS})
    shrinking: int = field(default=70, metadata={"most": MOST_GENERATIONS})

    def __post_init__(self) -> None:
        settle(
            self,
            members=whole(self.members, "members", FEWEST, MOST_MEMBERS),
            generations=whole(self.generations, "generations", 0, MOST_GENERATIONS),
            shrinking=whole(self.shrinking, "shrinking", 0, MOST_GENERATIONS),
        )


class SuccessHistoryEvolution(Stepwise):
    """L-SHADE of Tanabe and Fukunaga (2014): current-to-pbest/1/bin with an archive and a memory of F and CR.

    The population shrinks over `shrinking` generations and not over those that are wanted, so that a search that is
    extended takes the same steps as one that was longer from the beginning. Trials that break bounds or constraints are
    repaired as those of `DifferentialEvolution` are by default.

    Parameters
    ----------
    space : Space
    rng : numpy.random.Generator
        Source of every draw.
    settings : SuccessHistorySettings, optional
    """

    method, phase = "L-SHADE", "evolution"

    def __init__(self, space: Space, rng: np.random.Generator, settings: SuccessHistorySettings | None = None) -> None:
        self.settings = settings or SuccessHistorySettings()
        super().__init__(space, rng, self.settings)
        self._members = Members.none(space.dimension)
        self._archive = np.empty((0, space.dimension))
        self._memory = np.full((2, MEMORY), 0.5)  # F, CR; a CR below 0 has become 0 for good
        self._next = 0

    @property
    def best(self) -> Best:
        """The best member."""
        return self._members.best(self.space)

    @property
    def population(self) -> Floats:
        """Members (n, d), SI."""
        return self.space.from_unit(self._members.unit)

    @property
    def costs(self) -> Floats:
        """Costs (n,) of the members."""
        return self._members.costs.copy()

    def _step(self) -> Work:
        """Draws at first, then one trial for each member: select, learn from the successes, and shrink."""
        if self.steps == 0:
            x = sample_feasible(self.space, self.settings.members, self._rng)
            self._members = Members(np.clip(self.space.to_unit(x), 0.0, 1.0), (yield asked(x)))
            return
        unit, costs = self._members
        drawn = self._factors(len(costs))

        def redraw(members: IndexArray) -> Floats:
            return self._mutants(members, *drawn[:, members])[:, None]

        trial = treat(Treatment.REPAIR, self.space, unit, self._mutants(np.arange(len(costs)), *drawn), redraw)
        told = yield asked(trial.x)
        better, wins = told < costs, np.isfinite(told) & (told <= costs)
        before = np.where(np.isfinite(costs), costs, told.max(initial=0.0, where=better))
        self._learn(drawn[:, better], (before - told)[better])
        self._archive = np.vstack([self._archive, unit[better]])
        self._members = self._shrunk(Members(np.where(wins[:, None], trial.unit, unit), np.where(wins, told, costs)))
        most = round(ARCHIVE * len(self._members.costs))
        if len(self._archive) > most:
            self._archive = self._archive[np.sort(self._rng.permutation(len(self._archive))[:most])]

    def _factors(self, count: int) -> Floats:
        """F (Cauchy, in (0, 1]) and CR (Gauss, in [0, 1]) about random entries of the memory, (2, count)."""
        rows = self._rng.integers(0, MEMORY, count)
        factor = np.zeros(count)
        for _ in range(100):
            low = factor <= 0.0
            if not low.any():
                break
            factor[low] = self._memory[0, rows[low]] + SPREAD * self._rng.standard_cauchy(int(low.sum()))
        factor = np.where(factor <= 0.0, self._memory[0, rows], np.minimum(factor, 1.0))
        rate = np.clip(self._memory[1, rows] + SPREAD * self._rng.standard_normal(count), 0.0, 1.0)
        return np.stack([factor, np.where(self._memory[1, rows] < 0.0, 0.0, rate)])

    def _mutants(self, chosen: IndexArray, factor: Floats, rate: Floats) -> Floats:
        """Raw trials (k, d) of chosen members (k,) with their F and CR (k,)."""
        members, rng = self._members.sorted(), self._rng
        unit, k, n = self._members.unit, len(chosen), len(members.costs)
        leaders = members.unit[rng.integers(0, max(round(BEST_SHARE * n), 2), k)]
        first = (chosen + rng.integers(1, n, k)) % n  # another member
        pool = np.vstack([unit, self._archive])
        second = rng.integers(0, len(pool) - 2, k)  # neither of the two
        for taken in np.sort(np.stack([chosen, first]), axis=0):
            second += second >= taken
        f = factor[:, None]
        mutants = unit[chosen] + f * (leaders - unit[chosen]) + f * (unit[first] - pool[second])
        kept = rng.random(mutants.shape) <= rate[:, None]
        kept[np.arange(k), rng.integers(0, mutants.shape[1], k)] = True
        return np.where(kept, mutants, unit[chosen])

    def _learn(self, successful: Floats, gains: Floats) -> None:
        """Write the Lehmer means of the successful F and CR (2, k), weighted by their gains (k,), into the memory."""
        if not len(gains):
            return
        weights = np.maximum(gains, 1e-300)
        weights = weights / np.sum(weights)
        for row, drawn in enumerate(successful):
            ended = row == 1 and (self._memory[1, self._next] < 0.0 or not drawn.max() > 0.0)
            mean = -1.0 if ended else np.sum(weights * drawn * drawn) / np.sum(weights * drawn)
            self._memory[row, self._next] = mean
        self._next = (self._next + 1) % MEMORY

    def _shrunk(self, members: Members) -> Members:
        """The best members, as many as this generation leaves."""
        if not self.settings.shrinking:
            return members
        share = min(self.steps / self.settings.shrinking, 1.0)
        count = round(self.settings.members + share * (FEWEST - self.settings.members))
        if count >= len(members.costs):
            return members
        best = members.sorted()
        return Members(best.unit[:count], best.costs[:count])

    def _kept(self) -> dict[str, Any]:
        own = {"archive": self._archive.copy(), "memory": self._memory.copy(), "next": self._next}
        return self._members.kept() | own

    def _restore(self, state: Mapping[str, Any]) -> None:
        members = Members.of(state, self.space.dimension)
        archive, memory = np.array(state["archive"], dtype=float), np.array(state["memory"], dtype=float)
        if archive.shape[1:] != (self.space.dimension,) or memory.shape != (2, MEMORY):
            raise ConfigurationError("state: its archive or memory is not whole; take a whole state")
        self._members, self._archive, self._memory, self._next = members, archive, memory, int(state["next"]) % MEMORY
