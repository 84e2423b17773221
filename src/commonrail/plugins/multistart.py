"""Multi-start least squares: several descents from scattered starts; their agreement decides on convergence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from commonrail.base.arguments import number, settle
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.optimisers.base import (
    AGREEING,
    ALIKE,
    MOST_GENERATIONS,
    MOST_MEMBERS,
    MOST_STARTS,
    SMALL_GAIN,
    Best,
    Convergence,
    Optimiser,
    Question,
    Registered,
    Work,
    asked,
    check_counts,
    count,
    diverse_members,
    inside,
    noise_of,
    ranked,
)
from commonrail.calibration.optimisers.least_squares import DescentLoss, Descents, LossSum, Rules, advance, recognised
from commonrail.calibration.space import Space, sample_priors

POOL = 10  # best candidates for each start, among which distant ones are chosen


@dataclass(frozen=True)
class MultiStartSettings:
    """Settings of `MultiStartLeastSquares`.

    Raises `ConfigurationError` if a number lies outside its range, or a count is not an integer.
    """

    size: ClassVar[str] = "{starts} starts of {members} draws, {generations} iterations at most"  # for reports

    # candidates drawn and simulated once; descents start from good ones far from each other
    members: int = count(128, MOST_MEMBERS, 1)
    generations: int = count(60, MOST_GENERATIONS)  # iterations of the descents, at most
    # parallel descents, fewer if too few draws can be simulated; the same number follows if they end without agreement
    starts: int = count(8, MOST_STARTS, 1)
    difference: float = 1e-4  # forward difference of the derivatives as a share of each range

    def __post_init__(self) -> None:
        check_counts(self)
        settle(self, difference=number(self.difference, "1", "difference"))
        if not 0.0 < self.difference <= 0.1:
            raise ConfigurationError(f"difference = {self.difference:g} must lie above 0 and not above 0.1.")


class MultiStartLeastSquares(Optimiser):
    """Least squares with geodesic acceleration from several starts; it ends when enough starts agree.

    The first step simulates draws from priors and bounds. Each further step is an iteration of all descents. When all
    descents have ended, the search has converged if `AGREEING` descents are within `ALIKE` of the best 2 ln L and a
    full step from the best is predicted to gain less than `SMALL_GAIN`. Otherwise the same number of descents starts
    from other draws. The likelihood uses the noise of the objective, see `noise_of`.

    `rng`: source of every draw.
    """

    method, phase = "multi-start least squares", "multi-start least squares"

    def __init__(self, space: Space, rng: np.random.Generator, settings: MultiStartSettings | None = None) -> None:
        super().__init__(space, rng, settings or MultiStartSettings())
        d = space.dimension
        self._reserve = np.empty((0, d))  # unused starts in unit coordinates
        self._ends = Descents.begin(np.empty((0, d)), np.empty((0, 0)))
        self._loss = DescentLoss.SQUARES
        self._waves, self._stopped = 0, False

    @property
    def total(self) -> int:
        """Planned steps, or the steps done if the search has converged or given up."""
        return self.steps if self._stopped else super().total

    @property
    def reason(self) -> str:
        """Verdict and reason for the end of the search; empty before the end."""
        if not self.finished:
            return ""
        verdict = self.verdict
        assert verdict is not None
        stopped = "" if self._stopped else f"all {self.settings.generations} iterations are done; "
        return stopped + verdict.sentence

    @property
    def verdict(self) -> Convergence | None:
        """Verdict on convergence; None before the first step."""
        if not self._waves and not self.steps:
            return None
        if not np.isfinite(self.costs).any():
            return Convergence.of(False, "no candidate could be simulated", {"starts": len(self.costs)})
        excess = (self.costs - self.costs.min()) / self._noise(self.best.cost)
        agreeing = int((excess <= ALIKE).sum())
        gain = float(self._ends.gain[int(np.argmin(excess))]) / self._losses()[1]
        converged = agreeing >= AGREEING and gain < SMALL_GAIN
        figures = {
            "starts": len(excess),
            "agreeing": agreeing,
            "predicted_gain": gain if np.isfinite(gain) else None,
            "running": int(self._ends.running.sum()),
            "cut_short": not self._stopped,
        }
        rest = "" if not figures["running"] else f", {figures['running']} were still falling"
        sentence = (
            f"{agreeing} of {len(excess)} starts end within {ALIKE} of the best 2 ln L{rest}, and a further step is "
            f"predicted to gain {gain:.2g}; convergence needs {AGREEING} starts and a gain below {SMALL_GAIN}"
        )
        return Convergence.of(converged, sentence, figures)

    @property
    def ends(self) -> tuple[Best, ...]:
        """End points of all descents, best first."""
        return ranked(self.best, self.population, self.costs)

    def _noise(self, cost: float) -> float:
        """Change of the objective that changes 2 ln L by 1."""
        return noise_of(cost, self._ends.residuals.shape[1], self.space.dimension, self._loss.units)

    def _losses(self) -> tuple[LossSum, float]:
        """Losses, smoothed near the best descent's residuals, and the change of their sum that changes 2 ln L by 1."""
        best = self._ends.residuals[int(np.argmin(self.costs))]
        losses = LossSum.near(self._loss, best)
        return losses, self._noise(float(losses.costs(best)))

    def _step(self) -> Work:
        """First draw candidates and start descents from good, distant ones; then iterate these descents."""
        if self.steps:
            losses, noise = self._losses()
            rules = Rules(self.settings.difference, SMALL_GAIN * noise)
            after = yield from advance(self.space, self._ends.without_slopes(), losses, rules)
            x = self.space.from_unit(after.unit)
            costs = yield asked(x, Question.COSTS_AGAIN)
            self._take(after, costs)
            self._offer(x, costs)
        else:
            x = sample_priors(self.space, self.settings.members, self._rng)
            costs = yield asked(x)
            self._offer(x, costs)
            pool = np.argsort(costs, kind="stable")[: POOL * self.settings.starts]
            unit = self.space.to_unit(x[pool])
            self._reserve = unit[diverse_members(unit, costs[pool], 2 * self.settings.starts)]
        while not self._ends.running.any():
            verdict = self.verdict
            if not len(self._reserve) or self._waves > 1 or (verdict is not None and verdict.converged):
                self._stopped = True
                return
            yield from self._begin()

    def _begin(self) -> Work:
        """Start the next descents."""
        unit, self._reserve = np.split(self._reserve, [min(self.settings.starts, len(self._reserve))])
        self._waves += 1
        x = self.space.from_unit(unit)
        residuals = yield asked(x, Question.RESIDUALS)
        costs = yield asked(x, Question.COSTS_AGAIN)
        new = Descents.begin(unit, residuals)
        if self._waves == 1:
            self._loss = recognised(costs, residuals)
            self._take(new, costs)
        else:
            self._take(self._ends.joined(new), np.concatenate([self.costs, costs]))

    def _take(self, ends: Descents, costs: Floats) -> None:
        """Store the descents and the costs (n,) of their points."""
        self._ends, self.costs = ends, costs
        self.population = self.space.from_unit(ends.unit)

    def _kept(self) -> dict[str, Any]:
        return {
            "reserve": self._reserve.copy(),
            **self._ends.record(),
            "costs": self.costs.copy(),
            "loss": self._loss.value,
            "waves": self._waves,
            "stopped": self._stopped,
        }

    def _restore(self, state: Mapping[str, Any]) -> None:
        d = self.space.dimension
        reserve, costs = (np.array(state[name], dtype=float) for name in ("reserve", "costs"))
        ends = Descents.recorded(state, d)
        if len(costs) != len(ends.unit) or reserve.shape[1:] != (d,):
            raise ConfigurationError("state: its descents are incomplete; give a complete state")
        if not inside(reserve) or np.isnan(costs).any():
            raise ConfigurationError("state: a descent is outside the bounds, or its cost is not a number")
        self._reserve, self._loss = reserve, DescentLoss(state["loss"])
        self._waves, self._stopped = int(state["waves"]), bool(state["stopped"])
        self._take(ends, costs)


REGISTERED = Registered(MultiStartLeastSquares, MultiStartSettings, citation="Marquardt 1963; Transtrum & Sethna 2012")
