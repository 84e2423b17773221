"""Choice of measurements: one after the other by gain per cost, then exchange as long as one improves the plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from commonrail.analysis.design.criteria import Problem
from commonrail.arrays import Bools, Floats, IndexArray

__all__ = ["Rules", "exchange", "greedy", "select", "too_close"]


LEAST = 1e-9  # fall of the criterion that counts as one
MOST_EXCHANGES = 200
OTHER_STARTS = 8  # plans that begin with the second, third … best first measurement


class Rules(NamedTuple):
    """Limits of a plan.

    Attributes
    ----------
    costs : (c,)
        Of each candidate.
    levels : (c,) int
        Setting of the bench, such as a rail pressure, that each candidate needs.
    level_cost : float
        Cost of every setting that a plan uses, however many of its points.
    blocked : (c, c) bool
        Candidates that exclude each other; on the diagonal, that may not be repeated.
    most : int
        Largest number of measurements.
    budget : float
        Largest cost.
    """

    costs: Floats
    levels: IndexArray
    level_cost: float
    blocked: Bools
    most: int
    budget: float = math.inf

    def cost(self, chosen: Sequence[int]) -> float:
        """Cost of a plan."""
        which = list(chosen)
        return float(np.sum(self.costs[which])) + self.level_cost * len(set(self.levels[which].tolist()))

    def added(self, chosen: Sequence[int]) -> Floats:
        """Cost (c,) that each candidate adds to a plan."""
        new = ~np.isin(self.levels, self.levels[list(chosen)])
        return np.asarray(self.costs + self.level_cost * new)

    def admissible(self, chosen: Sequence[int]) -> Bools:
        """Mask (c,) of the candidates that may join a plan."""
        fits = self.cost(chosen) + self.added(chosen) <= self.budget * (1.0 + 1e-9)
        return np.asarray(fits & ~self.blocked[list(chosen)].any(axis=0))


def too_close(places: Floats, others: Floats, least: Floats) -> Bools:
    """Mask (n, m) of pairs of places (n, q), (m, q) that are closer than allowed in every coordinate.

    Parameters
    ----------
    places, others : (n, q), (m, q)
    least : (q,)
        Smallest distances; places at exactly that distance are far enough.
    """
    apart = np.abs(places[:, None] - others[None])
    return np.asarray((apart < least * (1.0 - 1e-9)).all(axis=-1))


def greedy(problem: Problem, rules: Rules, first: Sequence[int] = (), *, per_cost: bool = True) -> list[int]:
    """Measurements one after the other, each the best next one.

    Parameters
    ----------
    problem : Problem
    rules : Rules
    first : sequence of int
        Measurements that the plan begins with.
    per_cost : bool
        Judge the fall of the criterion per cost; otherwise the fall alone.
    """
    chosen = list(first)
    while len(chosen) < rules.most:
        fall = problem.score(chosen) - problem.scores(chosen)
        worth = fall / rules.added(chosen) if per_cost else fall
        worth = np.where(rules.admissible(chosen) & (fall > LEAST), worth, -np.inf)
        best = int(worth.argmax())
        if not np.isfinite(worth[best]):
            break
        chosen.append(best)
    return chosen


def exchange(problem: Problem, rules: Rules, chosen: Sequence[int]) -> list[int]:
    """Plan with measurements exchanged, the best exchange first, until none improves it.

    Parameters
    ----------
    problem : Problem
    rules : Rules
    chosen : sequence of int
    """
    plan = list(chosen)
    for _ in range(MOST_EXCHANGES):
        before = problem.score(plan)
        best, found = before - LEAST, None
        for i in range(len(plan)):
            rest = plan[:i] + plan[i + 1 :]
            scores = np.where(rules.admissible(rest), problem.scores(rest), np.inf)
            if scores.min() < best:
                best, found = float(scores.min()), [*rest[:i], int(scores.argmin()), *rest[i:]]
        if found is None:
            break
        plan = found
    return plan


def select(problem: Problem, rules: Rules) -> list[int]:
    """Best plan found, in the order of gain per cost.

    Plans are greedy with and without regard to cost, and such as begin with another good measurement; each is improved
    by exchange.
    """
    worth = np.where(rules.admissible([]), -problem.scores([]), -np.inf)
    starts = [[int(i)] for i in np.argsort(-worth, kind="stable")[1 : 1 + OTHER_STARTS] if np.isfinite(worth[i])]
    plans = [greedy(problem, rules, per_cost=False), *(greedy(problem, rules, first) for first in ([], *starts))]
    return _ordered(problem, rules, min((exchange(problem, rules, plan) for plan in plans), key=problem.score))


def _ordered(problem: Problem, rules: Rules, plan: Sequence[int]) -> list[int]:
    """The plan, each measurement the best next one per cost."""
    left, found = list(plan), list[int]()
    while left:
        worth = (problem.score(found) - problem.scores(found)) / rules.added(found)
        found.append(left.pop(int(np.argmax(worth[left]))))
    return found
