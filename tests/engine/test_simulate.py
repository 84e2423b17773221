"""One injection: two energisings, shifted clocks, replayed traces, horizons."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from commonrail.base.arguments import Quantity
from commonrail.base.choices import Body
from commonrail.base.errors import ConfigurationError
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from tests.tracing import trace_states

POINT = OperatingPoint(160e6, 700e-6)


def distance(one: Solution, other: Solution) -> float:
    """L1 of two rates, relative."""
    return float(np.abs(one.mass_rate - other.mass_rate).sum() / other.mass_rate.sum())


def openings(solution: Solution) -> int:
    """Number of times that the needle rises through 5 um; a closing needle rebounds by less."""
    lift = solution.channels["needle_lift"]
    return int(np.count_nonzero((lift[:-1] <= 5e-6) & (lift[1:] > 5e-6)))


def test_the_fields_of_an_operating_point_may_be_given_in_its_place(regulated: Injector) -> None:
    whole = OperatingPoint("160 MPa", "300 us", "6 MPa", "0.4 MPa", horizon="1 ms")
    apart = simulate(
        regulated,
        rail_pressure="160 MPa",
        energising_time="300 us",
        cylinder_pressure="6 MPa",
        return_pressure="0.4 MPa",
        horizon="1 ms",
    )
    assert apart.point == whole
    np.testing.assert_array_equal(apart.injected, simulate(regulated, whole).injected)
    twice: list[tuple[Quantity, Quantity]] = [(0.0, "250 us"), ("900 us", "300 us")]
    assert simulate(regulated, rail_pressure=120e6, energisings=twice).point == OperatingPoint(120e6, twice)


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"rail_pressure": 160e6},
        {"energising_time": 700e-6},
        {"rail_pressure": 160e6, "energising_time": 700e-6, "energisings": [(0.0, 700e-6)]},
        {"point": POINT, "rail_pressure": 160e6},
        {"point": POINT, "horizon": 1e-3},
    ],
)
def test_a_point_is_given_once_and_whole(regulated: Injector, given: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        simulate(regulated, **given)


def test_two_energisings_make_two_injections(regulated: Injector) -> None:
    point = OperatingPoint(120e6, (Energising(0.0, 300e-6), Energising(1.6e-3, 500e-6)))
    both = simulate(regulated, point)
    assert openings(both) == 2
    first = simulate(regulated, OperatingPoint(120e6, 300e-6)).injected_mass
    middle = np.searchsorted(both.time, 1.6e-3)
    # the first does not know of the second
    assert both.injected[middle] == pytest.approx(first, rel=1e-9)
    assert both.injected_mass > 2 * first


def test_a_short_dwell_joins_two_injections(regulated: Injector) -> None:
    point = OperatingPoint(120e6, (Energising(0.0, 500e-6), Energising(520e-6, 500e-6)))
    assert openings(simulate(regulated, point)) == 1


def test_an_earlier_start_shifts_nothing(regulated: Injector) -> None:
    sealed = regulated.with_values({"plunger_needle.plunger_gap": 0.0, "plunger_needle.needle_gap": 0.0})
    now = simulate(sealed, OperatingPoint(160e6, 700e-6, horizon=2e-3))
    early = simulate(sealed, OperatingPoint(160e6, 700e-6, start=-1e-3, horizon=3e-3))
    assert early.time[0] == -1e-3
    # at rest 1 ms longer: rounding only, of clocks and masses
    assert early.opening == pytest.approx(now.opening, abs=1e-12)
    assert early.closing == pytest.approx(now.closing, abs=1e-12)
    assert early.injected_mass == pytest.approx(now.injected_mass, rel=1e-9)


def test_a_later_energising_shifts_the_injection(regulated: Injector) -> None:
    sealed = regulated.with_values({"plunger_needle.plunger_gap": 0.0, "plunger_needle.needle_gap": 0.0})
    now = simulate(sealed, OperatingPoint(160e6, 700e-6))
    later = simulate(sealed, OperatingPoint(160e6, (Energising(130.4e-6, 700e-6),)))
    # by 130.4 steps, so switching falls elsewhere in a step: an error of the scheme
    assert later.opening - now.opening == pytest.approx(130.4e-6, abs=0.1e-6)
    assert later.closing - now.closing == pytest.approx(130.4e-6, abs=0.5e-6)


def test_a_constant_trace_is_a_constant_pressure(regulated: Injector) -> None:
    traces = OperatingPoint(
        Trace((0.0, 1e-3, 2e-3), (160e6,) * 3), 700e-6, Trace((0.0, 1.0), (5e6,) * 2), Trace((-1.0, 1.0), (0.5e6,) * 2)
    )
    steady, moving = simulate(regulated, POINT), simulate(regulated, traces)
    # the mean of a constant course differs from it by rounding
    assert moving.injected == pytest.approx(steady.injected, rel=1e-9, abs=1e-18)


def test_a_falling_rail_pressure_injects_less(regulated: Injector) -> None:
    falling = OperatingPoint(Trace((0.0, 2e-3), (160e6, 120e6)), 700e-6)
    least = simulate(regulated, OperatingPoint(120e6, 700e-6)).injected_mass
    assert least < simulate(regulated, falling).injected_mass < simulate(regulated, POINT).injected_mass


@pytest.mark.slow  # no other test compiles this wiring
def test_replaying_its_own_current_gives_its_own_rate(regulated: Injector, by_current: Injector) -> None:
    own = simulate(regulated, POINT)
    trace = Trace.of(own.time, own.channels["coil_current"])
    again = simulate(by_current, replace(POINT, drive=trace))
    # the regulator follows a trace with its lag L/(R + G) of 2 us, 5 um of 246 us
    assert again.opening == pytest.approx(own.opening, abs=3e-6)
    assert distance(again, own) < 0.01


def test_replaying_its_own_voltage_gives_its_own_rate(regulated: Injector, by_voltage: Injector) -> None:
    own = simulate(regulated, POINT)
    flux, current = trace_states(regulated, POINT, 1e-6)["solenoid.flux"], own.channels["coil_current"]
    mean = 30.0 * np.diff(flux) / 1e-6 + 0.2 * 0.5 * (current[1:] + current[:-1])  # v = N dφ/dt + R i, Eq. (11)
    # each step's mean as a staircase: two knots a step
    edges = np.repeat(own.time, 2)[1:-1] + np.tile([1e-12, -1e-12], len(mean))
    again = simulate(by_voltage, replace(POINT, drive=Trace.of(edges, np.repeat(mean, 2))))
    # a voltage is integrated, not followed: what is left is 1e-4 of the current
    assert again.opening == pytest.approx(own.opening, abs=0.2e-6)
    assert distance(again, own) < 0.002


def test_without_energising_nothing_is_injected(pwm: Injector) -> None:
    solution = simulate(pwm, OperatingPoint(160e6, ()))
    assert solution.injected_mass == 0.0
    assert np.isnan(solution.opening)
    assert np.isnan(solution.closing)
    assert solution.status is Status.OK


def test_a_short_horizon_is_told(regulated: Injector) -> None:
    assert simulate(regulated, replace(POINT, horizon=900e-6)).status is Status.STILL_INJECTING


def test_stopping_when_closed_keeps_the_figures(regulated: Injector) -> None:
    whole = simulate_batch(regulated, [POINT], stop_when_closed=False)
    stopped = simulate_batch(regulated, [POINT], stop_when_closed=True)
    # what the SAC gives between "0.1 MPa above the cylinder" and the end: 1e-3 of its 0.6 mg
    assert stopped.injected_mass[0, 0] == pytest.approx(whole.injected_mass[0, 0], rel=1e-4)
    assert stopped.opening == whole.opening
    assert stopped.closing == whole.closing


def test_a_rigid_body_has_nothing_to_release(pwm: Injector, rigid: Injector) -> None:
    """The shortened chain must first stretch, which fills the control chamber and delays the needle."""
    assert rigid.variant.body is Body.RIGID
    flexible, stiff = simulate(pwm, POINT), simulate(rigid, POINT)
    # at 160 MPa the plunger's top moves 0.1 mm, 1.5 mm³ of a net outflow of some 20 mm³/ms
    assert 50e-6 < flexible.opening - stiff.opening < 150e-6
    assert stiff.closing < flexible.closing
    assert stiff.injected_mass < flexible.injected_mass


def test_a_compressed_plunger_lifts_its_needle_further(pwm: Injector, rigid: Injector) -> None:
    # the stop holds the top; the chain between top and tip stretches as the control pressure falls
    flexible, stiff = (simulate(i, OperatingPoint(160e6, 2e-3)).channels["needle_lift"].max() for i in (pwm, rigid))
    assert flexible > stiff + 50e-6


def test_samples_are_means_of_the_injected_mass(regulated: Injector) -> None:
    fine, coarse = simulate(regulated, POINT), simulate(regulated, POINT, sample_interval=4e-6)
    means = fine.mass_rate[: 4 * len(coarse.mass_rate)].reshape(-1, 4).mean(axis=1)
    # rounding: differences of an accumulated 4e-5 kg over 1e-6 s
    assert coarse.mass_rate == pytest.approx(means, rel=1e-9, abs=1e-13)


@pytest.mark.parametrize(
    ("step", "interval", "words"),
    [
        ("1.875 us", "3 us", r"3 us .*1\.6 .*1\.875 us; .*1\.875 us .*3\.75 us"),
        ("2 us", "1 us", r"1 us .*0\.5 .*2 us; .*2 us\."),
    ],
)
def test_samples_that_are_no_whole_number_of_steps_are_refused(
    regulated: Injector, step: str, interval: str, words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words):
        simulate(regulated, POINT, time_step=step, sample_interval=interval)


def test_the_times_of_samples_are_as_far_apart_as_asked_for(regulated: Injector) -> None:
    found = simulate(regulated, POINT, time_step="0.7 us", sample_interval="2.1 us")
    assert np.diff(found.time) == pytest.approx(2.1e-6, rel=1e-9)


@pytest.mark.parametrize("step", [0.0, -1e-6, 1e-3, float("nan")])
def test_a_senseless_step_is_refused(regulated: Injector, step: float) -> None:
    with pytest.raises(ConfigurationError, match="time step"):
        simulate(regulated, POINT, time_step=step)


@pytest.mark.parametrize("interval", [float("nan"), float("inf"), 0.0, -1e-6, 1.0])
def test_a_sample_interval_without_sense_is_refused(regulated: Injector, interval: float) -> None:
    with pytest.raises(ConfigurationError, match="sample interval"):
        simulate(regulated, OperatingPoint(160e6, 700e-6), "reference", sample_interval=interval)


def test_no_points_and_no_threads_are_refused(regulated: Injector) -> None:
    with pytest.raises(ConfigurationError, match="operating point"):
        simulate_batch(regulated, [])
    with pytest.raises(ConfigurationError, match="threads"):
        simulate_batch(regulated, [OperatingPoint(160e6, 700e-6)], threads=0)
