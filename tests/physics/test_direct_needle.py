"""Armature and needle of a direct-acting injector: contact after the idle stroke, collision, lags of the flux."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from commonrail.physics.components import direct_needle, solenoid
from commonrail.physics.components.direct_needle import Loads, Masses, Pair, State
from commonrail.physics.components.plunger_needle import SeatContact
from commonrail.physics.model import lag_fraction

IDLE, LIFT = 70e-6, 60e-6
ARMATURE = direct_needle.ArmatureParameters(1.8e-3, IDLE, LIFT, 5.0, 0.0, 0.0, 2e7, 0.5)
NEEDLE = direct_needle.Parameters(0.8e-3, 22.0, 13e3, 0.0)
PRESSING = -30.0  # force of the pressures [N]: 20 MPa on 1.5 mm²
DT = 1e-6


SEAT = SeatContact(3e7, 0.4)


def masses(a: direct_needle.ArmatureParameters = ARMATURE, n: direct_needle.Parameters = NEEDLE) -> Masses:
    return Masses(direct_needle.armature_coefficients(a), direct_needle.coefficients(n))


def marched(m: Masses, force: float, steps: int, dt: float = DT) -> list[State]:
    """States from rest on under a constant magnetic force."""
    states = [direct_needle.at_rest(m, SEAT, Loads(0.0, PRESSING))]
    states[0] = states[0]._replace(load=Pair(force, PRESSING))
    for _ in range(steps):
        states.append(direct_needle.advance(m, SEAT, states[-1], Loads(force, PRESSING), dt))
    return states


@pytest.mark.parametrize("idle", [30e-6, 70e-6, 120e-6])
def test_the_armature_meets_the_needle_after_its_idle_stroke(idle: float) -> None:
    m, force = masses(ARMATURE._replace(idle_stroke=idle)), 60.0
    states = marched(m, force, 200)
    met = next(k for k, s in enumerate(states) if s.z.armature > idle + s.z.needle)
    # constant acceleration from rest; to the step that passes it
    expected = math.sqrt(2.0 * idle * ARMATURE.mass / (force - ARMATURE.spring_preload))
    assert met * DT == pytest.approx(expected, abs=1.5 * DT)
    # the needle, pressed on its seat, has not moved before
    assert np.ptp([s.z.needle for s in states[:met]]) < 1e-12


def test_at_rest_nothing_moves() -> None:
    m = masses()
    before, *_, after = marched(m, 0.0, 50)
    assert after.z == pytest.approx(before.z, abs=1e-15)
    assert before.z.armature == pytest.approx(-5.0 / 2e7)
    assert before.z.needle == pytest.approx(-(22.0 + 30.0) / (3e7 + 13e3))


def test_a_force_too_small_for_the_needle_holds_the_armature_at_it() -> None:
    held = marched(masses(ARMATURE._replace(damping=5.0)), 40.0, 20_000)[-1]
    # 35 N on the armature against 52 N on the needle: both at rest, the contact carries the 35 N
    assert held.v == pytest.approx(Pair(0.0, 0.0), abs=1e-9)
    assert held.z.armature - IDLE - held.z.needle == pytest.approx(35.0 / 2e7, rel=1e-6)
    assert held.z.needle == pytest.approx(-(52.0 - 35.0) / (3e7 + 13e3), rel=1e-6)


@pytest.mark.parametrize("factor", [0.0, 0.4])
def test_a_collision_keeps_the_momentum_and_loses_energy_by_its_damping_alone(factor: float) -> None:
    free = NEEDLE._replace(spring_preload=1e-12, spring_stiffness=0.0)
    m = masses(ARMATURE._replace(spring_preload=0.0, contact_damping=factor), free)
    s = State(Pair(95e-6, 27e-6), Pair(1.0, 0.0), Pair(0.0, 0.0))  # 2 um apart, between seats and stop
    each = ARMATURE.mass, NEEDLE.mass
    for _ in range(40):
        s = direct_needle.advance(m, SEAT, s, Loads(0.0, 0.0), DT)
        if s.z.armature - IDLE - s.z.needle < -1e-6 and s.v.needle > 0.0:
            break
    assert s.v.armature < s.v.needle  # they have parted
    momentum = each[0] * s.v.armature + each[1] * s.v.needle
    assert momentum == pytest.approx(each[0] * 1.0, rel=1e-12)
    # m v dv/dδ = −k δ (1 + β v) integrated from contact to contact, at 1 m/s; 1 % for steps of 1 us
    expected = (
        1.0
        if factor == 0.0
        else brentq(lambda e: factor * (1 + e) - math.log1p(factor) + math.log1p(-e * factor), 0.1, 1.0)
    )
    assert s.v.needle - s.v.armature == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(("dt", "off"), [(1e-6, 0.1e-6), (0.25e-6, 0.01e-6)])
def test_steps_follow_the_differential_equation_through_all_contacts(dt: float, off: float) -> None:
    """Opening to the stop and closing again against DOP853: within a step of travel at 1 m/s, and of second order."""
    m = masses(ARMATURE._replace(damping=3.0), NEEDLE._replace(damping=2.0))
    rest, switch, end = direct_needle.at_rest(m, SEAT, Loads(0.0, PRESSING)), 0.4e-3, 0.75e-3

    def slopes(t: float, y: np.ndarray) -> list[float]:
        a = direct_needle.accelerations(m, SEAT, Pair(y[0], y[1]), Pair(y[2], y[3]), Loads(force(t), PRESSING))
        return [y[2], y[3], a.armature, a.needle]

    def force(t: float) -> float:
        """Rises and falls within 40 us, as a flux behind eddy currents does."""
        return 120.0 * float(np.interp(t, [0.0, 40e-6, switch, switch + 40e-6], [0.0, 1.0, 1.0, 0.0]))

    y, exact = np.array([*rest.z, 0.0, 0.0]), []
    for start, stop in pairwise((0.0, switch, end)):
        at = np.arange(round(start / dt) + 1, round(stop / dt) + 1) * dt
        # the force belongs to the stretch: one instant before its end, so that its edge is not seen twice
        run = solve_ivp(
            lambda t, y, a=start, b=stop: slopes(min(max(t, a), b - 1e-12), y),
            (start, at[-1]), y, "DOP853", t_eval=at, rtol=1e-10, atol=1e-14, max_step=2e-6,
        )  # fmt: skip
        exact.append(run.y)
        y = run.y[:, -1]
    found, s = [], rest
    for k in range(round(end / dt)):
        s = direct_needle.advance(m, SEAT, s, Loads(force(k * dt), PRESSING), dt)
        found.append([*s.z])
    reference = np.hstack(exact)[:2].T
    assert reference[:, 1].max() > LIFT  # the needle has flown past the armature's stop
    assert np.abs(np.array(found) - reference).max() < off


@pytest.mark.parametrize(("rising", "falling"), [(140e-6, 70e-6), (50e-6, 200e-6), (100e-6, 0.0)])
def test_the_pulling_flux_follows_with_a_lag_for_either_direction(rising: float, falling: float) -> None:
    up, down = lag_fraction(rising, DT), lag_fraction(falling, DT)
    pulling, steps = 0.0, 100
    for _ in range(steps):
        pulling = solenoid.follow_flux(1e-4, 1e-4, pulling, up, down)
    full = 1e-4 * (1.0 - math.exp(-steps * DT / rising))
    assert pulling == pytest.approx(full, rel=1e-12)
    for _ in range(steps):
        pulling = solenoid.follow_flux(0.0, 0.0, pulling, up, down)
    assert pulling == pytest.approx(full * math.exp(-steps * DT / falling) if falling else 0.0, rel=1e-12, abs=1e-30)
    assert solenoid.lag_rate(1e-4, 0.0, 140e-6, 70e-6) == pytest.approx(1e-4 / 140e-6)
    assert solenoid.lag_rate(0.0, 1e-4, 140e-6, 70e-6) == pytest.approx(-1e-4 / 70e-6)
