"""Figures of all repetitions as arrays over the seeds: claims and record are made from them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import commonrail as cr
from commonrail.base.arrays import Floats, IndexArray
from commonrail.data.records import MM3_PER_MS
from commonrail.plugins.paper import study
from commonrail.plugins.paper.run import LABELS, Repetition, StiffnessCertainty

# Measures of curves and searches: edges, phases, convergence, quartiles. Pure functions of arrays.

EDGE_SHARE = 0.1  # share of the experiment's largest rate that marks opening and closing
PHASE_LENGTH = 0.4e-3  # Sec. 5 speaks of 0–0.4 ms, the middle, and the descent up to 1.2 ms
PHASES = ("before opening", "0–0.4 ms", "0.4–0.8 ms", "0.8 ms to the end")
WINDOW = 1.2e-3  # Sec. 5 leaves out what comes later; it does not say whether t counts from opening or from energising
WINDOWS = ("1.2 ms from opening", "1.2 ms from energising")


class Spread(NamedTuple):
    """Median and quartiles; NaN if there is no finite value."""

    median: float
    q1: float
    q3: float


class Box(NamedTuple):
    """Box plot; minimum and maximum are those of the values within 1.5 interquartile ranges of the box."""

    minimum: float
    q1: float
    median: float
    q3: float
    maximum: float


class Edges(NamedTuple):
    """Begin and end of an injection curve [s]; NaN where there is none."""

    opening: float
    closing: float


def spread(values: ArrayLike) -> Spread:
    """Median and quartiles of the finite values."""
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    if not len(finite):
        return Spread(np.nan, np.nan, np.nan)
    q1, median, q3 = np.percentile(finite, (25.0, 50.0, 75.0))
    return Spread(float(median), float(q1), float(q3))


def box(values: ArrayLike) -> Box:
    """Box plot with outliers suppressed, as the paper's Fig. 5."""
    v = np.asarray(values, float).ravel()
    q1, median, q3 = np.percentile(v, (25.0, 50.0, 75.0))
    reach = 1.5 * (q3 - q1)
    inliers = v[(v >= q1 - reach) & (v <= q3 + reach)]
    return Box(float(inliers.min()), float(q1), float(median), float(q3), float(inliers.max()))


def edges(rate: Floats, bounds: Floats, level: float) -> Edges:
    """First rise and last fall of a curve through a level, linear between the middles of the samples.

    Rate (n,) and level are in m³/s, the bounds (n + 1,) of the samples in s.
    """
    middle = 0.5 * (bounds[1:] + bounds[:-1])
    above = rate > level
    rises = np.flatnonzero(~above[:-1] & above[1:])
    falls = np.flatnonzero(above[:-1] & ~above[1:])

    def crossing(crossings: IndexArray, which: int) -> float:
        if not len(crossings):
            return float("nan")
        i = int(crossings[which])
        share = (level - rate[i]) / (rate[i + 1] - rate[i])
        return float(middle[i] + share * (middle[i + 1] - middle[i]))

    return Edges(crossing(rises, 0), crossing(falls, -1))


def level_of(measured: Floats) -> float:
    """Level at which edges are read: a share of the experiment's greatest rate."""
    return EDGE_SHARE * float(np.max(measured))


def j_by_phase(rate: Floats, measured: Floats, bounds: Floats, opening: float) -> Floats:
    """Parts of J [mm³/ms] in the phases of `PHASES`, counted from the experiment's opening [s]; they add up to J.

    Rates (n,) are in m³/s, the bounds (n + 1,) of the samples in s.
    """
    middle = 0.5 * (bounds[1:] + bounds[:-1])
    phase = np.digitize(middle - opening, (0.0, PHASE_LENGTH, 2.0 * PHASE_LENGTH))
    error = np.abs(rate - measured) * 1e6
    return np.array([float(np.sum(error[phase == i])) for i in range(len(PHASES))])


def j_by_window(rate: Floats, measured: Floats, bounds: Floats, opening: float) -> Floats:
    """J [mm³/ms] and number of samples (2, 2) within each of `WINDOWS`; arguments as for `j_by_phase`."""
    middle = 0.5 * (bounds[1:] + bounds[:-1])
    error = np.abs(rate - measured) * MM3_PER_MS
    inside = [middle < begin + WINDOW for begin in (opening, 0.0)]
    return np.array([(np.sum(error[mask]), np.sum(mask)) for mask in inside])


def oscillation(rate: Floats) -> float:
    """Total rise and fall [mm³/ms] of a curve (n,) [m³/s] beyond one rise to its maximum and one fall from it."""
    once = 2.0 * np.max(rate) - rate[0] - rate[-1]
    return float(np.sum(np.abs(np.diff(rate))) - once) * MM3_PER_MS


def ninety_percent(history: Sequence[cr.fit.Generation]) -> float:
    """First generation at which 90 % of what the search gains over its initial population is reached."""
    best = np.array([g.best for g in history])
    if not np.isfinite(best[[0, -1]]).all():
        return float("nan")
    return float(np.argmax(best <= best[0] - 0.9 * (best[0] - best[-1])))


K6 = "plunger_needle.k6"
NEAR_MAXIMUM = 0.8  # of a range
RANDOM_POINTS = 4000  # a share of them has a standard error of 0.8 % at most


class Figures:
    """Figures over n seeds; every array begins with the seeds.

    `j` are J (n,) [mm³/ms] and `phases` its parts (n, phases) by data and label; phases count from the experiment's
    opening. `windows` (n, windows, 2) are J and number of samples within `WINDOWS`, and `oscillation` (n,) [mm³/ms]
    belongs to the simulated rate. `theoretical` is the theoretical stiffness (7,) [N/m]; `change` (n, 7) is the
    relative change of the optimised stiffness from it, `random_change` (`RANDOM_POINTS`, 7) the change of random
    feasible stiffnesses without a search. `table3` are J (n, 3) at 160, 120 and 80 MPa by configuration, `mean_j` (n,)
    their means and `validation_j` (n,) the means over the unseen pressures. `ninety` (n,) are generations at which 90 %
    of the gain is reached, `k6_high` (n,) shares of all members of the search whose k6 lies in the upper fifth of its
    range, and `k6_high_at_random` is this share of random points.
    """

    def __init__(self, repetitions: tuple[Repetition, ...]) -> None:
        self.repetitions = repetitions
        self.seeds = [r.seed for r in repetitions]
        self.space, self.rigid_space = repetitions[0].space, repetitions[0].rigid_space  # the same for all
        self.theoretical = self.space.reference
        self.change = np.array([r.best.x for r in repetitions]) / self.theoretical - 1.0
        random = cr.fit.sample_feasible(self.space, RANDOM_POINTS, np.random.default_rng(0))
        self.random_change = random / self.theoretical - 1.0
        self.j = self._by_data_and_label(lambda r, i, label: float(r.data[i].misfit(r.rates[label][i])))
        self.phases = self._by_data_and_label(partial(_measure, j_by_phase))
        self.windows = self._by_data_and_label(partial(_measure, j_by_window))
        self.oscillation = self._by_data_and_label(lambda r, i, label: oscillation(r.rates[label][i]))
        self.table3 = {c: np.array([r.table3[c][1] for r in repetitions]) for c in study.CONFIGURATIONS}
        self.mean_j = {c: np.mean(js, axis=1) for c, js in self.table3.items()}
        self.validation_j = {c: np.mean(js[:, 1:], axis=1) for c, js in self.table3.items()}
        self.ninety = np.array([ninety_percent(r.best.history) for r in repetitions])
        i = study.NAMES.index(K6)
        high = self.space.lower[i] + NEAR_MAXIMUM * (self.space.upper[i] - self.space.lower[i])
        self.k6_high = np.array([np.mean(r.best.members[..., i] >= high) for r in repetitions])
        self.k6_high_at_random = float(np.mean(random[:, i] >= high))

    def _by_data_and_label(self, make: Callable[[Repetition, int, str], Any]) -> dict[str, dict[str, Floats]]:
        """Array over the seeds of `make(repetition, number of the curve, label)`, by data and label."""
        return {
            name: {label: np.array([make(r, i, label) for r in self.repetitions]) for label in LABELS}
            for i, name in enumerate(study.RAIL_PRESSURES)
        }

    def random_j(self, name: str) -> Floats:
        """J of random feasible stiffness (n, members) [mm³/ms]; NaN where the simulation failed."""
        i = list(study.RAIL_PRESSURES).index(name)
        return np.array([r.random_j[i] for r in self.repetitions])

    def edge_errors(self, name: str, label: str, which: str) -> Floats:
        """Difference (n,) of a model's "opening" or "closing" from the experiment's [s]."""
        i, at = list(study.RAIL_PRESSURES).index(name), Edges._fields.index(which)
        errors = []
        for r in self.repetitions:
            data = r.data[i]
            model, experiment = (
                edges(rate, data.bounds, level_of(data.rate)) for rate in (r.rates[label][i], data.rate)
            )
            errors.append(model[at] - experiment[at])
        return np.array(errors)

    def own_j(self, name: str) -> Floats:
        """J that a fit to the validation curve itself reaches (n,)."""
        return np.array([r.own_curve_searches[name].cost for r in self.repetitions])

    def gain_kept(self, name: str) -> Floats:
        """Share of the gain over theory at an unseen pressure that the fit at 160 MPa keeps (n,)."""
        theoretical = self.j[name]["theoretical"]
        return np.asarray((theoretical - self.j[name]["optimised"]) / (theoretical - self.own_j(name)))

    def certainty(self, parameter: int) -> list[StiffnessCertainty]:
        """Certainty of the parameter, of the seeds that have one."""
        name = study.NAMES[parameter]
        return [r.identified[name] for r in self.repetitions if name in r.identified]

    def verdicts(self, parameter: int) -> dict[str, int]:
        """Number of seeds by verdict on the parameter."""
        return dict(Counter(estimate.verdict for estimate in self.certainty(parameter)))

    def covers(self, parameter: int, truth: float) -> tuple[int, int]:
        """Number of seeds whose interval of the parameter holds its true value [SI], and of those with an interval.

        An end that is None is not bounded by the data. An interval without ends says nothing and is not counted.
        """
        ends = [(estimate.lower, estimate.upper) for estimate in self.certainty(parameter)]
        bounded = [(low, high) for low, high in ends if low is not None or high is not None]
        inside = [(low is None or low <= truth) and (high is None or truth <= high) for low, high in bounded]
        return sum(inside), len(inside)


def _measure(split: Callable[..., Floats], r: Repetition, i: int, label: str) -> Floats:
    """Parts of J of a model, by a function of its rate, the experiment, its samples and its opening."""
    d = r.data[i]
    opening = edges(d.rate, d.bounds, level_of(d.rate)).opening
    return split(r.rates[label][i], d.rate, d.bounds, opening)
