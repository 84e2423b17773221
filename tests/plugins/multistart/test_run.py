"""Multi-start least squares: curved valleys, constraints, the loss that it lowers, and its verdict on itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from commonrail.calibration.optimisers import least_squares
from commonrail.calibration.optimisers.base import AGREEING, Question, noise_of
from commonrail.calibration.optimisers.least_squares import DescentLoss, recognised
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.plugins.multistart import MultiStartLeastSquares, MultiStartSettings

Floats = np.ndarray
Residuals = Callable[[Floats], Floats]
T = np.linspace(0.0, 3.0, 60)
NOISE = 0.05 * np.random.default_rng(3).standard_normal(60)


def box(d: int, *constraints: str) -> Space:
    names = "abcdefg"[:d]
    return Space(
        [Parameter(n, 0.4 + 0.1 * i, 0.0, 1.0, "1", mark="E", source="test") for i, n in enumerate(names)], constraints
    )


def squares(residuals: Residuals) -> Callable[[Floats], Floats]:
    return lambda x: np.sum(residuals(x) ** 2, axis=1)


def searched(
    space: Space,
    residuals: Residuals,
    settings: MultiStartSettings,
    costs: Callable[[Floats], Floats] | None = None,
    seed: int = 1,
) -> MultiStartLeastSquares:
    """The search at its end."""
    search = MultiStartLeastSquares(space, np.random.default_rng(seed), settings)
    for _ in steps(search, residuals, costs or squares(residuals)):
        pass
    return search


def steps(search: MultiStartLeastSquares, residuals: Residuals, costs: Callable[[Floats], Floats]) -> Iterator[int]:
    while not search.finished:
        trials = search.ask()
        search.tell(residuals(trials.x) if trials.question is Question.RESIDUALS else costs(trials.x))
        yield search.steps


def decays(x: Floats) -> Floats:
    """Two decays whose rates are hard to tell apart: a curved valley with one minimum but for its mirror image."""
    rates = 0.5 + 4.0 * x[:, :2]
    truth = np.exp(-1.7 * T) + np.exp(-3.1 * T)
    return np.exp(-rates[:, :1] * T) + np.exp(-rates[:, 1:2] * T) - truth - NOISE


def test_starts_that_agree_end_the_search_before_its_iterations_are_used_up() -> None:
    space = box(2, "a < b")  # without its mirror image
    search = searched(space, decays, MultiStartSettings(32, 60, 6))
    verdict = search.verdict
    assert verdict is not None
    assert verdict.converged
    assert search.steps < 60
    assert verdict.sentence in search.reason
    # an independent search on a grid, finer and finer
    x, width = np.array([0.5, 0.5]), 0.5
    for _ in range(40):
        grid = x + width * np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 2), axis=-1).reshape(-1, 2)
        grid = np.clip(grid, 0.0, 1.0)
        grid = grid[grid[:, 0] <= grid[:, 1]]
        x, width = grid[np.argmin(squares(decays)(grid))], 0.7 * width
    noise = noise_of(search.best.cost, 60, 2, 1.0)
    assert search.best.cost - squares(decays)(x[None, :])[0] < 0.01 * noise  # the gain that the rule leaves


def test_a_minimum_on_an_ordering_is_found_there() -> None:
    def residuals(x: Floats) -> Floats:
        return np.hstack([x[:, :1] - 0.8, 2.0 * (x[:, 1:] - 0.3), np.full((len(x), 1), 0.1)])

    search = searched(box(2, "a < b"), residuals, MultiStartSettings(16, 30, 4))
    # along a = b: (a − 0.8)² + 4 (a − 0.3)² is least at a = (0.8 + 1.2)/5
    np.testing.assert_allclose(search.best.x, [0.4, 0.4], atol=1e-4)


def rippled(x: Floats) -> Floats:
    """A valley whose floor has a dip every twentieth of the range, in every parameter."""
    return np.hstack([x - 0.33, 0.3 * np.sin(2.0 * np.pi * 20.0 * x), np.full((len(x), 20), 0.02)])


def test_starts_that_disagree_are_doubled_once_and_then_it_says_so() -> None:
    search = searched(box(3), rippled, MultiStartSettings(64, 200, 4), seed=2)
    verdict = search.verdict
    assert verdict is not None
    assert verdict.figures["starts"] == 8
    assert not verdict.converged
    assert verdict.figures["agreeing"] < AGREEING
    assert verdict.sentence in search.reason


def test_iterations_that_do_not_suffice_are_no_convergence() -> None:
    search = searched(box(2, "a < b"), decays, MultiStartSettings(16, 2, 4))
    assert search.verdict is not None
    assert not search.verdict.converged
    assert search.verdict.figures["cut_short"]
    assert search.verdict.figures["running"] > 0
    assert search.reason != search.verdict.sentence  # it also says that the iterations are used up


def banana(x: Floats) -> Floats:
    """Rosenbrock's valley in a box, its minimum at (0.75, 0.75)."""
    a, b = 4.0 * x[:, :1] - 2.0, 4.0 * x[:, 1:] - 2.0
    return np.hstack([30.0 * (b - a**2), 1.0 - a, np.full((len(x), 4), 0.3)])


def test_a_bent_step_follows_a_curved_valley_in_fewer_iterations(monkeypatch: pytest.MonkeyPatch) -> None:
    def iterations() -> int:
        search = MultiStartLeastSquares(box(2), np.random.default_rng(5), MultiStartSettings(16, 100, 3))
        for done in steps(search, banana, squares(banana)):
            if search.best.cost < 0.361:
                return done
        return search.steps

    bent = iterations()
    monkeypatch.setattr(least_squares, "MOST_BENT", 0.0)  # no second difference is believed
    assert bent < iterations()


def test_the_loss_is_the_one_whose_sums_are_the_objective() -> None:
    residuals = np.random.default_rng(1).normal(size=(4, 30))
    assert recognised(np.sum(np.abs(residuals), axis=1), residuals) is DescentLoss.ABSOLUTE
    assert recognised(np.sum(residuals**2, axis=1), residuals) is DescentLoss.SQUARES
    assert recognised(np.sum(2.0 * (np.sqrt(1.0 + residuals**2) - 1.0), axis=1), residuals) is DescentLoss.SOFT
    # nearly all of it is of one loss
    assert recognised(np.sum(residuals**2, axis=1) + np.abs(residuals[:, 0]), residuals) is DescentLoss.SQUARES
    assert recognised(np.full(4, np.nan), residuals) is DescentLoss.SQUARES


@pytest.mark.parametrize("loss", list(DescentLoss))
def test_weights_give_the_slope_of_a_loss(loss: DescentLoss) -> None:
    r, width = np.linspace(-3.0, 3.0, 41), 1e-6
    slope = (loss.values(r + width, 0.3) - loss.values(r - width, 0.3)) / (2.0 * width)
    np.testing.assert_allclose(2.0 * loss.weights(r, 0.3) * r, slope, atol=1e-8)  # rounding over the width


def test_absolute_errors_are_lowered_as_such() -> None:
    """One outlier in eight moves the squares' minimum and hardly that of the absolute errors, their median."""
    data = np.array([0.30, 0.31, 0.29, 0.32, 0.28, 0.305, 0.295, 0.9])

    def residuals(x: Floats) -> Floats:
        return x[:, :1] - data

    search = searched(box(1), residuals, MultiStartSettings(16, 40, 4), lambda x: np.sum(np.abs(residuals(x)), axis=1))
    assert search.best.x[0] == pytest.approx(np.median(data), abs=0.01)  # smoothed over half of the mean error
    assert abs(np.mean(data) - np.median(data)) > 0.05


def two_valleys(x: Floats) -> Floats:
    """Residuals with minima near 0.2 and, a little higher, near 0.8."""
    return np.stack([20.0 * (x[:, 0] - 0.2) * (x[:, 0] - 0.8), 0.3 * x[:, 0], x[:, 1] - 0.5], axis=1)


def test_ends_are_the_optima_of_all_descents_the_best_first() -> None:
    settings = MultiStartSettings(40, 40, 4)
    search = searched(box(2), two_valleys, settings)
    ends = search.ends
    assert len(ends) == len(search.costs) >= 4
    assert ends[0].cost == search.best.cost
    assert [end.cost for end in ends] == sorted(end.cost for end in ends)
    # both valleys: 0.3 x draws their floors towards 0 by less than 0.01
    assert {round(float(end.x[0]), 1) for end in ends} == {0.2, 0.8}
    for end in ends:
        assert end.cost == pytest.approx(float(squares(two_valleys)(end.x[None, :])[0]), rel=1e-12)
