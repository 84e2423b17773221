"""Curvature against the simulated likelihood, on models whose intervals are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.analysis.certainty.lack_of_fit import lack_of_fit
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.certainty.ripple import MOST_RATIO, ripple_of
from commonrail.kinds.noise import Correlation, Law, Noise
from tests.analysis.certainty.linear import TRUTH, Floats, N, design, fitted, likelihood

STATED = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=0.2)


def curve(seed: int) -> Floats:
    return np.asarray(design() @ TRUTH + 0.2 * np.random.default_rng(seed).standard_normal(N))


def test_a_linear_model_falls_as_its_curvature_promises() -> None:
    found = ripple_of(fitted(likelihood([curve(1)], [design()], [STATED])))
    np.testing.assert_allclose(found.ratios, 1.0, rtol=0.02)  # the search ends within 0.01 of 2 ln L
    assert not found.rippled.any()
    assert found.simulated == 4 * 3


def test_a_staircase_is_rippled() -> None:
    """Derivatives within a step of the staircase say nothing of the distance of an error."""
    plain = likelihood([curve(1)], [design()], [STATED])
    error = float(np.diff(fitted(plain).interval(), axis=0)[0, 2]) / 2.0 / 1.96

    def rippled(points: Floats) -> Floats:
        bent = points.copy()
        # slope 1 + 0.8 at the ripple's foot, mean slope 1; a ripple is three standard errors long
        length = 3.0 * error
        bent[:, 2] += 0.8 * length / (2.0 * np.pi) * np.sin(2.0 * np.pi * (points[:, 2] - TRUTH[2]) / length)
        return plain.residuals(bent)

    own = Likelihood(plain.space, plain.blocks, rippled, forward=1e-5)
    found = ripple_of(fitted(own))
    assert found.rippled[2]
    assert max(found.ratios[2], 1.0 / found.ratios[2]) > MOST_RATIO


@pytest.mark.parametrize("noise", [STATED, Noise()])
@pytest.mark.parametrize(("drift", "least", "most"), [(0.2, 7, 10), (0.0, 0, 0)])
def test_a_drift_of_the_size_of_the_noise_is_found(drift: float, least: int, most: int, noise: Noise) -> None:
    """Ten curves with 0.5 to 1.5 periods over the record; autoregressive noise follows some drifts."""
    alarms = 0
    for seed in range(10):
        random = np.random.default_rng(seed)
        periods, phase = random.uniform(0.5, 1.5), random.uniform(0.0, 2.0 * np.pi)
        wave = np.sqrt(2.0) * drift * np.sin(2.0 * np.pi * periods * np.linspace(0.0, 1.0, N) + phase)
        test = lack_of_fit(fitted(likelihood([curve(seed) + wave], [design()], [noise])))[0]
        alarms += test.score < 0.005
    assert least <= alarms <= most
