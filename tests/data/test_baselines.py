"""Interpolation as the trivial model beside a validation map, and what is said of a model that does not beat it."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.result import data_records
from commonrail.data.base import Role
from commonrail.data.quantities.baselines import SCALES, Rule, Sister, interpolate, interpolate_line
from commonrail.data.quantities.data import QuantityData, QuantityScore
from commonrail.engine.operating_point import OperatingPoint
from commonrail.report.data.quantities import MapView
from commonrail.report.fit.verdict import baseline_lines

Law = Callable[[np.ndarray, np.ndarray], np.ndarray]

RAILS, TIMES = np.array([40e6, 80e6, 160e6]), np.array([3e-4, 5e-4, 9e-4])
EXACT = 1e-12  # relative: rounding of a few operations


def bilinear(exponent: float) -> Law:
    """A map that is bilinear in a power of the rail pressure and in energising time, above zero."""
    return lambda rail, time: (
        1e-9 * (1.0 + 2.0 * (rail / 1e8) ** exponent + (3e4 + 5e4 * (rail / 1e8) ** exponent) * time)
    )


def grid(rails: np.ndarray, times: np.ndarray) -> np.ndarray:
    return np.array([(rail, time) for rail in rails for time in times])


def known(law: Law, places: np.ndarray) -> np.ndarray:
    return np.column_stack([places, law(places[:, 0], places[:, 1])])


BOTH = list(itertools.product(Rule, Rule))


@pytest.mark.parametrize("rules", BOTH)
@pytest.mark.parametrize("exponent", SCALES.values())
def test_a_bilinear_map_is_interpolated_exactly(exponent: float, rules: tuple[Rule, Rule]) -> None:
    law, at = bilinear(exponent), grid(np.array([55e6, 120e6, 160e6]), np.array([3.5e-4, 7e-4]))
    rows = np.random.default_rng(1).permutation(known(law, grid(RAILS, TIMES)))
    found = interpolate(rows, at, exponent, rules)
    np.testing.assert_allclose(found.values, law(at[:, 0], at[:, 1]), rtol=EXACT)
    assert not found.extrapolated.any()


def test_a_bilinear_map_is_continued_exactly_and_said_to_be() -> None:
    law, at = bilinear(1.0), np.array([[20e6, 5e-4], [180e6, 5e-4], [80e6, 2e-4], [80e6, 1.2e-3], [80e6, 9e-4]])
    found = interpolate(known(law, grid(RAILS, TIMES)), at)
    np.testing.assert_allclose(found.values, law(at[:, 0], at[:, 1]), rtol=EXACT)
    assert found.extrapolated.tolist() == [True, True, True, True, False]


@pytest.mark.parametrize(
    "y", [[0.0, 1.0, 5.0, 6.0, 30.0], [3.0, 1.0, 4.0, 4.0, 2.0], [0.0, 0.1, 9.0, 9.1, 9.1], [0, 5, 1, 1, 9]]
)
def test_the_cubic_is_the_one_of_scipy(y: list[float]) -> None:
    x, values = np.array([1.0, 2.0, 2.5, 4.0, 7.0]), np.array(y, float)
    rows = np.column_stack([np.full(5, 80e6), x, values])
    at = np.linspace(1.0, 7.0, 61)
    found = interpolate(rows, np.column_stack([np.full(61, 80e6), at]), rules=(Rule.PCHIP, Rule.LINEAR))
    # quantities below zero do not occur: the cubic is monotone between points that are not
    np.testing.assert_allclose(found.values, PchipInterpolator(x, values)(at), rtol=1e-12, atol=1e-12)
    rows = np.column_stack([x, np.full(5, 80e6), values])
    found = interpolate(rows, np.column_stack([at, np.full(61, 80e6)]), rules=(Rule.LINEAR, Rule.PCHIP))
    np.testing.assert_allclose(found.values, PchipInterpolator(x, values)(at), rtol=1e-12, atol=1e-12)


def test_a_convex_map_is_better_met_by_the_cubic_and_is_judged_by_it() -> None:
    """A parabola in time: lines lie above it between the points, by a quarter of the curvature times the width."""

    def law(rail: np.ndarray, time: np.ndarray) -> np.ndarray:
        return np.asarray(1e-9 * (1.0 + (time / 1e-4) ** 2) * (rail / 1e8) ** 0.5)

    times = np.array([3e-4, 5e-4, 7e-4, 9e-4])
    fitted, seen = (
        a_map(law, grid(RAILS, times)),
        a_map(law, grid(RAILS, times + 1e-4)[[0, 1, 2, 4, 5, 6]], Role.VALIDATION),
    )
    (baseline,) = QuantityScore(seen, seen.quantity, np.empty(0)).baselines([fitted])
    assert baseline["rule"].startswith("PCHIP in energising time")
    linear = interpolate(known(law, grid(RAILS, times)), grid(RAILS, times + 1e-4)[[0, 1, 2, 4, 5, 6]]).values
    own = 100.0 * np.sqrt(np.mean((linear / seen.quantity - 1.0) ** 2))
    assert baseline["figures"]["rms_large_percent"] < 0.5 * own


def test_no_quantity_is_below_zero() -> None:
    rows = np.array([[80e6, 3e-4, 1e-9], [80e6, 4e-4, 11e-9]])
    assert interpolate(rows, np.array([[80e6, 2e-4]])).values.tolist() == [0.0]


def test_one_pressure_or_one_time_alone_is_constant() -> None:
    found = interpolate(np.array([[80e6, 3e-4, 7e-9]]), np.array([[120e6, 5e-4], [80e6, 3e-4]]))
    assert found.values.tolist() == [7e-9, 7e-9]
    assert found.extrapolated.tolist() == [True, False]


def test_values_at_the_same_place_are_averaged() -> None:
    rows = np.array([[80e6, 3e-4, 7e-9], [80e6, 3e-4 * (1 + 1e-13), 9e-9], [80e6, 5e-4, 10e-9]])
    assert interpolate(rows, np.array([[80e6, 3e-4]])).values[0] == pytest.approx(8e-9, rel=EXACT)


def test_a_line_between_points() -> None:
    assert interpolate_line(np.array([1.0, 3.0]), np.array([10.0, 30.0]), 2.0) == (20.0, False)


def a_map(law: Law, places: np.ndarray, role: Role = Role.FIT, dead: int = 0) -> QuantityData:
    """A map whose last `dead` rows are dead times of 0.5 mm³."""
    points = tuple(OperatingPoint(rail, time, 0.5e6, 0.1e6, horizon=time + 3e-3) for rail, time in places.tolist())
    quantity = law(places[:, 0], places[:, 1])
    marks = np.arange(len(places)) >= len(places) - dead
    quantity[marks] = 0.5e-9
    return QuantityData(role.value, role, points, quantity, 5e-11, 0.015, marks, 1.0, "made up", "all of it")


def records(values: Callable[[np.ndarray], np.ndarray], exponent: float = 1.0) -> list[dict[str, Any]]:
    """Records of a fitted and a validation map for a model that predicts some values of the latter."""
    law = bilinear(exponent)
    fitted, seen = a_map(law, grid(RAILS, TIMES)), a_map(law, grid(np.array([120e6]), TIMES), Role.VALIDATION)
    none = np.empty(0)
    seen = replace(seen, quantity=seen.quantity * [1.02, 0.98, 1.02])  # noise, which the interpolation does not follow
    scores = [QuantityScore(fitted, fitted.quantity, none), QuantityScore(seen, values(seen.quantity), none)]
    return data_records((fitted, seen), {"best": scores})


def test_a_model_that_is_better_beats_the_interpolation() -> None:
    fitted, seen = records(lambda quantity: 1.001 * quantity)
    assert "baselines" not in fitted
    (baseline,) = seen["baselines"]
    assert baseline["beaten"] is True
    assert re.search(r"^interpolating .*\b9\b", baseline["text"])
    assert baseline["figures"]["rms_large_percent"] == pytest.approx(2.0, abs=0.05)  # the noise
    assert baseline_lines([seen])[0].startswith("The model predicts validation better than interpolating the 9 fitted")
    assert "0.10 against 1.99 %" in baseline_lines([seen])[0]


def test_a_model_that_is_not_is_told_so() -> None:
    _, seen = records(lambda quantity: 1.05 * quantity)
    (baseline,) = seen["baselines"]
    assert baseline["beaten"] is False
    (line,) = baseline_lines([seen])
    assert "not beat" in line
    assert "interpolating the 9" in line
    assert "5.00 against 1.99 %" in line


def test_a_model_that_fails_does_not_beat_it() -> None:
    _, seen = records(lambda quantity: np.full(len(quantity), np.nan))
    assert seen["baselines"][0]["beaten"] is False


@pytest.mark.parametrize(("exponent", "scale"), [(0.5, "√p"), (1.0, "p")])
def test_the_better_of_both_scales_is_the_baseline(exponent: float, scale: str) -> None:
    law = bilinear(exponent)
    fitted, seen = a_map(law, grid(RAILS, TIMES)), a_map(law, grid(np.array([120e6]), TIMES), Role.VALIDATION)
    (baseline,) = QuantityScore(seen, seen.quantity, np.empty(0)).baselines([fitted])
    assert f" in {scale} between rail pressures" in baseline["rule"]
    assert baseline["figures"]["rms_large_percent"] < 1e-9  # rounding


def test_the_table_shows_the_baseline_and_its_rule() -> None:
    data = records(lambda quantity: quantity)
    table = MapView().tables(data, {"best": "calibrated"})[0]
    assert [row[2].text for row in table.rows] == ["calibrated", "calibrated", "interpolating the 9 fitted points"]
    assert table.note.startswith("Interpolating the 9 fitted points: linear in energising time")


def test_dead_times_are_interpolated_between_pressures() -> None:
    law = bilinear(1.0)
    places = np.vstack([grid(RAILS[:2], TIMES), [[40e6, 282e-6], [80e6, 240e-6]]])
    fitted = a_map(law, places, dead=2)
    seen = a_map(law, np.array([[60e6, 5e-4], [60e6, 261e-6]]), Role.VALIDATION, dead=1)
    score = QuantityScore(seen, seen.quantity, np.array([270e-6]))
    figures = score.baselines([fitted])[0]["figures"]
    assert figures["dead_time_rms"] == pytest.approx(0.0, abs=1e-15)
    other = replace(fitted, quantity=np.where(fitted.dead_time, 1e-9, fitted.quantity))
    assert score.baselines([other])[0]["figures"]["dead_time_rms"] is None


def test_no_baseline_without_fitted_maps() -> None:
    seen = a_map(bilinear(1.0), grid(RAILS, TIMES), Role.VALIDATION)
    assert QuantityScore(seen, seen.quantity, np.empty(0)).baselines([]) == []


def test_the_map_of_a_sister_part_is_scaled_by_the_catalogue_flow() -> None:
    law = bilinear(1.0)
    sister = Sister(known(law, grid(RAILS, TIMES)), 1.1, "another part")
    seen = replace(a_map(law, grid(np.array([120e6]), TIMES), Role.VALIDATION), sister=sister)
    (baseline,) = QuantityScore(seen, 1.05 * seen.quantity, np.empty(0)).baselines([])
    assert re.search(r"sister part.* 1\.1$", baseline["text"])
    assert baseline["figures"]["rms_large_percent"] == pytest.approx(10.0, rel=1e-9)
    assert baseline["beaten"] is True
    assert "another part" in baseline["rule"]


def test_a_sister_part_needs_three_columns_and_a_ratio() -> None:
    with pytest.raises(ConfigurationError, match=r"sister part .*\brows"):
        Sister(np.ones((3, 2)))
    with pytest.raises(ConfigurationError, match="flow_ratio"):
        Sister(np.ones((3, 3)), 0.0)
