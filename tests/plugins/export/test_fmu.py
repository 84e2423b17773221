"""Exported FMUs of both versions of the standard in a foreign importer, FMPy."""

from __future__ import annotations

import ctypes
import gc
import re
import shutil
import subprocess
import zipfile
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.physics.variants import unread_parameters
from commonrail.plugins.export.fmu import write_fmu
from commonrail.plugins.export.object_files import find_target
from commonrail.readers.injector import load_injector
from tests.conftest import DRAWN
from tests.plugins.export.test_library import ROUNDING

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed: pip install 'commonrail[fmi]'")

START = {"boundary.rail_pressure": 160e6, "energising[1].duration": 700e-6}
WATCHED = ["injected", "needle_lift", "sac_pressure", "coil_current", "opening", "closing", "status"]
# All that the binary may ask of its machine: the C library's memory and strings, and elementary functions.
ALLOWED = {
    *("calloc", "malloc", "realloc", "free", "memcpy", "memmove", "memset", "strcmp", "strcpy", "strlen"),
    *("exp", "sin", "cos", "sincos", "sqrt", "floor", "fmax", "fmin"),
    *("__cxa_finalize", "__stack_chk_fail", "_ITM_deregisterTMCloneTable", "_ITM_registerTMCloneTable"),
    "__gmon_start__",
}


OPTIONS = {
    "stop_time": 2e-3,
    "step_size": 1e-5,
    "output_interval": 1e-5,
    "start_values": START,
    "output": WATCHED,
}


def run(fmu, step=1e-5, stop=2e-3, start=START, **options):
    """Outputs of a simulation in FMPy."""
    changed = {"stop_time": stop, "step_size": step, "output_interval": step, "start_values": start}
    return fmpy.simulate_fmu(str(fmu), **{**OPTIONS, **changed, **options})


@pytest.mark.parametrize("version", ["fmu", "fmu3"])
def test_the_validator_finds_no_problem(version, request):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(request.getfixturevalue(version))) == []


def test_both_versions_have_the_same_bits(fmu, fmu3):
    assert run(fmu3).tobytes() == run(fmu).tobytes()


def test_the_sources_alone_make_the_same_fmu(fmu, own, tmp_path):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler on this machine")
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
        names = archive.namelist()
    root = Xml.parse(tmp_path / "modelDescription.xml").getroot()
    listed = [one.get("name", "") for one in root.findall("CoSimulation/SourceFiles/File")]
    (library,) = (name for name in names if name.startswith("binaries/"))
    command = [
        compiler,
        "-std=c11",
        "-Wall",
        "-Werror",
        "-O1",
        "-fPIC",
        "-shared",
        *listed,
        "-lm",
        "-o",
        f"../{library}",
    ]
    subprocess.run(command, cwd=tmp_path / "sources", check=True)
    found, expected = fmpy.simulate_fmu(str(tmp_path), **OPTIONS), run(fmu)
    assert found.tobytes() == expected.tobytes()


def test_a_state_of_version_3_comes_back_with_the_same_bits(fmu3):
    from fmpy.fmi3 import FMU3Slave

    description = fmpy.read_model_description(str(fmu3))
    references = {variable.name: variable.valueReference for variable in description.modelVariables}
    one = FMU3Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(fmu3)),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    one.instantiate()
    one.setFloat64([references[name] for name in START], list(START.values()))
    one.enterInitializationMode()
    one.exitInitializationMode()

    def march(first, count):
        for k in range(first, first + count):
            one.doStep(k * 1e-5, 1e-5)
        return one.getFloat64([references[name] for name in WATCHED[:-1]])

    march(0, 30)
    kept = one.serializeFMUState(one.getFMUState())
    expected = march(30, 50)
    march(80, 20)
    one.setFMUState(one.deserializeFMUState(kept))
    assert march(30, 50) == expected
    one.terminate()
    one.freeInstance()


def test_it_has_the_channels_of_the_lanes(fmu):
    found = run(fmu)
    solution = simulate(load_injector(DRAWN), OperatingPoint(160e6, 700e-6, horizon=2e-3))
    for name in ("needle_lift", "sac_pressure", "coil_current"):
        expected = solution.channels[name][::10]
        assert np.max(np.abs(found[name] - expected)) < ROUNDING * np.max(np.abs(expected)), name
    assert found["injected"][-1] == pytest.approx(solution.injected_mass, rel=ROUNDING)
    assert found["opening"][-1] == pytest.approx(solution.opening, rel=ROUNDING)
    assert found["closing"][-1] == pytest.approx(solution.closing, rel=ROUNDING)
    assert found["status"][-1] == 0


@pytest.mark.parametrize("step", [1e-6, 3.7e-6, 4e-4])
def test_the_result_does_not_depend_on_the_communication_step(fmu, step):
    # the last whole inner step of either run is the same, and so is all that it computes
    end = step * round(1.2e-3 / step)
    found, reference = run(fmu, step, end), run(fmu, 1e-6, 1e-6 * np.floor(end / 1e-6 + 1e-6))
    assert found["injected"][-1] == reference["injected"][-1]


def test_a_switched_command_is_the_planned_energising(fmu):
    kinds = [("time", float), ("command", np.bool_)]
    edges = np.array([(0.0, True), (7e-4, True), (7e-4, False), (2e-3, False)], dtype=kinds)
    found = run(fmu, start={"boundary.rail_pressure": 160e6}, input=edges)
    assert found["injected"][-1] == pytest.approx(run(fmu)["injected"][-1], rel=1e-9)


def test_a_state_comes_back_with_the_same_bits_in_another_instance(fmu):
    description = fmpy.read_model_description(str(fmu))
    references = {variable.name: variable.valueReference for variable in description.modelVariables}
    folder = fmpy.extract(str(fmu))

    def begun():
        from fmpy.fmi2 import FMU2Slave

        one = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="one",
        )
        one.instantiate()
        one.setupExperiment(startTime=0.0)
        one.setReal([references[name] for name in START], list(START.values()))
        one.enterInitializationMode()
        one.exitInitializationMode()
        return one

    def march(one, first, count):
        for k in range(first, first + count):
            one.doStep(k * 1e-5, 1e-5)
        return one.getReal([references[name] for name in WATCHED[:-1]])

    first = begun()
    march(first, 0, 30)
    state = first.getFMUstate()
    kept = first.serializeFMUstate(state)
    expected = march(first, 30, 60)
    first.setFMUstate(state)
    assert march(first, 30, 60) == expected
    other = begun()
    other.setFMUstate(other.deSerializeFMUstate(kept))
    assert march(other, 30, 60) == expected
    first.reset()
    first.freeInstance()
    assert march(other, 90, 1) != expected


def test_parameters_are_refused_after_the_initialization_and_failures_have_a_sentence(fmu):
    with pytest.raises(Exception, match="fmi2ExitInitializationMode"):
        run(fmu, start={**START, "valve.mass": -1.0})
    assert run(fmu)["status"][-1] == 0  # the failure left nothing behind


def test_every_variable_has_a_unit_a_description_and_a_name_of_its_own(fmu):
    with zipfile.ZipFile(fmu) as archive:
        names = archive.namelist()
        root = Xml.fromstring(archive.read("modelDescription.xml"))
    assert names[0] == "modelDescription.xml"
    assert len(set(names)) == len(names)
    assert not any("\\" in name or name.startswith((".", "/")) for name in names)
    variables = root.findall("ModelVariables/ScalarVariable")
    assert len({one.get("name", "").casefold() for one in variables}) == len(variables) > 100
    assert all(one.get("description") and len(one.get("name", "")) <= 55 for one in variables)
    units = {unit.get("name") for unit in root.findall("UnitDefinitions/Unit")}
    assert all(real.get("unit") in units for real in root.iter("Real"))
    outputs = [i for i, one in enumerate(variables, 1) if one.get("causality") == "output"]
    for part in ("Outputs", "InitialUnknowns"):
        assert [int(one.get("index", 0)) for one in root.findall(f"ModelStructure/{part}/Unknown")] == outputs
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", root.get("generationDateAndTime", ""))
    drawn = load_injector(DRAWN)
    values = {name: value for name, value in drawn.values.items() if name not in unread_parameters(drawn.variant)}
    starts = {one.get("name"): one.find("Real").get("start") for one in variables if one.find("Real") is not None}
    assert all(float(starts[name]) == value for name, value in values.items())


def test_the_binary_shows_the_functions_of_the_standard_and_needs_the_c_library_alone(binary):
    try:
        listed = subprocess.run(["nm", "-D", str(binary)], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("nm, which lists symbols, is not on this machine")
    rows = [line.split() for line in listed.splitlines()]
    shown = {row[-1] for row in rows if row[-2] not in ("U", "w")}
    needed = {row[-1].partition("@")[0] for row in rows if row[-2] in ("U", "w")}
    assert needed <= ALLOWED
    assert all(name.startswith("fmi2") for name in shown)
    assert len(shown) == 44  # all of the standard: some importers look up those of model exchange, too


def test_strange_arguments_are_no_crash(binary, fmu):
    dll = ctypes.CDLL(str(binary))
    instantiate = dll.fmi2Instantiate
    instantiate.restype = ctypes.c_void_p
    instantiate.argtypes = [ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p, *[ctypes.c_void_p] * 3]
    token = fmpy.read_model_description(str(fmu)).guid.encode()
    assert instantiate(b"x", 1, b"another", None, None, None, None) is None
    assert instantiate(b"x", 1, None, None, None, None, None) is None
    assert instantiate(b"x", 0, token, None, None, None, None) is None  # model exchange
    for name in (None, b"", b" "):
        one = instantiate(name, 1, token, None, None, None, None)
        assert one
        assert dll.fmi2DoStep(ctypes.c_void_p(one), ctypes.c_double(0.0), ctypes.c_double(1e-5), 1) == 3  # too early
        dll.fmi2FreeInstance(ctypes.c_void_p(one))
    dll.fmi2FreeInstance(None)
    assert dll.fmi2Reset(None) == 3


class Memory(ctypes.Structure):
    """Figures of glibc's allocator."""

    _fields_ = [(name, ctypes.c_size_t) for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks")]
    _fields_ += [(name, ctypes.c_size_t) for name in ("fsmblks", "uordblks", "fordblks", "keepcost")]


def test_ten_thousand_instances_leave_no_memory_behind(binary, fmu):
    count = getattr(ctypes.CDLL(None), "mallinfo2", None)
    if count is None:
        pytest.skip("this C library does not count its memory (mallinfo2)")
    count.restype = Memory
    dll = ctypes.CDLL(str(binary))
    dll.fmi2Instantiate.restype = ctypes.c_void_p
    token = fmpy.read_model_description(str(fmu)).guid.encode()

    def live(instances):
        for _ in range(instances):
            one = ctypes.c_void_p(dll.fmi2Instantiate(b"one", 1, token, None, None, None, None))
            assert dll.fmi2EnterInitializationMode(one) == dll.fmi2ExitInitializationMode(one) == 0
            dll.fmi2FreeInstance(one)

    def held():
        figures = count()
        return figures.uordblks + figures.hblkhd

    live(10)
    gc.collect()
    before = held()
    live(10_000)
    gc.collect()
    # an instance holds 53 kB; Python itself may keep some objects more
    assert held() - before < 10 * 53_000


def test_flat_names_are_the_same_model(own, fmu, tmp_path):
    """Importers may make buses of names with points."""
    from fmpy.validation import validate_fmu

    for fmi in (2, 3):
        path = tmp_path / f"flat{fmi}.fmu"
        write_fmu(load_injector(DRAWN), path, [find_target(own)], fmi, flat=True)
        assert validate_fmu(str(path)) == []
    start = {"boundary__rail_pressure": 160e6, "energising_1__duration": 700e-6}
    flat, structured = run(tmp_path / "flat2.fmu", start=start), run(fmu)
    assert flat.tobytes() == structured.tobytes()
    names = [variable.name for variable in fmpy.read_model_description(str(path)).modelVariables]
    assert len({*names}) == len(names)
    assert not any(sign in name for name in names for sign in ".[]")
