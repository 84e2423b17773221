"""Bounds of one parameter, Eq. (16), and what is refused."""

from __future__ import annotations

from typing import Any

import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.parameter import Parameter, percent_bounds


def make(**changes: Any) -> Parameter:
    values: dict[str, Any] = {
        "name": "plunger_needle.k1",
        "reference": 2.0,
        "lower": 1.0,
        "upper": 4.0,
        "unit": "N/m",
        "mark": "F",
        "source": "Table 1",
    }
    return Parameter(**{**values, **changes})


def test_percent_bounds_follow_eq_16() -> None:
    assert percent_bounds(200.0, 25.0, 50.0) == (150.0, 300.0)


def test_percent_bounds_take_the_papers_own_optimum_of_k1() -> None:
    # 3.03e8 is 148 % above 1.22e8: outside [0, 100], so the paper's own range cannot hold it.
    _, upper = percent_bounds(1.22e8, 100.0, 150.0)
    assert upper >= 3.03e8


@pytest.mark.parametrize(
    ("reference", "a_min", "a_max"),
    [
        (1.0, 101.0, 50.0),
        (1.0, -1.0, 50.0),
        (1.0, 50.0, 0.0),
        (1.0, 50.0, -20.0),
        (1.0, 50.0, float("inf")),
        (1.0, float("nan"), 50.0),
        (0.0, 50.0, 50.0),
        (-1.0, 50.0, 50.0),
    ],
)
def test_percent_bounds_refuse_what_crosses_or_turns_negative(reference: float, a_min: float, a_max: float) -> None:
    with pytest.raises(ConfigurationError, match=r"nozzle\.diameter"):
        percent_bounds(reference, a_min, a_max, "nozzle.diameter")


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"lower": 5.0}, "above the upper"),
        ({"lower": 4.0}, "less than"),
        ({"lower": -1.0}, "negative"),
        ({"upper": float("inf")}, "finite"),
        ({"reference": float("nan")}, "finite"),
        ({"scale": "log", "lower": 0.0}, "logarithmic"),
        ({"scale": "cubic"}, "linear"),
        ({"mark": "X"}, "M, C, F or E"),
    ],
)
def test_refusals_name_the_parameter(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(ConfigurationError, match=why) as caught:
        make(**changes)
    assert "plunger_needle.k1" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_count_is_not_searched() -> None:
    with pytest.raises(ConfigurationError, match=r"nozzle\.holes: .*pieces"):
        Parameter("nozzle.holes", 7.0, 6.0, 8.0, "1", mark="E", source="")


def test_an_offset_may_be_negative() -> None:
    assert make(reference=0.0, lower=-1e-5, upper=1e-5).lower == -1e-5
