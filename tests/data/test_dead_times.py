"""Dead times that are judged as times."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from commonrail.data.base import Role
from commonrail.data.quantities.data import QuantityData, point_values
from commonrail.data.quantities.dead_times import AROUND, FLATTEST, crossing_times, neighbours
from commonrail.data.simulator import ITSELF, Candidates
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.status import OK, STILL_INJECTING
from commonrail.runs.fingerprint import hash_values

HALF = 0.5e-9  # m³
DENSITY = 800.0


NOBODY: Any = None  # a map without a meter asks nothing of the candidates
CANDIDATES = Candidates(NOBODY, ITSELF)


def found_values(data: QuantityData, found: Any) -> np.ndarray:
    """Values of a batch."""
    return point_values(data, found, CANDIDATES)


def crossing(low: float, middle: float, high: float) -> float:
    """Crossing [us] of 0.5 mm³ around 300 us, for quantities in mm³."""
    quantity = 1e-9 * np.array([[[low, middle, high]]])
    return float(crossing_times(np.array([300e-6]), quantity, np.array([HALF]))[0, 0] * 1e6)


def test_a_quantity_is_interpolated_between_three_times() -> None:
    assert crossing(0.0, 0.5, 2.0) == pytest.approx(300.0)
    assert crossing(0.0, 1.0, 2.0) == pytest.approx(275.0)  # half-way below
    assert crossing(0.0, 0.2, 0.8) == pytest.approx(325.0)  # half-way above


def test_it_is_extrapolated_beyond_them() -> None:
    assert crossing(1.0, 1.5, 3.0) == pytest.approx(200.0)  # 0.5 mm³ in 50 us: 100 us earlier
    assert crossing(0.0, 0.1, 0.3) == pytest.approx(400.0)  # 0.2 mm³ in 50 us: 100 us later


def test_an_injector_that_injects_nothing_has_a_finite_dead_time() -> None:
    assert crossing(0.0, 0.0, 0.0) == pytest.approx(300.0 + FLATTEST * 1e6)
    assert crossing(0.4, 0.2, 0.1) == pytest.approx(300.0 + 0.6 * FLATTEST * 1e6)


def test_a_failed_simulation_has_none() -> None:
    assert np.isnan(crossing(np.nan, 0.5, 1.0))
    assert np.isnan(crossing(0.0, 0.5, np.nan))


def test_a_short_dead_time_has_a_neighbour_that_is_energised_too() -> None:
    short, long_ = neighbours(OperatingPoint(160e6, 60e-6))
    assert short.pulses[0].duration == pytest.approx(30e-6)
    assert long_.pulses[0].duration == pytest.approx(60e-6 + AROUND)


def a_map(tolerance: float | None) -> QuantityData:
    """A quantity of 10 mm³ and a dead time of 250 us."""
    points = OperatingPoint(160e6, 400e-6), OperatingPoint(160e6, 250e-6)
    quantity, dead = np.array([10e-9, HALF]), np.array([False, True])
    rest = 1.0, "source", "", float("nan"), tolerance
    return QuantityData("map", Role.FIT, points, quantity, 0.05e-9, 0.015, dead, *rest)  # type: ignore[arg-type]


def batch(*volumes: float, status: int = OK) -> Any:
    """Volumes [mm³] at the points that are simulated."""
    mass = DENSITY * 1e-9 * np.array([volumes])
    return SimpleNamespace(
        injected_mass=mass, reference_density=np.full(mass.shape, DENSITY), status=np.full(mass.shape, status)
    )


def test_a_tolerance_in_time_makes_the_error_one_of_time() -> None:
    data = a_map(4e-6)
    assert len(data.simulated_points) == 4
    assert data.measured == pytest.approx([10e-9, 250e-6])
    values = found_values(data, batch(10.2, 0.6, 0.1, 3.0))  # passes 0.5 mm³ 10 us early
    assert values[0] == pytest.approx([10.2e-9, 240e-6])
    assert data.errors(values)[0] == pytest.approx([0.2 / 0.2, -10.0 / 4.0])
    (term,) = QuantityData.terms([data], 1e-6)
    assert term.squares(batch(10.2, 0.6, 0.1, 3.0), CANDIDATES)[0, 0] == pytest.approx(1.0 + 6.25)
    assert np.isnan(found_values(data, batch(10.2, 0.6, 0.1, 3.0, status=STILL_INJECTING))).all()


def test_without_one_it_is_one_of_quantity() -> None:
    data = a_map(None)
    assert len(data.simulated_points) == 2
    assert data.measured == pytest.approx([10e-9, HALF])
    assert data.errors(found_values(data, batch(10.2, 0.6)))[0] == pytest.approx([1.0, 0.1 / 0.0575])


def test_the_target_of_a_copy_follows_its_fields() -> None:
    assert replace(a_map(None), dead_time_tolerance=4e-6).measured[1] == 250e-6
    assert replace(a_map(4e-6), dead_time_tolerance=None).measured[1] == HALF


def test_a_tolerance_in_time_makes_another_study() -> None:
    assert hash_values(a_map(None)) != hash_values(a_map(4e-6))
