"""Valve: forces by hand, gap of its seat."""

from __future__ import annotations

import math
from typing import Any

import pytest
from scipy.integrate import dblquad, solve_ivp

from commonrail.physics.components import valve

P = valve.Parameters(5e-3, 55e-6, 72.0, 2e4, 0.5, 0.5e-3, math.pi / 4, 0.8, 1e8, 1.0, 0.0, 0.0, 10e-6, 0.0, 10e-6)
C = valve.coefficients(P, 2e-3, 5e-3)


def test_between_seat_and_stop_only_springs_pull_and_pressure_act() -> None:
    force, damping = valve.forces(C, 20e-6, 100.0, 50e6)
    # 100 − 72 − 2e4 · 20e-6 + 50e6 · π/4 · (0.5e-3)²
    assert force == pytest.approx(100.0 - 72.0 - 0.4 + 9.817477, rel=1e-7)
    assert damping == 0.5


def test_seat_and_stop_push_back() -> None:
    seat, seat_damping = valve.forces(C, -1e-6, 0.0, 0.0)
    assert seat == pytest.approx(100.0 - 72.0 + 0.02, rel=1e-12)
    assert seat_damping == pytest.approx(100.5)
    stop, _ = valve.forces(C, 56e-6, 0.0, 0.0)
    assert stop == pytest.approx(-100.0 - 72.0 - 1.12, rel=1e-9)


@pytest.mark.parametrize("velocity", [-0.8, -0.3])
@pytest.mark.parametrize("phase", [0.0, 0.25, 0.5, 0.75])
def test_a_bounce_off_the_seat_is_that_of_the_differential_equation(velocity: float, phase: float) -> None:
    """Steps of 1 us, 60 of them, against DOP853: at most 3.2 nm off; with the instant's force alone 10 to 15 nm."""
    p = P._replace(mass=2e-3, damping=0.0, contact_stiffness=4e7)
    c, dt, steps = valve.coefficients(p, 2e-3, 5e-3), 1e-6, 60

    def slopes(t: float, y: Any) -> list[float]:
        force, damping = valve.forces(c, y[0], 0.0, 0.0)
        return [y[1], (force - damping * y[1]) / p.mass]

    start = 4.3e-6 - phase * velocity * dt
    exact = solve_ivp(slopes, (0.0, steps * dt), [start, velocity], "DOP853", rtol=1e-12, atol=1e-18, max_step=1e-7)
    # leapfrog's first velocity is the mean of the half step before: free flight under the spring
    s = valve.State(start, velocity - 0.5 * dt * slopes(0.0, [start, velocity])[1])
    for _ in range(steps):
        force, damping = valve.forces_over_step(c, s, 0.0, 0.0, dt)
        half = 0.5 * dt * damping / p.mass
        v = (s.velocity * (1.0 - half) + dt * force / p.mass) / (1.0 + half)
        s = valve.State(s.lift + dt * v, v)
    assert exact.y[0].min() < -5e-6 < exact.y[0, -1]  # it has met its seat and left it again
    assert s.lift == pytest.approx(exact.y[0, -1], abs=5e-9)


def test_forces_over_a_step_are_the_forces_where_nothing_touches() -> None:
    s = valve.State(20e-6, 0.5)
    assert valve.forces_over_step(C, s, 100.0, 50e6, 1e-6) == pytest.approx(valve.forces(C, 20e-6, 100.0, 50e6))


def test_gap_is_a_thin_cone_and_shut_below_the_seat() -> None:
    area = 0.8 * math.pi * 0.5e-3 * 30e-6 * math.sin(math.pi / 4)
    assert valve.gap_cda2(C, 30e-6) == pytest.approx(area**2, rel=1e-12)
    assert valve.gap_cda2(C, -1e-6) == 0.0


def test_a_disc_squeezes_by_the_pressure_of_its_film() -> None:
    """Reynolds' equation of a disc, dp/dr = −6 η v r/h³ and p = 0 at its edge: the pressure's integral over it."""
    radius, h, viscosity = 3e-3, 12e-6, 2e-3
    c = valve.coefficients(P._replace(stop_disc=2.0 * radius, stop_film=7e-6), viscosity, 5e-3)
    pressed, _ = dblquad(lambda s, r: 2.0 * math.pi * r * 6.0 * viscosity * s / h**3, 0.0, radius, lambda r: r, radius)
    assert valve.film_damping(c, valve.State(P.lift - 5e-6, 0.5)) == pytest.approx(pressed, rel=1e-9)
    assert valve.film_damping(c, valve.State(P.lift - 5e-6, -0.5)) == 0.0  # drawn apart, it breaks
    on_seat = valve.coefficients(P._replace(seat_disc=2.0 * radius, seat_film=7e-6), 5e-3, viscosity)
    assert valve.film_damping(on_seat, valve.State(5e-6, -0.5)) == pytest.approx(pressed, rel=1e-9)


def test_a_film_takes_the_momentum_that_its_integral_says() -> None:
    """Free of all other forces, m v = m v₀ − K/2 (1/h² − 1/h₀²) on the way to the stop."""
    p = P._replace(spring_preload=0.0, spring_stiffness=0.0, damping=0.0, stop_disc=8e-3, stop_film=20e-6)
    c, dt = valve.coefficients(p, 2e-3, 5e-3), 1e-7
    s = valve.State(0.0, 1.0)
    while s.lift < 0.9 * p.lift:
        s = valve.advance(c, s, 0.0, 0.0, valve.film_damping(c, s), dt)
    thin, thick = (20e-6 + p.lift - lift for lift in (s.lift - 0.5 * dt * s.velocity, 0.0))
    lost = 0.5 * c.stop.cubed * (thin**-2 - thick**-2) / p.mass
    assert 0.1 < lost < 0.9
    assert 1.0 - s.velocity == pytest.approx(lost, rel=1e-3)  # of a step of 0.1 us
