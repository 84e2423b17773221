"""Staged least squares: steps against an independent solver, cliffs, and what screening asks for."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.optimisers import staged
from commonrail.calibration.optimisers.base import Question
from commonrail.calibration.optimisers.staged import StagedLeastSquares, StagedSettings, capped
from commonrail.calibration.parameter import Parameter, Prior
from commonrail.calibration.space import Space

Floats = np.ndarray


def unit_box(d: int, prior: Prior | None = None) -> Space:
    return Space([Parameter(f"p{i}", 0.8, 0.0, 1.0, "1", mark="E", source="test", prior=prior) for i in range(d)])


def rippled(x: Floats) -> Floats:
    """Residuals of a valley whose floor has steps of 1/200 of the range, as bounces make them."""
    y = x + 0.004 * np.floor(200.0 * x) / 2.0 - 0.002 * 200.0 * x / 2.0
    return np.hstack([3.0 * (y[:, :1] - 0.31), 2.0 * (y[:, 1:] + 0.5 * y[:, :1] - 0.62)])


def descend() -> float:
    """Sum of squares at the end of a descent through all stages."""
    settings = StagedSettings(members=4, generations=25, starts=1, trial_iterations=0)
    search = StagedLeastSquares(unit_box(2), np.random.default_rng(2), settings)
    while not (search.finished or search.state()["hopping"]):
        trials = search.ask()
        values = rippled(trials.x)
        costs = trials.question in (Question.COSTS, Question.COSTS_AGAIN)
        search.tell(np.sum(values**2, axis=1) if costs else values)
    return search.ends[0].cost


def test_stages_end_lower_on_a_floor_with_steps_than_the_finest_difference_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # the finest difference lies within one step of the floor, whose slope there is not that of the valley
    by_stages = descend()
    monkeypatch.setattr(staged, "DIFFERENCES", (staged.DIFFERENCES[-1],) * len(staged.DIFFERENCES))
    assert by_stages < 0.5 * descend()


def test_one_point_far_off_costs_no_more_than_the_cap() -> None:
    residuals = np.array([[3.0, 1e6], [3.0, 4.0], [np.nan, 0.0]])
    assert capped(12.0, residuals).tolist() == [9.0 + 144.0, 25.0, np.inf]


def test_screening_comes_first_then_residuals_of_the_starts() -> None:
    space = unit_box(2, Prior(0.7, 0.1))
    search = StagedLeastSquares(space, np.random.default_rng(1), StagedSettings(members=40, generations=3))
    screened = search.ask()
    assert (screened.question, len(screened.x)) == (Question.SCREENED, 40)
    search.tell(screened.x - 0.4)
    starts = search.ask()
    assert (starts.question, len(starts.x)) == (Question.RESIDUALS, 3)
    best = np.sort(np.sum((screened.x - 0.4) ** 2, axis=1))[:3]
    assert np.sum((starts.x - 0.4) ** 2, axis=1) == pytest.approx(best)


@pytest.mark.parametrize(("first", "second"), [(("starts", 9), ("members", 8)), (("finalists", 3), ("starts", 2))])
def test_more_than_there_are_to_choose_from_are_refused(first: tuple[str, int], second: tuple[str, int]) -> None:
    with pytest.raises(ConfigurationError, match=f"{first[0]} = {first[1]} .*{second[0]} = {second[1]}"):
        StagedSettings(**dict((first, second)))


def finished(settings: StagedSettings, is_sound: bool) -> StagedLeastSquares:
    """A search on the rippled valley, of which no candidate can be simulated unless `is_sound`."""
    search = StagedLeastSquares(unit_box(2), np.random.default_rng(3), settings)
    while not search.finished:
        trials = search.ask()
        values = rippled(trials.x) if is_sound else np.full((len(trials.x), 2), np.nan)
        costs = trials.question in (Question.COSTS, Question.COSTS_AGAIN)
        search.tell(np.sum(values**2, axis=1) if costs else values)
    return search


def test_ensembles_lead_to_the_floor_of_the_valley() -> None:
    """After the screening, ten steps, and one in which descents begin from what the ensembles found."""
    settings = StagedSettings(members=60, generations=11, inversions=10, starts=2)
    assert finished(settings, True).best.cost < 1e-3 * finished(StagedSettings(60, 0, starts=2), True).best.cost


def test_ensembles_of_which_nothing_can_be_simulated_end_the_search_without_a_fault() -> None:
    assert finished(StagedSettings(members=40, generations=6, inversions=3), False).best.cost == np.inf


def test_ensembles_that_nothing_follows_are_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"inversions = 9 .*generations = 9"):
        staged.REGISTERED.checks["inversions"](StagedSettings(generations=9, inversions=9), unit_box(2))


def two_valleys(x: Floats) -> Floats:
    """Residuals with minima near 0.2 and, a little higher, near 0.8."""
    return np.stack([20.0 * (x[:, 0] - 0.2) * (x[:, 0] - 0.8), 0.3 * x[:, 0], x[:, 1] - 0.5], axis=1)


def test_ends_are_the_optima_of_the_first_descents_and_survive_hops_and_a_restart() -> None:
    settings = StagedSettings(members=40, generations=40, starts=8, trial_iterations=0, stage_iterations=6)
    search = StagedLeastSquares(unit_box(2), np.random.default_rng(1), settings)
    many = []
    while not search.finished:
        trials = search.ask()
        values = two_valleys(trials.x)
        wants_costs = trials.question in (Question.COSTS, Question.COSTS_AGAIN)
        search.tell(np.sum(values**2, axis=1) if wants_costs else values)
        many.append(len(search.population))
    assert (max(many), many[-1]) == (8, 1)  # the descents were followed by hops
    ends = search.ends
    assert len(ends) == 8
    assert ends[0].cost == search.best.cost
    assert [end.cost for end in ends] == sorted(end.cost for end in ends)
    # both valleys: 0.3 x draws their floors towards 0 by less than 0.01
    assert {round(float(end.x[0]), 1) for end in ends} == {0.2, 0.8}
    again = StagedLeastSquares(unit_box(2), np.random.default_rng(9), settings)
    again.restore(search.state())
    assert [end.cost for end in again.ends] == [end.cost for end in ends]
