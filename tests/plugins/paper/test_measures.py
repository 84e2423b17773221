"""Measures of curves and searches against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.calibration.search import Generation
from commonrail.plugins.paper.figures import box, edges, j_by_phase, j_by_window, ninety_percent, oscillation, spread

BOUNDS = 1e-6 * np.arange(0.0, 1201.0, 3.0)
MIDDLE = 0.5 * (BOUNDS[1:] + BOUNDS[:-1])


def trapezoid(begin: float, rise: float, end: float, fall: float) -> np.ndarray:
    """Rate of a trapezoid of height 1, at the middles of the samples."""
    return np.clip(np.minimum((MIDDLE - begin) / rise, (end - MIDDLE) / fall), 0.0, 1.0)


def test_edges_of_a_trapezoid_are_where_its_flanks_pass_the_level() -> None:
    found = edges(trapezoid(200e-6, 100e-6, 900e-6, 50e-6), BOUNDS, 0.1)
    # linear flanks are met exactly by linear interpolation
    assert found.opening == pytest.approx(210e-6, rel=1e-9)
    assert found.closing == pytest.approx(895e-6, rel=1e-9)


def test_the_first_rise_and_the_last_fall_count() -> None:
    rate = np.maximum(trapezoid(100e-6, 30e-6, 300e-6, 30e-6), trapezoid(500e-6, 30e-6, 800e-6, 30e-6))
    found = edges(rate, BOUNDS, 0.5)
    assert found.opening == pytest.approx(115e-6)
    assert found.closing == pytest.approx(785e-6)


def test_a_curve_that_never_rises_has_no_edges() -> None:
    assert np.isnan(edges(np.zeros(400), BOUNDS, 0.1)).all()


def test_phases_part_j_without_remainder() -> None:
    rng = np.random.default_rng(1)
    rate, measured = rng.normal(size=(2, 400)) * 1e-6
    parts = j_by_phase(rate, measured, BOUNDS, 150e-6)
    assert parts.sum() == pytest.approx(1e6 * np.abs(rate - measured).sum(), rel=1e-12)
    assert (parts > 0.0).all()


def test_an_error_in_the_descent_counts_there() -> None:
    measured = trapezoid(200e-6, 100e-6, 1100e-6, 50e-6)
    rate = measured + np.where(MIDDLE > 1.05e-3, 2e-6, 0.0)
    parts = j_by_phase(rate, measured, BOUNDS, 200e-6)
    assert parts[:3] == pytest.approx(0.0)
    assert parts[3] == pytest.approx(2.0 * np.sum(MIDDLE > 1.05e-3))


def test_windows_leave_out_what_comes_later_than_1200_us_from_opening_and_from_energising() -> None:
    bounds = 1e-6 * np.arange(0.0, 1561.0, 3.0)
    parts = j_by_window(np.full(520, 2e-6), np.zeros(520), bounds, 150e-6)
    assert parts.tolist() == [[pytest.approx(900.0), 450.0], [pytest.approx(800.0), 400.0]]


def test_one_rise_and_one_fall_do_not_oscillate() -> None:
    rate = 30e-6 * trapezoid(100e-6, 300e-6, 800e-6, 30e-6)
    assert oscillation(rate) == pytest.approx(0.0, abs=1e-9)
    ripple = np.where((MIDDLE > 500e-6) & (MIDDLE < 530e-6), 2e-6, 0.0)
    assert oscillation(rate - ripple) == pytest.approx(4.0)  # a dip of 2 mm³/ms falls and rises
    assert oscillation(np.linspace(1e-6, 3e-6, 9)) == pytest.approx(0.0, abs=1e-9)  # ends above zero


def test_the_quartiles_leave_out_what_is_not_finite() -> None:
    assert spread([1.0, 2.0, np.inf, 3.0, 4.0, 5.0, np.nan]) == (3.0, 2.0, 4.0)
    assert np.isnan(spread([np.nan])).all()


def test_a_box_suppresses_outliers_only() -> None:
    # 10 lies 2.1 interquartile ranges above the box
    assert box([1.0, 2.0, 3.0, 4.0, 5.0, 10.0]) == (1.0, 2.25, 3.5, 4.75, 5.0)
    assert box([1.0, 2.0, 3.0]) == (1.0, 1.5, 2.0, 2.5, 3.0)


@pytest.mark.parametrize(("best", "generation"), [((100.0, 50.0, 19.0, 11.0, 10.0), 2), ((10.0, 10.0), 0)])
def test_ninety_percent_of_the_gain(best: tuple[float, ...], generation: int) -> None:
    assert ninety_percent([Generation(i, b, b) for i, b in enumerate(best)]) == generation


def test_a_search_that_starts_without_success_has_no_ninety_percent() -> None:
    assert np.isnan(ninety_percent([Generation(0, np.inf, np.inf), Generation(1, 5.0, 6.0)]))
