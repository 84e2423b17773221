"""Laws of noise and autoregressions against SciPy's densities and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from commonrail.data.noise import Law
from commonrail.plugins.certainty.noise_fit import (
    FREEDOM,
    LAWS,
    Autoregression,
    as_normal,
    count_exact,
    fit_autoregression,
    sample_count,
    scale_of,
)

U = np.linspace(-6.0, 6.0, 25)


@pytest.mark.parametrize(("law", "density"), [(Law.GAUSSIAN, stats.norm), (Law.STUDENT, stats.t(FREEDOM))])
def test_cost_and_constant_are_those_of_the_density(law: Law, density: stats.rv_continuous) -> None:
    own = LAWS[law]
    np.testing.assert_allclose(own.cost(U) + own.constant, -2.0 * density.logpdf(U), rtol=1e-12)


def test_the_laplace_law_is_rounded_at_its_corner_alone() -> None:
    own, exact = LAWS[Law.LAPLACE], -2.0 * stats.laplace.logpdf(U)
    np.testing.assert_allclose(own.cost(U) + own.constant, exact, atol=0.4)  # twice the rounding
    np.testing.assert_allclose(own.weight(U[[0, -1]]) * np.abs(U[[0, -1]]), 1.0, rtol=1e-3)


@pytest.mark.parametrize(
    ("law", "density"), [(Law.GAUSSIAN, stats.norm), (Law.STUDENT, stats.t(FREEDOM)), (Law.LAPLACE, stats.laplace)]
)
def test_deviation_and_tail_are_those_of_the_density(law: Law, density: stats.rv_continuous) -> None:
    assert LAWS[law].deviation == pytest.approx(density.std())
    np.testing.assert_allclose([LAWS[law].tail(u) for u in (0.0, 1.0, 5.0)], density.sf([0.0, 1.0, 5.0]), rtol=1e-9)
    np.testing.assert_allclose(as_normal(law, U), np.abs(stats.norm.ppf(density.sf(np.abs(U)))), atol=1e-9)


def test_values_that_agree_exactly_are_no_samples() -> None:
    errors = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 2.0, 1.0, 0.0]])
    assert [sample_count(errors), sample_count(errors[0]), count_exact(errors)] == [2, 1, 2]
    assert sample_count(np.zeros(5)) == 5  # nothing is known of the noise


@pytest.mark.parametrize("law", LAWS)
def test_weight_and_slope_are_the_derivatives_of_the_cost(law: Law) -> None:
    own, h = LAWS[law], 1e-5
    psi = (own.cost(U + h) - own.cost(U - h)) / (4.0 * h)
    np.testing.assert_allclose(own.weight(U) * U, psi, atol=1e-9)
    slope = ((U + h) * own.weight(U + h) - (U - h) * own.weight(U - h)) / (2.0 * h)
    np.testing.assert_allclose(own.slope(U), slope, atol=1e-8)


def test_the_mean_slope_of_the_laplace_law_is_twice_the_density_at_zero() -> None:
    u = np.random.default_rng(1).standard_normal(100_000)
    mean = LAWS[Law.LAPLACE].slope(u).mean()
    assert mean == pytest.approx(2.0 * stats.norm.pdf(0.0), rel=0.05)  # the kernel is 0.2 wide


@pytest.mark.parametrize(("law", "expected"), [(Law.GAUSSIAN, 1.0), (Law.LAPLACE, np.sqrt(2 / np.pi))])
def test_the_scale_of_normal_errors(law: Law, expected: float) -> None:
    errors = np.random.default_rng(2).standard_normal(100_000)
    assert scale_of(law, errors, len(errors)) == pytest.approx(expected, rel=0.03)


def test_whitening_is_the_inverse_root_of_the_covariance() -> None:
    own = Autoregression(np.array([0.8, -0.3, 0.1]))
    n = 12
    whitener = own.whiten(np.eye(n)).T
    covariance = np.linalg.inv(whitener.T @ whitener)
    # of a stationary process: every diagonal is constant
    for lag in range(n):
        np.testing.assert_allclose(np.diag(covariance, lag), covariance[0, lag], rtol=1e-9)
    assert covariance[0, 1] / covariance[0, 0] == pytest.approx(0.8)
    assert 1.0 / np.sqrt(covariance[0, 0]) == pytest.approx(own.innovation_share)


def test_an_autoregression_is_recovered_and_white_noise_is_left_white() -> None:
    rng = np.random.default_rng(3)
    e = rng.standard_normal(20_000)
    x = np.zeros_like(e)
    for i in range(2, len(e)):
        x[i] = 1.2 * x[i - 1] - 0.5 * x[i - 2] + e[i]
    found = fit_autoregression(x[None])
    np.testing.assert_allclose(found.predictors[-1][:2], [1.2, -0.5], atol=0.03)
    assert found.whiten(x).std() == pytest.approx(1.0, rel=0.02)
    assert np.abs(fit_autoregression(e[None]).reflections).max(initial=0.0) < 0.03
