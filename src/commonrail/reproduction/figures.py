"""The figures of all repetitions as arrays over the seeds: what claims and record are made from."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.sampling import sample_feasible
from commonrail.calibration.space import Space
from commonrail.reproduction import paper
from commonrail.reproduction.measures import Edges, edges, j_by_phase, level_of, ninety_percent
from commonrail.reproduction.paper import Configuration
from commonrail.reproduction.repetition import LABELS, Repetition

__all__ = ["Figures"]

Floats = NDArray[np.float64]

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
    def space(self) -> Space:
        """Bounds and ordering of k1…k7, the same for all."""
        return self.repetitions[0].space

    @property
    def rigid_space(self) -> Space:
        """Bounds of the rigid body's stop and control volume, the same for all."""
        return self.repetitions[0].rigid_space

    @cached_property
    def j(self) -> dict[str, dict[str, Floats]]:
        """J (n,) by data and label [mm³/ms]."""
        return {
            name: {
                label: np.array([float(r.data[i].misfit(r.rates[label][i])) for r in self.repetitions])
                for label in LABELS
            }
            for i, name in enumerate(paper.RAIL_PRESSURES)
        }

    @cached_property
    def change(self) -> Floats:
        """Optimised over theoretical stiffness, less one, (n, 7)."""
        return np.array([r.best.x for r in self.repetitions]) / self.theoretical - 1.0

    @cached_property
    def random_change(self) -> Floats:
        """Random feasible over theoretical stiffness, less one, (`RANDOM_POINTS`, 7): what no search has chosen."""
        return sample_feasible(self.space, RANDOM_POINTS, np.random.default_rng(0)) / self.theoretical - 1.0

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
        found: dict[str, dict[str, Floats]] = {}
        for i, name in enumerate(paper.RAIL_PRESSURES):
            found[name] = {}
            for label in LABELS:
                parts = []
                for r in self.repetitions:
                    d = r.data[i]
                    opening = edges(d.rate, d.bounds, level_of(d.rate)).opening
                    parts.append(j_by_phase(r.rates[label][i], d.rate, d.bounds, opening))
                found[name][label] = np.array(parts)
        return found

    def edge_errors(self, name: str, label: str, which: str) -> Floats:
        """Opening or closing of a model minus the experiment's (n,) [s]."""
        i = list(paper.RAIL_PRESSURES).index(name)
        return np.array([self._edge_error(r, i, label, which) for r in self.repetitions])

    @staticmethod
    def _edge_error(r: Repetition, i: int, label: str, which: str) -> float:
        data = r.data[i]
        level = level_of(data.rate)
        model, experiment = (edges(rate, data.bounds, level) for rate in (r.rates[label][i], data.rate))
        at = Edges._fields.index(which)
        return model[at] - experiment[at]

    def own_j(self, name: str) -> Floats:
        """J that a fit to the validation curve itself reaches (n,)."""
        return np.array([r.own[name].cost for r in self.repetitions])

    def gain_kept(self, name: str) -> Floats:
        """Share of the gain over theory at an unseen pressure that the fit at 160 MPa keeps (n,)."""
        theoretical = self.j[name]["theoretical"]
        return np.asarray((theoretical - self.j[name]["optimised"]) / (theoretical - self.own_j(name)))

    def verdicts(self, parameter: int) -> dict[str, int]:
        """How many seeds pin the parameter down, and how."""
        name = paper.NAMES[parameter]
        return dict(Counter(r.identified[name]["verdict"] for r in self.repetitions if name in r.identified))
