"""The reference engine on its own: books, resolution, crossing instants, guide friction."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status
from commonrail.physics.connections import CLEAR_LIFT
from commonrail.physics.injector import Injector
from commonrail.plugins.verification.run import difference

POINT = OperatingPoint(120e6, 400e-6, horizon=1.3e-3)


@pytest.fixture(scope="module")
def fine(regulated: Injector) -> Solution:
    return simulate_reference(regulated, POINT)


def test_books_balance(fine: Solution) -> None:
    assert fine.status is Status.OK
    # LSODA at 1e-8 on each mass, of which some 100 times the injected are in the pipe; the return line is left out
    assert abs(fine.balance) < 1e-5


def test_instants_are_where_the_needle_clears_and_meets_its_seat(fine: Solution) -> None:
    lift, time = fine.channels["needle_lift"], fine.time
    clear = np.flatnonzero((lift[:-1] <= CLEAR_LIFT) & (lift[1:] > CLEAR_LIFT))[0]
    assert time[clear] <= fine.opening <= time[clear + 1]
    last = np.flatnonzero(lift > CLEAR_LIFT)[-1]
    meets = last + np.flatnonzero(lift[last:] <= 0.0)[0]
    # between two samples, or in the one before if the needle bounced within it
    assert time[meets - 1] <= fine.closing <= time[meets]


def test_it_has_converged(regulated: Injector, fine: Solution) -> None:
    coarse = simulate_reference(regulated, POINT, resolution=Resolution((160, 80), 1e-7))
    found = difference(coarse, fine)
    # a tenth of what the lanes are judged by
    assert found.rate < 0.02  # [%]
    assert abs(found.volume) < 0.01  # [%]


def test_an_ideal_rail_is_the_inlet(fine: Solution) -> None:
    np.testing.assert_array_equal(fine.channels["inlet_pressure"], np.full(len(fine.time), 120e6))
    np.testing.assert_array_equal(fine.channels["rail_pressure"], fine.channels["inlet_pressure"])


def test_a_measured_rail_pressure_is_the_inlet(regulated: Injector) -> None:
    trace = Trace((20e-6, 60e-6), (120e6, 118e6))
    found = simulate_reference(regulated, OperatingPoint(trace, 0.0, horizon=90e-6), 10e-6, Resolution((20, 10)))
    # the values of the trace itself, to rounding
    expected = 1e6 * np.array([120, 120, 120, 119.5, 119, 118.5, 118, 118, 118, 118])
    np.testing.assert_allclose(found.channels["inlet_pressure"], expected, rtol=1e-12)


def test_a_throttle_takes_its_loss_between_rail_and_inlet(volume: Injector) -> None:
    """Eq. (4) at the injection's height, with the flow that the books of the rail state."""
    at = Resolution((60, 30), method="explicit")  # whose kernel the comparison of the engines needs, too
    found = simulate_reference(volume, POINT, 1e-6, at)
    rail, inlet = found.channels["rail_pressure"], found.channels["inlet_pressure"]
    assert rail[0] == pytest.approx(120e6, rel=1e-12)
    assert 0.0 < rail[0] - inlet[0] < 100.0  # of the guides' leakage
    fuel, warm = volume.fuel, volume.values["fuel.temperature"]
    density = np.array([float(fuel.density(p, warm)) for p in rail])
    flow = -np.gradient(density, found.time) * volume.values["rail.volume"]
    area = 0.25 * np.pi * volume.values["rail.throttle_diameter"] ** 2 * volume.values["rail.throttle_discharge"]
    loss = flow * np.abs(flow) / (2.0 * density * area**2)
    strong = loss > 0.2 * np.max(loss)
    assert np.max(loss) > 0.1e6
    # the slope by differences 1 us apart, which smooths the pipe's ripple of cell by cell
    assert (rail - inlet)[strong] == pytest.approx(loss[strong], abs=0.03 * np.max(loss))


def test_guide_friction_delays_the_needle(regulated: Injector, fine: Solution) -> None:
    friction = np.full((9, 2), (2.0, 1.0))
    with_friction = simulate_reference(regulated, POINT, friction=friction)
    assert with_friction.opening > fine.opening
    assert with_friction.injected_mass < fine.injected_mass


def test_friction_acts_on_a_rigid_body_as_that_of_its_guides(rigid: Injector) -> None:
    """The argument was ignored."""
    on_two = np.zeros((9, 2))
    on_two[[0, 6], 1] = 20.0
    plain, by_argument, by_law = (
        simulate_reference(injector, POINT, resolution=Resolution((20, 10)), friction=friction)
        for injector, friction in (
            (rigid, None),
            (rigid, on_two),
            (rigid.with_values({"plunger_needle.viscous": 20.0}), None),
        )
    )
    # 1e-5: the solver's tolerance of 1e-8 over some thousand steps and switchings of the PWM
    assert by_argument.injected_mass == pytest.approx(by_law.injected_mass, rel=1e-5)
    assert abs(plain.injected_mass / by_law.injected_mass - 1.0) > 1e-3
