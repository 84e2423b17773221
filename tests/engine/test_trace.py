"""Courses in time: exact means, and operating points that refuse nonsense."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace

ZIGZAG = Trace((0.0, 1.0, 1.5, 4.0), (2.0, 6.0, -2.0, 3.0))


def test_mean_is_the_integral_of_the_broken_line() -> None:
    start, stop = np.array([-1.0, 0.25, 0.9, -2.0, 3.0, 5.0]), np.array([0.5, 0.75, 1.25, 9.0, 6.0, 7.0])
    for a, b, mean in zip(start, stop, ZIGZAG.mean(start, stop), strict=True):
        knots = np.unique(np.concatenate(([a, b], [t for t in ZIGZAG.time if a < t < b])))
        exact = np.trapezoid(np.interp(knots, ZIGZAG.time, ZIGZAG.value), knots) / (b - a)
        assert mean == pytest.approx(exact, rel=1e-13)  # rounding


def test_mean_by_hand() -> None:
    # from 0 to 1: (2 + 6)/2; before the first sample it is constant
    assert ZIGZAG.mean(np.array([0.0, -3.0]), np.array([1.0, -1.0])) == pytest.approx([4.0, 2.0])


@pytest.mark.parametrize(
    ("time", "value", "says"),
    [
        ((0.0,), (1.0,), "least two"),
        ((0.0, 1.0), (1.0,), "least two"),
        ((0.0, 0.0), (1.0, 2.0), "increase"),
        ((0.0, float("nan")), (1.0, 2.0), "finite"),
    ],
)
def test_a_trace_that_is_none_is_refused(time: tuple[float, ...], value: tuple[float, ...], says: str) -> None:
    with pytest.raises(ConfigurationError, match=says):
        Trace(time, value)


def test_an_operating_point_refuses_nonsense() -> None:
    with pytest.raises(ConfigurationError, match="rail pressure"):
        OperatingPoint(0.0, 1e-3)
    with pytest.raises(ConfigurationError, match="cylinder pressure"):
        OperatingPoint(1e8, 1e-3, cylinder_pressure=Trace((0.0, 1.0), (1e6, -1e6)))
    with pytest.raises(ConfigurationError, match=r"energising at 500 us .* 1000 us"):
        OperatingPoint(1e8, (Energising(0.0, 1e-3), Energising(0.5e-3, 1e-3)))
    with pytest.raises(ConfigurationError, match="horizon"):
        OperatingPoint(1e8, 1e-3, horizon=0.0)


def test_a_pressure_at_or_above_the_rails_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"cylinder pressure .* 200 MPa .* 160 MPa"):
        OperatingPoint(160e6, 1e-3, cylinder_pressure=200e6)
    with pytest.raises(ConfigurationError, match=r"return pressure .* 1 MPa .* 1 MPa"):
        OperatingPoint(1e6, 1e-3, cylinder_pressure=0.5e6, return_pressure=1e6)
    rail, cylinder = Trace((0.0, 1.0, 2.0), (9e6, 5e6, 9e6)), Trace((0.5, 1.5), (6e6, 6.5e6))
    with pytest.raises(ConfigurationError, match=r"6\.25 MPa .* 5 MPa"):
        OperatingPoint(rail, 1e-3, cylinder)


def test_all_is_at_rest_at_the_pressures_where_the_simulation_begins() -> None:
    falling = Trace((-20e-3, 0.0, 10e-3), (110e6, 100e6, 95e6))
    for start, pressure in ((-20e-3, 110e6), (-10e-3, 105e6), (0.0, 100e6)):  # whatever lies before the energising
        point = OperatingPoint(falling, [(0.0, 1e-3)], Trace((-20e-3, 0.0), (1e6, 3e6)), start=start)
        assert point.initial_pressures() == pytest.approx((pressure, 3e6 + 1e8 * start, 0.5e6), rel=1e-12)  # rounding


@pytest.mark.parametrize("duration", [1e-316, "0.9 ns", -1e-6])
def test_an_energising_lasts_a_nanosecond_or_is_none(duration: float | str) -> None:
    for energisings in (duration, [(0.0, duration)]):
        with pytest.raises(ConfigurationError):
            OperatingPoint(1e8, energisings)  # type: ignore[arg-type]  # both are accepted
    assert OperatingPoint(1e8, 0.0).pulses == (Energising(0.0, 0.0),)


def test_horizon_by_default_outlasts_the_last_energising() -> None:
    point = OperatingPoint(1e8, (Energising(0.0, 1e-3), Energising(2e-3, 0.5e-3)), start=-1e-3)
    assert point.duration == pytest.approx(1e-3 + 2.5e-3 + 2.5e-3)
