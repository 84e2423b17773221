"""Bands of a model that is linear in its parameters, where what they hold is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import t

from commonrail.calibration.parameter import Parameter, Prior
from commonrail.calibration.space import Space
from commonrail.data.base import DataSet, Role
from commonrail.data.noise import Correlation, Law, Noise
from commonrail.data.quantities.data import QuantityData
from commonrail.data.simulator import Simulator
from commonrail.engine.operating_point import OperatingPoint
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.prediction.band import Band
from commonrail.plugins.prediction.run import _Fit
from commonrail.plugins.prediction.scatter import LEAST, curve_scatter, left_out, scatter_of
from tests.plugins.certainty.linear import fitted, likelihood

PLAIN = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE)
MIDDLE = np.full(3, 50.0)
N, NEW = 14, 5


def space(sigma: float) -> Space:
    """Three parameters with priors of a standard deviation about the middle of wide bounds."""
    prior = Prior(50.0, sigma, "test")
    return Space([Parameter(n, 50.0, 1.0, 101.0, "1", mark="E", source="test", prior=prior) for n in "abc"])


def estimated(x: np.ndarray, y: np.ndarray, sigma: float = 1.0) -> Estimate:
    return fitted(likelihood([y], [x], [PLAIN], room=space(sigma)))


def quantities(values: np.ndarray, role: Role = Role.FIT) -> DataSet:
    """Map whose tolerance is one unit of the residuals."""
    points = tuple(OperatingPoint(80e6, 3e-4 + 1e-5 * i, 0.5e6, 0.1e6, horizon=4e-3) for i in range(len(values)))
    none = np.zeros(len(values), bool)
    return QuantityData(role.value, role, points, values, 1.0, 0.0, none, 1.0, "", "test")


def refitted(x: np.ndarray, y: np.ndarray, scale: float, sigma: float) -> np.ndarray:
    return np.asarray(
        np.linalg.solve(x.T @ x / scale**2 + np.eye(3) / sigma**2, x.T @ y / scale**2 + MIDDLE / sigma**2)
    )


def test_values_left_out_are_predicted_as_by_fits_without_them() -> None:
    rng = np.random.default_rng(3)
    x = rng.normal(size=(N, 3))
    y = x @ rng.normal(50.0, 1.0, 3) + 0.5 * rng.standard_normal(N)
    found = estimated(x, y)
    scale = found.likelihood.noises[0].scale
    expected = []
    for i in range(N):
        rest = np.arange(N) != i
        covariance = np.linalg.inv(x[rest].T @ x[rest] / scale**2 + np.eye(3))
        error = x[i] @ refitted(x[rest], y[rest], scale, 1.0) - y[i]
        expected.append(error / np.sqrt(scale**2 + x[i] @ covariance @ x[i]))
    judged = left_out(found, np.arange(N))
    # the search ends 1e-3 of 2 ln L below the top; derivatives of positions lose four digits
    np.testing.assert_allclose(judged.errors, expected, atol=2e-3)


def test_without_priors_the_degrees_of_freedom_are_those_of_the_residuals() -> None:
    rng = np.random.default_rng(4)
    x = rng.normal(size=(N, 3))
    judged = left_out(estimated(x, x @ MIDDLE + rng.standard_normal(N), sigma=1e6), np.arange(N))
    # tr(M)²/tr(M²) of a projection of rank n − d, each value by its own leverage
    assert judged.freedom == pytest.approx(N - 3, rel=0.1)


def smooth(rng: np.random.Generator, many: int, deviation: float) -> np.ndarray:
    """Discrepancy of a model at points spread over a unit interval, correlated over a third of it."""
    places = rng.random(many)
    covariance = np.exp(-4.5 * (places[:, None] - places) ** 2) + 1e-9 * np.eye(many)
    return np.asarray(deviation * np.linalg.cholesky(covariance) @ rng.standard_normal(many))


def covered(many: int, width: float = 1.0, discrepancy: float = 0.0) -> float:
    """Share of new values inside 90 % bands, where parameters vary about the middle as the priors say.

    Parameters
    ----------
    many : int
    width : float
        Of the variation, in standard deviations of the priors.
    discrepancy : float
        Standard deviation of what the model cannot do, beside noise of 0.5.
    """
    held = 0
    for seed in range(many):
        rng = np.random.default_rng(seed)
        x, new = rng.normal(size=(N, 3)), rng.normal(size=(NEW, 3))
        truth = MIDDLE + width * rng.standard_normal(3)
        off = smooth(rng, N + NEW, discrepancy) if discrepancy else np.zeros(N + NEW)
        found = estimated(x, x @ truth + off[:N] + 0.5 * rng.standard_normal(N))
        scatter = scatter_of(found, [quantities(np.zeros(N))])["quantities"]
        factor = scatter.calibration
        slopes = new * 100.0
        variance = np.einsum("ni,ij,nj->n", slopes, found.covariance.noise, slopes) + scatter.factor**2
        half = t.ppf(0.95, scatter.freedom) * factor * np.sqrt(variance)
        low, high = new @ found.point - half, new @ found.point + half
        seen = new @ truth + off[N:] + 0.5 * rng.standard_normal(NEW)
        held += int(np.count_nonzero((low <= seen) & (seen <= high)))
    return held / (many * NEW)


def test_bands_hold_their_share_of_new_values() -> None:
    # 1000 values, five to a fit: three binomial standard errors are 2.9 %
    assert covered(200) == pytest.approx(0.9, abs=0.03)


@pytest.mark.parametrize(("width", "discrepancy"), [(0.3, 0.0), (1.0, 0.75)])
def test_priors_that_are_too_wide_and_models_that_are_wrong_leave_it_so(width: float, discrepancy: float) -> None:
    """The values held out tell both: of 500 values, which are correlated, three standard errors are 5 %."""
    assert covered(100, width, discrepancy) == pytest.approx(0.9, abs=0.05)


@pytest.mark.parametrize(("law", "freedom"), [(Law.STUDENT, 4.0), (Law.LAPLACE, 3.0)])
def test_bands_of_a_law_with_tails_have_the_tails(law: Law, freedom: float) -> None:
    """Errors are weighted as the law asks, so that their mean square is of its scale and not of its outliers."""
    rng = np.random.default_rng(5)

    def draw(n: int) -> np.ndarray:
        return 0.5 * (rng.standard_t(4.0, n) if law is Law.STUDENT else rng.laplace(size=n))

    noise, held, many = Noise(law=law, correlation=Correlation.WHITE), 0, 60
    for _ in range(many):
        x = rng.normal(size=(20, 3))
        found = fitted(likelihood([x @ MIDDLE + draw(20)], [x], [noise], room=space(1.0)))
        scatter = scatter_of(found, [quantities(np.zeros(20))])["quantities"]
        assert (scatter.left_out, scatter.freedom) == (20, freedom)
        half = t.ppf(0.95, scatter.freedom) * scatter.calibration * scatter.factor
        held += int(np.count_nonzero(np.abs(draw(500)) <= half))
    # the share is known to 1 %; with quantiles of 17 degrees of freedom 83 and 81 % are held
    assert held / (500 * many) == pytest.approx(0.9, abs=0.03)


def test_few_values_are_not_left_out() -> None:
    x = np.random.default_rng(1).normal(size=(LEAST - 1, 3))
    found = estimated(x, x @ MIDDLE + np.linspace(-0.5, 0.5, LEAST - 1))
    scatter = scatter_of(found, [quantities(np.zeros(LEAST - 1))])["quantities"]
    assert (scatter.calibration, scatter.left_out) == (1.0, 0)


@pytest.mark.parametrize("many", [LEAST - 1, 200])
def test_residuals_beyond_a_stated_noise_count(many: int) -> None:
    """Means of repeated shots: their noise is known to be small, and a wave is not in the model."""
    place = np.arange(many) / many
    x = np.column_stack([np.ones(many), place, place**2])
    wave = 3.0 * np.cos(6.0 * np.pi * place)
    stated = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=0.1)
    found = fitted(likelihood([x @ MIDDLE + wave], [x], [stated], room=space(1e6)))
    scatter = scatter_of(found, [quantities(np.zeros(many))])["quantities"]
    assert (scatter.calibration, scatter.left_out) == (1.0, 0)
    assert scatter.factor == pytest.approx(np.sqrt(np.sum(found.errors**2) / (many - 3)), rel=1e-3)
    assert scatter.freedom == pytest.approx(many - 3, abs=1e-3)
    honest = fitted(likelihood([x @ MIDDLE + wave], [x], [Noise(law=Law.GAUSSIAN, sigma=5.0)], room=space(1e6)))
    assert scatter_of(honest, [quantities(np.zeros(many))])["quantities"].factor == 5.0


def test_values_that_agree_exactly_do_not_hide_residuals_beyond_a_stated_noise() -> None:
    """A wave that is not in the model, and three times as many values that are exactly zero in data and model."""
    place = np.arange(200) / 200
    x = np.column_stack([np.ones(200), place, place**2])
    y = x @ MIDDLE + 3.0 * np.cos(6.0 * np.pi * place)
    stated, levels = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=0.1), []
    for quiet in (0, 600):
        own, design = np.append(y, np.zeros(quiet)), np.vstack([x, np.zeros((quiet, 3))])
        found = fitted(likelihood([own], [design], [stated], room=space(1e6)))
        levels.append(scatter_of(found, [quantities(np.zeros(200 + quiet))])["quantities"].factor)
    assert levels[1] == pytest.approx(levels[0], rel=1e-3)


def band(values: Sequence[float], measured: Sequence[float], half: float, alone: float, **more: Any) -> Band:
    middle = np.array(values)
    edges = {0.9: (middle - half, middle + half)}
    return Band(quantities(np.array(measured)), middle, edges, True, {0.9: (middle - alone, middle + alone)}, **more)


def test_the_count_is_of_measured_values_inside() -> None:
    record = band([20.0] * 5, [20.0, 20.3, 19.6, 23.0, 15.0], 0.5, 0.1).judgement(0.9, "test")
    assert (record["covered"], record["values"], record["covered_by_parameters_alone"]) == (3, 5, 1)
    assert record["median_half_width_percent"] == pytest.approx(2.5)
    assert record["half_widths"] == pytest.approx([0.5] * 5)


def test_a_fitted_curve_scatters_as_it_does_itself_and_others_as_the_worst() -> None:
    """A stroke with noise of 0.6 beside a mean of many with 0.1; a curve that is not fitted may be either."""
    rng, x = np.random.default_rng(6), np.random.default_rng(7).normal(size=(300, 3))
    pair = [x @ MIDDLE + sigma * rng.standard_normal(300) for sigma in (0.6, 0.1)]
    found = fitted(likelihood(pair, [x, x], [PLAIN, PLAIN], room=space(1e6)))
    stroke, mean = (replace(quantities(np.zeros(300)), name=name) for name in ("stroke", "mean"))
    fit = _Fit(
        cast(Simulator, None),
        found,
        found.point[None],
        scatter_of(found, [stroke, mean]),
        curve_scatter(found, [stroke, mean]),
    )
    # a standard deviation of 300 values is known to 4 %
    assert fit.scatter_about(stroke).factor == pytest.approx(0.6, rel=0.12)
    assert fit.scatter_about(mean).factor == pytest.approx(0.1, rel=0.12)
    other = replace(quantities(np.zeros(300), Role.VALIDATION), name="mean")
    assert fit.scatter_about(other).factor >= fit.scatter_about(stroke).factor
