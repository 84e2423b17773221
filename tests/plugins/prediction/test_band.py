"""Edges of bands against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm, t

from commonrail.plugins.prediction.band import _quantiles, band_from_draws

SLOPES = np.array([[1.0, 0.0], [1.0, 2.0]])
COVARIANCE = np.array([[0.04, -0.01], [-0.01, 0.09]])
DEVIATIONS = np.array([0.1, 0.3])
VALUES = np.array([5.0, 7.0])
PARAMETERS = np.array([0.04, 0.04 - 0.04 + 0.36])  # variances of SLOPES @ parameters


def test_bands_of_normal_draws_are_quantiles_of_parameters_and_scatter() -> None:
    rng = np.random.default_rng(1)
    draws = VALUES + rng.multivariate_normal([0.0, 0.0], COVARIANCE, 20_000) @ SLOPES.T
    draws[0] = np.nan  # a simulation that failed does not count
    for level, (low, high) in band_from_draws(draws, DEVIATIONS, np.inf, [0.5, 0.9]).items():
        half = norm.ppf(0.5 + 0.5 * level) * np.sqrt(PARAMETERS + DEVIATIONS**2)
        # quantiles of 20 000 draws scatter by 1 % of the half width
        np.testing.assert_allclose(high, VALUES + half, atol=0.04 * half.max())
        np.testing.assert_allclose(low, VALUES - half, atol=0.04 * half.max())


@pytest.mark.parametrize("freedom", [np.inf, 5.0])
def test_a_band_of_scatter_alone_is_that_of_its_law(freedom: float) -> None:
    """Normal scatters are equally likely ones: exact to the parts; those of an estimated scale are drawn."""
    found = band_from_draws(np.tile(VALUES, (4000, 1)), DEVIATIONS, freedom, [0.5, 0.9])
    for level, (low, high) in found.items():
        half = t.ppf(0.5 + 0.5 * level, freedom) * DEVIATIONS
        # 16 000 values: a quantile of 95 % is known to 0.02 deviations, of normal ones to a part
        tolerance = (0.06 if np.isfinite(freedom) else 1e-3) * DEVIATIONS.max()
        np.testing.assert_allclose(high, VALUES + half, atol=tolerance)
        np.testing.assert_allclose(low, VALUES - half, atol=tolerance)


@pytest.mark.parametrize("many", [1, 2, 7, 400])
@pytest.mark.parametrize("missing", [False, True])
def test_quantiles_are_those_of_numpy(many: int, missing: bool) -> None:
    rows = np.random.default_rng(many).standard_normal((5, many))
    if missing:
        rows[2, 1:] = np.nan
    shares = [0.05, 0.5, 0.95]
    np.testing.assert_allclose(_quantiles(rows, shares), np.nanquantile(rows, shares, axis=1), rtol=1e-14, atol=1e-15)


def test_draws_that_all_failed_have_no_band() -> None:
    ((low, high),) = band_from_draws(np.full((3, 2), np.nan), DEVIATIONS, np.inf, [0.9]).values()
    assert np.isnan([low, high]).all()


def test_draws_that_fail_at_one_operating_point_still_tell_of_the_others() -> None:
    random = np.random.default_rng(7)
    draws = random.normal(0.0, 1.0, (400, 3))
    whole = band_from_draws(draws, np.zeros(3), np.inf, [0.9])[0.9]
    draws[10:, 1] = np.nan  # most of them fail here,
    draws[:40, 2] = np.nan  # and a tenth there
    low, high = band_from_draws(draws, np.zeros(3), np.inf, [0.9])[0.9]
    assert (low[0], high[0]) == (whole[0][0], whole[1][0])
    assert np.isnan([low[1], high[1]]).all()
    assert (low[2], high[2]) == pytest.approx((-1.645, 1.645), abs=0.35)  # 360 draws: 3 standard errors of a quantile
