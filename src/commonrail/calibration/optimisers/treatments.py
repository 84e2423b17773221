"""Treatments of trials that break bounds or constraints.

The paper does not say what it did. Of the draws in its box 0.3 % keep the ordering, so the choice
decides how many of the slots are simulated at all. Each treatment here has a name, to be recorded
with the result, and one signature: `Treated` from the space, the parents and the raw trials.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Bools, Floats, IndexArray
from commonrail.calibration.space import Space

__all__ = ["Redraw", "Treated", "Treatment", "reflect", "treat", "wins"]


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

    Parameters
    ----------
    treatment : Treatment
        Which one.
    space : Space
        Bounds and constraints.
    parents : (n, d) array
        The members that the trials would replace, unit coordinates. Repair and resampling need
        them feasible, and keep them so.
    trials : (n, d) array
        Trials after mutation and crossover, unit coordinates.
    redraw : callable
        More raw trials for some of the members; used by resampling only.

    Returns
    -------
    Treated
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
        found = feasible.any(axis=1)
        first = feasible.argmax(axis=1)
        unit[broken[found]] = further[found, first[found]]
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
