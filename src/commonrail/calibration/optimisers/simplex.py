"""Nelder–Mead: simplices that reflect, expand, contract and shrink, several side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from commonrail.arguments import number, settle, whole
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.base import MOST_GENERATIONS, Best
from commonrail.calibration.optimisers.members import MOST_MEMBERS, Members, diverse_members
from commonrail.calibration.optimisers.stepwise import Stepwise, Work, asked
from commonrail.calibration.sampling import sample_feasible
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError

__all__ = ["NelderMead", "NelderMeadSettings"]


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
