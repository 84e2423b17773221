"""Local intervals against closed forms of linear models, and their coverage over noise of several laws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import t as student

from commonrail.data.noise import Correlation, Law, Noise
from commonrail.plugins.certainty.lack_of_fit import lack_of_fit
from tests.plugins.certainty.linear import TRUTH, Floats, design, fitted, interval, likelihood, space

WHITE = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE)
Draw = Callable[[np.random.Generator, int], Floats]


def normal(rng: np.random.Generator, n: int) -> Floats:
    return rng.standard_normal(n)


def autoregressive(rng: np.random.Generator, n: int) -> Floats:
    found = rng.standard_normal(n)
    for i in range(1, n):
        found[i] = 0.9 * found[i - 1] + np.sqrt(0.19) * found[i]
    return found


def outliers(rng: np.random.Generator, n: int) -> Floats:
    return rng.standard_normal(n) * np.where(rng.random(n) < 0.1, 8.0, 1.0)


def curve(draw: Draw, seed: int, n: int = 300) -> Floats:
    return np.asarray(design(n) @ TRUTH + 0.2 * draw(np.random.default_rng(seed), n))


def test_white_noise_gives_the_interval_of_least_squares() -> None:
    y, x = curve(normal, 1), design()
    found = fitted(likelihood([y], [x], [WHITE]))
    best, rest, *_ = np.linalg.lstsq(x, y, rcond=None)
    error = np.sqrt(rest[0] / 297 * np.diag(np.linalg.inv(x.T @ x)))
    low, high = interval(found)
    assert (np.abs(found.point - best) < 0.04 * error).all()  # the search ends 1e-3 of 2 ln L below the top
    np.testing.assert_allclose(high - low, 2 * student.ppf(0.975, 297) * error, rtol=1e-4)


def test_a_stated_sigma_is_taken_and_the_quantile_is_the_normal_one() -> None:
    x = design()
    found = fitted(likelihood([curve(normal, 2)], [x], [Noise(correlation=Correlation.WHITE, sigma=0.5)]))
    error = 0.5 * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))
    low, high = interval(found)
    np.testing.assert_allclose(high - low, 2 * 1.959964 * error, rtol=1e-6)


def test_a_sigma_of_few_repeats_widens_the_intervals_until_they_cover() -> None:
    """Share of intervals that hold the truth, σ from three repeats: 95 % with t of two degrees of freedom, else 81 %.

    Over 150 draws of independent scales the share scatters by 1.8 % to 3.2 %.
    """
    x, rng, inside, sizes = design(60), np.random.default_rng(12), [], []
    for seed in range(150):
        sigma = 0.2 * float(np.sqrt(rng.chisquare(2.0) / 2.0))
        noise = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=sigma, freedom=2.0)
        found = fitted(likelihood([curve(normal, 500 + seed, 60)], [x], [noise]))
        low, high = interval(found)
        inside.append((low <= TRUTH) & (high >= TRUTH))
        sizes.append(lack_of_fit(found, 3)[0].size)
    assert 0.90 <= np.mean(inside) <= 0.99
    # the test of the residuals' size knows that σ is uncertain: its probabilities are uniform
    assert np.mean(np.array(sizes, float) < 0.1) == pytest.approx(0.1, abs=0.075)  # three standard errors


@pytest.mark.parametrize("draw", [normal, autoregressive, outliers])
def test_intervals_cover_the_truth(draw: Draw) -> None:
    """Share of intervals that hold the truth: over 100 draws it scatters by 1.3 to 2.2 %."""
    x, inside, points, half = design(), [], [], []
    for seed in range(100):
        found = fitted(likelihood([curve(draw, 100 + seed)], [x]))
        low, high = interval(found)
        inside.append((low <= TRUTH) & (high >= TRUTH))
        points.append(found.point)
        half.append(0.5 * (high - low))
    assert 0.91 <= np.mean(inside) <= 0.99
    assert (np.mean(inside, axis=0) >= 0.88).all()
    width = np.mean(half, axis=0) / (1.96 * np.std(points, axis=0))
    assert ((width > 0.83) & (width < 1.25)).all()  # the scatter of 100 points is known to 7 %


def test_blocks_of_other_units_have_their_own_scale() -> None:
    rng, small = np.random.default_rng(5), design(12)
    noisy = small @ TRUTH + 1e-3 * rng.standard_normal(12)
    found = fitted(likelihood([curve(normal, 3), noisy], [design(), small]))
    assert found.likelihood.noises[0].scale == pytest.approx(0.2, rel=0.15)
    assert found.likelihood.noises[1].scale == pytest.approx(1e-3, rel=0.5)
    assert found.covariance.used.sum() == pytest.approx(3.0)
    assert (found.covariance.freedom < 15).all()  # the map of 12 values decides, and it has few


def test_a_discrepancy_of_one_length_is_that_of_generalised_least_squares() -> None:
    x, n = design(60), 60
    noise = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=0.2, discrepancy=0.1, length=0.2)
    found = fitted(likelihood([curve(normal, 6, n)], [x], [noise]))
    t = np.linspace(0.0, 1.0, n)
    k = 0.01 * np.exp(-0.5 * ((t[:, None] - t) / 0.2) ** 2)
    expected = np.linalg.inv(x.T @ np.linalg.solve(0.04 * np.eye(n) + k, x)) / 9.9**2
    # bumps a length apart add up to a variance that is even to 1.4 %
    np.testing.assert_allclose(np.diag(found.covariance.noise), np.diag(expected), rtol=0.03)


def test_a_white_discrepancy_has_more_degrees_of_freedom_than_the_noise_beside_it() -> None:
    """Of σ² from three repeats and δ² that is stated: (σ² + δ²)²/(σ⁴/3), by Satterthwaite."""
    noise = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=0.2, freedom=3.0, discrepancy=0.4)
    found = fitted(likelihood([curve(normal, 6, 60)], [design(60)], [noise]))
    assert found.likelihood.noises[0].scale == pytest.approx(np.hypot(0.2, 0.4))
    assert found.likelihood.noises[0].freedom == pytest.approx(3.0 * 5.0**2)


def test_a_parameter_that_nothing_holds_has_no_interval() -> None:
    x = design()
    x[:, 2] = 0.0
    found = fitted(likelihood([curve(normal, 7)], [x], [WHITE]))
    assert np.isinf(found.half_widths()[2])
    assert np.isfinite(found.half_widths()[:2]).all()


def test_an_active_ordering_is_kept_and_the_interval_is_not_cut() -> None:
    x = design()
    y = x @ [2.0, 2.005, 5.0] + 0.2 * np.random.default_rng(9).standard_normal(300)
    free, held = (fitted(likelihood([y], [x], [WHITE], room=space(constraints=c))) for c in ([], ["b < a"]))
    assert held.point[0] == pytest.approx(held.point[1], rel=1e-6)
    np.testing.assert_allclose(held.half_widths(), free.half_widths(), rtol=0.1)  # s² is larger there


def test_several_starts_that_agree_settle_a_search() -> None:
    found = fitted(likelihood([curve(normal, 11)], [design()]), starts=4)
    assert (found.starts, found.agreeing, found.settled) == (4, 4, True)
