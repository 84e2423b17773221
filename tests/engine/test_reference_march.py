"""The explicit march against LSODA, which shares its equations and none of its method; order, books, switching."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.choices import Boundary
from commonrail.base.errors import ConfigurationError
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.reference import Model, Resolution, simulate_reference
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector

CELLS = (120, 60)
FRICTION = np.column_stack(((1.5, 0.5, 0.3, 1.0, 1.0, 0.3, 1.5, 1.0, 0.0), np.linspace(1.0, 0.2, 9)))
EXPLICIT = Resolution(CELLS, method="explicit")
SHOT = OperatingPoint(160e6, 500e-6, horizon=1.3e-3)
TWICE = OperatingPoint(120e6, [(0.0, 250e-6), (500e-6, 300e-6)], horizon=1.6e-3)
# knots between samples, and a slope that changes during the injection
RAMPS = OperatingPoint(Trace((0.0, 100.4e-6, 400.7e-6, 1.2e-3), (120e6, 121e6, 112e6, 118e6)), 400e-6, horizon=1.2e-3)


@pytest.fixture(scope="module")
def throttled(pwm: Injector) -> Injector:
    """Fed from a rail volume, PWM: as the virtual test bench has it."""
    return replace(pwm, variant=pwm.variant._replace(boundary=Boundary.VOLUME))


def j(one: Solution, other: Solution) -> float:
    """Sum over the samples of the differences [mm3/ms]."""
    return float(np.sum(np.abs(one.rate - other.rate)) * 1e6)


@pytest.mark.parametrize(
    ("name", "point", "friction"),
    [("pwm", SHOT, None), ("throttled", SHOT, FRICTION), ("throttled", TWICE, None), ("pwm", RAMPS, FRICTION)],
    ids=["paper's injector", "rail volume, friction", "two injections", "rail trace"],
)
def test_it_agrees_with_lsoda(
    name: str, point: OperatingPoint, friction: np.ndarray | None, request: pytest.FixtureRequest
) -> None:
    injector = request.getfixturevalue(name)
    marched = simulate_reference(injector, point, resolution=EXPLICIT, friction=friction)
    # at its usual 1e-8 LSODA alone is off by 2e-5 with the trace, or by next to nothing, as its roundings fall
    solved = simulate_reference(injector, point, resolution=Resolution(CELLS, relative=1e-9), friction=friction)
    assert marched.status is solved.status is Status.OK
    print("J", j(marched, solved), "of", np.sum(solved.rate) * 1e6, "mm3/ms")
    # kinks inside a step (the seat, the memory of the lift) are of first order: 1e-5 after two injections, less after
    # one; noise of 0.3 mm3/ms makes some 1e-2
    assert j(marched, solved) < 2e-5 * np.sum(solved.rate) * 1e6
    # a tenth of a step
    assert marched.opening == pytest.approx(solved.opening, abs=5e-9)
    assert marched.closing == pytest.approx(solved.closing, abs=5e-9)
    for channel, values in solved.channels.items():
        # two samples may fall beside a switching or the fading of the lift's memory (0.1 us); at two or three more
        # LSODA may miss the SAC's pressure by some 0.5 MPa where it changes its method, as the march at a quarter of
        # its step tells (kernels without fused products)
        apart = np.sort(np.abs(marched.channels[channel] - values))[-5]
        assert apart <= 1e-3 * np.ptp(values) + 1e-6 * np.max(np.abs(values)), channel


def test_the_comparison_can_see_a_friction(throttled: Injector) -> None:
    plain, with_friction = (
        simulate_reference(throttled, SHOT, resolution=EXPLICIT, friction=f) for f in (None, FRICTION)
    )
    assert j(plain, with_friction) > 1e-3 * np.sum(plain.rate) * 1e6
    assert with_friction.opening > plain.opening


def test_it_is_of_order_four_where_nothing_switches(pwm: Injector) -> None:
    """A closed injector while its rail pressure rises: pipe waves, the Z-hole and the chain, and no kink."""
    point = OperatingPoint(Trace((0.0, 60e-6), (120e6, 150e6)), 0.0, horizon=60e-6)
    model = Model(pwm, point, Resolution((60, 30), step=1e-8), None)
    # every flow has its sign by now: a flow that begins or turns is a kink of order 1.5
    model.start = model.march(np.array([0.0, 40e-6]))[0][-1]

    def state(step: float) -> np.ndarray:
        model.resolution = model.resolution._replace(step=step)
        states = model.march(np.array([40e-6, 45e-6]))[0]
        return np.asarray(states[-1])

    exact = state(1.25e-8)
    # pressure behind the inlet, which the ramp drives, and the needle's tip
    for row in (1, -2 * 30 - 2):
        errors = [abs(state(step)[row] - exact[row]) for step in (2e-7, 1e-7, 5e-8)]
        orders = np.log2(np.divide(errors[:-1], errors[1:]))
        print("errors:", errors, "orders:", orders)
        # the next powers of the step still contribute at 0.2 us
        assert orders == pytest.approx(4.0, abs=0.25)


def test_half_the_step_changes_next_to_nothing(throttled: Injector) -> None:
    whole, half = (
        simulate_reference(throttled, SHOT, resolution=EXPLICIT._replace(step=step), friction=FRICTION)
        for step in (5e-8, 2.5e-8)
    )
    # as far as it is from LSODA: the kinks
    assert j(whole, half) < 1e-5 * np.sum(half.rate) * 1e6


@pytest.mark.parametrize(
    ("share", "volume"), [(0.5, 1.0), (0.6, 0.5)], ids=["small holes", "small holes and a small SAC"]
)
def test_a_stiff_sac_shortens_the_step(pwm: Injector, share: float, volume: float) -> None:
    """Small holes leave the seat a small pressure drop: the SAC settles within 15 ns, a third of the step."""
    factors = {"nozzle.hole_diameter": share, "sac.volume": volume}
    stiff = pwm.with_values({name: factor * pwm.values[name] for name, factor in factors.items()})
    whole, half = (
        simulate_reference(stiff, SHOT, resolution=Resolution((60, 30), method="explicit", step=step))
        for step in (5e-8, 2.5e-8)
    )
    # as where the SAC is not stiff; 1.5e-4 at steps of 50 ns throughout
    assert j(whole, half) < 1e-5 * np.sum(half.rate) * 1e6


@pytest.mark.parametrize("point", [SHOT, TWICE], ids=["one", "two"])
def test_books_balance_to_rounding(throttled: Injector, point: OperatingPoint) -> None:
    # a Runge–Kutta step keeps sums exactly; 1e-16 in each of some 1e5 steps, random
    assert abs(simulate_reference(throttled, point, resolution=EXPLICIT).balance) < 1e-12


def test_the_current_turns_at_its_limits(pwm: Injector) -> None:
    p = pwm.values
    point = OperatingPoint(160e6, 600e-6, horizon=600e-6)
    found = simulate_reference(pwm, point, 0.1e-6, Resolution((10, 10), method="explicit"))
    current = found.channels["coil_current"]
    peak = p["drive.peak_current"] + 0.5 * p["drive.peak_band"]
    # 1e-8 A: the limit is met to 1e-9 of its band; a switching at the end of a step would be 4e-3 A late
    assert peak - 0.02 < np.max(current) < peak + 1e-8
    held = current[found.time > p["drive.peak_duration"] + 60e-6]
    low = p["drive.hold_current"] - 0.5 * p["drive.hold_band"]
    assert low - 1e-8 < np.min(held) < low + 0.02
    assert np.max(held) < low + p["drive.hold_band"] + 1e-8


def test_a_state_that_runs_away_is_seen_and_not_raised(pwm: Injector) -> None:
    """A seat so stiff that its oscillation is beyond the step: NaN within some microseconds."""
    hard = pwm.with_values({"needle_seat.contact_stiffness": 1e13})
    found = simulate_reference(hard, SHOT, resolution=EXPLICIT)
    assert found.status is Status.NOT_FINITE
    assert not np.isfinite(found.rate[-1])


def test_fine_pipes_shorten_the_step(pwm: Injector) -> None:
    """A wave passes 2800 cells of 0.04 mm in 25 ns each, four times too fast for steps of 100 ns."""
    point = OperatingPoint(160e6, 0.0, horizon=30e-6)
    found = simulate_reference(pwm, point, resolution=Resolution((2800, 10), method="explicit", step=1e-7))
    assert np.isfinite(found.rate).all()
    # at rest but for rounding
    assert found.channels["accumulation_pressure"] == pytest.approx(160e6, rel=1e-4)


def test_threads_do_not_disturb_each_other(throttled: Injector) -> None:
    injectors = [throttled.with_values({"plunger_needle.k1": k}) for k in (1e8, 2e8, 3e8, 4e8)]

    def rate(injector: Injector) -> np.ndarray:
        return simulate_reference(injector, SHOT, resolution=EXPLICIT).rate

    alone = [rate(injector) for injector in injectors]
    with ThreadPoolExecutor(4) as pool:
        for one, other in zip(pool.map(rate, injectors), alone, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"method": "euler"}, '"lsoda" or "explicit", .*"euler"'),
        ({"step": 0.0}, "0.1 ns and 100 ns, .* 0 ns"),
        ({"step": float("nan")}, "not nan ns"),
        ({"cells": (0, 10)}, "one cell"),
    ],
)
def test_a_resolution_that_makes_no_sense_is_refused(pwm: Injector, wrong: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        simulate_reference(pwm, SHOT, resolution=EXPLICIT._replace(**wrong))  # type: ignore[arg-type]
