"""Figures of all repetitions as arrays over the seeds: claims and record are made from them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import commonrail as cr
from commonrail.arrays import Floats
from commonrail.reproduction import paper
from commonrail.reproduction.measures import Edges, edges, j_by_phase, level_of, ninety_percent
from commonrail.reproduction.paper import Configuration
from commonrail.reproduction.repetition import LABELS, Repetition

__all__ = ["Figures"]


K6 = "plunger_needle.k6"
NEAR_MAXIMUM = 0.8  # of a range
RANDOM_POINTS = 4000  # a share among them has a standard error of 0.8 % at most


@dataclass(frozen=True)
class Figures:
    """Figures over n seeds; every array begins with the seeds."""

    repetitions: tuple[Repetition, ...]

    @property
    def seeds(self) -> list[int]:
        """Seeds."""
        return [r.seed for r in self.repetitions]

    @property
    def space(self) -> cr.Space:
        """Bounds and ordering of k1…k7, the same for all."""
        return self.repetitions[0].space

    @property
    def rigid_space(self) -> cr.Space:
        """Bounds of the rigid body's stop and control volume, the same for all."""
        return self.repetitions[0].rigid_space

    @cached_property
    def j(self) -> dict[str, dict[str, Floats]]:
        """J (n,) by data and label [mm³/ms]."""

        def of(label: str, i: int) -> Floats:
            return np.array([float(r.data[i].misfit(r.rates[label][i])) for r in self.repetitions])

        return {name: {label: of(label, i) for label in LABELS} for i, name in enumerate(paper.RAIL_PRESSURES)}

    @cached_property
    def change(self) -> Floats:
        """Optimised over theoretical stiffness, less one, (n, 7)."""
        return np.array([r.best.x for r in self.repetitions]) / self.theoretical - 1.0

    @cached_property
    def random_change(self) -> Floats:
        """Random feasible over theoretical stiffness, less one, (`RANDOM_POINTS`, 7): what no search has chosen."""
        return cr.sample_feasible(self.space, RANDOM_POINTS, np.random.default_rng(0)) / self.theoretical - 1.0

    def random_j(self, name: str) -> Floats:
        """J of random feasible stiffness (n, members) [mm³/ms]; NaN where the simulation failed."""
        i = list(paper.RAIL_PRESSURES).index(name)
        return np.array([r.random_j[i] for r in self.repetitions])

    @cached_property
    def theoretical(self) -> Floats:
        """Theoretical stiffness (7,) [N/m]."""
        return self.space.reference

    @cached_property
    def table3(self) -> dict[Configuration, Floats]:
        """J at 160, 120 and 80 MPa (n, 3) by configuration."""
        return {c: np.array([r.table3[c][1] for r in self.repetitions]) for c in paper.CONFIGURATIONS}

    @cached_property
    def mean_j(self) -> dict[Configuration, Floats]:
        """Mean of the three J (n,) by configuration."""
        return {c: np.mean(js, axis=1) for c, js in self.table3.items()}

    @cached_property
    def validation_j(self) -> dict[Configuration, Floats]:
        """Mean J of the unseen pressures (n,) by configuration."""
        return {c: np.mean(js[:, 1:], axis=1) for c, js in self.table3.items()}

    @cached_property
    def ninety(self) -> Floats:
        """Generation at which 90 % of the gain is reached (n,)."""
        return np.array([ninety_percent(r.best.history) for r in self.repetitions])

    @cached_property
    def k6_high(self) -> Floats:
        """Share of all members of the search whose k6 lies in the upper fifth of its range (n,)."""
        i = paper.NAMES.index(K6)
        return np.array([np.mean(r.best.members[..., i] >= self._k6_limit) for r in self.repetitions])

    @cached_property
    def k6_high_at_random(self) -> float:
        """Share of random feasible points whose k6 lies in the upper fifth of its range."""
        i = paper.NAMES.index(K6)
        return float(np.mean((1.0 + self.random_change[:, i]) * self.theoretical[i] >= self._k6_limit))

    @property
    def _k6_limit(self) -> float:
        i = paper.NAMES.index(K6)
        return float(self.space.lower[i] + NEAR_MAXIMUM * (self.space.upper[i] - self.space.lower[i]))

    @cached_property
    def phases(self) -> dict[str, dict[str, Floats]]:
        """J by phase (n, phases) by data and label; phases count from the experiment's opening."""

        def of(label: str, i: int, r: Repetition) -> Floats:
            d = r.data[i]
            opening = edges(d.rate, d.bounds, level_of(d.rate)).opening
            return j_by_phase(r.rates[label][i], d.rate, d.bounds, opening)

        return {
            name: {label: np.array([of(label, i, r) for r in self.repetitions]) for label in LABELS}
            for i, name in enumerate(paper.RAIL_PRESSURES)
        }

    def edge_errors(self, name: str, label: str, which: str) -> Floats:
        """Difference (n,) of a model's opening or closing from the experiment's [s].

        Parameters
        ----------
        name, label : str
            Of the data and of the model.
        which : {"opening", "closing"}
        """
        i, at = list(paper.RAIL_PRESSURES).index(name), Edges._fields.index(which)

        def of(r: Repetition) -> float:
            data = r.data[i]
            level = level_of(data.rate)
            model, experiment = (edges(rate, data.bounds, level) for rate in (r.rates[label][i], data.rate))
            return model[at] - experiment[at]

        return np.array([of(r) for r in self.repetitions])

    def own_j(self, name: str) -> Floats:
        """J that a fit to the validation curve itself reaches (n,)."""
        return np.array([r.own[name].cost for r in self.repetitions])

    def gain_kept(self, name: str) -> Floats:
        """Share of the gain over theory at an unseen pressure that the fit at 160 MPa keeps (n,)."""
        theoretical = self.j[name]["theoretical"]
        return np.asarray((theoretical - self.j[name]["optimised"]) / (theoretical - self.own_j(name)))

    def certainty(self, parameter: int) -> list[dict[str, Any]]:
        """Records of the parameter's certainty, of the seeds that have one."""
        name = paper.NAMES[parameter]
        return [r.identified[name] for r in self.repetitions if name in r.identified]

    def verdicts(self, parameter: int) -> dict[str, int]:
        """Number of seeds by verdict on the parameter."""
        return dict(Counter(one["verdict"] for one in self.certainty(parameter)))

    def covers(self, parameter: int, truth: float) -> tuple[int, int]:
        """Number of seeds whose interval of the parameter holds its true value [SI], and of those with an interval.

        An end that is None is not bounded by the data. An interval without ends says nothing and is not counted.
        """
        ends = [(one["lower"], one["upper"]) for one in self.certainty(parameter)]
        bounded = [(low, high) for low, high in ends if low is not None or high is not None]
        inside = [(low is None or low <= truth) and (high is None or truth <= high) for low, high in bounded]
        return sum(inside), len(inside)
