"""Outliers integrated out: against quadrature, where few values decide, profiles, and a search misled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.data.noise import Correlation, Law, Noise
from commonrail.plugins.certainty.covariance import Robust, second_moment
from commonrail.plugins.certainty.estimate import assimilated, estimate, library, starts_from
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.noise_fit import LAWS, scale_of
from commonrail.plugins.certainty.profile import profiles_of
from tests.plugins.certainty.linear import TRUTH, Floats, design, fitted, likelihood
from tests.plugins.certainty.test_estimate import curve, normal, outliers

STUDENT = LAWS[Law.STUDENT]


def robust_fit(errors: Floats, tangents: Floats) -> tuple[Floats, Robust]:
    """Most likely values (d,) of a linear model under Student's t with four degrees of freedom, and the block there."""
    d, n = tangents.shape
    at, scale = np.zeros(d), scale_of(Law.STUDENT, errors, n - d)
    for _ in range(60):
        weights = STUDENT.weight((errors + at @ tangents) / scale)
        at = np.linalg.solve((tangents * weights) @ tangents.T, -(tangents * weights) @ errors)
        scale = scale_of(Law.STUDENT, errors + at @ tangents, n - d)
    u = (errors + at @ tangents) / scale
    return at, Robust(u, tangents / scale, STUDENT.weight(u), float(d))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_second_moment_of_a_mean_is_that_of_quadrature(seed: int) -> None:
    """Posterior of mean, scale and freedom on a grid, flat in the mean and in the logarithms of the others."""
    errors = outliers(np.random.default_rng(seed), 40)
    at, block = robust_fit(errors, -np.ones((1, 40)))
    means = np.linspace(at[0] - 1.5, at[0] + 1.5, 121)
    scales, freedoms = np.exp(np.linspace(-1.2, 1.2, 41)), np.exp(np.linspace(0.0, np.log(30.0), 12))
    off = errors[:, None, None] - means[:, None]
    density = np.array([stats.t.logpdf(off, df=freedom, scale=scales).sum(axis=0) for freedom in freedoms])
    share = np.exp(density - density.max()).sum(axis=(0, 2))
    expected = float(np.sum(share * (means - at[0]) ** 2) / np.sum(share))
    # the draws know a variance to 4 %; scale and freedom are drawn at the most likely mean alone
    assert second_moment([block], np.zeros((1, 1)))[0, 0] == pytest.approx(expected, rel=0.12)


def test_an_outlier_among_the_values_that_decide_widens_the_interval() -> None:
    """The same errors in another order: a value of five deviations where six of 120 values decide, or elsewhere.

    The peak value holds 40 % of the information on the second parameter: without it the error is 1.29 times as large.
    """
    t = np.linspace(0.0, 1.0, 121)
    tangents = np.array([np.ones(121), np.exp(-(((t - 0.5) / 0.01) ** 2))])
    errors = np.random.default_rng(4).standard_normal(121)
    errors[[10, 30, 90, 110]] = 9.0, -7.0, 8.0, -6.0
    found = {}
    for place in (20, 60):
        own = errors.copy()
        own[[place, 60]] = 5.0, own[60] if place != 60 else 5.0
        _, block = robust_fit(own, tangents)
        found[place] = np.sqrt(second_moment([block], np.zeros((2, 2)))[1, 1])
    assert found[60] > 1.2 * found[20]


def test_normal_noise_is_left_to_the_curvature() -> None:
    found = fitted(likelihood([curve(normal, 1)], [design()]))
    assert (found.covariance.beyond == 1.0).all()
    assert found.covariance.freedom == pytest.approx(297.0, abs=0.1)


def test_a_parameter_that_nothing_holds_has_no_interval_among_outliers() -> None:
    x = design()
    x[:, 1] = 0.0
    found = fitted(likelihood([curve(outliers, 2)], [x]))
    assert np.isfinite(found.half_widths()).tolist() == [True, False, True]


@pytest.mark.parametrize("law", [Law.AUTO, Law.STUDENT])
@pytest.mark.parametrize("draw", [normal, outliers])
def test_exact_zeros_before_and_after_an_injection_are_no_sample_of_the_noise(
    law: Law, draw: Callable[[np.random.Generator, int], Floats]
) -> None:
    """1500 values that meter and model both state as zero change neither law nor intervals."""
    stated, y, x = [Noise(law=law, correlation=Correlation.WHITE)], curve(draw, 3), design()
    alone = fitted(likelihood([y], [x], stated))
    longer = fitted(likelihood([np.append(y, np.zeros(1500))], [np.vstack([x, np.zeros((1500, 3))])], stated))
    assert longer.likelihood.noises[0].law is alone.likelihood.noises[0].law
    # the draws know a standard error to 2 %
    np.testing.assert_allclose(longer.half_widths(), alone.half_widths(), rtol=0.06)


def widths_of(y: Floats, law: Law, sigma: float | None) -> Floats:
    """Half widths where the noise has a law and a standard deviation, or an estimated one."""
    stated = Noise(law=law, correlation=Correlation.WHITE, sigma=sigma)
    return fitted(likelihood([y], [design(len(y))], [stated])).half_widths()


def test_a_stated_sigma_is_not_estimated_beside_outliers() -> None:
    """Of 5, where the values scatter by 0.2: tails of any kind that has this deviation, and no smaller noise."""
    y = curve(outliers, 3)
    assert (widths_of(y, Law.STUDENT, 5.0) > 0.3 * widths_of(y, Law.GAUSSIAN, 5.0)).all()
    assert (widths_of(y, Law.STUDENT, 5.0) > 5.0 * widths_of(y, Law.STUDENT, None)).all()


@pytest.mark.parametrize("freedom", [4.0, 200.0])
def test_a_stated_sigma_is_the_standard_deviation_whatever_the_tails(freedom: float) -> None:
    """The intervals are those of an estimated scale, known to 3 %; taken as the scale they were 1.2 times as wide."""
    n = 1000
    errors = 0.2 * np.random.default_rng(8).standard_t(freedom, n)
    y, sigma = design(n) @ TRUTH + errors, 0.2 * np.sqrt(freedom / (freedom - 2.0))
    np.testing.assert_allclose(widths_of(y, Law.STUDENT, sigma), widths_of(y, Law.STUDENT, None), rtol=0.08)


@pytest.mark.parametrize("law", [Law.STUDENT, Law.LAPLACE])
def test_the_fitted_noise_keeps_the_stated_standard_deviation(law: Law) -> None:
    stated = Noise(law=law, correlation=Correlation.WHITE, sigma=0.5)
    noise = fitted(likelihood([curve(normal, 1)], [design()], [stated])).likelihood.noises[0]
    assert noise.sigma == pytest.approx(0.5)
    assert noise.scale == pytest.approx(0.5 / np.sqrt(2.0))  # of both laws


def test_a_sigma_of_few_degrees_of_freedom_lies_between_a_known_and_an_estimated_one() -> None:
    widths = []
    for sigma, freedom in ((None, np.inf), (1.0, 2.0), (1.0, 50.0), (1.0, np.inf)):
        stated = Noise(law=Law.STUDENT, correlation=Correlation.WHITE, sigma=sigma, freedom=freedom)
        widths.append(fitted(likelihood([curve(outliers, 3)], [design()], [stated])).half_widths()[0])
    assert widths == sorted(widths)
    assert widths[-1] > 1.5 * widths[1]


def test_values_that_the_fit_meets_exactly_give_no_interval() -> None:
    found = fitted(likelihood([curve(outliers, 1, 3)], [design(3)], [Noise(law=Law.STUDENT)]))
    assert np.isinf(found.half_widths()).all()


def test_a_flat_top_ends_no_profile_sooner() -> None:
    """Normal noise under Student's t: the curvature at the top is smaller than the law says of such values."""
    stated = Noise(law=Law.STUDENT, correlation=Correlation.WHITE)
    found = fitted(likelihood([curve(normal, 5)], [design()], [stated]))
    assert (found.covariance.beyond >= 1.0).all()


def test_profiles_under_outliers_are_as_wide_as_the_intervals() -> None:
    found = fitted(likelihood([curve(outliers, 3)], [design()], [Noise(correlation=Correlation.WHITE)]))
    assert found.likelihood.noises[0].law is Law.STUDENT
    low, high = found.interval()
    for i, profile in enumerate(profiles_of(found).found):
        # an end is found within 5 %, and the likelihood of Student's t is no parabola
        assert profile.high.value - profile.low.value == pytest.approx(high[i] - low[i], rel=0.08)


def test_a_profile_reaches_as_far_as_the_standard_error_lies_beyond_the_curvature() -> None:
    stated = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=0.2)
    found = fitted(likelihood([curve(normal, 1)], [design()], [stated]))
    wider = replace(found, covariance=found.covariance._replace(beyond=np.full(3, 1.5)))
    half = 0.5 * np.diff(found.interval(), axis=0)[0]
    for i, profile in enumerate(profiles_of(wider).found):
        # an end is found within 5 % of the wanted root, on a parabola
        assert profile.high.value == pytest.approx(found.point[i] + 1.5 * half[i], abs=0.09 * half[i])


def of_one_bump() -> Likelihood:
    """Likelihood of the place of a bump: at 3 by most values; least squares takes six outliers at 7 for it."""
    t = np.linspace(0.0, 10.0, 300)
    measured = np.exp(-(((t - 3.0) / 0.3) ** 2)) + 0.05 * np.random.default_rng(1).standard_normal(300)
    measured[206:218:2] += 6.0
    parameters = [Parameter("a", 5.0, 0.1, 10.0, "1", mark="E", source="test")]

    def residuals(points: Floats) -> Floats:
        return np.asarray(np.exp(-(((t - points) / 0.3) ** 2)) - measured)

    blocks = likelihood([measured], [design()], [Noise(correlation=Correlation.WHITE)]).blocks
    return Likelihood(Space(parameters), blocks, residuals)


def test_a_search_that_outliers_mislead_is_made_again_under_their_law() -> None:
    own = of_one_bump()
    starts = own.space.to_unit(np.array([[7.0], [2.8], [3.2], [7.2]]))
    assert estimate(own, starts[:1]).point[0] == pytest.approx(7.0, abs=0.2)
    assert estimate(own, starts).point[0] == pytest.approx(3.0, abs=0.02)


def test_ensembles_come_to_the_best_of_many_places() -> None:
    """Eight parameters, each with lesser places beside the right one: of 192 draws none is near the right ones."""
    names, right = "abcdefgh", np.linspace(2.0, 7.0, 8)
    room = Space([Parameter(name, 5.0, 0.0, 10.0, "1", mark="E", source="test") for name in names])

    def residuals(points: Floats) -> Floats:
        away = points - right
        return np.asarray(np.hstack([away + np.sin(4.0 * away), 0.5 * away]) + 0.01)

    def farthest(unit: Floats) -> Floats:
        return np.abs(room.from_unit(unit) - right).max(axis=1)

    block = likelihood([np.ones(16)], [np.ones((16, 1))], [Noise(correlation=Correlation.WHITE)]).blocks
    own = Likelihood(room, block, residuals)
    drawn = library(own, 192)
    starts = assimilated(own, drawn, 3)
    assert len(starts) == 3
    assert farthest(drawn[0]).min() > 2.0
    assert farthest(starts).max() < 0.3  # a quarter of the way to the next place, at 1.5


def test_starts_are_ranked_by_what_outliers_do_not_lead() -> None:
    """The bump and the outliers of the test above; by squares the best of a library lies at the outliers."""
    own = of_one_bump()
    unit = np.linspace(0.01, 0.99, 99)[:, None]
    errors = own.residuals(own.space.from_unit(unit))
    assert own.space.from_unit(unit[[int(np.argmin(np.sum(errors**2, axis=1)))]])[0, 0] == pytest.approx(7.0, abs=0.2)
    assert own.space.from_unit(starts_from(own, (unit, errors), 1))[0, 0] == pytest.approx(3.0, abs=0.2)
