"""Contact: pushes only; the damping grows with the overlap (Hunt and Crossley)."""

from __future__ import annotations

from typing import Any

import pytest
from scipy.integrate import quad, solve_ivp

from commonrail.physics.components.contact import contact, contact_over_step, overlap_over_step


def test_overlap_pushes_by_k_depth_and_damps_by_beta_times_that() -> None:
    assert contact(3e-6, 2e8, 0.2) == (600.0, 120.0)


def test_bodies_apart_do_not_pull() -> None:
    assert contact(-1e-6, 2e8, 0.2) == (0.0, 0.0)
    assert contact(0.0, 2e8, 0.2) == (0.0, 0.0)


def test_over_a_step_is_third_order_while_bodies_touch() -> None:
    """3 g at 0.5 m/s, 3 um deep in a seat of 4e7 N/m: eight times nearer the differential equation at half the step."""
    mass, law, push = 3e-3, (4e7, 1.0), 120.0

    def slopes(t: float, y: Any) -> list[float]:
        return [y[1], (push - law[0] * y[0] * (1.0 + law[1] * y[1])) / mass]

    exact = solve_ivp(slopes, (0.0, 16e-6), [3e-6, 0.5], "DOP853", rtol=1e-12, atol=1e-18, dense_output=True)

    def missed(dt: float) -> float:
        depth = exact.sol(dt)[0]
        speed = (depth - 3e-6) / dt
        for _ in range(round(16e-6 / dt) - 1):
            force, damping = contact_over_step(depth, speed, push, 1.0 / mass, law, dt)
            half = 0.5 * dt * damping / mass
            speed = (speed * (1.0 - half) + dt / mass * (push - force)) / (1.0 + half)
            depth += dt * speed
        return abs(float(depth - exact.y[0, -1]))

    # the instant's force alone: second order, a ratio of four and 5 nm at 1 us
    assert missed(1e-6) < 0.3e-9
    assert 6.0 < missed(2e-6) / missed(1e-6) < 10.0


@pytest.mark.parametrize("depth", [-3e-6, -1.9e-6, -0.4e-6, 0.0, 0.7e-6, 1.9e-6, 5e-6])
@pytest.mark.parametrize("move", [-2e-6, 2e-6])
def test_overlap_over_a_step_is_the_weighted_mean_along_the_path(depth: float, move: float) -> None:
    def mean_of(value: Any) -> float:
        crossing = [-depth / move] if abs(depth) < abs(move) else []
        return float(quad(lambda s: (1.0 - abs(s)) * value(depth + s * move), -1.0, 1.0, points=[0.0, *crossing])[0])

    overlap = overlap_over_step(depth, move)
    assert overlap.mean == pytest.approx(mean_of(lambda x: max(x, 0.0)), abs=1e-15)
    assert overlap.share == pytest.approx(mean_of(lambda x: float(x > 0.0)), abs=1e-9)


def test_without_a_path_the_overlap_is_that_of_the_instant() -> None:
    assert overlap_over_step(3e-6, 0.0).mean == pytest.approx(3e-6, abs=1e-14)
    assert overlap_over_step(-3e-6, 0.0) == (0.0, 0.0)
