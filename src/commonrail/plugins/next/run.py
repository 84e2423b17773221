"""Next measurements of a calibration: those that would make named parameters or a map's predictions most certain."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arguments import instance, number, thread_count
from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.base.text import join_words
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Role
from commonrail.data.quantities.data import QuantityData
from commonrail.data.registry import in_order, of_role
from commonrail.data.simulator import Simulator
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.noise_fit import FittedNoise
from commonrail.plugins.certainty.run import certainty as certify
from commonrail.plugins.certainty.uncertain import with_uncertain_free
from commonrail.plugins.next.problem import Response, has_discrepancy, problem_of, responses_of
from commonrail.plugins.next.settings import DesignSettings
from commonrail.plugins.next.study import (
    KINDS,
    MOST_CANDIDATES,
    Candidate,
    Problem,
    fitted_kinds,
    grid,
    place_of,
    planned,
    usual_axes,
)

# Choice of measurements: one after the other by gain per cost, then exchange as long as one improves the plan.

LEAST = 1e-9  # fall of the criterion that counts as one
MOST_EXCHANGES = 200
OTHER_STARTS = 8  # plans that begin with the second, third … best first measurement


class Rules(NamedTuple):
    """Limits of a plan.

    `costs` (c,) are those of the candidates; `levels` (c,) settings of the bench that they need, such as a rail
    pressure, of which each that a plan uses costs `level_cost`; `blocked` (c, c) marks candidates that exclude each
    other, and on the diagonal those that may not be repeated; `most` is the largest number of measurements, `budget`
    the largest cost.
    """

    costs: Floats
    levels: IndexArray
    level_cost: float
    blocked: Bools
    most: int
    budget: float = math.inf

    def cost(self, selection: Sequence[int]) -> float:
        """Cost of a plan."""
        which = list(selection)
        return float(np.sum(self.costs[which])) + self.level_cost * len(set(self.levels[which].tolist()))

    def added(self, selection: Sequence[int]) -> Floats:
        """Cost (c,) that each candidate adds to a plan."""
        new = ~np.isin(self.levels, self.levels[list(selection)])
        return np.asarray(self.costs + self.level_cost * new)

    def admissible(self, selection: Sequence[int]) -> Bools:
        """Mask (c,) of the candidates that may join a plan."""
        fits = self.cost(selection) + self.added(selection) <= self.budget * (1.0 + 1e-9)
        return np.asarray(fits & ~self.blocked[list(selection)].any(axis=0))


def too_close(places: Floats, others: Floats, least: Floats) -> Bools:
    """Mask (n, m) of pairs of places (n, q), (m, q) that are closer in every coordinate than `least` (q,)."""
    distances = np.abs(places[:, None] - others[None])
    return np.asarray((distances < least * (1.0 - 1e-9)).all(axis=-1))


def greedy(problem: Problem, rules: Rules, first: Sequence[int] = (), *, per_cost: bool = True) -> list[int]:
    """Measurements after `first`, each the best next one by the fall of the criterion, per cost or alone."""
    selection = list(first)
    while len(selection) < rules.most:
        fall = problem.score(selection) - problem.scores(selection)
        worth = fall / rules.added(selection) if per_cost else fall
        worth = np.where(rules.admissible(selection) & (fall > LEAST), worth, -np.inf)
        best = int(worth.argmax())
        if not np.isfinite(worth[best]):
            break
        selection.append(best)
    return selection


def exchange(problem: Problem, rules: Rules, selection: Sequence[int]) -> list[int]:
    """Plan with measurements exchanged, the best exchange first, until none improves it."""
    plan = list(selection)
    for _ in range(MOST_EXCHANGES):
        before = problem.score(plan)
        best, better_plan = before - LEAST, None
        for i in range(len(plan)):
            rest = plan[:i] + plan[i + 1 :]
            scores = np.where(rules.admissible(rest), problem.scores(rest), np.inf)
            if scores.min() < best:
                best, better_plan = float(scores.min()), [*rest[:i], int(scores.argmin()), *rest[i:]]
        if better_plan is None:
            break
        plan = better_plan
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
    left, ordered = list(plan), list[int]()
    while left:
        worth = (problem.score(ordered) - problem.scores(ordered)) / rules.added(ordered)
        ordered.append(left.pop(int(np.argmax(worth[left]))))
    return ordered


TRUSTED = 5.0  # degrees of freedom from which a scale that was estimated is believed
WORTH = 0.1  # fall of an error from which it is worth measuring: an error that 50 values estimate is uncertain by that
DRAWS, DRAWS_EACH = 100, 5  # draws at which candidates are simulated, or more of many parameters
MOST_TRIED = 16  # places at which a kind that is not planned is tried: the best of them is named, no plan is made


class Measurement(NamedTuple):
    """Measurement of a plan.

    `value` is the injected or returned quantity that is expected [m³], NaN if it could not be simulated; `deviation`
    the standard deviation of that quantity before the plan [m³], noise of the measurement excluded, NaN for a curve;
    `factor` a typical standard deviation that the criterion is about, after this measurement and those before it, over
    that before the plan; `ratio` the same of the standard error of the plan's `widest` parameter.
    """

    candidate: Candidate
    value: float
    deviation: float
    factor: float
    ratio: float


@dataclass(frozen=True, repr=False)
class MeasurementPlan(Shown):
    """Plan of measurements.

    Attributes
    ----------
    measurements : tuple of Measurement
        In the order of gain per cost.
    cost : float
    settings : DesignSettings
    candidates : int
        Number that the plan was chosen from.
    before, after : mapping of str to float
        Standard error of each parameter [SI], without and with the plan.
    failed : int
        Simulations of candidates that failed, each at one draw.
    notes : tuple of str
        What the plan takes for granted.
    widest : str
        Parameter whose standard error is the largest share of its range before the plan.
    alternatives : tuple of Measurement
        Best single one of each fitted kind that the plan does not choose from.
    """

    presenter = "commonrail.plugins.next.page:PLAN"

    measurements: tuple[Measurement, ...]
    cost: float
    settings: DesignSettings
    candidates: int
    before: Mapping[str, float]
    after: Mapping[str, float]
    failed: int
    notes: tuple[str, ...] = field(default=())
    widest: str = ""
    alternatives: tuple[Measurement, ...] = ()

    @property
    def is_worth_measuring(self) -> bool:
        """True if the plan lowers what the criterion is about, or the widest interval, by `WORTH`."""
        return any(min(measurement.factor, measurement.ratio) <= 1.0 - WORTH for measurement in self.measurements[-1:])


def candidates_of(
    study: Study,
    costs: Mapping[str, float] = {},
    pressures: Floats | None = None,
    times: Floats | None = None,
    dwells: Sequence[float] = (),
    first_energising_time: float = 0.0,
) -> list[Candidate]:
    """Candidates of kinds with their costs, by default of the first kind of `KINDS` that was fitted, on a grid.

    Rail pressures [Pa] and energising times [s] lie within the range of the data by default; dwells [s] and the first
    energising time [s] are as in `grid`.
    """
    data = of_role(study.data, Role.FIT)
    usual_kind = fitted_kinds(data)[0]
    if pressures is None or times is None:
        usual = usual_axes(data)
        pressures = usual[0] if pressures is None else pressures
        times = usual[1] if times is None else times
    points = grid(data[0].points[0], pressures.tolist(), times.tolist(), dwells, first_energising_time)
    return [Candidate(kind, point, cost) for kind, cost in (costs or {usual_kind: 1.0}).items() for point in points]


def next_measurements(
    study: Study,
    best: Mapping[str, float],
    candidates: Sequence[Candidate] | None = None,
    settings: DesignSettings | None = None,
    *,
    threads: int | None = None,
    note: Callable[[str], None] = lambda _: None,
) -> MeasurementPlan:
    """Measurements that would make parameters or predictions most certain, with the noise of the data that there are.

    Parameters
    ----------
    study : Study
    best : mapping of str to float
        Values [SI], as `Calibration.best`.
    candidates : sequence of Candidate, optional
        Measurements that could be made; by default points within the range of the data, of their kind.
    settings : DesignSettings, optional
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    note : function of str
        Called before long steps.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, a name is unknown, or no candidate may be measured.
    SimulationError
        If the best values cannot be simulated.
    """
    instance(study, Study, "study")
    settings = settings or DesignSettings()
    threads = thread_count(threads)
    study.space.point(best)  # before the candidates, whose range a study may lack
    names = settings.parameters or study.space.names
    columns = [_column(study, name) for name in names]
    all_candidates = list(candidates_of(study) if candidates is None else candidates)
    free = with_uncertain_free(study)
    data = in_order(free.data)
    _check(all_candidates, data)
    n, all_candidates = len(all_candidates), [*all_candidates, *_of_other_kinds(all_candidates, data)]
    note("fitting the noise of the data ...")
    certainty = certify(study, best, threads=threads, seed=settings.seed)
    estimate, draws = certainty.estimate, certainty.draws.unit
    noises, notes = _trusted(estimate, data)
    many = min(max(DRAWS, DRAWS_EACH * draws.shape[1]), len(draws))
    unit = draws[np.random.default_rng(settings.seed).permutation(len(draws))[:many]]
    note(f"simulating {len(all_candidates)} candidates at {many} draws of the parameters ...")
    likelihood = estimate.likelihood.with_noises(noises)
    simulator = Simulator(free.injector, likelihood.names, study.time_step, threads, same_bits=study.same_bits)
    by_kind = {item.kind: noise for item, noise in reversed(list(zip(data, noises, strict=True)))}
    responses = responses_of(all_candidates, data, by_kind, simulator, likelihood.space.from_unit(unit), unit)
    problem = problem_of(
        settings.criterion,
        estimate,
        likelihood,
        draws,
        data,
        responses,
        parameters=columns,
        injector_count=study.space.dimension,
        predicted=n,
    )
    rules = _rules(all_candidates, data, settings)
    plan = select(problem, rules._replace(costs=np.where(np.arange(len(all_candidates)) < n, rules.costs, np.inf)))
    if not plan:
        raise ConfigurationError(
            "No candidate may be measured within the budget and the distance to the points that there are, or none "
            "tells anything; state other rail pressures and energising times, or a smaller distance."
        )
    before, after = (_standard_errors(study, estimate, problem, selection) for selection in ([], plan))
    widest = max(study.space.parameters, key=lambda item: before[item.name] / (item.upper - item.lower)).name
    column = study.space.names.index(widest)
    others, scores = list[Measurement](), np.where(np.isfinite(rules.costs), problem.scores([]), np.inf)
    for kind in dict.fromkeys(item.kind for item in all_candidates[n:]):
        best_one = min((i for i, item in enumerate(all_candidates) if item.kind == kind), key=scores.__getitem__)
        others += _measurements(problem, [best_one], responses, column) if np.isfinite(scores[best_one]) else []
    measurements, failed = tuple(_measurements(problem, plan, responses, column)), sum(r.failed for r in responses[:n])
    gains = before, after, failed, tuple(notes), widest, tuple(others)
    return MeasurementPlan(measurements, rules.cost(plan), settings, n, *gains)


def _of_other_kinds(candidates: Sequence[Candidate], data: Sequence[DataSet]) -> list[Candidate]:
    """Candidates of the fitted kinds that are not wanted, at some of the same points."""
    stride = len(candidates) // MOST_TRIED | 1  # odd, so that it meets all times of a grid
    kinds = [kind for kind in fitted_kinds(data) if kind not in {item.kind for item in candidates}]
    return [Candidate(kind, item.point) for kind in kinds for item in candidates[::stride]]


def _check(candidates: Sequence[Candidate], data: Sequence[DataSet]) -> None:
    if not 0 < len(candidates) <= MOST_CANDIDATES:
        raise ConfigurationError(f"There must be 1 to {MOST_CANDIDATES} candidates, not {len(candidates)}.")
    for candidate in candidates:
        if candidate.kind not in KINDS:
            raise ConfigurationError(
                f'"{candidate.kind}" is no kind of measurement{nearest(candidate.kind, KINDS)}; '
                f"{join_words(KINDS)} are."
            )
        if not number(candidate.cost, "1", "cost of a candidate") > 0.0:
            raise ConfigurationError(f"The cost of a measurement must be greater than zero, not {candidate.cost:g}.")
    for kind in {candidate.kind for candidate in candidates}:
        planned(kind, (), data)


def _trusted(estimate: Estimate, data: Sequence[DataSet]) -> tuple[list[FittedNoise], list[str]]:
    """Noise of the data sets: of a map with too few points to estimate it, one tolerance."""
    noises, notes = [], []
    for block, noise, data_set in zip(estimate.likelihood.blocks, estimate.likelihood.noises, data, strict=True):
        if isinstance(data_set, QuantityData) and not noise.stated and noise.freedom < TRUSTED:
            noise = FittedNoise(noise.law, max(noise.scale, 1.0 / noise.density.deviation), noise.freedom)
            notes.append(
                f"{data_set.name} has too few points to estimate its noise: at least one tolerance is assumed."
            )
        if not block.ordered and has_discrepancy(block):  # its loads act on planned points too
            noise = replace(noise, courses=np.empty((0, 0)))
        noises.append(noise)
        if not has_discrepancy(block):
            notes.append(
                f"{data_set.name} states no correlated discrepancy: "
                "errors of new measurements are taken as independent."
            )
    return noises, notes


def _rules(candidates: Sequence[Candidate], data: Sequence[DataSet], settings: DesignSettings) -> Rules:
    places = np.array([place_of(item.point) for item in candidates])
    least = np.array([settings.apart_pressure, settings.apart_time, settings.apart_time])
    kinds = np.array([item.kind for item in candidates])
    blocked = too_close(places, places, least) & (kinds[:, None] == kinds)
    taken = np.zeros(len(candidates), bool)
    for item in data:
        measured_places = np.array([place_of(point) for point in item.points])
        taken |= too_close(places, measured_places, least).any(axis=1) & (kinds == item.kind)
    costs = np.where(taken, np.inf, np.array([item.cost for item in candidates]))
    _, levels = np.unique(places[:, 0], return_inverse=True)
    budget = 1e300 if settings.budget is None else settings.budget  # less than what a taken place costs
    return Rules(costs, levels.reshape(-1), settings.pressure_cost, blocked, settings.points, budget)


def _measurements(
    problem: Problem, plan: Sequence[int], responses: Sequence[Response], column: int
) -> Iterator[Measurement]:
    """Measurements of a plan; `column`: of the widest parameter."""
    first, prior = problem.score([]), problem.covariance([])
    for k, i in enumerate(plan, 1):
        response = responses[i]
        d = len(response.plain)
        deviation = math.sqrt(float(response.plain @ prior[:d, :d] @ response.plain)) * response.scale
        ratio = math.sqrt(problem.covariance(plan[:k])[column, column] / prior[column, column])
        factor = math.exp(problem.score(plan[:k]) - first)
        yield Measurement(response.candidate, response.value, deviation, factor, ratio)


def _standard_errors(study: Study, estimate: Estimate, problem: Problem, plan: Sequence[int]) -> dict[str, float]:
    """Standard error of each parameter of a study [SI], after a plan."""
    scale = estimate.likelihood.scaled(estimate.unit)
    deviations = np.sqrt(np.diag(problem.covariance(plan))[: len(scale)]) * scale
    return dict(zip(study.space.names, deviations.tolist(), strict=False))


def _column(study: Study, name: str) -> int:
    """Place of a parameter among the free ones; `ConfigurationError` if there is none of this name."""
    names = study.space.names
    if name not in names:
        raise ConfigurationError(
            f"{name} is no free parameter of the study{nearest(name, names)}; free are {', '.join(names)}."
        )
    return names.index(name)
