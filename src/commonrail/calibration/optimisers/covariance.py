"""CMA-ES: evolution by a normal distribution whose mean, step and covariance adapt to the objective."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from commonrail.arguments import number, settle, whole
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.base import MOST_GENERATIONS, Best, Trials
from commonrail.calibration.optimisers.members import MOST_MEMBERS, Members
from commonrail.calibration.optimisers.stepwise import Stepwise, Work, asked
from commonrail.calibration.optimisers.treatments import Treatment, treat
from commonrail.calibration.sampling import sample_feasible
from commonrail.calibration.space import Space
from commonrail.elementary import exp, log, norm, product
from commonrail.errors import ConfigurationError
from commonrail.linear import singular

__all__ = ["CovarianceSettings", "CovarianceStrategy"]


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
