"""Draws from the posterior against closed forms of linear models, and their refusal where no regression follows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student
from scipy.stats import truncnorm

from commonrail.data.noise import Correlation, Law, Noise
from commonrail.plugins.certainty.draws import LARGEST_K, draw, smoothed
from commonrail.plugins.certainty.likelihood import Likelihood
from tests.plugins.certainty.linear import TRUTH, design, fitted, likelihood, space
from tests.plugins.certainty.test_estimate import Draw, autoregressive, curve, normal, outliers

WHITE = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE)
# Ends of a 95 % interval of 4000 draws, some of them with little weight: three standard errors of the quantile.
CHANCE = 0.08


def test_under_white_noise_of_unknown_scale_they_are_students_t() -> None:
    y, x = curve(normal, 1), design()
    _, draws = draw(fitted(likelihood([y], [x], [WHITE])))
    best, rest, *_ = np.linalg.lstsq(x, y, rcond=None)
    error = np.sqrt(rest[0] / 297 * np.diag(np.linalg.inv(x.T @ x)))
    half = student.ppf(0.975, 297) * error
    low, high = np.quantile(space().from_unit(draws.unit), [0.025, 0.975], axis=0)
    np.testing.assert_allclose((low - best) / half, -1.0, atol=CHANCE)
    np.testing.assert_allclose((high - best) / half, 1.0, atol=CHANCE)
    assert not draws.refusal
    assert draws.k_hat < LARGEST_K


def test_a_constraint_cuts_them() -> None:
    """b < a with b one standard error above a: the difference is a normal distribution cut at zero."""
    x = design()[:, :2]
    noise = Noise(correlation=Correlation.WHITE, sigma=0.2, law=Law.GAUSSIAN)
    y = x @ [2.0, 2.03] + 0.2 * np.random.default_rng(3).standard_normal(300)
    _, draws = draw(fitted(likelihood([y], [x], [noise], room=space(2, ["b < a"]))))
    best, inverse = np.linalg.lstsq(x, y, rcond=None)[0], 0.04 * np.linalg.inv(x.T @ x)
    mean, deviation = best[1] - best[0], float(np.sqrt([-1, 1] @ inverse @ [-1, 1]))
    differences = np.diff(space(2).from_unit(draws.unit), axis=1)[:, 0]
    assert differences.max() <= 1e-9
    expected = truncnorm.ppf([0.05, 0.5, 0.95], -np.inf, -mean / deviation, mean, deviation)
    np.testing.assert_allclose(np.quantile(differences, [0.05, 0.5, 0.95]), expected, atol=CHANCE * deviation)


def coverage(law: Draw, seeds: int) -> tuple[float, np.ndarray]:
    """Share of 95 % intervals that hold the truth, and half widths relative to the scatter of the points."""
    inside, points, half = [], [], []
    for seed in range(seeds):
        estimate, draws = draw(fitted(likelihood([curve(law, 100 + seed)], [design()])))
        low, high = np.quantile(space().from_unit(draws.unit), [0.025, 0.975], axis=0)
        inside.append((low <= TRUTH) & (high >= TRUTH))
        points.append(estimate.point)
        half.append(0.5 * (high - low))
    return float(np.mean(inside)), np.mean(half, axis=0) / (1.96 * np.std(points, axis=0))


def test_intervals_of_few_draws_cover_the_truth() -> None:
    """Of 18 intervals, which hold the truth in 95 % of cases, 15 or more do so with 99.8 %."""
    share, width = coverage(autoregressive, 6)
    assert share >= 15 / 18
    assert ((width > 0.5) & (width < 2.5)).all()  # the scatter of 6 points is known to 30 %


@pytest.mark.slow
@pytest.mark.parametrize("law", [normal, autoregressive, outliers])
def test_intervals_cover_the_truth(law: Draw) -> None:
    """Share of 95 % intervals that hold the truth: over 24 draws of three it scatters by 2.6 to 4.4 %."""
    share, width = coverage(law, 24)
    assert share >= 0.86
    assert ((width > 0.6) & (width < 1.6)).all()  # the scatter of 24 points is known to 15 %


def test_equal_seeds_give_equal_draws() -> None:
    found = fitted(likelihood([curve(normal, 4)], [design()], [WHITE]))
    (_, one), (_, same), (_, other) = (draw(found, seed) for seed in (1, 1, 2))
    assert one.unit.tobytes() == same.unit.tobytes()
    assert one.unit.tobytes() != other.unit.tobytes()


def test_a_model_that_no_polynomial_follows_is_refused() -> None:
    """Residuals that scatter anew from position to position: the simulated density is another one."""
    y, x = curve(normal, 5), design()
    own = likelihood([y], [x], [Noise(correlation=Correlation.WHITE, sigma=0.2, law=Law.GAUSSIAN)])

    waves = 1e4 * np.random.default_rng(6).standard_normal((3, 300))

    def rough(points: np.ndarray) -> np.ndarray:
        return np.asarray(points @ x.T - y + 0.4 * np.sin(points @ waves))

    _, draws = draw(fitted(Likelihood(own.space, own.blocks, rough)))
    assert draws.refusal


def test_weights_of_heavy_tails_are_told_by_k_hat() -> None:
    """Logarithms of Pareto weights with shape k: k-hat is near k (Vehtari et al. 2024)."""
    for k in (0.2, 0.5, 1.0):
        logs = k * np.random.default_rng(1).exponential(size=20_000)
        assert smoothed(logs)[1] == pytest.approx(k, abs=0.12)


def test_a_map_of_two_values_pins_nothing_by_meeting_them() -> None:
    """Two values and two parameters: without a noise of their own they would be met exactly, with no error left."""
    x = np.array([[1.0, 0.3], [0.2, 1.0]])
    _, draws = draw(fitted(likelihood([x @ [2.0, 3.0]], [x], room=space(2))))
    deviations = space(2).from_unit(draws.unit).std(axis=0)
    # one tolerance of each value: the bounds of 0.1 to 10 cut little of it
    np.testing.assert_allclose(deviations, np.sqrt(np.diag(np.linalg.inv(x.T @ x))), rtol=0.15)
