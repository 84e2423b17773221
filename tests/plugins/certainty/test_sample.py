"""Posterior against closed forms: a Gaussian, one cut by a bound, and one with an uncertain quantity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.errors import SimulationError
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.data.noise import Law, Noise
from commonrail.plugins.certainty.estimate import Estimate, estimate
from commonrail.plugins.certainty.posterior import Posterior, Surrogate, _agreement, sample_posterior
from tests.plugins.certainty.linear import TRUTH, design, fitted, likelihood

SIGMA = 0.5


def posterior(truth: np.ndarray = TRUTH, seed: int = 3, most: int = 100_000, sigma: float = SIGMA) -> Posterior:
    a = design(60)
    y = a @ truth + sigma * np.random.default_rng(1).standard_normal(60)
    noise = Noise(law=Law.GAUSSIAN, sigma=sigma, correlation="white")  # type: ignore[arg-type]
    return sample_posterior(fitted(likelihood([y], [a], [noise])), seed=seed, most=most)


@pytest.fixture(scope="module")
def found() -> Posterior:
    return posterior()


def test_draws_have_the_mean_and_covariance_of_the_closed_form(found: Posterior) -> None:
    a = design(60)
    y = a @ TRUTH + SIGMA * np.random.default_rng(1).standard_normal(60)
    covariance = SIGMA**2 * np.linalg.inv(a.T @ a)
    mean = covariance @ a.T @ y / SIGMA**2
    points, deviations = found.points(), np.sqrt(np.diag(covariance))
    assert found.converged
    # 4 standard errors of a mean of the effective number of draws; as much for a standard deviation (1/sqrt(2 n))
    off = np.abs(points.mean(axis=0) - mean) / deviations
    assert (off < 4.0 / np.sqrt(found.effective)).all()
    np.testing.assert_allclose(points.std(axis=0), deviations, rtol=4.0 / np.sqrt(2.0 * found.effective.min()))
    low, high = found.interval(0.9)
    np.testing.assert_allclose(high - low, 2.0 * 1.645 * deviations, rtol=0.12)


def test_a_bound_cuts_the_posterior(found: Posterior) -> None:
    """Most likely value near the bound 0.1: half of a normal distribution."""
    cut = posterior(np.array([0.1, 3.0, 5.0]))
    points = cut.points()
    assert points[:, 0].min() >= 0.1
    assert cut.interval()[0][0] < 0.15
    a = design(60)
    y = a @ np.array([0.1, 3.0, 5.0]) + SIGMA * np.random.default_rng(1).standard_normal(60)
    covariance = SIGMA**2 * np.linalg.inv(a.T @ a)
    rng = np.random.default_rng(0)
    draws = rng.multivariate_normal(covariance @ a.T @ y / SIGMA**2, covariance, 100_000)
    draws = draws[draws[:, 0] >= 0.1]
    near = 4.0 / np.sqrt(cut.effective.min())
    assert abs(points[:, 0].mean() - draws[:, 0].mean()) < near * draws[:, 0].std()


def test_equal_seeds_give_equal_draws(found: Posterior) -> None:
    again, other = posterior(), posterior(seed=4)
    np.testing.assert_array_equal(found.unit, again.unit)
    assert not np.array_equal(found.unit[:, :10], other.unit[:, :10])


def test_chains_that_are_too_short_are_refused() -> None:
    short = posterior(most=1)
    assert not short.converged
    with pytest.raises(SimulationError, match="cannot be used"):
        short.interval()


def ordered(sigma: float = SIGMA) -> Estimate:
    """Fit of seven stiffnesses in the paper's order, by data that ask for the reverse: it touches all constraints."""
    order = [7, 2, 3, 5, 4, 1, 6]
    parameters = [Parameter(f"k{i}", 4.0, 0.1, 10.0, "1", mark="E", source="test") for i in range(1, 8)]
    space = Space(parameters, [" < ".join(f"k{i}" for i in order)])
    rng = np.random.default_rng(2)
    a = rng.standard_normal((60, 7))
    y = a @ (8.0 - np.argsort(order)) + sigma * rng.standard_normal(60)
    noise = Noise(law=Law.GAUSSIAN, sigma=sigma, correlation="white")  # type: ignore[arg-type]
    own = likelihood([y], [a], [noise], room=space)
    return estimate(own, own.space.to_unit(own.space.centre)[None])


def test_chains_start_within_an_ordering_that_the_fit_touches() -> None:
    """Of independent draws about such a corner one in 5040 keeps the order."""
    fit = ordered()
    assert np.ptp(fit.point) < 1e-2 * fit.point.max()  # all seven are equal
    drawn = sample_posterior(fit, most=10_000)
    flat = drawn.unit.reshape(-1, 7)
    assert drawn.estimate.likelihood.space.satisfies(drawn.estimate.likelihood.space.from_unit(flat)).all()
    assert drawn.accepted > 0.02


def test_a_start_that_cannot_be_simulated_names_the_constraints() -> None:
    fit = ordered()

    def failing(points: np.ndarray) -> np.ndarray:
        return np.full((len(points), fit.likelihood.size), np.nan)

    broken = fit.likelihood.with_space(fit.likelihood.space, failing).with_noises(fit.likelihood.noises)
    with pytest.raises(SimulationError, match=r"k7 < k2.*480 of 480 simulations failed"):  # 16 walkers, 30 times
        sample_posterior(replace(fit, likelihood=broken), most=1000)


def test_starts_have_the_spread_that_is_asked_for() -> None:
    """Without feasible a filled ellipsoid has the covariance of the distribution, times the square of the factor."""
    covariance = np.array([[4e-4, 1e-4, 0.0], [1e-4, 1e-4, 0.0], [0.0, 0.0, 1e-6]])
    surrogate = Surrogate(np.array([0.5, 0.4, 0.6]), covariance)
    feasible = FeasibleSet.of(likelihood([np.zeros(60)], [design(60)]).space)
    drawn = surrogate.spread(feasible, 4000, np.random.RandomState(1), 1.5)
    # a variance of 4000 draws has a relative standard error of at most sqrt(2/4000) = 2.2 %
    np.testing.assert_allclose(np.diag(np.cov(drawn.T)), 2.25 * np.diag(covariance), rtol=0.09)
    np.testing.assert_allclose(drawn.mean(axis=0), surrogate.centre, atol=1.5e-3)


@pytest.mark.parametrize("apart", ["place", "spread", "no movement"])
def test_chains_that_disagree_are_refused(found: Posterior, apart: str) -> None:
    unit = np.random.default_rng(0).normal(0.5, 0.01, (6, 500, 3))
    assert replace(found, unit=unit, r_hat=_agreement(unit)[0], effective=_agreement(unit)[1]).converged
    if apart == "place":
        unit[0, :, 1] += 0.03
    elif apart == "spread":
        unit[0, :, 1] = 0.5 + 10.0 * (unit[0, :, 1] - 0.5)
    else:
        unit[:, :, 1] = 0.5
    r_hat, effective = _agreement(unit)
    assert "R-hat of b" in replace(found, unit=unit, r_hat=r_hat, effective=effective).refusal


def test_draws_of_the_first_parameters_leave_the_others_out(found: Posterior) -> None:
    y = design(60) @ TRUTH
    narrow = fitted(likelihood([y], [design(60)[:, :2]], [Noise(sigma=SIGMA)]))
    first = found.of_first(narrow)
    assert first.names == ("a", "b")
    np.testing.assert_array_equal(first.points(), found.points()[:, :2])
    assert (len(first.r_hat), len(first.effective), first.converged) == (2, 2, True)
