"""Discrepancy of the model that is estimated: one share of all values, so that no data set counts by its samples."""

from __future__ import annotations

import numpy as np

from commonrail.calibration.space import Space
from commonrail.data.noise import NOISE
from commonrail.plugins.certainty.estimate import estimate
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.noise_fit import Block
from tests.plugins.certainty.linear import space

Floats = np.ndarray
TIMES = np.linspace(0.0, 2e-3, 900)
POINTS = np.array([(t, p) for t in np.linspace(0.2e-3, 1.2e-3, 11) for p in np.linspace(20e6, 160e6, 8)])


def bench(missing: float, seed: int) -> tuple[Likelihood, Space]:
    """A curve of 900 samples and a map of 88 quantities, both in proportion to the only parameter.

    The curve has a bump that the model lacks, `missing` times its height, so that it asks for another value than the
    map does.
    """
    rng, room = np.random.default_rng(seed), space(1)
    shape = np.exp(-(((TIMES - 1e-3) / 0.4e-3) ** 4))
    curve = 2.0 * shape * (1.0 + missing) + 0.01 * rng.standard_normal(900)
    quantity = POINTS[:, 0] * 1e3 * np.sqrt(POINTS[:, 1] / 1e8)
    values = 2.0 * quantity * (1.0 + 0.005 * rng.standard_normal(88))
    places = [np.column_stack([TIMES, np.full(900, 1e8)]), POINTS]
    blocks = [
        Block("curve", slice(0, 900), NOISE, "1", True, -curve, np.ones(900), places[0]),
        Block("map", slice(900, 988), NOISE, "1", False, -values, np.ones(88), places[1]),
    ]
    both, target = np.concatenate([shape, quantity]), np.concatenate([curve, values])
    return Likelihood(room, blocks, lambda points: np.asarray(points * both - target)), room


def test_a_model_that_fits_has_none() -> None:
    for seed in range(5):
        own, room = bench(0.0, seed)
        found = estimate(own, room.to_unit(np.array([[3.0]])))
        assert max(noise.share for noise in found.likelihood.noises) == 0.0


def test_data_that_pull_apart_by_a_tenth_show_one_of_some_percent_and_share_the_error() -> None:
    own, room = bench(0.1, 1)
    found = estimate(own, room.to_unit(np.array([[3.0]])))
    assert 0.01 < found.likelihood.noises[0].share < 0.2
    # the curve asks for 2.2 and the map for 2.0: by numbers of samples the curve alone would have its way
    assert 1.98 < found.point[0] < 2.15
    error = float(np.sqrt(found.covariance.noise[0, 0]) * found.likelihood.scaled(found.unit)[0])
    assert 0.005 < error < 0.2  # without one it is 0.0005, by which neither value is within


def test_values_that_agree_exactly_show_neither_drift_nor_discrepancy() -> None:
    """Meters show zero before and after an injection, as the model does: such agreement is no sample."""
    shape = np.where(np.abs(TIMES - 1e-3) < 0.5e-3, 1.0, 0.0)
    for seed in range(6):
        rng = np.random.default_rng(40 + seed)
        curve = shape * (2.0 + 0.1 * rng.standard_normal(900))
        places = np.column_stack([TIMES, np.full(900, 1e8)])
        block = Block("curve", slice(0, 900), NOISE, "1", True, -curve, np.ones(900), places)
        own = Likelihood(space(1), [block], lambda points, y=curve: np.asarray(points * shape - y))  # type: ignore[misc]
        (noise,) = estimate(own, space(1).to_unit(np.array([[2.1]]))).likelihood.noises
        assert (noise.share, noise.drift) == (0.0, None)
        assert abs(noise.sigma - 0.1) < 0.02
