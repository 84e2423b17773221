"""Eq. (2) against published fits, closed forms and quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from commonrail.physics import fuel


def arrays(*values: float) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(value) for value in values)


# n-dodecane at 80 °C, CoolProp: p [MPa], rho [kg/m3], K_S [MPa], nu [mm2/s].
N_DODECANE_80 = np.array([[0.1, 705.0, 814, 0.891], [80, 760.8, 1713, 1.758], [160, 794.8, 2508, 2.848]])


def test_published_fits_of_eq_2_reproduce_n_dodecane_at_80_degrees() -> None:
    p, rho, modulus, viscosity = N_DODECANE_80.T
    density = fuel.saturating_law(p, *arrays(706.47, 14.51, 2.699, 0.6867))
    stiff = fuel.saturating_law(p, *arrays(806.3, 0.0, 16.73, 0.9108))
    thick = fuel.power_law(p, *arrays(0.9355, 0.0035, 1.2436))
    # tolerances: the errors that the fits themselves state, and half a digit of the table
    assert np.abs(density - rho).max() <= 1.5 + 0.05
    assert np.abs(stiff - modulus).max() <= 7 + 0.5
    assert np.abs(thick - viscosity).max() <= 0.05 + 0.0005


def test_law_starts_at_k1_and_k2_of_zero_is_the_limit_of_small_k2() -> None:
    assert fuel.saturating_law(0.0, *arrays(806.3, 0.0, 16.73, 0.9)) == 806.3
    assert fuel.saturating_law(0.0, *arrays(706.0, 14.5, 2.7, -0.2)) == 706.0
    limit = fuel.saturating_law(50.0, *arrays(806.3, 0.0, 16.73, 0.9))
    near = fuel.saturating_law(50.0, *arrays(806.3, 1e-3, 16.73, 0.9))
    assert limit == pytest.approx(near, rel=1e-15)  # exp(-50000) is zero


@pytest.mark.parametrize("k", [(14.51, 2.699, 0.6867), (379.0, 611.0, -0.165), (0.0, 16.7, 0.91)])
def test_slope_is_the_derivative(k: tuple[float, float, float]) -> None:
    p = np.array([0.5, 5.0, 50.0, 250.0])
    h = 1e-5 * p
    above = fuel.saturating_law(p + h, *arrays(0.0, *k))
    below = fuel.saturating_law(p - h, *arrays(0.0, *k))
    # central difference: truncation 1e-10, rounding 1e-16/1e-5
    assert fuel.saturating_slope(p, *arrays(*k)) == pytest.approx((above - below) / (2 * h), rel=1e-8)


def test_log_compression_has_the_closed_forms_of_constant_and_linear_modulus() -> None:
    p = np.array([0.0, 1.0, 100.0, 350.0])
    constant = fuel.log_compression(p, *arrays(1000.0, 0.0, 0.0, 1.0))
    assert constant == pytest.approx(p / 1000.0, rel=1e-14)
    linear = fuel.log_compression(p, *arrays(1000.0, 0.0, 11.0, 1.0))
    assert linear == pytest.approx(np.log1p(0.011 * p) / 11.0, rel=1e-13)  # Gauss error and rounding


@pytest.mark.parametrize("k", [(1050.0, 20.0, 12.5, 0.945), (679.5, 0.0, 14.06, 0.9246)])
@pytest.mark.parametrize("p", [0.3, 160.0, 350.0])
def test_log_compression_equals_adaptive_quadrature(k: tuple[float, ...], p: float) -> None:
    wanted, _ = quad(lambda q: 1.0 / fuel.saturating_law(q, *arrays(*k)), 0, p, epsabs=0, epsrel=1e-12)
    assert fuel.log_compression(p, *arrays(*k)) == pytest.approx(wanted, rel=1e-11)


def test_scaled_temperature_is_zero_at_80_degrees_and_polynomials_ascend() -> None:
    assert fuel.scaled_temperature([313.15, 353.15, 393.15]) == pytest.approx([-1.0, 0.0, 1.0])
    assert fuel.coefficient((2.0, 3.0, 5.0), 433.15) == pytest.approx(2.0 + 3.0 * 2 + 5.0 * 4)
