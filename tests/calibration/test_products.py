"""Constraints between products of parameters."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError, InputError
from commonrail.calibration.constraints import parse_products
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space, sample_feasible

NAMES = ("valve.spring_preload", "valve.seat_diameter")
TEXT = "valve.spring_preload >= 1.2 * pi / 4 * valve.seat_diameter^2 * rail_pressure_max"


def space(text: str = TEXT, lower: float = 35.0) -> Space:
    preload = Parameter(NAMES[0], 60.0, lower, 120.0, "N", mark="E", source="test")
    seat = Parameter(NAMES[1], 0.5e-3, 0.35e-3, 0.8e-3, "m", mark="E", source="test")
    return replace(Space([preload, seat]), products=parse_products([text], NAMES, {"rail_pressure_max": 160e6}))


def test_a_preload_holds_the_valve_shut() -> None:
    box = space()
    x = box.from_unit(np.random.default_rng(1).random((500, 2)))
    force = 1.2 * 0.25 * math.pi * x[:, 1] ** 2 * 160e6
    assert box.satisfies(x).tolist() == (x[:, 0] >= force).tolist()
    assert 0 < box.satisfies(x).sum() < len(x)
    short = np.maximum(0.0, 1.0 - x[:, 0] / force)
    assert box.shortfall(x)[:, 0] == pytest.approx(short, rel=1e-12, abs=1e-12)
    assert (box.violation(x) > 0.0).tolist() == (~box.satisfies(x)).tolist()


def test_a_point_is_pulled_back_to_the_curve() -> None:
    box = space()
    anchor, goal = np.array([[100.0, 0.4e-3]]), np.array([[40.0, 0.7e-3]])
    (found,) = box.pull_back(anchor, goal)
    assert box.satisfies(found)
    assert found[0] == pytest.approx(1.2 * 0.25 * math.pi * found[1] ** 2 * 160e6, rel=1e-6)
    assert np.array_equal(box.pull_back(goal, anchor), anchor)  # a feasible goal stays


def test_draws_keep_to_the_curve() -> None:
    box = space()
    assert box.satisfies(sample_feasible(box, 100, np.random.default_rng(1))).all()


def test_a_value_that_does_not_vary_is_known() -> None:
    (product,) = parse_products(["2 * a > b^3 / 4"], ("a",), {"b": 2.0}).constraints
    assert (product.factor, product.exponents.tolist(), product.strict) == (1.0, [1.0], True)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("valve.spring_preload", "exactly one"),
        ("1 < valve.spring_preload < 2", "exactly one"),
        ("valve.spring_preload > valve.seat_diameter + 1", "or a power"),
        ("valve.spring_preload > 2 *", "has nothing"),
        ("valve.spring_preload > valve.seat_diametre", "no parameter.*valve.seat_diameter"),
        ("rail_pressure_max > 3", "free parameter"),
        ("0 * valve.spring_preload > 3", "than zero"),
        ("valve.spring_preload / 0 > 3", "than zero"),
        ("valve.spring_preload * 10^999 > 3", "too large"),
        ("valve.spring_preload * 10^10^10 > 3", "or a power"),
        ("valve.spring_preload > \u0663", "or a power"),
    ],
)
def test_what_cannot_be_read_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        space(text)


def test_no_room_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"constraints: .*1e9"):
        space("valve.spring_preload >= 1e9 * valve.seat_diameter")
