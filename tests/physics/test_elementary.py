"""Elementary functions of the project against those of NumPy and of the C library."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from commonrail.physics import elementary

Floats = NDArray[np.float64]
RNG = np.random.default_rng(7)


def roundings(found: Floats, expected: Floats) -> float:
    """Largest distance in units of the expected number's last place."""
    return float(np.max(np.abs(found - expected) / np.spacing(np.abs(expected))))


@pytest.mark.parametrize(
    ("own", "other", "x"),
    [
        (elementary.exp, np.exp, RNG.uniform(-700.0, 700.0, 20_000)),
        (elementary.expm1, np.expm1, RNG.uniform(-3.0, 3.0, 20_000)),
        (elementary.expm1, np.expm1, -(10.0 ** RNG.uniform(-300.0, 0.0, 20_000))),
        (elementary.log, np.log, 10.0 ** RNG.uniform(-300.0, 300.0, 20_000)),
        (elementary.log, np.log, 1.0 + RNG.uniform(-0.3, 0.5, 20_000)),
    ],
)
def test_functions_are_exact_to_a_few_roundings(
    own: Callable[[Floats], Floats], other: Callable[[Floats], Floats], x: Floats
) -> None:
    assert roundings(own(x), other(x)) <= 4.0  # 2 were seen; the other side has one


def test_a_power_loses_what_its_logarithm_does() -> None:
    base, exponent = RNG.uniform(1e-3, 400.0, 20_000), RNG.uniform(0.3, 1.5, 20_000)
    # the rounding of e ln b counts |e ln b| < 10 times, half a unit each, and exp and log add theirs
    assert roundings(elementary.power(base, exponent), base**exponent) <= 12.0


def test_a_cosine_is_exact_to_a_rounding_of_one() -> None:
    x = np.linspace(-np.pi, np.pi, 10_001)
    assert np.max(np.abs(elementary.cosine(x) - np.cos(x))) <= 4.0 * np.spacing(1.0)


def test_sine_and_exponential_of_the_kernels() -> None:
    for x in np.linspace(0.0, math.pi, 1001).tolist():
        assert elementary.sine(x) == pytest.approx(math.sin(x), abs=2.0 * np.spacing(1.0))
        assert elementary.cosine(x) == pytest.approx(math.cos(x), abs=2.0 * np.spacing(1.0))
    for x in (-np.linspace(0.0, 700.0, 7001)).tolist():
        assert elementary.exponential(x) == pytest.approx(math.exp(x), rel=8.0 * np.spacing(1.0))
    assert elementary.exponential(-1e6) == 0.0


def test_the_ends_of_the_range() -> None:
    np.testing.assert_array_equal(elementary.exp([-np.inf, -1e300, 0.0, np.inf]), [0.0, 0.0, 1.0, np.inf])
    np.testing.assert_array_equal(elementary.log([0.0, 1.0, np.inf]), [-np.inf, 0.0, np.inf])
    np.testing.assert_array_equal(elementary.power([0.0, 0.0, 2.0], [0.0, 0.5, 0.0]), [1.0, 0.0, 1.0])
    assert np.isnan(elementary.exp(np.nan))
    assert np.isnan(elementary.log([-1.0, np.nan])).all()


def test_products() -> None:
    left, right = RNG.normal(size=(5, 3, 7)), RNG.normal(size=(7, 4))
    np.testing.assert_allclose(elementary.product(left, right), left @ right, atol=1e-14)
    np.testing.assert_allclose(elementary.product(left[0, 0], right), left[0, 0] @ right, atol=1e-14)
