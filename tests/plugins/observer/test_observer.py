"""Virtual sensor: slopes against differences, quantities of shots whose truth is known, drift, logs, the verb."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.text import MISSING
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector
from commonrail.plugins.observer.design import observer_design
from commonrail.plugins.observer.disturbance import Disturbance
from commonrail.plugins.observer.file import LogColumns, Observation, read_log
from commonrail.plugins.observer.page import observer_html, observer_lines, warning_lines
from commonrail.plugins.observer.response import RATE_STEP, Simulator, find_cuts, find_figures
from commonrail.plugins.observer.run import observe
from commonrail.plugins.observer.study import (
    DELAY,
    GAIN,
    OFFSET,
    STATES,
    DriftState,
    ObserverSettings,
    ShotRecord,
    cut_log,
    resolve_states,
)
from tests.cli.conftest import Command, check_made_again

RATE, CYCLE = 50e3, 15e-3
NOISE = 0.05e6
MM3 = 1e-9


class Logged(NamedTuple):
    """A log with the true quantities (shots,) [m³]."""

    time: Floats
    pressure: Floats
    energisings: list[tuple[float, float]]
    quantities: Floats


def logged(injectors: list[Injector], rails: Floats, durations: Floats) -> Logged:
    """Log of one shot of each injector, at half the observer's time step, with noise and a rising pressure."""
    rng = np.random.default_rng(4)
    count = round((len(rails) * CYCLE + 4e-3) * RATE)
    time, pressure, pulses, quantities = np.arange(count) / RATE, np.empty(count), [], []
    for k, (injector, rail, duration) in enumerate(zip(injectors, rails, durations, strict=True)):
        start = 4e-3 + k * CYCLE
        point = OperatingPoint(float(rail), float(duration), horizon=float(duration) + 2.2e-3)
        found = simulate(injector, point, time_step=0.5e-6)
        first = 0 if k == 0 else round((start - 7e-3) * RATE)
        pressure[first:] = np.interp(time[first:] - start, found.time, found.channels["rail_pressure"])
        pulses.append((start, float(duration)))
        quantities.append(found.injected_volume)
    pressure += 0.1e9 * ((time + 2e-3) % CYCLE) + NOISE * rng.standard_normal(count)
    return Logged(time, pressure, pulses, np.array(quantities))


@pytest.fixture(scope="module")
def part(rigid_volume: Injector) -> Injector:
    """A part with 6 % more nozzle flow, and a spring and a friction that the observer does not estimate."""
    values = rigid_volume.values
    return rigid_volume.with_values(
        {
            "nozzle.hole_diameter": values["nozzle.hole_diameter"] * 1.06**0.5,
            "valve.spring_stiffness": values["valve.spring_stiffness"] * 1.03,
            "feed_pipe.friction_factor": values["feed_pipe.friction_factor"] * 1.2,
        }
    )


RAILS = np.array([160.0, 120.0, 140.0, 100.0]) * 1e6
DURATIONS = np.array([700.0, 800.0, 500.0, 900.0]) * 1e-6


@pytest.fixture(scope="module")
def log(part: Injector) -> Logged:
    """Four shots of the part."""
    return logged([part] * 4, RAILS, DURATIONS)


@pytest.fixture(scope="module")
def observed(rigid_volume: Injector, log: Logged) -> Observation:
    """What is observed of them."""
    return observe(rigid_volume, log.time, log.pressure, log.energisings, threads=1)


def test_quantities_come_nearer_to_the_truth_than_the_model_alone(observed: Observation, log: Logged) -> None:
    """The drop of the pressure tells quantities to the stated deviation; the model alone misses them by 5 %."""
    found = np.array([shot.figures[0, 0] for shot in observed.shots if shot.figures is not None])
    spread = np.array([shot.deviations[0, 0] for shot in observed.shots if shot.deviations is not None])
    alone = np.array([shot.open_loop[0, 0] for shot in observed.shots if shot.open_loop is not None])
    assert np.abs(alone / log.quantities - 1.0).min() > 0.02
    assert np.abs(found - log.quantities).max() < 0.5 * np.abs(alone - log.quantities).max()
    assert np.all(np.abs(found - log.quantities) < 3.0 * spread)
    assert np.all(spread < 0.04 * log.quantities)
    nozzle = observed.shots[-1].drift
    assert nozzle is not None
    assert 0.02 < nozzle[0] < 0.10  # drawn 6 % larger


def test_the_result_does_not_depend_on_threads(rigid_volume: Injector, observed: Observation, log: Logged) -> None:
    again = observe(rigid_volume, log.time, log.pressure, log.energisings, threads=2)
    assert again.rows() == observed.rows()


def test_arrays_have_the_figures_by_shot_and_injection(observed: Observation) -> None:
    data = observed.to_xarray()
    quantities = [shot.figures[0, 0] for shot in observed.shots if shot.figures is not None]
    assert data.quantity.dims == ("shot", "injection")
    assert data.quantity.attrs["units"] == "mm3"
    assert data.quantity.values[:, 0] * MM3 == pytest.approx(quantities)
    assert data.closing.attrs["units"] == "us"
    assert data.rail_pressure.values * 1e6 == pytest.approx([shot.rail_pressure for shot in observed.shots])
    two = observed.shots[0]._replace(energisings=(Energising(0.0, 1e-4), Energising(1e-3, 1e-4)), figures=None)
    mixed = replace(observed, shots=(two._replace(deviations=None, open_loop=None), *observed.shots[1:])).to_xarray()
    assert mixed.start.shape == (len(observed.shots), 2)
    assert np.isnan(mixed.start.values[1:, 1]).all()


def test_slopes_are_those_of_a_changed_part_and_of_the_sensor(rigid_volume: Injector) -> None:
    """Each slope against `simulate` of a changed part, or a changed sensor, written out here."""
    settings = ObserverSettings(averaged=20e-6)
    settings = replace(settings, states=resolve_states(rigid_volume, settings))
    time = np.arange(-10, 140) / RATE
    shot = ShotRecord(0.0, (Energising(0.0, 600e-6),), time, time, time)
    simulator = Simulator(rigid_volume, settings)
    names = [state.name for state in settings.states]
    rest = 120e6
    found = simulator.at(shot, rest, np.zeros(len(names)))
    assert found is not None

    def shown(injector: Injector, gain: float = 0.0, offset: float = 0.0, delay: float = 0.0) -> tuple[Floats, float]:
        true = (rest - offset) / (1.0 + gain)
        solved = simulate(injector, OperatingPoint(true, 600e-6, horizon=3e-3))
        course = np.interp(time - delay, solved.time, solved.channels["rail_pressure"])
        return (1.0 + gain) * course + offset - rest, solved.injected_volume

    middle, quantity = shown(rigid_volume)
    assert found.shown == pytest.approx(middle, abs=1.0)
    assert found.figures[0, 0] == pytest.approx(quantity, rel=1e-6)
    wider = rigid_volume.with_values({"nozzle.hole_diameter": rigid_volume.values["nozzle.hole_diameter"] * 1.005**0.5})
    warmer = rigid_volume.with_values({"fuel.temperature": rigid_volume.values["fuel.temperature"] + 1.0})
    cases = {
        "nozzle flow": (shown(wider), np.log(1.005)),
        "fuel temperature": (shown(warmer), 1.0),
        GAIN: (shown(rigid_volume, gain=1e-3), 1e-3),
        OFFSET: (shown(rigid_volume, offset=0.07e6), 0.07e6),
        DELAY: (shown(rigid_volume, delay=1e-6), 1e-6),
    }
    for name, ((moved, other), step) in cases.items():
        i = names.index(name)
        expected = (moved - middle) / step
        size = np.abs(expected).max()
        assert size > 0.0
        assert found.slopes[:, i] == pytest.approx(expected, abs=0.02 * size), name
        if name != DELAY:
            assert found.figure_slopes[0, 0, i] == pytest.approx((other - quantity) / step, rel=0.02), name
            assert found.rate_slopes[:, i].sum() * RATE_STEP == pytest.approx((other - quantity) / step, rel=0.02), name


def test_the_rate_is_that_of_a_simulation(rigid_volume: Injector) -> None:
    time = np.arange(-10, 140) / RATE
    shot = ShotRecord(0.0, (Energising(0.0, 600e-6),), time, time, time)
    settings = ObserverSettings(states=STATES[:1], averaged=20e-6)
    found = Simulator(rigid_volume, settings).at(shot, 120e6, np.zeros(1))
    assert found is not None
    solved = simulate(rigid_volume, OperatingPoint(120e6, 600e-6, horizon=3e-3))
    each = np.interp(10e-6 * np.arange(len(found.rate) + 1), solved.time, solved.injected)
    volumes = np.diff(each) * solved.injected_volume / each[-1]
    assert found.rate * 10e-6 == pytest.approx(volumes, abs=1e-3 * volumes.max())


def test_a_shot_whose_pressure_drops_out_costs_no_other(rigid_volume: Injector, log: Logged) -> None:
    """Below the pressure in the cylinder no shot can be simulated; where all are so, the reason is the error."""
    pressure = log.pressure.copy()
    pressure[np.abs(log.time - log.energisings[1][0]) < 4e-3] = 0.5e6
    settings = ObserverSettings(noise=NOISE, horizon=2)
    with pytest.warns(RuntimeWarning, match=r"^1 of 4 shots .* cylinder pressure"):
        found = observe(rigid_volume, log.time, pressure, log.energisings, settings, threads=1)
    assert [shot.figures is None for shot in found.shots] == [False, True, False, False]
    with pytest.raises(ConfigurationError, match="cylinder pressure"):
        observe(rigid_volume, log.time, np.full_like(pressure, 0.5e6), log.energisings, settings, threads=1)


def test_a_nozzle_that_wears_raises_an_alarm_and_a_sound_one_does_not(rigid_volume: Injector) -> None:
    worn = rigid_volume.with_values({"nozzle.hole_diameter": rigid_volume.values["nozzle.hole_diameter"] * 1.08**0.5})
    settings = ObserverSettings(learning=2)
    made = logged([rigid_volume] * 5 + [worn] * 5, np.full(10, 140e6), np.full(10, 800e-6))
    found = observe(rigid_volume, made.time, made.pressure, made.energisings, settings, threads=1)
    alarms = {k: shot.alarm for k, shot in enumerate(found.shots) if shot.alarm is not None}
    first = min(alarms)
    assert 5 <= first <= 9
    assert alarms[first].state == "nozzle flow"
    assert first - alarms[first].ago == 5
    assert 0.04 < alarms[first].size < 0.12  # 8 % more


def test_opening_and_closing_are_where_the_rate_crosses_its_level() -> None:
    """A trapezoid of 10 units: its ramps of 100 us cross 2 % after 2 us; the bounce behind it is no injection."""
    time = np.asarray(1e-6 * np.arange(3001), float)
    corners = np.array([0.3, 0.4, 0.8, 0.9, 1.0, 1.05, 1.1, 2.0, 2.1, 2.2, 2.3]) * 1e-3
    rate = np.interp(time, corners, [0, 10, 10, 0, 0, 1.5, 0, 0, 4, 4, 0])
    injected = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) * 1e-6])
    pulses = (Energising(0.0, 500e-6), Energising(1.3e-3, 400e-6))
    found = find_figures(time, injected, find_cuts(time, injected, pulses))
    assert found[0] == pytest.approx([5.0e-3 + 0.075e-3, 0.8e-3], rel=1e-6)
    assert found[1] == pytest.approx([302e-6, 2002e-6], abs=0.05e-6)
    assert found[2] == pytest.approx([898e-6, 2298e-6], abs=0.05e-6)


def test_energisings_are_grouped_to_shots_and_what_is_not_whole_is_left_out() -> None:
    time = np.arange(0.0, 50e-3, 1e-5)
    pulses = tuple(Energising(a, 0.5e-3) for a in (1e-3, 10e-3, 11e-3, 30e-3, 48e-3))
    with pytest.warns(RuntimeWarning, match=r"^2 of 4 shots "):
        shots = cut_log(time, time, pulses, ObserverSettings())
    assert [(shot.start, len(shot.energisings)) for shot in shots] == [(10e-3, 2), (30e-3, 1)]
    assert shots[0].energisings[1].start == pytest.approx(1e-3)
    assert shots[0].quiet.max() < 10e-3  # in this log the pressure is the time
    assert shots[0].time[0] == pytest.approx(-2e-3, abs=2e-5)
    assert shots[0].pressure == pytest.approx(shots[0].time + 10e-3)


def test_an_ideal_rail_and_an_uneven_log_are_refused(rigid: Injector, rigid_volume: Injector) -> None:
    time = np.arange(0.0, 20e-3, 1e-5)
    with pytest.raises(ConfigurationError, match="ideal rail"):
        observe(rigid, time, np.full_like(time, 1e8), [(5e-3, 5e-4)])
    with pytest.raises(ConfigurationError, match="evenly spaced"):
        observe(rigid_volume, time**2 + time, np.full_like(time, 1e8), [(5e-3, 5e-4)])
    with pytest.raises(ConfigurationError, match="one clock"):
        observe(rigid_volume, time, np.full_like(time, 1e8), [(19e-3, 5e-4)])
    with pytest.raises(ConfigurationError, match="nozzle flow"):
        ObserverSettings(deviations={"nozle flow": 0.1})


@pytest.mark.parametrize(("start", "whole"), [(2e-3 - 0.4e-5, True), (2e-3 - 0.6e-5, False)])
def test_half_a_sample_may_be_missing_before_the_first_shot(start: float, whole: bool) -> None:
    time = np.arange(0.0, 20e-3, 1e-5)
    assert bool(cut_log(time, time, (Energising(start, 0.5e-3),), ObserverSettings())) == whole


@pytest.mark.parametrize("rounding", [-1e-15, 1e-15])
def test_a_sample_at_the_start_is_not_at_rest_whatever_its_rounding(rigid_volume: Injector, rounding: float) -> None:
    time = np.arange(0.0, 12e-3, 1.0 / RATE)
    settings = ObserverSettings(states=STATES[:1], iterations=1)
    log = time, 100e6 + 1e9 * time, [(5e-3 + rounding, 500e-6)]
    found = observe(rigid_volume, *log, settings, threads=1)
    expected = 100e6 + 1e9 * (4e-3 - 0.5 / RATE)  # the middle of the 100 samples before it
    assert found.shots[0].rail_pressure == pytest.approx(expected, abs=1.0)


def test_what_cannot_be_observed_is_refused_in_a_sentence(rigid_volume: Injector) -> None:
    time = np.arange(0.0, 20e-3, 1e-5)
    log = time, np.full_like(time, 1e8), [(5e-3, 5e-4)]
    long, longer = ObserverSettings(averaged=1.1e-3), ObserverSettings(averaged=20e-3)
    for settings in (long, longer, ObserverSettings(before=1e-6)):
        with pytest.raises(ConfigurationError, match="`before`"):
            observe(rigid_volume, *log, settings)
    with pytest.raises(ConfigurationError, match="`before`"):
        observer_design(rigid_volume, longer)
    with pytest.raises(ConfigurationError, match="injector"):
        observer_design(None)  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match="settings"):
        observer_design(rigid_volume, {})  # type: ignore[arg-type]
    none = "drift state .*deviation"
    with pytest.raises(ConfigurationError, match=none):
        ObserverSettings(states=())
    with pytest.raises(ConfigurationError, match=none):
        ObserverSettings(deviations={state.name: 0.0 for state in STATES})
    eddy = next(state for state in STATES if state.parameter == "solenoid.eddy_lag")
    with pytest.raises(ConfigurationError, match="drift state"):
        resolve_states(rigid_volume.with_values({"solenoid.eddy_lag": 0.0}), ObserverSettings(states=(eddy,)))
    with pytest.raises(ConfigurationError, match=r"0\.005 s .*1 ns"):
        observe(rigid_volume, *log[:2], [(5e-3, 1e-9)])


NAN = float("nan")


@pytest.mark.parametrize(
    "energisings",
    [None, 5e-3, "5 ms", b"ab", [5e-3], [None], ["ab"], [(5e-3,)], [(5e-3, 5e-4, 1.0)], {5e-3: 5e-4}, [(NAN, 5e-4)]],
)
def test_energisings_that_are_no_pairs_are_refused_with_an_example(rigid_volume: Injector, energisings: Any) -> None:
    time = np.arange(0.0, 20e-3, 2e-5)
    with pytest.raises(ConfigurationError, match="energising"):
        observe(rigid_volume, time, np.full_like(time, 1e8), energisings)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sensor": []}, "sensor"),
        ({"sensor": "nose"}, '"rail".* "nose"'),
        ({"disturbance": {}}, "Disturbance"),
        ({"disturbance": Disturbance(1e5, 1e9, NAN, 1e4, 1e3, 1e-3)}, "memory .*disturbance"),
        ({"disturbance": Disturbance(0.0, 1e9, 2e-3, 1e4, 1e3, 1e-3)}, "noise .*disturbance"),
        ({"states": (DriftState("x", "valve.lift", NAN, 0.1, 0.0, 0.0, 0.0),)}, "power of x"),
        ({"states": (DriftState("x", "valve.lift", 1.0, 0.1, -1.0, 0.0, 0.0),)}, "walk of x"),
        ({"states": (DriftState("x", "valve.lift", 1.0, 0.1, 0.0, 0.0, 0.0, "V"),)}, "unit .*drift state"),
        ({"states": 2 * STATES[:1]}, "1 are repeated"),
        ({"deviations": {"nozzle flow": "1000000%"}}, "nozzle flow"),
        ({"deviations": {"fuel temperature": 1e6}}, "100 K"),
        ({"deviations": {"sensor delay": 1.0}}, "1 ms"),
    ],
)
def test_odd_settings_are_refused_in_a_sentence(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        ObserverSettings(**change)


@pytest.mark.parametrize("parameter", ["", "no.such"])
def test_a_drift_state_of_no_parameter_is_refused(rigid_volume: Injector, parameter: str) -> None:
    state = DriftState("x", parameter, 1.0, 0.1, 0.0, 0.0, 0.0)
    with pytest.raises(ConfigurationError, match='"x"'):
        resolve_states(rigid_volume, ObserverSettings(states=(*STATES[:1], state)))


def test_a_log_says_where_it_is_wrong(rigid_volume: Injector) -> None:
    time = np.arange(0.0, 20e-3, 1e-5)
    uneven, pressure = np.where(time < 9.995e-3, time, time + 1e-4), np.full_like(time, 1e8)
    with pytest.raises(ConfigurationError, match=r"sample 1001 at 0\.0101 s .*110 µs .* 10 µs"):
        observe(rigid_volume, uneven, pressure, [(5e-3, 5e-4)])
    pressure[700] = 1e300
    with pytest.raises(ConfigurationError, match=r"1e\+300 Pa at 0\.007 s"):
        observe(rigid_volume, time, pressure, [(5e-3, 5e-4)])


def test_a_log_without_an_injection_says_so(rigid_volume: Injector) -> None:
    made = logged([rigid_volume] * 2, RAILS[:2], np.full(2, 20e-6))
    found = observe(rigid_volume, made.time, made.pressure, made.energisings, threads=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        observer_html(found.record())
        (line,) = observer_lines(found.summary)
    assert "2 energisings" in line


def test_an_injection_that_does_not_open_has_no_deviation(rigid_volume: Injector) -> None:
    """A pilot of 20 us, before a main injection that has figures and deviations."""
    pulses = (Energising(0.0, 20e-6), Energising(1.2e-3, 600e-6))
    solved = simulate(rigid_volume, OperatingPoint(RAILS[0], pulses, horizon=4.5e-3))
    time = np.arange(0.0, 8e-3, 1.0 / RATE)
    pressure = np.interp(time - 3e-3, solved.time, solved.channels["rail_pressure"])
    pressure += NOISE * np.random.default_rng(8).standard_normal(len(time))
    energisings = [(3e-3 + pulse.start, pulse.duration) for pulse in pulses]
    found = observe(rigid_volume, time, pressure, energisings, threads=1)
    pilot, main = found.rows()
    assert abs(pilot["quantity"]) < 1e-3 * MM3
    assert {pilot[f"{key}_deviation"] for key in ("quantity", "opening", "closing")} == {None}
    assert min(main[f"{key}_deviation"] for key in ("quantity", "opening", "closing")) > 0.0
    (share,) = re.findall(r"median standard deviation of a quantity (\S+) mm³", " ".join(observer_lines(found.summary)))
    assert float(share) == pytest.approx(main["quantity_deviation"] / MM3, rel=0.05)  # of the main injection alone
    page = observer_html(found.record())
    assert f"0.00 ± {MISSING} (" in page
    assert "0.00 ± 0.00" not in page


def written(folder: Path, log: Logged, command: bool = True) -> Path:
    """The log as CSV, with a voltage as command, or without."""
    on = np.zeros(len(log.time))
    for start, duration in log.energisings:
        on[(log.time >= start) & (log.time < start + duration)] = 12.0
    file = folder / "log.csv"
    heads, columns = ["time [ms]", "p [bar]"], [log.time * 1e3, log.pressure * 1e-5]
    if command:
        heads, columns = [*heads, "U [V]"], [*columns, on]
    np.savetxt(file, np.array(columns).T, fmt="%.6f", delimiter=",", header=",".join(heads), comments="")
    return file


def test_energisings_are_read_from_a_command_or_from_a_file(tmp_path: Path, log: Logged) -> None:
    columns = LogColumns(pressure="p", command="U")
    found = read_log(written(tmp_path, log), columns)
    assert found.pressure == pytest.approx(log.pressure, abs=0.1)
    # an edge lies between two samples
    assert np.array(found.energisings) == pytest.approx(np.array(log.energisings), abs=1.01 / RATE)
    (tmp_path / "pulses.csv").write_text("start,duration [us]\n4,700\n19,800\n", encoding="utf-8")
    with pytest.raises(InputError, match=r'pulses.csv.*"start \[us\]"\.$'):  # nor anywhere else
        read_log(written(tmp_path, log, False), columns._replace(energisings=tmp_path / "pulses.csv"))
    (tmp_path / "pulses.csv").write_text("start [ms],duration [us]\n4,700\n19,800\n", encoding="utf-8")
    apart = read_log(written(tmp_path, log, False), columns._replace(energisings=tmp_path / "pulses.csv"))
    assert np.array(apart.energisings) == pytest.approx(np.array([[4e-3, 700e-6], [19e-3, 800e-6]]))
    still = log._replace(energisings=[])
    with pytest.raises(InputError, match="constant"):
        read_log(written(tmp_path, still), columns)


@pytest.mark.parametrize("head", ["I [A]", "I"])
def test_a_current_whose_hold_lies_below_half_of_its_peak_gives_the_energisings(tmp_path: Path, head: str) -> None:
    """Rises of 60 us to 20 A, a hold of 7 A and falls of 30 us."""
    time = np.arange(0.0, 60e-3, 2.5e-6)
    pulses = np.array([[10e-3, 500e-6], [30e-3, 800e-6], [50e-3, 300e-6]])
    current = 0.1 * np.random.default_rng(7).standard_normal(len(time))
    for start, duration in pulses:
        corners = start + np.array([0.0, 60e-6, 150e-6, duration, duration + 30e-6])
        current += np.interp(time, corners, [0.0, 20.0, 7.0, 7.0, 0.0])
    file = tmp_path / "log.csv"
    table = np.array([time, np.full_like(time, 1e8), current]).T
    np.savetxt(file, table, delimiter=",", header=f"time [s],p [Pa],{head}", comments="")
    read = read_log(file, LogColumns(pressure="p", command="I"))
    assert np.array(read.energisings) == pytest.approx(pulses, abs=5e-6)
    assert max(read.errors) <= 5e-6


def test_a_log_of_a_german_logger_is_read_as_by_inspect(tmp_path: Path) -> None:
    """Windows' encoding, semicolons, decimal commas and usual headings; a current sampled at 20 kHz tells no ends."""
    time = np.arange(0.0, 40e-3, 50e-6)
    current = np.zeros_like(time)
    for start in (10e-3, 30e-3):
        corners = start + np.array([0.0, 90e-6, 150e-6, 200e-6, 350e-6, 380e-6])
        current += np.interp(time, corners, [0.0, 18.0, 18.0, 12.0, 12.0, 0.0])
    rows = (f"{t * 1e3:.3f};1000,5;{i:.2f}".replace(".", ",") for t, i in zip(time, current, strict=True))
    file = tmp_path / "log.csv"
    file.write_text("\n".join(["Zeit [ms];Raildruck [bar];Strom Düse [A]", *rows]), encoding="cp1252")
    with pytest.warns(RuntimeWarning, match="Raildruck"):
        read = read_log(file, LogColumns(command="Strom Düse"))
    assert read.time == pytest.approx(time, abs=1e-9)
    assert read.pressure == pytest.approx(np.full(len(time), 100.05e6))
    assert [start for start, _ in read.energisings] == pytest.approx([10e-3, 30e-3], abs=60e-6)
    assert np.isinf(read.errors).all()


def test_shots_of_doubtful_times_are_refused(observed: Observation, log: Logged, rigid_volume: Injector) -> None:
    errors = [0.0] * len(log.energisings)
    errors[1], errors[-1] = 6e-6, np.inf
    with pytest.warns(RuntimeWarning, match="refused"):
        sure = observe(rigid_volume, log.time, log.pressure, log.energisings, errors=errors, threads=1)
    whole = [shot.start for shot in observed.shots]
    assert [shot.start for shot in sure.shots] == [whole[0], *whole[2:-1]]
    with pytest.raises(ConfigurationError):
        observe(rigid_volume, log.time, log.pressure, log.energisings, errors=[np.inf] * len(errors), threads=1)


@pytest.mark.parametrize("current", [False, True])
def test_a_shot_whose_energising_the_log_cuts_is_counted_as_not_whole(tmp_path: Path, current: bool) -> None:
    """A pilot before the log and a main 1 ms behind it are one shot; the last energising goes on behind the log."""
    time = np.arange(0.0, 30e-3, 1e-5)
    on = np.zeros_like(time)
    for start, end in ((-1e-3, 0.1e-3), (2.5e-3, 3e-3), (12e-3, 12.5e-3), (29.5e-3, 31e-3)):
        on[(time >= start) & (time < end)] = 1.0
        on[(time >= start + 150e-6) & (time < end)] = 0.4 if current else 1.0
    table = np.array([time, np.full_like(time, 1e8), on]).T
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="time [s],pressure [Pa],command", comments="")
    read = read_log(tmp_path / "log.csv", LogColumns())
    assert len(read.energisings) == 4
    with pytest.warns(RuntimeWarning, match=r"^2 of 3 shots "):
        shots = cut_log(read.time, read.pressure, tuple(Energising(*p) for p in read.energisings), ObserverSettings())
    assert [len(shot.energisings) for shot in shots] == [1]
    assert shots[0].start == pytest.approx(12e-3, abs=3e-5)


def test_a_log_of_few_samples_is_refused(rigid_volume: Injector) -> None:
    for rate, words in ((19e3, "needs 20"), (20e3, "one clock")):
        time = np.arange(0.0, 20e-3, 1.0 / rate)
        with pytest.raises(ConfigurationError, match=words):
            observe(rigid_volume, time, np.full_like(time, 1e8), [(19e-3, 5e-4)])


def test_a_wrong_rail_volume_or_unit_is_told(observed: Observation, log: Logged, rigid_volume: Injector) -> None:
    assert warning_lines(observed.summary) == []
    larger = rigid_volume.with_values({"rail.volume": 3.0 * rigid_volume.values["rail.volume"]})
    found = observe(larger, log.time, log.pressure, log.energisings, threads=1)
    words = " ".join(warning_lines(found.summary))
    assert "not use" in words or "no quantity" in words
    assert f"{larger.values['rail.volume'] * 1e6:.4g} cm³" in words
    assert "✓" not in re.sub("<script.*?</script>", "", observer_html(found.record()), flags=re.S)
    shots = tuple(shot._replace(rail_pressure=1e-2 * shot.rail_pressure) for shot in found.shots)
    assert "usual" in warning_lines(replace(found, shots=shots).summary)[0]


def test_an_alarm_of_a_state_far_off_needs_more_than_four_deviations(observed: Observation) -> None:
    states, last = observed.settings.states, observed.shots[-1]
    assert last.drift is not None
    is_lift = np.array([state.name == "valve lift" for state in states])
    (deviation,) = (state.deviation for state in states if state.name == "valve lift")
    for share, told in ((3.9, 0), (-4.1, 1)):
        shot = last._replace(drift=np.where(is_lift, share * deviation, last.drift))
        summary = replace(observed, shots=(*observed.shots[:-1], shot)).summary
        assert sum("Valve lift" in line for line in warning_lines(summary)) == told


def test_the_verb_leaves_a_report(command: Command, tmp_path: Path, log: Logged) -> None:
    file, folder = written(tmp_path, log), tmp_path / "out"
    options = ("--pressure", "p", "--command", "U", "--cylinder-pressure", "5MPa", "--return-pressure", "0.5MPa")
    model = "virtual-lino-2016@rigid,volume,regulated"
    done = command("observe", file, "--model", model, *options, "--uncertain", "fuel temperature=0K", "--out", folder)
    assert done.status == 0, done.err
    assert "4 shots with 4 injections" in done.out
    assert "fuel temperature" not in done.out
    rows = (folder / "observer.csv").read_text(encoding="utf-8").splitlines()
    assert len([row for row in rows if not row.startswith("#")]) == 5
    assert "the drift" in (folder / "report.html").read_text(encoding="utf-8")
    assert f"commonrail observe {file} --model {model}" in unescape((folder / "report.html").read_text("utf-8"))
    check_made_again(command, folder)
    assert "LOG" in command("observe", "--design", file, "--model", model).sentence
    bare = tmp_path / "bare.csv"
    bare.write_text(file.read_text("utf-8").replace("p [bar]", "p"), encoding="utf-8")
    assert "--pressure-unit" in command("observe", bare, "--model", model, "--pressure", "p", "--command", "U").sentence
    assert "--noise" in command("observe", "--design", "--model", model, "--noise", "0.1MPa").err
    for wrong, words in (
        (("--model", "virtual-lino-2016"), "ideal rail"),
        (("--model", model, "--uncertain", "nozzle=3%"), "--uncertain nozzle=3%: "),
        (("--model", model, *2 * ("--uncertain", "nozzle flow=3%")), "'--uncertain'"),
        (("--model", model, "--uncertain", "nozzle flow=1000000%"), "nozzle flow"),
        (("--model", model, "--energisings", file, "--command", "I"), "--command: "),
    ):
        refused = command("observe", file, *wrong, *(options if "--energisings" not in wrong else options[:2]))
        assert refused.status == 2
        assert words in refused.err


def test_a_design_is_worse_with_noise_and_better_where_the_sensor_is_known(rigid_volume: Injector) -> None:
    rows = observer_design(rigid_volume)
    for key in ("quantity", "closing", "nozzle_flow"):
        by_noise = [getattr(row, key) for row in rows if row.rate == 50e3]
        assert by_noise == sorted(by_noise)
        assert 0.0 < by_noise[0] < by_noise[-1]
    known = observer_design(rigid_volume, ObserverSettings(deviations={"sensor gain": 0.0, "fuel temperature": 0.0}))
    assert known[0].quantity < 0.9 * rows[0].quantity
    fixed = observer_design(rigid_volume, ObserverSettings(deviations={"nozzle flow": 0.0}))
    assert {row.nozzle_flow for row in fixed} == {0.0}
