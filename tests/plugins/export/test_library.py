"""The exported library against the lanes, and what it promises of its memory."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.choices import Actuation, Body, Boundary, Drive
from commonrail.engine import plan
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.plan import admissible
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.status import Status
from commonrail.physics.injector import FUEL_TEMPERATURE
from commonrail.plugins.export.library import write_library
from commonrail.plugins.export.object_files import find_target
from commonrail.readers.injector import load_injector
from tests.conftest import DRAWN
from tests.plugins.export.native import Native, Run

BOUNDARY = (160e6, 5e6, 0.5e6, 0.0)
# The compiler contracts products and sums in other places than in the lanes, and the contacts of valve and needle
# amplify that rounding: 1e-13 measured.
ROUNDING = 1e-11
# Of instants and masses of candidates with other parameters; a chattering needle amplifies more: 3e-13 measured.
CANDIDATES = 1e-10


@pytest.fixture(scope="module")
def injector():
    return load_injector(DRAWN)


def deviations(solution, courses):
    """Largest deviation of each channel, relative to its peak."""
    expected = {**solution.channels, "injected": solution.injected}
    peaks = {name: float(np.max(np.abs(values))) for name, values in expected.items()}
    return {
        name: float(np.max(np.abs(courses[name] - values)) / max(peaks[name], 1e-300))
        for name, values in expected.items()
    }


def inputs_of(injector, point, step=1e-6):
    """Inputs of each step, as the lanes have them."""
    return plan.prepare(injector, [point], step).courses.inputs[0]


def test_an_injection_has_the_channels_of_the_lanes(native: Native, injector):
    solution = simulate(injector, OperatingPoint(160e6, 700e-6, horizon=2e-3))
    run = Run(native, BOUNDARY)
    assert run.plan((0.0, 700e-6)) == 0
    found = deviations(solution, run.courses(2000))
    assert len(found) == 12
    assert max(found.values()) < ROUNDING, found
    figures = run.figures()
    assert figures.opening == pytest.approx(solution.opening, rel=ROUNDING)
    assert figures.closing == pytest.approx(solution.closing, rel=ROUNDING)
    assert figures.returned == pytest.approx(solution.returned_mass, rel=ROUNDING)
    # the density of the fuel's polynomials, not of its laws: docs/theory/fuel.md
    assert figures.reference_density == pytest.approx(solution.reference_density, rel=1e-5)


def test_a_train_has_the_clock_of_the_lanes(native: Native, injector):
    # the second begins in the step in which the first ends, the third where no step begins
    energisings = ((0.0, 200.3e-6), (200.7e-6, 100e-6), (900.25e-6, 300e-6))
    point = OperatingPoint(120e6, [Energising(*one) for one in energisings], horizon=2e-3)
    planned, given = Run(native, (120e6, 5e6, 0.5e6, 0.0)), Run(native, (120e6, 5e6, 0.5e6, 0.0))
    assert planned.plan(*energisings) == 0
    planned.march(2000)
    given.march_inputs(inputs_of(injector, point))
    assert planned.observe() == given.observe()
    assert planned.figures().injected == pytest.approx(simulate(injector, point).injected_mass, rel=ROUNDING)


def test_a_measured_rail_pressure_goes_in_step_by_step(native: Native, injector):
    rail = Trace.of([0.0, 0.5e-3, 1e-3, 2e-3], [140e6, 130e6, 138e6, 135e6])
    point = OperatingPoint(rail, 500e-6, horizon=1.5e-3)
    solution = simulate(injector, point)
    start = point.initial_pressures()
    run = Run(native, (*start, 0.0))
    assert run.march_inputs(inputs_of(injector, point)) == 0
    assert run.figures().injected == pytest.approx(solution.injected_mass, rel=ROUNDING)
    assert run.observe()["sac_pressure"] == pytest.approx(solution.channels["sac_pressure"][-1], rel=ROUNDING)


def test_candidates_have_the_figures_of_the_lanes(native: Native, injector):
    rng = np.random.default_rng(7)
    names = [name for name, value in injector.values.items() if value != 0.0 and name not in ("nozzle.holes",)]
    own = np.array([injector.values[name] for name in names])
    values = own * rng.uniform(0.95, 1.05, (40, len(own)))
    values = values[admissible(names, values, injector.fuel)]
    assert len(values) > 10
    point = OperatingPoint(100e6, 500e-6, horizon=2e-3)
    batch = simulate_batch(injector, [point], names, values, threads=1, stop_when_closed=False)
    compared = 0
    for i, candidate in enumerate(values):
        run = Run(native, (100e6, 5e6, 0.5e6, 0.0), values=dict(zip(names, candidate, strict=True)))
        run.plan((0.0, 500e-6))
        run.march(2000)
        status = Status(int(batch.status[i, 0]))
        assert run.native.status(run.state) == status
        if not status.failed:
            figures, compared = run.figures(), compared + 1
            assert figures.injected == pytest.approx(batch.injected_mass[i, 0], rel=CANDIDATES)
            assert figures.opening == pytest.approx(batch.opening[i, 0], rel=CANDIDATES, nan_ok=True)
            assert figures.closing == pytest.approx(batch.closing[i, 0], rel=CANDIDATES, nan_ok=True)
    assert compared > 5


@pytest.mark.parametrize("temperature", [293.15, 333.0, 393.15])
def test_the_temperature_of_the_fuel_is_set_at_run_time(native: Native, injector, temperature):
    warm = injector.with_values({FUEL_TEMPERATURE: temperature})
    solution = simulate(warm, OperatingPoint(160e6, 400e-6, horizon=1e-3))
    run = Run(native, BOUNDARY, values={FUEL_TEMPERATURE: temperature})
    run.plan((0.0, 400e-6))
    run.march(1000)
    assert run.figures().injected == pytest.approx(solution.injected_mass, rel=ROUNDING)


def test_switching_is_planning(native: Native):
    planned, switched = Run(native, BOUNDARY), Run(native, BOUNDARY)
    planned.plan((10.4e-6, 300.2e-6))
    switched.march(10)
    assert switched.native.switch(switched.state, 10.4e-6, 1) == 0
    switched.march(300)
    assert switched.native.switch(switched.state, 310.6e-6, 0) == 0
    planned.march(900)
    switched.march(590)
    # 10.4 us + 300.2 us is 310.6 us but for a rounding
    assert switched.figures().injected == pytest.approx(planned.figures().injected, rel=ROUNDING)
    assert planned.figures().injected > 1e-6


def test_the_instants_are_those_of_the_last_switched_injection(native: Native):
    run, first = Run(native, BOUNDARY), Run(native, BOUNDARY)
    first.plan((0.0, 400e-6))
    first.march(1500)
    for start in (0, 2000):
        run.march(start - round(native.time(run.state) * 1e6))
        assert native.switch(run.state, start * 1e-6, 1) == 0
        run.march(400)
        assert native.switch(run.state, (start + 400) * 1e-6, 0) == 0
        run.march(1100)
        opening = run.figures().opening - start * 1e-6
        # the waves of the first injection are still in the pipe when the second begins
        assert opening == pytest.approx(first.figures().opening, rel=0.0 if start == 0 else 0.1, abs=1e-12)


def test_two_simulations_in_turns_and_in_threads_do_not_touch(native: Native):
    alone, beside, other = Run(native, BOUNDARY), Run(native, BOUNDARY), Run(native, (80e6, 5e6, 0.5e6, 0.0))
    for run in (alone, beside, other):
        run.plan((0.0, 500e-6))
    for _ in range(100):
        beside.march(7)
        other.march(7)
    alone.march(700)
    assert beside.observe() == alone.observe() != other.observe()
    pressures = [60e6 + 20e6 * i for i in range(8)]
    serial, parallel = ([Run(native, (rail, 5e6, 0.5e6, 0.0)) for rail in pressures] for _ in range(2))
    for run in serial:
        run.plan((0.0, 500e-6))
        run.march(700)
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda run: (run.plan((0.0, 500e-6)), run.march(700)), parallel))
    assert [run.observe() for run in parallel] == [run.observe() for run in serial]


def test_the_library_holds_no_memory_of_its_own(library):
    """Threads can only meet in data that can be written, and there is none."""
    if shutil.which("nm") is None:
        pytest.skip("nm, which lists symbols, is not on this machine")
    (static,) = (path for path in library.files if path.suffix == ".a")
    listed = subprocess.run(["nm", str(static)], capture_output=True, text=True, check=True).stdout
    symbols = [line.split()[-2:] for line in listed.splitlines() if len(line.split()) >= 2]
    assert {"T", "U"} <= {kind for kind, _ in symbols}
    # constants that hold addresses, which the loader fills in before it protects them
    tables = {f"{library.model.name}_{name}" for name in ("parameters", "channels", "sentences")}
    assert {name for kind, name in symbols if kind in "BbDdCSs"} <= tables


def test_a_state_comes_back_with_the_same_bits(native: Native):
    run = Run(native, BOUNDARY)
    run.plan((0.0, 500e-6))
    run.march(333)
    kept = run.memory.copy()
    run.march(500)
    expected = run.memory.copy()
    again = Run(native, (90e6, 5e6, 0.5e6, 0.0))
    again.memory[:] = kept
    again.native.march(again.state, 500, ctypes.byref(run.boundary))
    assert again.memory.tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    ("boundary", "step", "values", "status"),
    [
        (BOUNDARY, 1e-6, {"valve.mass": 0.0}, Status.OUTSIDE_DOMAIN),
        (BOUNDARY, 1e-6, {"valve.mass": float("nan")}, Status.OUTSIDE_DOMAIN),
        (BOUNDARY, 1e-6, {FUEL_TEMPERATURE: 500.0}, Status.OUTSIDE_DOMAIN),
        (BOUNDARY, 1.0, {}, Status.OUTSIDE_DOMAIN),
        (BOUNDARY, 5e-6, {}, Status.STEP_UNSTABLE),
        ((160e6, 170e6, 0.5e6, 0.0), 1e-6, {}, 16),
        ((float("nan"), 5e6, 0.5e6, 0.0), 1e-6, {}, 16),
        ((160e9, 5e6, 0.5e6, 0.0), 1e-6, {}, 16),
    ],
)
def test_what_cannot_be_simulated_is_a_status_with_a_sentence(native: Native, boundary, step, values, status):
    run = Run(native, boundary, step, values)
    assert run.status == status
    sentence = native.sentence(run.status).decode()
    assert sentence.endswith(".")
    assert len(sentence) > 40
    if isinstance(status, Status):
        assert sentence == status.sentence


def test_the_longest_step_is_that_of_the_lanes(native: Native, injector):
    solution = simulate(injector, OperatingPoint(160e6, 0.0, horizon=10e-6))
    run = Run(native, BOUNDARY)
    longest = native.longest_step(native.vector(), ctypes.byref(run.boundary))
    # modulus and sound speed of polynomials: within 0.2 % and 0.6 % of the laws (physics/fuel_polynomials.py)
    assert longest == pytest.approx(solution.longest_step, rel=5e-3)


def test_misuse_is_refused(native: Native):
    run = Run(native, BOUNDARY)
    run.plan((0.0, 500e-6))
    run.march(100)
    assert run.plan((0.0, 500e-6)) == 17  # in the past
    assert run.plan((200e-6, 100e-6), (250e-6, 100e-6)) == 17  # overlap
    assert native.switch(run.state, 50e-6, 1) == 17
    foreign = np.zeros(len(run.memory))
    assert native.march(foreign.ctypes.data, 1, ctypes.byref(run.boundary)) == 18
    assert native.status(foreign.ctypes.data) == 18
    assert native.begin(run.state, 100, native.vector(), ctypes.byref(run.boundary), 1e-6, 0.0) == 18


WIRINGS = {
    "rigid, rail volume, regulated": (
        DRAWN,
        {"body": Body.RIGID, "boundary": Boundary.VOLUME, "drive": Drive.REGULATED},
    ),
    "current trace": (DRAWN, {"drive": Drive.CURRENT}),
    "voltage trace, rigid": (DRAWN, {"drive": Drive.VOLTAGE, "body": Body.RIGID}),
    "free-wheel": (DRAWN, {"drive": Drive.FREE_WHEEL}),
    "extended": (DRAWN, {"values": {"plunger_needle.friction": 5.0, "valve.seat_land": 50e-6}}),
    "direct-acting": ("direct-acting-kr", {}),
}


@pytest.mark.slow
@pytest.mark.parametrize("wiring", sorted(WIRINGS))
def test_every_choice_of_wiring_has_the_channels_of_the_lanes(wiring, own, tmp_path):
    name, changes = WIRINGS[wiring]
    injector = load_injector(name)
    injector = injector.with_values(changes.get("values", {}))
    variant = {field: choice for field, choice in changes.items() if field != "values"}
    injector = replace(injector, variant=injector.variant._replace(**variant))
    traced = injector.variant.drive in (Drive.CURRENT, Drive.VOLTAGE)
    drive = Trace.of([0.0, 50e-6, 400e-6, 450e-6, 2e-3], [0.0, 18.0, 14.0, 0.0, 0.0]) if traced else None
    rail = 30e6 if injector.variant.actuation is Actuation.DIRECT else 120e6
    point = OperatingPoint(rail, [] if traced else 600e-6, drive=drive, horizon=1.5e-3)
    solution = simulate(injector, point)
    library = Native(write_library(injector, tmp_path, [find_target(own)]), own)
    run = Run(library, (rail, 5e6, 0.5e6, 0.0))
    rows = [run.observe()]
    for one in inputs_of(injector, point):
        run.march_inputs(one[None])
        rows.append(run.observe())
    courses = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    expected = solution.channels
    if injector.variant.actuation is Actuation.DIRECT:
        expected = {name: values for name, values in expected.items() if name in courses}
    found = deviations(replace(solution, channels=expected), courses)
    assert max(found.values()) < ROUNDING, found
    assert solution.injected_mass > 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("platform", ["win64", "linux-arm64", "darwin-arm64"])
def test_zig_links_for_other_platforms(platform, injector, tmp_path):
    pytest.importorskip("ziglang", reason="zig is not installed: pip install 'commonrail[export]'")
    library = write_library(injector, tmp_path, [find_target(platform)])
    content = library.shared[platform].read_bytes()
    # magic numbers of PE, of ELF with the machine AArch64, of Mach-O with the processor ARM64
    signs = {"win64": b"MZ", "linux-arm64": b"\x7fELF", "darwin-arm64": b"\xcf\xfa\xed\xfe\x0c\x00\x00\x01"}
    assert content.startswith(signs[platform])
    if platform == "linux-arm64":
        assert content[18:20] == b"\xb7\x00"
    if platform == "win64":
        needed = set(re.findall(rb"[\w-]+\.dll", content, re.I)) - {library.shared[platform].name.encode()}
        assert all(name.startswith(b"api-ms-win-crt-") or name == b"KERNEL32.dll" for name in needed), needed
