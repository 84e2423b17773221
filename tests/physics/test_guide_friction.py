"""Friction of the guides: terminal speed, distance of stopping, the law in the chain and in the rigid body."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from commonrail.physics.components import guide_friction, plunger_needle, rigid_body
from commonrail.physics.components.plunger_needle import Loads, Nine, SeatContact
from commonrail.physics.injector import Injector

VISCOUS, DRY, ROUNDED = 12.0, 6.0, 0.01
SEAT = SeatContact(2e8, 0.2)
DT = 1e-6  # [s]
FREE = Loads(0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def drawn(regulated: Injector) -> plunger_needle.Parameters:
    """Nothing but friction acts: no needle spring, the stop out of reach."""
    return regulated.parameters.plunger_needle._replace(
        spring_stiffness=0.0, stop_lift=1.0, viscous=VISCOUS, friction=DRY
    )


def rubbing(v: float) -> float:
    """Force of one guide against the motion [N]."""
    return v * (VISCOUS + DRY / (abs(v) + ROUNDED))


def terminal_speed(force: float) -> float:
    """Speed at which both guides together balance a force: 2 (c v² + (c v0 + F_c) v)/(v + v0) = force."""
    b = 2.0 * (VISCOUS * ROUNDED + DRY) - force
    return (-b + math.sqrt(b * b + 8.0 * VISCOUS * force * ROUNDED)) / (4.0 * VISCOUS)


def chain_at(z: float, v: float) -> plunger_needle.State:
    return plunger_needle.State(*(Nine(*[each] * 9) for each in (z, v, 0.0)))


@pytest.mark.parametrize("force", [5.0, 40.0])
def test_a_constant_force_reaches_the_terminal_speed(drawn: plunger_needle.Parameters, force: float) -> None:
    c = plunger_needle.coefficients(drawn, DT)
    body, chain = rigid_body.State(1e-3, 0.0), chain_at(1e-3, 0.0)
    pushed = FREE._replace(foot=0.5 * force, head=0.5 * force)  # plunger and needle by themselves: neither pulls
    for _ in range(20_000):
        body = guide_friction.advance_body(c, SEAT, body, pushed, DT)
        chain = guide_friction.advance_chain(c, SEAT, chain, pushed, DT)
    speed = terminal_speed(force)
    assert rubbing(speed) == pytest.approx(0.5 * force)
    # 1e-6: what is left of the start after 20 ms; the slowest time constant is m/(2 c_v) = 0.25 ms
    assert body.v == pytest.approx(speed, rel=1e-6)
    assert np.mean(chain.v) == pytest.approx(speed, rel=1e-4)  # the chain still rings a little


def test_dry_friction_alone_stops_a_body_as_the_differential_equation_says(drawn: plunger_needle.Parameters) -> None:
    c = plunger_needle.coefficients(drawn._replace(viscous=0.0), DT)

    def slopes(t: float, y: Any) -> list[float]:
        return [y[1], -2.0 * DRY * y[1] / (abs(y[1]) + ROUNDED) / c.total_mass]

    exact = solve_ivp(slopes, (0.0, 300 * DT), [1e-3, 0.5], rtol=1e-11, atol=1e-14)
    body = rigid_body.State(1e-3, 0.5 - 0.5 * DT * slopes(0.0, [0.0, 0.5])[1])  # half a step before
    for _ in range(300):
        body = guide_friction.advance_body(c, SEAT, body, FREE, DT)
    travelled = exact.y[0, -1] - 1e-3
    assert 10e-6 < travelled < 200e-6
    assert body.z - 1e-3 == pytest.approx(travelled, rel=1e-3)


def advanced(drawn: plunger_needle.Parameters, dt: float, load: Loads, end: float) -> Nine:
    """Positions of the chain at `end`, from rest in free flight."""
    c = plunger_needle.coefficients(drawn, dt)
    s = chain_at(1e-3, 0.0)
    still = Nine(*[0.0] * 9)
    a = guide_friction.accelerate_chain(c, SEAT, s.z, still, load)
    s = plunger_needle.State(s.z, Nine(*[-0.5 * dt * x for x in a]), Nine(*[dt * x for x in a]))
    for _ in range(round(end / dt)):
        s = guide_friction.advance_chain(c, SEAT, s, load, dt)
    return s.z


def test_the_chain_follows_the_differential_equation_with_second_order(drawn: plunger_needle.Parameters) -> None:
    drawn = drawn._replace(damping_ratio=0.0)
    c, load, end = plunger_needle.coefficients(drawn, DT), FREE._replace(top=40.0, tip=-15.0), 60e-6

    def slopes(t: float, y: Any) -> Any:
        z, v = Nine(*y[:9]), Nine(*y[9:])
        return np.concatenate([v, guide_friction.accelerate_chain(c, SEAT, z, v, load)])

    start = np.concatenate([[1e-3] * 9, [0.0] * 9])
    exact = solve_ivp(slopes, (0.0, end), start, "DOP853", rtol=1e-12, atol=1e-16).y[:9, -1]
    errors = [np.abs(np.array(advanced(drawn, dt, load, end)) - exact).max() for dt in (1e-6, 0.5e-6, 0.25e-6)]
    assert errors[0] < 0.01 * np.abs(exact - 1e-3).max()
    # a quarter for half the step; 3: the start from rest is a kink of the dry friction's derivative
    assert all(coarse > 3.0 * fine for coarse, fine in pairwise(errors))


def test_friction_acts_on_the_two_guided_masses_only(drawn: plunger_needle.Parameters) -> None:
    c, v = plunger_needle.coefficients(drawn, DT), Nine(*[0.1 * i for i in range(1, 10)])
    z = Nine(*[1e-3] * 9)
    free = plunger_needle.accelerations(c, SEAT, z, v, FREE)
    slowed = guide_friction.accelerate_chain(c, SEAT, z, v, FREE)
    lost = (np.array(free) - np.array(slowed)) / np.array(c.per_mass)
    expected = [rubbing(0.1), 0.0, 0.0, 0.0, 0.0, 0.0, rubbing(0.7), 0.0, 0.0]
    assert lost == pytest.approx(expected, abs=1e-9)  # rounding of forces of 1e3 N


def test_the_rigid_body_carries_both_guides(drawn: plunger_needle.Parameters) -> None:
    c = plunger_needle.coefficients(drawn, DT)
    for v in (-0.7, 0.003, 2.0):
        free = rigid_body.accelerations(c, SEAT, 1e-3, v, FREE)
        slowed = guide_friction.accelerate_body(c, SEAT, 1e-3, v, FREE)
        assert (free - slowed) * c.total_mass == pytest.approx(2.0 * rubbing(v), rel=1e-12)


def test_strong_friction_only_brings_to_rest(drawn: plunger_needle.Parameters) -> None:
    """100 times what is usual: an explicit damper would need dt c < m, and would be unstable here."""
    c = plunger_needle.coefficients(drawn._replace(viscous=6000.0, friction=2000.0), DT)
    body, chain = rigid_body.State(1e-3, 1.0), chain_at(1e-3, 1.0)
    assert DT * (6000.0 + 2000.0 / ROUNDED) * c.per_mass.i1 > 100.0
    for _ in range(3000):
        body = guide_friction.advance_body(c, SEAT, body, FREE, DT)
        chain = guide_friction.advance_chain(c, SEAT, chain, FREE, DT)
    assert abs(body.v) < 1e-3
    assert max(abs(chain.v.i1), abs(chain.v.i7)) < 1e-3
    assert max(map(abs, chain.v)) < 0.2  # between its guides the plunger still rings


def test_without_friction_both_bodies_move_as_the_papers(drawn: plunger_needle.Parameters) -> None:
    c = plunger_needle.coefficients(drawn._replace(viscous=0.0, friction=0.0), DT)
    pushed = FREE._replace(foot=-30.0, head=-60.0)
    body = other_body = rigid_body.State(3e-6, -0.2)
    chain = other_chain = chain_at(3e-6, -0.2)
    for _ in range(100):
        body, other_body = (
            f(c, SEAT, s, pushed, DT)
            for f, s in ((guide_friction.advance_body, body), (rigid_body.advance, other_body))
        )
        chain, other_chain = (
            f(c, SEAT, s, pushed, DT)
            for f, s in ((guide_friction.advance_chain, chain), (plunger_needle.advance, other_chain))
        )
    assert body == pytest.approx(other_body, rel=1e-12)
    assert chain.z == pytest.approx(other_chain.z, rel=1e-12)
