"""Valve: forces by hand, gap of its seat."""

from __future__ import annotations

import math
from typing import Any

import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from commonrail.parts import valve

P = valve.Parameters(5e-3, 55e-6, 72.0, 2e4, 0.5, 0.5e-3, math.pi / 4, 0.8, 1e8, 1.0, 0.0)
VISCOSITY = 3e-3  # [Pa s]
HOLE = (0.7 * math.pi / 4.0 * (0.25e-3) ** 2) ** 2  # (c_d A)² of an A-hole [m⁴]
HEAD = 850.0 * 160e6  # [Pa kg/m³]
C = valve.coefficients(P, VISCOSITY)


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
    c, dt, steps = valve.coefficients(p, VISCOSITY), 1e-6, 60

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
    assert valve.gap_drive(C, 30e-6, HOLE, HEAD) == pytest.approx(area**2, rel=1e-12)
    assert valve.gap_drive(C, -1e-6, HOLE, HEAD) == 0.0


def series_flow(height: float, land: float, head: float, viscosity: float) -> float:
    """Mass flow [kg/s] of A-hole, seat and film in series by a root search for the whole pressure drop."""
    gap = (0.8 * math.pi * 0.5e-3 * height) ** 2
    density, resistance = 850.0, 12.0 * viscosity * land / (math.pi * 0.5e-3 * height**3)

    def surplus(flow: float) -> float:
        return flow**2 / (2.0 * density) * (1.0 / HOLE + 1.0 / gap) + resistance * flow / density - head / density

    return float(brentq(surplus, 0.0, 10.0, xtol=1e-18, rtol=1e-14))


@pytest.mark.parametrize("height", [0.1e-6, 1e-6, 3e-6, 10e-6, 30e-6])
@pytest.mark.parametrize(
    ("land", "head", "viscosity"), [(100e-6, HEAD, VISCOSITY), (20e-6, 0.1 * HEAD, 3.0 * VISCOSITY)]
)
def test_a_land_passes_what_film_and_orifices_in_series_pass(
    height: float, land: float, head: float, viscosity: float
) -> None:
    c = valve.coefficients(P._replace(seat_land=land), viscosity)
    gap = valve.land_gap_drive(c, height / math.sin(P.seat_angle), HOLE, head)
    flow = math.sqrt(2.0 * head / (1.0 / HOLE + 1.0 / gap))
    assert flow == pytest.approx(series_flow(height, land, head, viscosity), rel=1e-9)


def test_far_below_the_land_the_flow_grows_with_the_cube_of_the_gap_and_with_the_pressure() -> None:
    """Plane Poiseuille flow: ρ π d h³ Δp/(12 η l)."""
    c = valve.coefficients(P._replace(seat_land=100e-6), VISCOSITY)
    height = 0.05e-6
    for head in (HEAD, 0.5 * HEAD):
        gap = valve.land_gap_drive(c, height / math.sin(P.seat_angle), HOLE, head)
        thin = math.pi * 0.5e-3 * height**3 * head / (12.0 * VISCOSITY * 100e-6)
        assert math.sqrt(2.0 * head * gap) == pytest.approx(thin, rel=1e-3)


def test_a_seat_without_a_land_is_the_plain_one_and_shuts() -> None:
    assert valve.land_gap_drive(C, 30e-6, HOLE, HEAD) == valve.gap_drive(C, 30e-6, HOLE, HEAD)
    for c in (C, valve.coefficients(P._replace(seat_land=1e-4), VISCOSITY)):
        assert valve.land_gap_drive(c, 0.0, HOLE, HEAD) == valve.land_gap_drive(c, -1e-6, HOLE, HEAD) == 0.0
    assert valve.land_gap_drive(C, 30e-6, HOLE, 0.0) == valve.gap_drive(C, 30e-6, HOLE, 0.0)
