"""Posterior density against closed forms: scales and uncertain quantities that are integrated out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.data.noise import Correlation, Law, Noise
from commonrail.plugins.certainty.posterior import PosteriorDensity
from tests.plugins.certainty.linear import TRUTH, Uncertain, design, fitted, likelihood, linear

SIGMA = 0.5
A = design(60)
Y = A @ TRUTH + SIGMA * np.random.default_rng(1).standard_normal(60)


def differences(noise: Noise, nuisances: list[Uncertain] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms of the density of three places relative to the first, and their values."""
    found = fitted(likelihood([Y], [A], [noise], nuisances or ()))
    unit = found.unit + np.array([[0.0, 0.0, 0.0], [0.02, 0.0, -0.01], [-0.01, 0.03, 0.0]])
    logs = PosteriorDensity(found)(unit)
    return logs - logs[0], found.likelihood.space.from_unit(unit)


def test_a_stated_scale_gives_the_normal_density() -> None:
    logs, points = differences(Noise(law=Law.GAUSSIAN, sigma=SIGMA, correlation="white"))  # type: ignore[arg-type]
    squares = np.sum((points @ A.T - Y) ** 2, axis=1)
    np.testing.assert_allclose(logs, -0.5 * (squares - squares[0]) / SIGMA**2, rtol=1e-9, atol=1e-9)


def test_an_estimated_scale_is_integrated_out() -> None:
    """∫ σ⁻ⁿ exp(−S/2σ²) dσ/σ ∝ S^(−n/2)."""
    logs, points = differences(Noise(law=Law.GAUSSIAN, correlation="white"))  # type: ignore[arg-type]
    squares = np.sum((points @ A.T - Y) ** 2, axis=1)
    np.testing.assert_allclose(logs, -30.0 * np.log(squares / squares[0]), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("noise", [Noise(law=Law.GAUSSIAN), Noise(law=Law.GAUSSIAN, sigma=SIGMA, freedom=4.0)])
def test_exact_zeros_of_a_quiet_meter_do_not_sharpen_the_density(noise: Noise) -> None:
    """180 values at which meter and model agree exactly change no difference of densities."""
    noise, quiet = replace(noise, correlation=Correlation.WHITE), np.zeros(180)
    logs = []
    for y, x in ((Y, A), (np.append(Y, quiet), np.vstack([A, np.zeros((180, 3))]))):
        found = fitted(likelihood([y], [x], [noise]))
        logs.append(PosteriorDensity(found)(np.array([[0.3, 0.3, 0.5], [0.32, 0.3, 0.49]])))
    np.testing.assert_allclose(np.diff(logs[1]), np.diff(logs[0]), rtol=1e-6)


def test_the_scale_of_few_repeats_is_integrated_out() -> None:
    """∫ σ⁻ⁿ exp(−S/2σ²) σ^(−ν−1) exp(−ν s²/2σ²) dσ ∝ (S + ν s²)^(−(n + ν)/2), by quadrature."""
    noise = Noise(law=Law.GAUSSIAN, sigma=SIGMA, correlation="white", freedom=4.0)  # type: ignore[arg-type]
    logs, points = differences(noise)
    squares = np.sum((points @ A.T - Y) ** 2, axis=1)
    scales = np.exp(np.linspace(np.log(0.05), np.log(5.0), 4001))[:, None]
    densities = -64.0 * np.log(scales) - 0.5 * (squares + 4.0 * SIGMA**2) / scales**2
    integrals = np.log(np.sum(np.exp(densities - densities.max()), axis=0))
    np.testing.assert_allclose(logs, integrals - integrals[0], rtol=1e-6)


def test_an_uncertain_quantity_is_integrated_out() -> None:
    """Normal density with the covariance σ² I + g gᵀ."""
    course = 0.4 * np.sin(np.arange(60) / 7.0)
    nuisance = linear("gain", course)
    noise = Noise(law=Law.GAUSSIAN, sigma=SIGMA, correlation="white")  # type: ignore[arg-type]
    logs, points = differences(noise, [nuisance])
    inverse = np.linalg.inv(SIGMA**2 * np.eye(60) + np.outer(course, course))
    errors = points @ A.T - Y
    squares = np.einsum("mi,ij,mj->m", errors, inverse, errors)
    np.testing.assert_allclose(logs, -0.5 * (squares - squares[0]), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("beyond", [-0.01, 1.01])
def test_beyond_a_bound_there_is_no_density_and_no_simulation(beyond: float) -> None:
    density = PosteriorDensity(fitted(likelihood([Y], [A])))
    assert density(np.array([[beyond, 0.5, 0.5]]))[0] == -np.inf
    assert density.likelihood.simulated == 0
