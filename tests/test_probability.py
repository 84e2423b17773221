"""Probabilities and quantiles against closed forms and SciPy."""

from __future__ import annotations

import math

import pytest
from scipy import special

from commonrail.probability import beta_share, gamma_rest, normal_quantile, student_quantile, student_tail

ROUNDING = 1e-10  # relative, what the module promises


@pytest.mark.parametrize("t", [0.0, 1e-6, 0.3, 1.0, 4.0, 50.0])
def test_the_tail_of_one_and_two_degrees_of_freedom_has_a_closed_form(t: float) -> None:
    one, root = math.atan2(1.0, t) / math.pi, math.sqrt(2.0 + t * t)
    assert student_tail(t, 1.0) == pytest.approx(one, rel=ROUNDING)
    assert student_tail(t, 2.0) == pytest.approx(1.0 / (root * (root + t)), rel=ROUNDING)


@pytest.mark.parametrize("freedom", [1.5, 3.0, 29.9, 30.1, 513.0, 9.9e4, 1.1e5, 1e9])
@pytest.mark.parametrize("t", [0.1, 1.0, 1.3, 2.0, 6.0])
def test_the_tail_of_student_is_that_of_scipy(freedom: float, t: float) -> None:
    assert student_tail(t, freedom) == pytest.approx(special.stdtr(freedom, -t), rel=ROUNDING)


@pytest.mark.parametrize("freedom", [1.0, 2.0, 7.5, 513.0, 1.1e5, 1e9])
@pytest.mark.parametrize("share", [0.5, 0.6, 0.975, 1.0 - 1e-7])
def test_the_quantile_undoes_the_tail(freedom: float, share: float) -> None:
    found = student_quantile(freedom, share)
    assert student_tail(found, freedom) == pytest.approx(1.0 - share, rel=1e-9)  # 1 − share has 1e-16 / 1e-7 itself
    assert found == pytest.approx(special.stdtrit(freedom, share), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("a", [0.5, 3.5, 14.9, 15.0, 260.0, 5e3])
@pytest.mark.parametrize("b", [0.5, 2.5, 20.0])
@pytest.mark.parametrize("x", [1e-9, 0.3, 0.9, 0.999])
def test_the_share_of_beta_is_that_of_scipy(a: float, b: float, x: float) -> None:
    expected = float(special.betainc(a, b, x))
    assert beta_share(a, b, x) == pytest.approx(expected, rel=ROUNDING, abs=1e-280)


@pytest.mark.parametrize("a", [0.5, 1.0, 14.9, 15.0, 256.5, 5e3, 1e6])
@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.99, 1.0, 1.01, 1.5])
def test_the_rest_of_gamma_is_that_of_scipy(a: float, ratio: float) -> None:
    expected = float(special.gammaincc(a, a * ratio))
    assert gamma_rest(a, a * ratio) == pytest.approx(expected, rel=ROUNDING, abs=1e-280)


def test_beta_and_gamma_end_at_zero_and_one() -> None:
    assert (beta_share(2.0, 3.0, 0.0), beta_share(2.0, 3.0, 1.0)) == (0.0, 1.0)
    assert gamma_rest(0.5, 1e5) == 0.0


@pytest.mark.parametrize("share", [1e-10, 0.01, 0.8, 0.975])
def test_the_normal_quantile_is_that_of_scipy(share: float) -> None:
    assert normal_quantile(share) == pytest.approx(float(special.ndtri(share)), rel=ROUNDING)
