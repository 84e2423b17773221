"""Choice of the next measurements: the plan that makes parameters or predictions most certain."""

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
from commonrail.plugins.next.problem import Response, build_problem, has_discrepancy, simulate_responses
from commonrail.plugins.next.settings import DesignSettings
from commonrail.plugins.next.study import (
    KINDS,
    MOST_CANDIDATES,
    Candidate,
    Problem,
    grid,
    list_fitted_kinds,
    locate,
    plan_data_sets,
    usual_axes,
)

# Measurements are added by gain per cost, then exchanged as long as an exchange improves the plan.

LEAST = 1e-9  # smallest decrease of the criterion that counts
MOST_EXCHANGES = 200
OTHER_STARTS = 8  # further plans, which begin with the second best measurement, the third best, and so on


class Rules(NamedTuple):
    """Limits of a plan."""

    costs: Floats  # (c,), of the candidates
    levels: IndexArray  # (c,), setting of the bench that each needs, such as a rail pressure
    level_cost: float  # of each level in a plan
    blocked: Bools  # (c, c), pairs of candidates that exclude each other; on the diagonal: no repetition
    most: int  # measurements
    budget: float = math.inf

    def cost(self, selection: Sequence[int]) -> float:
        """Cost of a plan."""
        which = list(selection)
        return float(np.sum(self.costs[which])) + self.level_cost * len(set(self.levels[which].tolist()))

    def added_cost(self, selection: Sequence[int]) -> Floats:
        """Cost (c,) that each candidate adds to a plan."""
        new = ~np.isin(self.levels, self.levels[list(selection)])
        return np.asarray(self.costs + self.level_cost * new)

    def admissible(self, selection: Sequence[int]) -> Bools:
        """Mask (c,) of the candidates that can be added to a plan."""
        fits = self.cost(selection) + self.added_cost(selection) <= self.budget * (1.0 + 1e-9)
        return np.asarray(fits & ~self.blocked[list(selection)].any(axis=0))


def too_close(places: Floats, others: Floats, least: Floats) -> Bools:
    """Mask (n, m) of pairs of places (n, q), (m, q) that are closer in every coordinate than `least` (q,)."""
    distances = np.abs(places[:, None] - others[None])
    return np.asarray((distances < least * (1.0 - 1e-9)).all(axis=-1))


def greedy(problem: Problem, rules: Rules, first: Sequence[int] = (), *, per_cost: bool = True) -> list[int]:
    """Extend `first` by the candidate that lowers the criterion most (per cost or in total), again and again."""
    selection = list(first)
    while len(selection) < rules.most:
        fall = problem.score(selection) - problem.scores(selection)
        worth = fall / rules.added_cost(selection) if per_cost else fall
        worth = np.where(rules.admissible(selection) & (fall > LEAST), worth, -np.inf)
        best = int(worth.argmax())
        if not np.isfinite(worth[best]):
            break
        selection.append(best)
    return selection


def exchange(problem: Problem, rules: Rules, selection: Sequence[int]) -> list[int]:
    """Exchange measurements of a plan, best exchange first, until no exchange improves it."""
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
    """Select the best plan, ordered by gain per cost.

    Greedy plans with and without regard to cost, and with other good first measurements, are improved by exchange.
    """
    worth = np.where(rules.admissible([]), -problem.scores([]), -np.inf)
    starts = [[int(i)] for i in np.argsort(-worth, kind="stable")[1 : 1 + OTHER_STARTS] if np.isfinite(worth[i])]
    plans = [greedy(problem, rules, per_cost=False), *(greedy(problem, rules, first) for first in ([], *starts))]
    return _order_by_gain(problem, rules, min((exchange(problem, rules, plan) for plan in plans), key=problem.score))


def _order_by_gain(problem: Problem, rules: Rules, plan: Sequence[int]) -> list[int]:
    """Order a plan so that each measurement is the best next one per cost."""
    left, ordered = list(plan), list[int]()
    while left:
        worth = (problem.score(ordered) - problem.scores(ordered)) / rules.added_cost(ordered)
        ordered.append(left.pop(int(np.argmax(worth[left]))))
    return ordered


TRUSTED = 5.0  # degrees of freedom from which an estimated noise scale is used
WORTH = 0.1  # least useful relative decrease of an error: the uncertainty of an error from 50 values
DRAWS, DRAWS_EACH = 100, 5  # draws at which candidates are simulated: least number, and number per parameter
MOST_TRIED = 16  # places at which other kinds of measurement are tried


class Measurement(NamedTuple):
    """Measurement of a plan."""

    candidate: Candidate
    value: float  # expected injected or returned quantity [m³], NaN if it could not be simulated
    deviation: float  # of this quantity before the plan [m³], without measurement noise; NaN for a curve
    factor: float  # typical standard deviation of the criterion after the plan up to here, over the one before the plan
    ratio: float  # the same for the standard error of the plan's `widest` parameter

    @property
    def place(self) -> tuple[float, float, float]:
        """Rail pressure [Pa], energising time [s] and dwell [s], as `locate`."""
        return locate(self.candidate.point)


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
        Number of candidates.
    before, after : mapping of str to float
        Standard error of each parameter [SI], without and with the plan.
    failed : int
        Failed simulations of candidates.
    notes : tuple of str
        Assumptions of the plan.
    widest : str
        Parameter with the largest standard error in proportion to its range, before the plan.
    alternatives : tuple of Measurement
        Best single measurement of each fitted kind that is not planned.
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
        """True if the plan lowers the criterion's standard deviation, or the widest interval, by `WORTH`."""
        return any(min(measurement.factor, measurement.ratio) <= 1.0 - WORTH for measurement in self.measurements[-1:])


def list_candidates(
    study: Study,
    costs: Mapping[str, float] = {},
    pressures: Floats | None = None,
    times: Floats | None = None,
    dwells: Sequence[float] = (),
    first_energising_time: float = 0.0,
) -> list[Candidate]:
    """List candidates of kinds, with their costs, on a grid; default: the first kind of `KINDS` that was fitted.

    Rail pressures [Pa] and energising times [s] cover the range of the data by default; dwells as in `grid`.
    """
    data = of_role(study.data, Role.FIT)
    usual_kind = list_fitted_kinds(data)[0]
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
    """Plan the measurements that make parameters or predictions most certain, with the noise of the present data.

    Parameters
    ----------
    study : Study
    best : mapping of str to float
        Values [SI], as `Calibration.best`.
    candidates : sequence of Candidate, optional
        Possible measurements; default: points within the range of the data.
    settings : DesignSettings, optional
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    note : function of str
        Called before long steps.

    Raises
    ------
    ConfigurationError
        If an argument has the wrong type, a name is unknown, or no candidate is allowed.
    SimulationError
        If the best values cannot be simulated.
    """
    instance(study, Study, "study")
    settings = settings or DesignSettings()
    threads = thread_count(threads)
    study.space.point(best)  # checked first: the default candidates need a range of the data
    names = settings.parameters or study.space.names
    columns = [_column(study, name) for name in names]
    all_candidates = list(list_candidates(study) if candidates is None else candidates)
    free = with_uncertain_free(study)
    data = in_order(free.data)
    _check(all_candidates, data)
    n = len(all_candidates)
    other_kinds = [kind for kind in list_fitted_kinds(data) if kind not in {item.kind for item in all_candidates}]
    stride = n // MOST_TRIED | 1  # odd, to reach all energising times of a grid
    all_candidates += [Candidate(kind, item.point) for kind in other_kinds for item in all_candidates[:n:stride]]
    note("fitting the noise of the data ...")
    certainty = certify(study, best, threads=threads, seed=settings.seed)
    estimate, draws = certainty.estimate, certainty.draws.unit
    noises, notes = _take_noise(estimate, data)
    many = min(max(DRAWS, DRAWS_EACH * draws.shape[1]), len(draws))
    unit = draws[np.random.default_rng(settings.seed).permutation(len(draws))[:many]]
    note(f"simulating {len(all_candidates)} candidates at {many} draws of the parameters ...")
    likelihood = estimate.likelihood.with_noises(noises)
    simulator = Simulator(free.injector, likelihood.names, study.time_step, threads, same_bits=study.same_bits)
    by_kind = {item.kind: noise for item, noise in reversed(list(zip(data, noises, strict=True)))}
    responses = simulate_responses(all_candidates, data, by_kind, simulator, likelihood.space.from_unit(unit), unit)
    problem = build_problem(
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
            "No candidate is within the budget and far enough from the measured points, or none adds information; "
            "state other rail pressures and energising times, or a smaller distance."
        )
    scale = likelihood.scaled(estimate.unit)
    before, after = (
        dict(
            zip(
                study.space.names,
                (np.sqrt(np.diag(problem.covariance(p))[: len(scale)]) * scale).tolist(),
                strict=False,
            )
        )
        for p in ([], plan)
    )
    widest = max(study.space.parameters, key=lambda item: before[item.name] / (item.upper - item.lower)).name
    column = study.space.names.index(widest)
    others, scores = list[Measurement](), np.where(np.isfinite(rules.costs), problem.scores([]), np.inf)
    for kind in other_kinds:
        best_one = min((i for i, item in enumerate(all_candidates) if item.kind == kind), key=scores.__getitem__)
        others += _measurements(problem, [best_one], responses, column) if np.isfinite(scores[best_one]) else []
    return MeasurementPlan(
        measurements=tuple(_measurements(problem, plan, responses, column)),
        cost=rules.cost(plan),
        settings=settings,
        candidates=n,
        before=before,
        after=after,
        failed=sum(response.failed for response in responses[:n]),
        notes=tuple(notes),
        widest=widest,
        alternatives=tuple(others),
    )


def _check(candidates: Sequence[Candidate], data: Sequence[DataSet]) -> None:
    if not 0 < len(candidates) <= MOST_CANDIDATES:
        raise ConfigurationError(f"There must be 1 to {MOST_CANDIDATES} candidates, not {len(candidates)}.")
    for candidate in candidates:
        if candidate.kind not in KINDS:
            hint = nearest(candidate.kind, KINDS)
            raise ConfigurationError(
                f'Unknown kind of measurement "{candidate.kind}"{hint}; take one of {join_words(KINDS)}.'
            )
        if not number(candidate.cost, "1", "cost of a candidate") > 0.0:
            raise ConfigurationError(f"The cost of a measurement must be greater than zero, not {candidate.cost:g}.")
    for kind in {candidate.kind for candidate in candidates}:
        plan_data_sets(kind, (), data)


def _take_noise(estimate: Estimate, data: Sequence[DataSet]) -> tuple[list[FittedNoise], list[str]]:
    """Noise of the data sets; at least one tolerance for a map with too few points for an estimate."""
    noises, notes = [], []
    for block, noise, data_set in zip(estimate.likelihood.blocks, estimate.likelihood.noises, data, strict=True):
        if isinstance(data_set, QuantityData) and not noise.stated and noise.freedom < TRUSTED:
            noise = FittedNoise(noise.law, max(noise.scale, 1.0 / noise.density.deviation), noise.freedom)
            notes.append(
                f"{data_set.name} has too few points to estimate its noise: at least one tolerance is assumed."
            )
        if not block.ordered and has_discrepancy(block):  # its components also act on planned points
            noise = replace(noise, courses=np.empty((0, 0)))
        noises.append(noise)
        if not has_discrepancy(block):
            notes.append(
                f"{data_set.name} states no correlated discrepancy: "
                "errors of new measurements are taken as independent."
            )
    return noises, notes


def _rules(candidates: Sequence[Candidate], data: Sequence[DataSet], settings: DesignSettings) -> Rules:
    places = np.array([locate(item.point) for item in candidates])
    least = np.array([settings.apart_pressure, settings.apart_time, settings.apart_time])
    kinds = np.array([item.kind for item in candidates])
    blocked = too_close(places, places, least) & (kinds[:, None] == kinds)
    taken = np.zeros(len(candidates), bool)
    for item in data:
        measured_places = np.array([locate(point) for point in item.points])
        taken |= too_close(places, measured_places, least).any(axis=1) & (kinds == item.kind)
    costs = np.where(taken, np.inf, np.array([item.cost for item in candidates]))
    _, levels = np.unique(places[:, 0], return_inverse=True)
    budget = 1e300 if settings.budget is None else settings.budget  # finite: a measured place has an infinite cost
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


def _column(study: Study, name: str) -> int:
    """Index of a free parameter; `ConfigurationError` for an unknown name."""
    names = study.space.names
    if name not in names:
        raise ConfigurationError(
            f"{name} is not a free parameter of the study{nearest(name, names)}; free are {', '.join(names)}."
        )
    return names.index(name)
