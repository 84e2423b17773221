"""What users of FMUs ask of one, besides what test_fmu.py holds: docs/howto/export.md lists it."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.simulate import simulate
from commonrail.readers.injector import load_injector
from tests.conftest import DRAWN
from tests.plugins.export.fmi2 import DISCARD, ERROR, OK, Binary
from tests.plugins.export.test_fmu import Memory, run
from tests.plugins.export.test_library import ROUNDING, inputs_of

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed: pip install 'commonrail[fmi]'")

STEP = 1e-5
OUTPUTS = ("injected", "needle_lift", "sac_pressure", "opening", "closing")
START = {"boundary.rail_pressure": 160e6, "energising[1].duration": 300e-6}


@pytest.fixture(scope="module")
def references(fmu) -> dict[str, int]:
    """References of the variables."""
    return {v.name: v.valueReference for v in fmpy.read_model_description(str(fmu)).modelVariables}


@pytest.fixture(scope="module")
def own_binary(binary, fmu) -> Binary:
    """Its functions, called without an importer."""
    return Binary(binary, fmpy.read_model_description(str(fmu)).guid)


@pytest.fixture
def one(own_binary, references):
    """An instance in which an injection is planned."""
    found = own_binary.instance()
    assert found.set([references[name] for name in START], list(START.values())) == OK
    yield found
    found.free()


def outputs(instance, references) -> list[float]:
    return instance.get([references[name] for name in OUTPUTS])


@pytest.mark.parametrize("version", ["fmu", "fmu3"])
def test_the_archive_is_one_that_every_tool_unpacks(version, request):
    with zipfile.ZipFile(request.getfixturevalue(version)) as archive:
        names = archive.namelist()
        root = Xml.fromstring(archive.read("modelDescription.xml"))
        icon = archive.read("model.png" if version == "fmu" else "terminalsAndIcons/icon.png")
    assert len({name.casefold() for name in names}) == len(names)
    assert icon.startswith(b"\x89PNG")
    for attribute in ("author", "version", "copyright", "license", "description", "generationTool"):
        assert root.get(attribute), attribute


def test_limits_belong_to_the_range_that_the_binary_takes(fmu, own_binary, references):
    with zipfile.ZipFile(fmu) as archive:
        root = Xml.fromstring(archive.read("modelDescription.xml"))
    reals = {v.get("name"): v.find("Real") for v in root.findall("ModelVariables/ScalarVariable")}
    least = {name: float(real.get("min")) for name, real in reals.items() if real is not None and real.get("min")}
    assert least["valve.mass"] == sys.float_info.min  # greater than zero: zero itself is refused
    assert least["valve.spring_preload"] in (0.0, sys.float_info.min)
    instance = own_binary.instance()
    assert instance.set([references["valve.mass"]], [0.0]) == OK
    assert instance.begin() == ERROR
    instance.free()


@pytest.mark.parametrize("version", ["fmu", "fmu3"])
def test_twenty_failing_instances_leave_their_process_alive(version, request):
    code = """
import sys, fmpy
for i in range(20):
    try:
        given = {"valve.mass": -1.0}
        fmpy.simulate_fmu(sys.argv[1], validate=False, stop_time=1e-4, output_interval=1e-5, start_values=given)
    except Exception as error:
        assert "ExitInitializationMode" in str(error), error
print("all of them failed")
"""
    command = [sys.executable, "-c", code, str(fmpy.extract(str(request.getfixturevalue(version))))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-500:]
    assert done.stdout.endswith("all of them failed\n")


def test_a_thousand_resets_give_the_same_bits(one, references):
    found = set()
    for _ in range(1000):
        assert one.reset() == OK
        assert one.set([references[name] for name in START], list(START.values())) == OK
        assert one.begin() == OK
        assert one.step(0.0, 2e-4) == OK
        found.add(tuple(outputs(one, references)))
    assert len(found) == 1


def test_a_thousand_instances_in_threads_do_not_disturb_each_other(own_binary, references):
    def simulated(pressure: float) -> tuple[float, ...]:
        instance = own_binary.instance()
        instance.set([references[name] for name in START], [pressure, 300e-6])
        assert instance.begin() == OK
        instance.march(5e-5, 4)
        found = tuple(outputs(instance, references))
        instance.free()
        return found

    pressures = [80e6 + 1e5 * (i % 10) for i in range(1000)]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(simulated, pressures))
    assert found == [simulated(80e6 + 1e5 * (i % 10)) for i in range(10)] * 100
    assert len(set(found)) == 10


def test_a_serialised_state_goes_on_in_another_process(one, own_binary, binary, references, tmp_path):
    assert one.begin() == OK
    one.march(STEP, 30)
    (tmp_path / "state").write_bytes(one.serialised())
    one.march(STEP, 40, 30)
    code = """
import sys
from pathlib import Path
from tests.plugins.export.fmi2 import Binary
one = Binary(Path(sys.argv[1]), sys.argv[2]).instance()
assert one.restore(Path(sys.argv[3]).read_bytes()) == 0
one.march(1e-5, 40, 30)
print(*(value.hex() for value in one.get([int(text) for text in sys.argv[4:]])))
"""
    numbers = [str(references[name]) for name in OUTPUTS]
    command = [sys.executable, "-c", code, str(binary), own_binary.token.decode(), str(tmp_path / "state"), *numbers]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[3])
    assert [float.fromhex(text) for text in done.stdout.split()] == outputs(one, references)


def test_a_damaged_state_is_refused(one):
    assert one.begin() == OK
    content = one.serialised()
    for wrong in (b"", content[:20], b"\xff" * 64):
        assert one.restore(wrong) == ERROR
    assert one.restore(content) == OK


def test_a_step_allocates_no_memory(one):
    count = getattr(ctypes.CDLL(None), "mallinfo2", None)
    if count is None:
        pytest.skip("this C library does not count its memory (mallinfo2)")
    count.restype = Memory
    assert one.begin() == OK
    step, pointer = one.dll.fmi2DoStep, one.pointer
    arguments = [(pointer, ctypes.c_double(1e-4 * k), ctypes.c_double(1e-4), 1) for k in range(20)]
    step(*arguments[0])
    before = count()
    for each in arguments[1:]:
        step(*each)
    after = count()
    # a single allocation of a state would be 53 kB; what Python itself keeps for twenty calls is far less
    assert after.uordblks + after.hblkhd - before.uordblks - before.hblkhd < 8192


@pytest.mark.parametrize("length", [1e-9, 3.1e-7])
def test_steps_far_below_the_inner_one_come_to_the_same(own_binary, references, length):
    found = []
    for each in (length, 2e-5):
        instance = own_binary.instance()
        instance.set([references[name] for name in START], [160e6, 10e-6])
        assert instance.begin() == OK
        instance.march(each, round(2e-5 / each))
        instance.step(2e-5, 1e-4)
        found.append(outputs(instance, references))
        instance.free()
    assert found[0] == found[1]


def test_the_clock_does_not_drift_over_a_long_simulation(own_binary, references):
    def injection(begun: float, wait: float) -> tuple[float, float]:
        instance = own_binary.instance()
        names = [*START, "energising[1].start"]
        instance.set([references[name] for name in names], [160e6, 300e-6, wait])
        assert instance.begin(begun) == OK
        if wait:
            assert instance.step(begun, wait) == OK
        for k in range(100):
            assert instance.step(begun + wait + 1e-5 * k, 1e-5) == OK
        injected, opening = instance.get([references["injected"], references["opening"]])
        instance.free()
        return injected, opening - begun - wait

    # after 200,000 and 600,000 inner steps of rest, and on a clock that begins at 1000 s
    for usual, late in (((0.0, 0.2), (0.0, 0.6)), ((0.0, 0.0), (1000.0, 0.0))):
        expected, found = injection(*usual), injection(*late)
        # a step that was lost or gained would be 1e-6; between 0.2 and 0.6 s the pressures at rest still settle
        assert found[1] == pytest.approx(expected[1], abs=1e-8)
        # edges of the PWM that fall on a step go to it or the next by rounding: 2e-4 measured
        assert found[0] == pytest.approx(expected[0], rel=1e-3)


def test_a_failed_step_has_a_sentence_and_leaves_the_instance_usable(one, references):
    assert one.begin() == OK
    assert one.set([references["boundary.rail_pressure"]], [1e12]) == OK
    assert one.step(0.0, STEP) == DISCARD
    assert one.terminate() == OK
    assert one.reset() == OK
    assert one.set([references[name] for name in START], list(START.values())) == OK
    assert one.begin() == OK
    one.march(STEP, 60)
    assert outputs(one, references)[0] > 0.0


def test_fixed_parameters_are_refused_while_steps_are_taken_and_inputs_are_not(one, references):
    assert one.begin() == OK
    assert one.set([references["valve.mass"]], [1e-3]) == ERROR
    assert one.set([references["boundary.rail_pressure"]], [150e6]) == OK


def test_an_input_that_the_model_does_not_read_is_refused(one, references):
    drive = references["boundary.rail_pressure"] + 3  # of an injector with a PWM; no such variable is declared
    assert "boundary.drive" not in references
    assert one.set([drive], [14.0]) == ERROR


def test_a_communication_step_without_end_is_refused(one, references):
    assert one.begin() == OK
    assert one.step(0.0, 1e9) == ERROR
    assert one.step(0.0, STEP) == OK


def test_out_of_the_box_it_simulates_its_default_experiment(fmu, fmu3):
    for path in (fmu, fmu3):
        found = fmpy.simulate_fmu(str(path))
        assert found["time"][-1] == pytest.approx(0.01)
        assert (found["status"] == 0).all()
        assert np.max(np.abs(found["injected"])) < 1e-18  # nothing but rounding passes the closed seat [kg]


def test_inputs_have_no_initial_and_all_outputs_are_in_the_structure(fmu3):
    with zipfile.ZipFile(fmu3) as archive:
        root = Xml.fromstring(archive.read("modelDescription.xml"))
        terminals = Xml.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
    variables = list(root.find("ModelVariables"))
    assert all(v.get("initial") is None for v in variables if v.get("causality") == "input")
    listed = {unknown.get("valueReference") for unknown in root.findall("ModelStructure/Output")}
    assert listed == {v.get("valueReference") for v in variables if v.get("causality") == "output"}
    names = {v.get("name") for v in variables}
    members = [m.get("variableName") for m in terminals.iter("TerminalMemberVariable")]
    assert set(members) <= names
    assert {t.get("name") for t in terminals.iter("Terminal")} == {"fuel_line", "coil"}


def test_the_binary_needs_no_newer_c_library_than_stated(binary):
    pytest.importorskip("ziglang", reason="ziglang, which links for old C libraries, is not installed")
    if shutil.which("nm") is None:
        pytest.skip("nm, which lists symbols, is not on this machine")
    listed = subprocess.run(["nm", "-D", str(binary)], capture_output=True, text=True, check=True).stdout
    versions = {tuple(map(int, text.split("."))) for text in re.findall(r"@GLIBC_([\d.]+)", listed)}
    assert versions
    assert max(versions) <= (2, 17)


def test_it_has_the_bits_of_the_library(native, fmu):
    from tests.plugins.export.test_library import BOUNDARY, Run

    library = Run(native, BOUNDARY)
    assert library.plan((0.0, 700e-6)) == 0
    library.march(2000)
    assert run(fmu)["injected"][-1] == library.figures().injected


def test_two_importers_find_the_same(fmu, fmu3, references):
    fmuloader = pytest.importorskip("fmuloader", reason="fmuloader, a second importer, is not installed")
    assert fmuloader
    from fmuloader.fmi2 import Fmi2Slave, Fmi2Type
    from fmuloader.fmi3 import Fmi3Slave

    names = ["injected", "needle_lift", "sac_pressure", "coil_current"]
    numbers = [references[name] for name in names]
    given = [references[name] for name in START], list(START.values())
    for path in (fmu, fmu3):
        description = fmpy.read_model_description(str(path))
        model = description.coSimulation.modelIdentifier
        if path is fmu:
            slave = Fmi2Slave(str(path), model_identifier=model)
            slave.instantiate("one", Fmi2Type.CO_SIMULATION, guid=description.guid)
            slave.setup_experiment(start_time=0.0)
            slave.set_real(*given)
            slave.enter_initialization_mode()
        else:
            slave = Fmi3Slave(str(path), model_identifier=model)
            slave.instantiate_co_simulation("one", instantiation_token=description.guid)
            slave.set_float64(*given)
            slave.enter_initialization_mode(start_time=0.0)
        slave.exit_initialization_mode()
        read = slave.get_real if path is fmu else slave.get_float64
        courses = [read(numbers)]
        for k in range(100):
            slave.do_step(k * STEP, STEP)
            courses.append(read(numbers))
        slave.terminate()
        slave.free_instance()
        expected = run(path, stop=1e-3, start=START, output=names)
        for name, course in zip(names, np.transpose(courses), strict=True):
            peak = np.max(np.abs(expected[name]))
            assert np.max(np.abs(course - expected[name])) <= 1e-9 * peak, name  # the bound that is asked for


def test_a_train_is_that_of_the_lanes(fmu):
    pulses = ((0.0, 250e-6), (800e-6, 200e-6), (1400e-6, 300e-6))
    point = OperatingPoint(120e6, [Energising(*one) for one in pulses], horizon=2.5e-3)
    start = {"boundary.rail_pressure": 120e6}
    for i, (begun, duration) in enumerate(pulses, 1):
        start |= {f"energising[{i}].start": begun, f"energising[{i}].duration": duration}
    found = run(fmu, stop=2.5e-3, start=start)
    assert found["injected"][-1] == pytest.approx(simulate(load_injector(DRAWN), point).injected_mass, rel=ROUNDING)


def test_a_measured_rail_pressure_is_an_input(own_binary, references):
    injector = load_injector(DRAWN)
    rail = Trace.of([0.0, 0.5e-3, 1e-3, 2e-3], [140e6, 130e6, 138e6, 135e6])
    point = OperatingPoint(rail, 500e-6, horizon=1.5e-3)
    one = own_binary.instance()
    one.set([references[name] for name in START], [point.initial_pressures()[0], 500e-6])
    assert one.begin() == OK
    for k, row in enumerate(inputs_of(injector, point)):
        assert one.set([references["boundary.rail_pressure"]], row[:1]) == OK  # its mean over the step
        assert one.step(1e-6 * k, 1e-6) == OK
    solution = simulate(injector, point)
    injected, pressure = one.get([references["injected"], references["sac_pressure"]])
    one.free()
    assert injected == pytest.approx(solution.injected_mass, rel=ROUNDING)
    assert pressure == pytest.approx(solution.channels["sac_pressure"][-1], rel=ROUNDING)
