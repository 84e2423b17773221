"""Coil current and return flow beside the pressure: rows against the engine, what they teach, logs that are refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.record import from_record
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector
from commonrail.plugins.observer.disturbance import Disturbance
from commonrail.plugins.observer.file import LogColumns, ObservationSummary, read_log
from commonrail.plugins.observer.further import join_covariances
from commonrail.plugins.observer.kalman import Belief, update
from commonrail.plugins.observer.online import Online, observer_texts
from commonrail.plugins.observer.page import observer_html, observer_notes, warning_lines
from commonrail.plugins.observer.response import Response, Simulator
from commonrail.plugins.observer.run import observe
from commonrail.plugins.observer.study import CURRENT_DELAY, METER_GAIN, ObserverSettings, ShotRecord, resolve_states
from tests.child_in_process import read_in_process
from tests.cli.conftest import Command

RATE, CYCLE = 50e3, 15e-3
NOISE = 0.05e6
BOTH = ("current", "return")


def leak(injector: Injector, rail: float) -> float:
    """Leakage of the guides of a closed injector [kg/s]."""
    return simulate(injector, OperatingPoint(rail, 0.0, horizon=1e-3)).returned_mass / 1e-3


def test_rows_are_current_and_return_quantity_of_the_engine(rigid_volume: Injector) -> None:
    """Values, and slopes by the boost voltage and the meter's gain, against `simulate`."""
    settings = ObserverSettings(further=BOTH)
    settings = replace(settings, states=resolve_states(rigid_volume, settings))
    names = [state.name for state in settings.states]
    time = np.arange(-10, 140) / RATE
    shot = ShotRecord(0.0, (Energising(0.0, 600e-6),), time, time, time, dict.fromkeys(BOTH, time), CYCLE)
    rest = 120e6
    found = Simulator(rigid_volume, settings).at(shot, rest, np.zeros(len(names)))
    assert found is not None

    def shown(injector: Injector) -> tuple[Floats, float]:
        solved = simulate(injector, OperatingPoint(rest, 600e-6, horizon=2.8e-3))
        after = leak(injector, rest) * (CYCLE - float(solved.time[-1]))
        return np.interp(time, solved.time, solved.channels["coil_current"]), solved.returned_mass + after

    current, returned = shown(rigid_volume)
    flows = (time >= 0.0) & (time < 600e-6 + 0.3e-3)
    rows = slice(len(time), len(time) + int(flows.sum()))
    assert len(found.shown) == len(time) + int(flows.sum()) + 1
    assert found.shown[rows] == pytest.approx(current[flows], abs=1e-6 * current.max())
    assert found.shown[-1] == pytest.approx(returned, rel=1e-4)
    stronger = rigid_volume.with_values({"drive.boost_voltage": rigid_volume.values["drive.boost_voltage"] * 1.002})
    by_voltage = (shown(stronger)[0] - current)[flows] / 0.002
    assert found.slopes[rows, names.index("boost voltage")] == pytest.approx(by_voltage, abs=0.02 * by_voltage.max())
    gain = found.slopes[:, names.index(METER_GAIN)]
    assert gain[-1] == pytest.approx(returned, rel=1e-4)
    assert not gain[:-1].any()


class Logged(NamedTuple):
    """A log with both further sensors."""

    time: Floats
    pressure: Floats
    energisings: list[tuple[float, float]]
    further: dict[str, Floats]


@pytest.fixture(scope="module")
def log(rigid_volume: Injector) -> Logged:
    """Four shots of a part with 4 % more boost voltage, at half the observer's time step, with noise."""
    voltage = rigid_volume.values["drive.boost_voltage"]
    part, rng = rigid_volume.with_values({"drive.boost_voltage": 1.04 * voltage}), np.random.default_rng(4)
    time = np.arange(round((4 * CYCLE + 4e-3) * RATE)) / RATE
    pressure, current, flow = np.empty(len(time)), np.zeros(len(time)), np.zeros(len(time))
    pulses = [(4e-3 + k * CYCLE, duration) for k, duration in enumerate((700e-6, 800e-6, 500e-6, 900e-6))]
    for (start, duration), rail in zip(pulses, (160e6, 120e6, 140e6, 100e6), strict=True):
        found = simulate(part, OperatingPoint(rail, duration, horizon=duration + 2.2e-3), time_step=0.5e-6)
        since = time - start
        pressure[since > -7e-3] = np.interp(since[since > -7e-3], found.time, found.channels["rail_pressure"])
        current += np.interp(since, found.time, found.channels["coil_current"], left=0.0, right=0.0)
        whole = found.returned_mass + leak(part, rail) * (CYCLE - float(found.time[-1]))
        flow[(since >= 0.0) & (since < CYCLE)] = whole / CYCLE
    pressure += 0.1e9 * ((time + 2e-3) % CYCLE) + NOISE * rng.standard_normal(len(time))
    current += 0.05 * rng.standard_normal(len(time))
    return Logged(time, pressure, pulses, {"current": current, "return": flow})


def test_a_boost_voltage_that_is_off_is_learnt_with_the_current_and_not_without(
    rigid_volume: Injector, log: Logged
) -> None:
    drift = {}
    for further in ({}, {"current": log.further["current"]}, log.further):
        exact = {CURRENT_DELAY: 0.1e-6}
        settings = ObserverSettings(further=tuple(further), current_timing=0.1e-6, deviations=exact)
        found = observe(rigid_volume, *log[:3], settings, further=further, threads=1)
        index = [state.name for state in found.settings.states].index("boost voltage")
        last = found.shots[-1]
        assert last.drift is not None
        assert last.drift_deviations is not None
        drift[tuple(further)] = last.drift[index], last.drift_deviations[index]
        assert max(shot.consistency or 9.0 for shot in found.shots) < 1.5
    truth, before = np.log(1.04), 0.02
    assert drift[()][1] > 0.95 * before
    assert drift[()][0] < 0.25 * truth
    for names in (("current",), BOTH):
        value, deviation = drift[names]
        assert deviation < 0.6 * before
        assert value > 0.4 * truth
        assert value == pytest.approx(truth, abs=2.5 * deviation)
    assert found.settings.current_noise == pytest.approx(0.05, rel=0.1)
    assert all(all(shot.further.values()) for shot in found.shots)
    assert not warning_lines(found.summary)


def test_a_sensor_that_does_not_fit_the_pressure_is_left_out_and_named(rigid_volume: Injector, log: Logged) -> None:
    """Quantities are those without it, a shot without a fault counts, and the report names the sensor."""
    current, flow = log.further["current"], log.further["return"]
    late = np.where(log.time > log.energisings[1][0], 1.5, 1.0)  # from the second shot on
    figures = {}
    for name, further in (
        ("plain", {}),
        ("dead current", {"current": 0.4 * current}),
        ("wrong return flow", {"return": late * flow}),
    ):
        settings = ObserverSettings(further=tuple(further), horizon=1)
        found = observe(rigid_volume, *log[:3], settings, further=further, threads=1)
        figures[name] = [shot.figures[0, 0] for shot in found.shots if shot.figures is not None]
        counts = [list(shot.further.values()) for shot in found.shots]
        lines = " ".join(warning_lines(found.summary))
        if name == "dead current":
            assert counts == [[False]] * 4
            assert figures[name] == pytest.approx(figures["plain"], rel=1e-3)  # peak and hold current are states
            assert "--current" in lines
            assert "4 of 4" in lines
            assert "current" not in " ".join(observer_notes(found.summary))
        if name == "wrong return flow":
            assert counts == [[True], [False], [False], []]
            assert "--return-flow" in lines
            assert "2 of 3" in lines
            assert found.summary.shots[1].further == {"return": False}


def test_what_the_model_lacks_of_the_return_quantity_stays_however_many_shots_there_are(rigid_volume: Injector) -> None:
    """300 readings tell the A-hole's flow, to which they are proportional here, no better than one without noise."""
    settings = ObserverSettings(further=("return",))
    states = tuple(state for state in settings.states if state.name in ("A-hole flow", METER_GAIN))
    time, none = np.arange(-10, 140) / RATE, np.zeros((3, 1, 2))
    shot = ShotRecord(0.0, (Energising(0.0, 600e-6),), time, time, time, {"return": time}, CYCLE)
    reading = np.array([5e-6])
    one = Response(reading, np.array([[5e-6, 5e-6]]), none[..., 0], none, np.zeros(1), np.zeros((1, 2)))
    spread = join_covariances(np.zeros((0, 0)), np.eye(0), settings, shot, reading, time[:0])
    belief = Belief.before(states)
    for _ in range(300):
        done = update(belief, states, reading, lambda _: spread, one.shift, 1)
        assert done is not None
        belief = done.belief
    lacking, before = 0.03, states[0].deviation  # [E], as the page says
    assert belief.covariance[0, 0] > 1.0 / (1.0 / lacking**2 + 1.0 / before**2)


def test_a_return_flow_that_is_off_alike_in_all_shots_is_noticed_by_all_of_them(
    rigid_volume: Injector, log: Logged
) -> None:
    """By a meter of 10 % each shot of 0.7 times the flow may be by chance; two of them may not."""
    settings = ObserverSettings(further=("return",), return_deviation=0.1, horizon=1)
    for factor, counts in ((1.0, [True, True, True]), (0.7, [True, False, False])):
        given = {"return": factor * log.further["return"]}
        found = observe(rigid_volume, *log[:3], settings, further=given, threads=1)
        assert [shot.further.get("return") for shot in found.shots] == [*counts, None]


def test_what_pressures_alone_have_taught_goes_on_with_the_next_log(rigid_volume: Injector, log: Logged) -> None:
    """Two halves of a log give what the whole gives, and deviations are those without the sensor."""
    current = log.further["current"]
    plain = observe(rigid_volume, *log[:3], ObserverSettings(horizon=1), threads=1)
    settings = ObserverSettings(further=("current",), horizon=1, current_noise=0.05, disturbance=plain.disturbance)
    whole = observe(rigid_volume, *log[:3], settings, further={"current": current}, threads=1)
    early = log.time < 4e-3 + 2 * CYCLE - 4e-3  # between the shots
    halves = None
    for own, pulses in ((early, log.energisings[:2]), (~early, log.energisings[2:])):
        given = settings if halves is None else None
        halves = observe(
            *(rigid_volume, log.time[own], log.pressure[own], pulses, given),
            further={"current": current[own]},
            previous=halves,
            threads=1,
        )
    assert halves is not None
    first = np.array([state.deviation for state in whole.settings.states])
    assert halves.memory.alone.mean / first == pytest.approx(whole.memory.alone.mean / first, abs=1e-6)
    index = [state.name for state in whole.settings.states].index("boost voltage")
    without = plain.memory.alone.covariance[index, index] ** 0.5  # the pressure tells little of it
    assert halves.memory.alone.covariance[index, index] ** 0.5 == pytest.approx(without, rel=0.01)
    assert halves.memory.belief.covariance[index, index] ** 0.5 < 0.9 * without


def test_edges_that_are_off_alike_in_all_shots_are_no_boost_voltage(rigid_volume: Injector, log: Logged) -> None:
    """Half a sample of 20 µs by which all energisings are read too early is learnt as such."""
    current = np.interp(log.time - 10e-6, log.time, log.further["current"])
    drift = {}
    for delay in (0.0, 6e-6):
        settings = ObserverSettings(
            further=("current",), current_timing=6e-6, horizon=1, deviations={CURRENT_DELAY: delay}
        )
        found = observe(rigid_volume, *log[:3], settings, further={"current": current}, threads=1)
        learnt = found.shots[-1].drift
        assert learnt is not None
        drift[delay] = dict(zip((state.name for state in found.settings.states), learnt, strict=True))
    assert drift[6e-6][CURRENT_DELAY] == pytest.approx(10e-6, abs=5e-6)
    assert drift[6e-6]["boost voltage"] > drift[0.0]["boost voltage"] + 0.01


def test_a_meter_over_many_cycles_tells_as_much_less(rigid_volume: Injector) -> None:
    """Variance of the return quantity: of the meter times the cycles, and of what the model lacks."""
    time = np.arange(-10, 140) / RATE
    shot = ShotRecord(0.0, (Energising(0.0, 600e-6),), time, time, time, {"return": time}, CYCLE)
    settings = ObserverSettings(further=("return",), return_deviation=0.02, return_shots=9, return_discrepancy=0.03)
    whole = join_covariances(np.eye(2), np.eye(2), settings, shot, np.array([0.0, 0.0, 5e-6]), time[:2])
    assert whole[2, 2] == pytest.approx((0.06**2 + 0.03**2) * 25e-12)
    assert not whole[2, :2].any()


def test_further_sensors_that_do_not_fit_are_refused_in_a_sentence(rigid_volume: Injector, log: Logged) -> None:
    for settings, further, words in (
        (None, {"torque": log.time}, "torque"),
        (None, {"current": log.time[:-1]}, '"current"'),
        (ObserverSettings(further=BOTH), {"current": log.time}, "current, return"),
        (ObserverSettings(further=("current",)), {}, "none"),
        (None, [1.0], "mapping"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            observe(rigid_volume, *log[:3], settings, further=further, threads=1)  # type: ignore[arg-type]
    one, beyond = log.energisings[:1], [log.energisings[0], (log.time[-1] + 1e-3, 5e-4)]
    for further, pulses, words in (
        ({"current": np.full(len(log.time), 0.3)}, log.energisings, "--current"),
        ({"current": -log.further["current"]}, log.energisings, "--current"),
        ({"return": np.where(log.time < 20e-3, log.further["return"], 0.0)}, log.energisings, r"0\.034 s"),
        ({"return": log.further["return"]}, one, "--return-flow"),
        ({"return": log.further["return"]}, beyond, "--return-flow"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            observe(rigid_volume, *log[:2], pulses, further=further, threads=1)
    given = ObserverSettings(further=BOTH, disturbance=Disturbance(1e5, 5e8, 2e-3, 2e4, 1e3, 1e-3), grid=0.05)
    with pytest.raises(ConfigurationError, match="`further`"):
        observer_texts(Online(rigid_volume, given, 1e-5))


def test_the_verb_reads_further_columns(command: Command, tmp_path: Path, log: Logged, rigid_volume: Injector) -> None:
    """A return flow in l/h gives what one in kg/s gives, at the density of the return line."""
    density = float(rigid_volume.fuel.density(0.5e6, rigid_volume.values["fuel.temperature"]))
    on = np.zeros(len(log.time))
    for start, duration in log.energisings:
        on[(log.time >= start) & (log.time < start + duration)] = 1.0
    current, flow = log.further["current"], log.further["return"]
    table = np.array([log.time, log.pressure, on, current, flow, flow / density * 3.6e6]).T
    file, heads = tmp_path / "log.csv", "time [s],pressure [Pa],command,I [A],q [kg/s],v [l/h]"
    np.savetxt(file, table, delimiter=",", header=heads, comments="")
    model = ("--model", "virtual-lino-2016@rigid,volume,regulated")
    said = []
    for column in ("q", "v"):
        done = command("observe", file, *model, "--current", "I", "--return-flow", column, "--json")
        assert done.status == 0, done.err
        said.append(json.loads(done.out))
    assert list(said[0]["further"]) == ["current", "return"]
    assert {"peak current", METER_GAIN} < {state["name"] for state in said[0]["states"]}
    one, other = ([shot["injections"][0]["quantity"] for shot in record["shots"]] for record in said)
    assert one == pytest.approx(other, rel=1e-3)  # roundings grow from shot to shot
    assert all(
        word in " ".join(observer_notes(from_record(ObservationSummary, said[0])))
        for word in ("current", "return flow")
    )
    assert "Return flow" in observer_html(said[0])
    for options, words in (
        (("--current", "pressure"), "Pa"),
        (("--current", "command"), "--current-unit"),
        (("--current", "I", "--current-unit", "mA"), "mA"),
        (("--return-flow", "command"), "--return-unit"),
        (("--return-unit", "kg/s"), "--return-flow"),
        (("--return-flow", "I"), '"I"'),
        (("--return-flow", "none"), '"none"'),
        (("--current-noise", "0.1A"), "--current"),
        (("--return-shots", "5"), "--return-flow"),
        (("--uncertain", "peak current=1%"), "--uncertain peak current: "),
        (("--current", "I", "--online", tmp_path / "o.fmu"), "--online: "),
    ):
        refused = command("observe", file, *model, *options)
        assert refused.status == 2, options
        assert words in refused.sentence
    bare = tmp_path / "bare.csv"
    np.savetxt(bare, table, delimiter=",", header="time [s],pressure [Pa],command,I,q,v", comments="")
    done = command(
        *("observe", bare, *model, "--current", "I", "--current-unit", "A"),
        *("--return-flow", "q", "--return-unit", "kg/s", "--json"),
    )
    assert done.status == 0, done.err
    assert json.loads(done.out)["shots"] == said[0]["shots"]


def test_a_channel_with_a_clock_of_its_own_covers_the_pressure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mean that lacks a sample at the end does; one that ends or begins elsewhere is refused, and a slow current."""
    asammdf = pytest.importorskip("asammdf", reason="the extra mdf is not installed")
    read_in_process(monkeypatch)
    time = np.arange(4000) * 20e-6
    wave = np.abs(np.sin(100.0 * time))
    record = asammdf.MDF()
    for name, unit, own in (
        ("pressure", "Pa", time),
        ("command", "V", time),
        ("current", "A", time),
        ("short", "A", time[:2000]),
        ("elsewhere", "A", time + 1e3),
        ("slow", "A", time[::10]),
        ("mean", "kg/h", time[::500]),
    ):
        record.append([asammdf.Signal(1e8 + 0.0 * own if unit == "Pa" else wave[: len(own)], own, unit, name)])
    file = record.save(tmp_path / "log.mf4")
    columns = LogColumns(further={"current": "current", "return": "mean"})
    assert read_log(Path(file), columns).further["current"] == pytest.approx(wave)
    for name, words in (("short", r"0 to 0\.03998 s"), ("elsewhere", "1000 to"), ("slow", "5 samples")):
        with pytest.raises(InputError, match=f'log.mf4, column "{name}".*{words}'):
            read_log(Path(file), columns._replace(further={"current": name}))
