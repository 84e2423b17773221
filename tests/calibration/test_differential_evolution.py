"""The whole search: against a slow twin, convergence, feasibility, failures, resumption."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError, StudyError
from commonrail.calibration.optimisers.base import Best, Optimiser
from commonrail.calibration.optimisers.evolution import (
    DifferentialEvolution,
    EvolutionSettings,
    InitialSampling,
    Treatment,
    draw,
)
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from tests.refused import refused

ORDER = [6, 1, 2, 4, 3, 0, 5]
Cost = Callable[[np.ndarray], np.ndarray]


def box(d: int, constraints: tuple[str, ...] = (), reach: float = 5.0) -> Space:
    return Space(
        [Parameter(f"a{i}", 0.0, -reach, reach, "1", mark="E", source="test") for i in range(d)],
        constraints,
    )


def sphere(x: np.ndarray) -> np.ndarray:
    return (x**2).sum(axis=-1)


def search(optimiser: Optimiser, cost: Cost, generations: int = 10**6) -> Best:
    while not optimiser.finished and generations > 0:
        optimiser.tell(cost(optimiser.ask().x))
        generations -= 1
    return optimiser.best


def naive_search(space: Space, cost: Cost, settings: EvolutionSettings, seed: int) -> np.ndarray:
    """Eq. (17) to (20) in SI, member by member; a trial outside the space leaves its parent."""
    rng = np.random.default_rng(seed)
    n, d = settings.members, space.dimension
    rnd = rng.random((n, d))
    population = [[space.lower[j] + rnd[i, j] * (space.upper[j] - space.lower[j]) for j in range(d)] for i in range(n)]
    costs = [float(cost(np.array(x))) if space.satisfies(np.array(x)) else np.inf for x in population]
    for _ in range(settings.generations):
        draws = draw(rng, np.arange(n), (n, d), settings.factor)
        following = []
        for i in range(n):
            r1, r2, r3 = draws.others[:, i]
            trial = list(population[i])
            for j in range(d):
                if draws.chance[i, j] <= settings.crossover or j == draws.forced[i]:
                    step = population[r2][j] - population[r3][j]
                    trial[j] = population[r1][j] + draws.factor[i, j] * step
            allowed = bool(space.satisfies(np.array(trial)))
            value = float(cost(np.array(trial))) if allowed else np.inf
            if allowed and value <= costs[i]:
                following.append(trial)
                costs[i] = value
            else:
                following.append(population[i])
        population = following
    return np.array(population)


@pytest.mark.parametrize("constraints", [(), ("a0 < a1 < a2",), ("a0 + 2*a1 <= 3", "a2 < a0")])
def test_the_search_is_the_papers_member_by_member(constraints: tuple[str, ...]) -> None:
    space = box(3, constraints)
    settings = EvolutionSettings(12, 25, treatment=Treatment.REJECT, initial=InitialSampling.UNIFORM)
    optimiser = DifferentialEvolution(space, np.random.default_rng(8), settings)
    search(optimiser, sphere)
    # The search moves in unit coordinates, the twin in SI: rounding of 25 generations.
    np.testing.assert_allclose(optimiser.population, naive_search(space, sphere, settings, 8), atol=1e-12)


def test_generations_and_slots_are_the_papers(paper_space) -> None:
    optimiser = DifferentialEvolution(paper_space(100.0), np.random.default_rng(0))
    asked = 0
    while not optimiser.finished:
        assert optimiser.reason == ""
        trials = optimiser.ask()
        asked += len(trials.x)
        optimiser.tell(sphere(trials.x))
    assert asked == optimiser.counts.slots == optimiser.settings.slots == 3550  # 50 x 71
    assert "70 generations" in optimiser.reason
    with refused(StudyError, "finished"):
        optimiser.ask()


def test_f_is_not_shared_within_a_member() -> None:
    """Without crossover a shared F would leave v - x_r1 parallel to x_r2 - x_r3."""
    space = box(4)
    settings = EvolutionSettings(8, 1, crossover=1.0, treatment=Treatment.REJECT)
    optimiser = DifferentialEvolution(space, np.random.default_rng(0), settings)
    first = optimiser.ask().x
    optimiser.tell(sphere(first))
    second = optimiser.ask().x
    ratios = []
    for i, trial in enumerate(second):
        triples = (
            (first[a], first[b], first[c])
            for a in range(8)
            for b in range(8)
            for c in range(8)
            if len({a, b, c, i}) == 4
        )
        for base, plus, minus in triples:
            ratio = (trial - base) / (plus - minus)
            if ((ratio >= 0.4 - 1e-9) & (ratio <= 1.0 + 1e-9)).all():
                ratios.append(ratio)
    assert len(ratios) >= 8
    assert all(np.ptp(ratio) > 1e-6 for ratio in ratios)


def test_converges_on_a_sphere() -> None:
    best = search(DifferentialEvolution(box(5), np.random.default_rng(1), EvolutionSettings(40, 150)), sphere)
    # From 25 at a typical start; 150 generations leave well below 1e-6.
    assert best.cost < 1e-6
    assert best.cost == sphere(best.x)


@pytest.mark.parametrize("treatment", list(Treatment))
def test_converges_on_a_valley_with_an_ordering_that_binds(treatment: Treatment) -> None:
    """Rosenbrock's valley with x0 > x1: the minimum (1, 1) is on the edge of the half plane."""

    def valley(x: np.ndarray) -> np.ndarray:
        return 100.0 * (x[..., 1] - x[..., 0] ** 2) ** 2 + (1.0 - x[..., 0]) ** 2

    space = box(2, ("a1 < a0 - 0.09",))
    settings = EvolutionSettings(30, 150, treatment=treatment)
    best = search(DifferentialEvolution(space, np.random.default_rng(3), settings), valley)
    assert best.x[1] < best.x[0] - 0.09
    # On the edge x1 = x0 - 0.09 the valley x1 = x0^2 is met where x0^2 - x0 + 0.09 = 0, at
    # x0 = 0.9 (to the first order of the small pull towards 1): J = 0.01 at most.
    assert best.cost <= 0.01
    np.testing.assert_allclose(best.x, [0.9, 0.81], atol=2e-3)


@pytest.mark.parametrize("treatment", list(Treatment))
@pytest.mark.parametrize("initial", list(InitialSampling))
@pytest.mark.parametrize("percent", [60.0, 100.0])
def test_best_keeps_ordering_and_bounds_in_every_generation(
    paper_space, optimal, treatment: Treatment, initial: InitialSampling, percent: float
) -> None:
    space = paper_space(percent, 150.0)
    settings = EvolutionSettings(20, 25, treatment=treatment, initial=initial)
    optimiser = DifferentialEvolution(space, np.random.default_rng(7), settings)
    while not optimiser.finished:
        trials = optimiser.ask()
        assert space.satisfies(trials.x[trials.simulate]).all()
        optimiser.tell(np.abs(trials.x / optimal - 1.0).sum(axis=1))
        best = optimiser.best.x
        assert (np.diff(best[ORDER]) > 0.0).all()
        assert ((best >= space.lower) & (best <= space.upper)).all()


def test_repair_simulates_every_slot_and_rejection_a_minority(paper_space, optimal) -> None:
    simulated = {}
    for treatment in (Treatment.REPAIR, Treatment.REJECT):
        optimiser = DifferentialEvolution(
            paper_space(100.0, 150.0),
            np.random.default_rng(2),
            EvolutionSettings(treatment=treatment),
        )
        search(optimiser, lambda x: np.abs(x / optimal - 1.0).sum(axis=1))
        simulated[treatment] = optimiser.counts.simulated
        assert optimiser.counts.slots == 3550
    assert simulated[Treatment.REPAIR] == 3550
    assert simulated[Treatment.REJECT] < 3550 / 2


def test_rules_reach_feasible_members_from_a_start_without_any(paper_space, optimal) -> None:
    settings = EvolutionSettings(treatment=Treatment.FEASIBILITY_RULES, initial=InitialSampling.UNIFORM)
    optimiser = DifferentialEvolution(paper_space(100.0, 150.0), np.random.default_rng(1), settings)
    assert not optimiser.ask().simulate.any()
    best = search(optimiser, lambda x: np.abs(x / optimal - 1.0).sum(axis=1))
    assert np.isfinite(best.cost)
    assert optimiser.space.satisfies(optimiser.population).all()


@pytest.mark.parametrize("failure", [np.nan, np.inf, -np.inf])
def test_failures_never_win_and_are_counted(failure: float) -> None:
    def cost(x: np.ndarray) -> np.ndarray:
        # Fails around the minimum of the sphere, where it would win if it were comparable.
        return np.where(x[:, 0] > 1.0, sphere(x), failure)

    optimiser = DifferentialEvolution(box(3), np.random.default_rng(5), EvolutionSettings(20, 40))
    failed = 0
    while not optimiser.finished:
        trials = optimiser.ask()
        told = cost(trials.x)
        failed += int((~np.isfinite(told)).sum())
        before = optimiser.costs
        optimiser.tell(told)
        assert not np.isnan(optimiser.costs).any()
        if len(before):
            assert (optimiser.costs <= before).all()
    assert optimiser.counts.failed == failed > 0
    assert optimiser.counts.simulated == optimiser.counts.slots
    assert optimiser.best.x[0] > 1.0
    assert optimiser.best.cost == pytest.approx(1.0, abs=0.05)


def test_costs_told_for_trials_not_simulated_are_ignored(paper_space) -> None:
    settings = EvolutionSettings(20, 5, treatment=Treatment.REJECT)
    optimiser = DifferentialEvolution(paper_space(100.0), np.random.default_rng(0), settings)
    assert optimiser.ask().simulate.all()
    optimiser.tell(np.full(20, 10.0))
    while not optimiser.finished:
        trials = optimiser.ask()
        optimiser.tell(np.where(trials.simulate, 20.0, -1.0))
    assert optimiser.best.cost == 10.0
    assert optimiser.counts.simulated < optimiser.counts.slots
    assert optimiser.counts.failed == 0


def test_until_a_simulation_succeeds_best_is_the_centre_at_infinite_cost() -> None:
    space = box(2, ("a0 < a1",))
    optimiser = DifferentialEvolution(space, np.random.default_rng(0), EvolutionSettings(6, 2))
    assert optimiser.population.shape == (0, 2)
    search(optimiser, lambda x: np.full(len(x), np.nan))
    assert optimiser.best.cost == np.inf
    assert space.satisfies(optimiser.best.x)
    assert optimiser.counts.failed == 18


def test_a_generation_is_updated_as_a_whole() -> None:
    optimiser = DifferentialEvolution(box(2), np.random.default_rng(0), EvolutionSettings(6, 3))
    first = optimiser.ask().x
    np.testing.assert_array_equal(optimiser.ask().x, first)  # the same until answered
    optimiser.tell(sphere(first))
    np.testing.assert_array_equal(optimiser.population, first)
    second = optimiser.ask().x
    np.testing.assert_array_equal(optimiser.population, first)
    optimiser.tell(sphere(second))
    better = sphere(second) <= sphere(first)
    np.testing.assert_array_equal(optimiser.population, np.where(better[:, None], second, first))


def reference_search(space: Space, initial: InitialSampling, seed: int = 3) -> DifferentialEvolution:
    return DifferentialEvolution(space, np.random.default_rng(seed), EvolutionSettings(12, 4, initial=initial))


def test_the_reference_is_a_member_of_the_first_population_if_asked_for(paper_space) -> None:
    space = paper_space(100.0)
    asked = reference_search(space, InitialSampling.REFERENCE).ask()
    # through unit coordinates and back: a rounding of each
    np.testing.assert_allclose(asked.x[0], space.reference, rtol=1e-14)
    assert asked.simulate.all()
    # the draws are those of a feasible start, so the two starts differ by one member alone
    np.testing.assert_array_equal(asked.x[1:], reference_search(space, InitialSampling.FEASIBLE).ask().x[1:])


def test_a_search_from_the_reference_is_never_worse_than_it(paper_space, optimal) -> None:
    def cost(x: np.ndarray) -> np.ndarray:
        return np.abs(x / optimal - 1.0).sum(axis=1)

    space = paper_space(100.0)
    optimiser = reference_search(space, InitialSampling.REFERENCE)
    optimiser.tell(cost(optimiser.ask().x))
    assert optimiser.best.cost <= cost(space.reference[None, :])[0] * (1.0 + 1e-12)


def test_a_reference_that_breaks_a_constraint_cannot_start() -> None:
    space = Space([Parameter(f"a{i}", 2.0 - i, 0.0, 4.0, "1", mark="E", source="test") for i in range(2)], ("a0 < a1",))
    with refused(ConfigurationError, "infeasible-start"):
        reference_search(space, InitialSampling.REFERENCE)
    reference_search(space, InitialSampling.FEASIBLE)


def test_a_state_belongs_to_its_way_to_start() -> None:
    state = reference_search(box(3), InitialSampling.REFERENCE).state()
    with pytest.raises(ConfigurationError, match="settings"):
        reference_search(box(3), InitialSampling.FEASIBLE).restore(state)


@pytest.mark.parametrize("treatment", list(Treatment))
@pytest.mark.parametrize("unanswered", [False, True])
def test_a_restored_search_goes_on_with_the_same_bits(
    paper_space, optimal, treatment: Treatment, unanswered: bool
) -> None:
    def cost(x: np.ndarray) -> np.ndarray:
        return np.abs(x / optimal - 1.0).sum(axis=1)

    def fresh(seed: int) -> DifferentialEvolution:
        settings = EvolutionSettings(15, 12, treatment=treatment)
        return DifferentialEvolution(paper_space(60.0), np.random.default_rng(seed), settings)

    whole, broken_off = fresh(1), fresh(1)
    search(whole, cost)
    search(broken_off, cost, generations=5)
    if unanswered:
        broken_off.ask()
    resumed = fresh(99)
    resumed.restore(pickle.loads(pickle.dumps(broken_off.state())))
    search(resumed, cost)
    np.testing.assert_array_equal(resumed.population, whole.population)
    np.testing.assert_array_equal(resumed.costs, whole.costs)
    assert resumed.counts == whole.counts
    assert resumed.state()["rng"] == whole.state()["rng"]


def test_a_state_saved_before_the_first_trials_is_restored() -> None:
    optimiser = DifferentialEvolution(box(3), np.random.default_rng(1), EvolutionSettings(6, 2))
    state = optimiser.state()
    first = optimiser.ask().x
    resumed = DifferentialEvolution(box(3), np.random.default_rng(2), EvolutionSettings(6, 2))
    resumed.restore(state)
    np.testing.assert_array_equal(resumed.ask().x, first)


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (
            lambda: DifferentialEvolution(box(3), np.random.default_rng(0), EvolutionSettings(7, 2)),
            "settings",
        ),
        (
            lambda: DifferentialEvolution(box(3, reach=4.0), np.random.default_rng(0), EvolutionSettings(6, 2)),
            "lower",
        ),
        (
            lambda: DifferentialEvolution(box(2), np.random.default_rng(0), EvolutionSettings(6, 2)),
            "names",
        ),
        (
            lambda: DifferentialEvolution(box(3), np.random.Generator(np.random.MT19937(0)), EvolutionSettings(6, 2)),
            "MT19937",
        ),
    ],
)
def test_a_state_of_another_search_is_refused(other: Any, why: str) -> None:
    state = DifferentialEvolution(box(3), np.random.default_rng(0), EvolutionSettings(6, 2)).state()
    with pytest.raises(ConfigurationError, match=why):
        other().restore(state)


def test_given_points_open_the_initial_population(paper_space, optimal) -> None:
    space = paper_space(100.0, 150.0)
    optimiser = DifferentialEvolution(space, np.random.default_rng(0), start=optimal)
    # Through unit coordinates and back: a rounding.
    np.testing.assert_allclose(optimiser.ask().x[0], optimal, rtol=1e-14)
    with refused(ConfigurationError, "infeasible-start"):
        DifferentialEvolution(space, np.random.default_rng(0), start=optimal[::-1])
    with refused(ConfigurationError, "wrong-shape"):
        DifferentialEvolution(space, np.random.default_rng(0), start=np.ones((2, 6)))


def test_costs_of_the_wrong_shape_or_unasked_are_refused() -> None:
    optimiser = DifferentialEvolution(box(2), np.random.default_rng(0), EvolutionSettings(6, 2))
    with refused(StudyError, "not-asked"):
        optimiser.tell(np.zeros(6))
    optimiser.ask()
    with refused(StudyError, "wrong-shape"):
        optimiser.tell(np.zeros(5))


@pytest.mark.parametrize(
    "changes",
    [
        {"members": 3},
        {"generations": -1},
        {"crossover": 1.1},
        {"crossover": float("nan")},
        {"factor": (0.0, 1.0)},
        {"factor": (1.0, 0.4)},
        {"factor": (0.4, 2.5)},
        {"redraws": 0},
    ],
)
def test_settings_out_of_range_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match=rf"\b{next(iter(changes))}\b"):
        EvolutionSettings(**changes)


def test_costs_fall_from_generation_to_generation() -> None:
    optimiser = DifferentialEvolution(box(4), np.random.default_rng(6), EvolutionSettings(16, 30))
    history = []
    while not optimiser.finished:
        optimiser.tell(sphere(optimiser.ask().x))
        history.append(optimiser.costs)
    assert all((late <= early).all() for early, late in pairwise(history))
    assert history[-1].min() < history[0].min() / 100.0


def test_trials_are_the_callers_to_change() -> None:
    untouched, changed = (DifferentialEvolution(box(3), np.random.default_rng(2)) for _ in range(2))
    for _ in range(3):
        trials = changed.ask()
        costs = sphere(trials.x)
        trials.x[:] = np.nan
        np.testing.assert_array_equal(changed.ask().x, untouched.ask().x)
        for optimiser in (untouched, changed):
            optimiser.tell(costs)
