"""Longest step of a direct-acting injector: eigenvalues of the pair of masses, and which parameters bind."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import candidate_matrix
from commonrail.engine.time_step import (
    DIRECT_LENGTHENS,
    DIRECT_SHORTENS,
    RIGID,
    longest,
    longest_step,
    medium_of,
    stiffest_corner,
    too_long,
)
from commonrail.physics.injector import Injector
from commonrail.readers.injector import load_injector

POINT = OperatingPoint(20e6, 600e-6)


@pytest.fixture(scope="module")
def direct() -> Injector:
    return load_injector("direct-acting-kr")


def test_the_limit_is_the_largest_eigenvalue_of_both_masses(direct: Injector) -> None:
    v, medium = direct.values, medium_of(direct, 20e6)
    push, seat = v["armature.contact_stiffness"], v["needle_seat.contact_stiffness"] + v["needle.spring_stiffness"]
    area = 0.25 * np.pi * v["needle_seat.diameter"] ** 2
    seat += medium.modulus * area**2 * (1.0 / v["sac.volume"] + 1.0 / v["accumulation.volume"])
    stiffness = np.array([[2.0 * push + v["armature.spring_stiffness"], -push], [-push, push + seat]])
    root = np.diag([v["armature.mass"] ** -0.5, v["needle.mass"] ** -0.5])
    fastest = float(np.linalg.eigvalsh(root @ stiffness @ root)[-1] ** 0.5)
    assert longest(direct.variant, v, medium) == pytest.approx(RIGID / fastest, rel=1e-9)


@pytest.mark.parametrize("name", DIRECT_SHORTENS[:4])
def test_what_shortens_the_step_does(direct: Injector, name: str) -> None:
    medium, stiff = medium_of(direct, 20e6), direct.with_values({name: 1e9})
    assert longest(stiff.variant, stiff.values, medium) < 0.6 * longest(direct.variant, direct.values, medium)


@pytest.mark.parametrize("name", DIRECT_LENGTHENS)
def test_what_lengthens_the_step_does(direct: Injector, name: str) -> None:
    medium, small = medium_of(direct, 20e6), direct.with_values({name: 1e-3 * direct.values[name]})
    assert longest(small.variant, small.values, medium) < 0.8 * longest(direct.variant, direct.values, medium)


def test_candidates_are_judged_each_by_itself(direct: Injector) -> None:
    names, values = ["needle.mass"], np.array([[0.8e-3], [0.01e-3]])
    theta, medium = candidate_matrix(direct, names, values), medium_of(direct, 20e6)
    assert too_long(direct, names, theta, medium, 1.5e-6).tolist() == [False, True]
    assert longest_step(direct, theta[1], medium) < 1.5e-6 < longest_step(direct, theta[0], medium)


def test_the_stiffest_corner_of_bounds_has_the_lightest_needle(direct: Injector) -> None:
    corner = stiffest_corner(direct.values, {"needle.mass": 0.5e-3}, {"needle.mass": 1e-3})
    assert corner["needle.mass"] == 0.5e-3
