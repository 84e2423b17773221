"""Observer without Python: its library and FMU against the Python observer, its work in slices, what it refuses."""

from __future__ import annotations

import ctypes
import re
import zipfile
from collections.abc import Iterator
from ctypes import POINTER, Structure, byref, c_double, c_int, c_size_t, c_void_p
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from commonrail.plugins.export.object_files import find_target
from commonrail.plugins.observer.disturbance import Disturbance
from commonrail.plugins.observer.file import Observation
from commonrail.plugins.observer.online import (
    GRID,
    INJECTIONS,
    Online,
    observer_texts,
    online_variables,
    write_observer_fmu,
    write_observer_library,
)
from commonrail.plugins.observer.run import observe
from commonrail.plugins.observer.study import STATES, ObserverSettings, resolve_states
from tests.cli.conftest import Command
from tests.exporting import usable_platform

SAMPLING, CYCLE = 20e-6, 20e-3
SETTINGS = ObserverSettings(
    disturbance=Disturbance(0.07e6, 0.5e9, 2e-3, 0.02e6, 1e3, 1e-3),
    learning=0,
    horizon=1,
    significance=1.0,
    window=2,
    states=tuple(state._replace(limit=3e-3 if state.name == "nozzle flow" else 0.0) for state in STATES),
    iterations=2,
    grid=GRID,
)
SHOTS = 6  # of the log
BAD_MEMORY = 18  # of the header of the library
WORK = 100.0  # so much that shots 20 ms apart are evaluated in time


class Logged(NamedTuple):
    """Times [s], pressure [Pa], shares of the intervals that end with the samples, energisings [s]."""

    time: Floats
    pressure: Floats
    command: Floats
    energisings: list[tuple[float, float]]


@pytest.fixture(scope="module")
def log(rigid_volume: Injector) -> Logged:
    """Single injections and pairs; edges on samples and between; a nozzle that wears; a shot beside another's."""
    rng = np.random.default_rng(5)
    count = round((SHOTS * CYCLE + 8e-3) / SAMPLING)
    time, pressure, pulses = SAMPLING * np.arange(count), np.empty(count), []
    diameter = rigid_volume.values["nozzle.hole_diameter"]
    for k in range(SHOTS):
        own = [(0.0, 600e-6)] if k % 2 == 0 else [(0.0, 350e-6), (1.2e-3, 700e-6)]
        start = round((4e-3 + k * CYCLE) / SAMPLING) * SAMPLING + (0.37 * SAMPLING if k % 2 else 0.0)
        part = rigid_volume.with_values({"nozzle.hole_diameter": diameter * (1.06 if k > 2 else 1.01)})
        found = simulate(part, OperatingPoint(90e6 + 20e6 * (k % 3), own, horizon=5e-3))
        first = 0 if k == 0 else round((start - 5e-3) / SAMPLING)
        pressure[first:] = np.interp(time[first:] - start, found.time, found.channels["rail_pressure"])
        if k == SHOTS - 2:
            pressure[first:] -= np.where(time[first:] > start + 0.5e-3, 4e6, 0.0)
        pulses += [(start + begin, duration) for begin, duration in own]
    pressure += 0.05e6 * rng.standard_normal(count)
    command = np.zeros(count)
    for begin, duration in pulses:
        both = np.minimum(time, begin + duration) - np.maximum(time - SAMPLING, begin)
        command += np.clip(both / SAMPLING, 0.0, 1.0)
    return Logged(np.asarray(time), pressure, command, pulses)


@pytest.fixture(scope="module")
def by_python(rigid_volume: Injector, log: Logged) -> Observation:
    return observe(rigid_volume, log.time, log.pressure, log.energisings, SETTINGS, threads=1)


class Library:
    """Functions of the observer, by ctypes."""

    def __init__(self, injector: Injector, folder: Path) -> None:
        own = usable_platform()
        online = Online(injector, SETTINGS, SAMPLING)
        written = write_observer_library(online, folder, [find_target(own)])
        self.dll, self.name = ctypes.CDLL(str(written.shared[own])), written.model.name
        self.fields = [v.name for v in online_variables(online) if v.kind.causality == "output"]
        number = [(str(i), c_double) for i in range(len(self.fields))]
        self.observed = type("Observed", (Structure,), {"_fields_": number})
        self.size = self._function("size", c_size_t)()
        self.begin = self._function("begin", c_int, c_void_p, c_size_t, c_double)
        self.step = self._function("step", c_int, c_void_p, c_double, c_double)
        self._read = self._function("read", None, c_void_p, POINTER(self.observed))

    def _function(self, name: str, result: Any, *arguments: Any) -> Any:
        found = getattr(self.dll, f"{self.name}_observer_{name}")
        found.restype, found.argtypes = result, arguments
        return found

    def begun(self, work: float = WORK) -> Any:
        """Memory of an observer that has begun."""
        memory = (c_double * (self.size // 8))()
        assert self.begin(memory, self.size, work) == 0
        return memory

    def read(self, memory: Any) -> dict[str, float]:
        out = self.observed()
        self._read(memory, byref(out))
        return dict(zip(self.fields, (getattr(out, name) for name, *_ in out._fields_), strict=True))

    def shots(self, memory: Any, log: Logged) -> Iterator[dict[str, float]]:
        """What is read after each shot."""
        done = 0.0
        for pressure, command in zip(log.pressure.tolist(), log.command.tolist(), strict=True):
            assert self.step(memory, pressure, command) == 0
            found = self.read(memory)
            if found["shots"] > done:
                done = found["shots"]
                yield found


@pytest.fixture(scope="module")
def library(rigid_volume: Injector, tmp_path_factory: pytest.TempPathFactory) -> Library:
    return Library(rigid_volume, tmp_path_factory.mktemp("library"))


def check_alike(found: list[dict[str, float]], expected: Observation) -> None:
    """All numbers to 1e-9, states relative to their deviations."""
    states = expected.settings.states
    for one, shot in zip(found, expected.shots, strict=True):
        assert shot.figures is not None
        assert shot.deviations is not None
        assert shot.drift is not None
        assert shot.drift_deviations is not None
        count = shot.figures.shape[1]
        assert (one["valid"], one["injections"]) == (1.0, count)
        for row, name in enumerate(("quantity", "opening", "closing")):
            keys = [f"injection[{i + 1}].{name}" for i in range(count)]
            assert [one[key] for key in keys] == pytest.approx(shot.figures[row], rel=1e-9, nan_ok=True)
            assert [one[f"{key}_deviation"] for key in keys] == pytest.approx(
                shot.deviations[row], rel=1e-9, nan_ok=True
            )
        drift = [one[key] for key in one if key.startswith("drift.")]
        assert np.abs((drift - shot.drift) / shot.drift_deviations).max() < 1e-9
        assert [one[key] for key in one if key.startswith("drift_d")] == pytest.approx(shot.drift_deviations, rel=1e-9)
        assert one["consistency"] == pytest.approx(shot.consistency, rel=1e-9)
        assert one["rail_pressure"] == pytest.approx(shot.rail_pressure, rel=1e-9)
        assert one["start"] == pytest.approx(shot.start, abs=1e-12)
        assert (states[int(one["alarm"]) - 1].name if one["alarm"] else None) == (shot.alarm and shot.alarm.state)
        if shot.alarm:
            assert one["alarm_ago"] == shot.alarm.ago
            assert (one["alarm_size"], one["alarm_deviation"]) == pytest.approx(shot.alarm[2:], rel=1e-9)


def test_the_library_finds_what_python_finds(library: Library, log: Logged, by_python: Observation) -> None:
    # what is compared holds all that a filter does; the alarm is of a shot before, when the window has moved on
    assert [shot.alarm.ago for shot in by_python.shots if shot.alarm] == [1]
    assert any(shot.consistency is not None and shot.consistency > 3.0 for shot in by_python.shots)
    memory = library.begun()
    check_alike(list(library.shots(memory, log)), by_python)
    last = library.read(memory)
    assert (last["missed"], last["failed"]) == (0.0, 0.0)


def test_an_injection_that_does_not_open_has_no_deviations(rigid_volume: Injector, library: Library) -> None:
    time = SAMPLING * np.arange(1000)
    pressure = 90e6 + 0.05e6 * np.random.default_rng(3).standard_normal(len(time))
    command = np.zeros(len(time))
    command[201:203] = 1.0
    given = Logged(np.asarray(time), pressure, command, [(200 * SAMPLING, 2 * SAMPLING)])
    expected = observe(rigid_volume, time, pressure, given.energisings, SETTINGS, threads=1)
    found = list(library.shots(library.begun(), given))
    assert np.isnan(found[0]["injection[1].quantity_deviation"])
    check_alike(found, expected)


def test_the_fmu_finds_what_python_finds(
    rigid_volume: Injector, log: Logged, by_python: Observation, tmp_path: Path
) -> None:
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    online, path = Online(rigid_volume, SETTINGS, SAMPLING), tmp_path / "observer.fmu"
    write_observer_fmu(online, path, [find_target(usable_platform())])
    assert not validate_fmu(str(path))
    given = np.zeros(len(log.time) - 1, [("time", float), ("pressure", float), ("command", float)])
    # an importer holds an input over the step that follows
    given["time"], given["pressure"], given["command"] = log.time[:-1], log.pressure[:-1], log.command[1:]
    names = [v.name for v in online_variables(online) if v.kind.causality == "output"]
    found = fmpy.simulate_fmu(
        str(path),
        input=given,
        output=names,
        start_values={"work": WORK},
        step_size=SAMPLING,
        output_interval=SAMPLING,
        stop_time=given["time"][-1],
        fmi_type="CoSimulation",
    )
    rows = [found[np.searchsorted(found["shots"], k + 1)] for k in range(int(found["shots"][-1]))]
    check_alike([{name: float(row[name]) for name in names} for row in rows], by_python)


def test_an_edge_that_is_smeared_over_samples_is_one_edge(library: Library, log: Logged) -> None:
    """As an importer interpolates: half a sample later, with as many injections of the same durations."""
    smeared = 0.5 * (log.command + np.append(0.0, log.command[:-1]))
    later = np.append(log.pressure[0], 0.5 * (log.pressure[1:] + log.pressure[:-1]))
    count = round((4e-3 + 2 * CYCLE) / SAMPLING)
    sharp, found = (
        list(library.shots(library.begun(), Logged(log.time, pressure[:count], command[:count], [])))
        for pressure, command in ((log.pressure, log.command), (later, smeared))
    )
    assert [one["injections"] for one in found] == [one["injections"] for one in sharp] == [1.0, 2.0]
    for one, other in zip(found, sharp, strict=True):
        assert one["injection[1].quantity"] == pytest.approx(other["injection[1].quantity"], rel=0.01)
        assert one["start"] == pytest.approx(other["start"] + 0.5 * SAMPLING, abs=1e-9)


def test_a_copy_of_the_memory_goes_on_alike(library: Library, log: Logged) -> None:
    """Copied while a shot is evaluated, to another place."""
    memory = library.begun(30.0)
    at = round(9e-3 / SAMPLING)
    for i in range(at):
        library.step(memory, log.pressure[i], log.command[i])
    assert library.read(memory)["shots"] == 0.0
    copy = (c_double * (library.size // 8 + 1))()
    beside = ctypes.addressof(copy) + 8
    ctypes.memmove(beside, memory, library.size)
    for i in range(at, at + 1000):
        library.step(memory, log.pressure[i], log.command[i])
        library.step(beside, log.pressure[i], log.command[i])
    found = library.read(memory)
    assert found["shots"] == 1.0
    np.testing.assert_equal(library.read(beside), found)


def test_no_step_does_much_more_than_it_may(library: Library, log: Logged) -> None:
    """Less work a step: the same shots later; too little: the next shot is missed and counted."""
    memory, slow = library.begun(15.0), library.begun(0.5)
    (first, *_) = library.shots(memory, log)
    assert first["longest"] < 15.0 + 60.0
    assert first["shots"] == 1.0
    assert list(library.shots(slow, log)) == []
    assert library.read(slow)["missed"] == SHOTS - 1


def test_shots_that_do_not_fit_are_missed_and_counted(library: Library, log: Logged) -> None:
    memory = library.begun()
    command = np.zeros(1500)
    command[200:900:50] = 1.0  # 14 energisings 1 ms apart
    for share in command.tolist():
        library.step(memory, 100e6, share)
    found = library.read(memory)
    assert (found["missed"], found["shots"]) == (1.0, 0.0)


def test_a_shot_that_cannot_be_simulated_has_no_figures(library: Library, log: Logged) -> None:
    """The rail's pressure is that of the cylinder behind a pair with an alarm; the states stay as they were."""
    memory = library.begun()
    *_, before = library.shots(memory, log)
    assert (before["valid"], before["failed"], before["injections"]) == (1.0, 0.0, 2.0)
    assert before["alarm"] > 0.0
    for share in log.command[:700].tolist():
        library.step(memory, 5e6, share)
    found = library.read(memory)
    assert (found["failed"], found["shots"], found["valid"], found["missed"]) == (1.0, SHOTS + 1.0, 0.0, 0.0)
    assert found["start"] == pytest.approx(len(log.time) * SAMPLING + log.energisings[0][0])
    assert found["injections"] == 1.0
    assert found["rail_pressure"] == pytest.approx(5e6)
    assert [found[key] for key in found if key.startswith("alarm_")] + [found["alarm"]] == [0.0] * 4
    assert np.isnan([found["consistency"], *(found[key] for key in found if key.startswith("injection["))]).all()
    assert [found[key] for key in found if key.startswith("drift")] == [
        before[key] for key in before if key.startswith("drift")
    ]


def test_a_number_that_no_sensor_shows_is_told(library: Library) -> None:
    memory = library.begun()
    assert library.step(memory, 100e6, 0.0) == 0
    assert library.step(memory, float("nan"), 0.0) != 0
    assert library.step(memory, 1e160, 0.0) != 0  # whose square is none
    assert library.begin(memory, 8, 0.0) != 0


@pytest.mark.parametrize("work", [float("nan"), float("inf"), -1.0, 0.0])
def test_a_work_that_bounds_no_step_is_refused(library: Library, work: float) -> None:
    """Zero is the usual work; a parameter of the FMU that is outside its domain has that status too."""
    memory = (c_double * (library.size // 8))()
    assert library.begin(memory, library.size, work) == (0 if work == 0.0 else Status.OUTSIDE_DOMAIN)


def test_memory_that_is_not_aligned_for_doubles_is_refused(library: Library) -> None:
    memory = (c_double * (library.size // 8 + 1))()
    place = ctypes.addressof(memory)
    assert library.begin(place + 4, library.size, 0.0) == BAD_MEMORY
    assert library.begin(place + 8, library.size, 0.0) == 0


def test_the_verb_writes_an_fmu_at_the_rate_of_the_log(command: Command, log: Logged, tmp_path: Path) -> None:
    usable_platform()
    table = np.column_stack([log.time * 1e3, log.pressure * 1e-5, log.command > 0.5])[:1100]
    np.savetxt(tmp_path / "log.csv", table, "%.5f", ",", header="time [ms],pressure [bar],command", comments="")
    model = "virtual-lino-2016@rigid,volume,regulated"
    given = "observe", tmp_path / "log.csv", "--model", model, "--online"
    done = command(*given, tmp_path / "made.FMU")
    assert done.status == 0, done.err
    assert "every 20 µs" in done.err
    with zipfile.ZipFile(tmp_path / "made.FMU") as archive:
        (name,) = (n for n in archive.namelist() if n.endswith("observer.h"))
        text = archive.read(name).decode()
    (found,) = re.findall(r"_SAMPLING (\S+)\n", text)
    assert float(found) == pytest.approx(SAMPLING, rel=1e-6)
    assert "--online" in command(*given, tmp_path / "log.csv").sentence
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    bare = "observe", tmp_path / "none.csv", "--model", model, "--online"  # refused before the log is read
    assert f"--online: {tmp_path / 'full'} " in command(*bare, tmp_path / "full").sentence
    assert "nodir.so" in command(*bare, tmp_path / "nodir.so").sentence
    assert not (tmp_path / "nodir.so").exists()
    assert "none.csv" in command(*bare, tmp_path / "new").sentence
    assert "--online" in command("observe", "--design", "--model", model, "--online", tmp_path / "x").err


def test_the_header_has_room_for_the_states(rigid_volume: Injector) -> None:
    text = observer_texts(Online(rigid_volume, SETTINGS, SAMPLING))["observer.h"]
    assert f"#define CR_STATES {len(resolve_states(rigid_volume, SETTINGS))}\n" in text
    assert f"#define CR_MOST_INJECTIONS {INJECTIONS}\n" in text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"disturbance": None}, "disturbance"),
        ({"after": 2.96e-3}, "`after`"),
    ],
)
def test_what_cannot_run_online_is_refused(rigid_volume: Injector, change: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        observer_texts(Online(rigid_volume, replace(SETTINGS, **change), SAMPLING))
