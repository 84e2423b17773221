"""Loops from a library give the bits of those that are compiled, and a library that does not fit is not used."""

from __future__ import annotations

import ctypes
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.choices import Actuation, Drive, Precision
from commonrail.base.errors import ConfigurationError, SimulationError
from commonrail.compiler.target import LEVEL_3, LEVEL_4, own_processor
from commonrail.engine import lanes, machine_code
from commonrail.engine.job import VECTORS
from commonrail.engine.machine_code import symbol_of
from commonrail.engine.operating_point import Trace
from commonrail.physics.variants import Variant
from commonrail.readers.injector import injector_catalogue, load_injector
from tests.conftest import wired
from tools import wheel_libraries
from tools.wheel_libraries import ALL, CATALOGUE, write_libraries

RAILS = {Actuation.SERVO: 160e6, Actuation.DIRECT: 25e6}
COURSES = {
    Drive.CURRENT: Trace.of([0.0, 40e-6, 3e-4, 3.4e-4], [0.0, 18.0, 18.0, 0.0]),  # [A]
    Drive.VOLTAGE: Trace.of([0.0, 1e-6, 3e-4, 3.1e-4], [0.0, 50.0, 50.0, 0.0]),  # [V]
}
NAMES, VALUES = ["nozzle.discharge_maximum"], np.linspace(0.75, 0.9, 19)[:, None]
CACHES = (
    lanes.load_loop,
    machine_code.objection,
    machine_code.read_stamp,
    machine_code._level,
    machine_code._open_library,
)
REASON = "" if shutil.which("cc") else "no C compiler, cc, is on this machine"
if own_processor() not in (LEVEL_3, LEVEL_4):
    REASON = "this processor is below x86-64-v3"
pytestmark = pytest.mark.skipif(
    bool(REASON) or platform.system() != "Linux", reason=REASON or "libraries are made for Linux"
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, rigid: cr.Injector) -> Path:
    """Libraries of the rigid body in double precision, of kernels that other tests have compiled too."""
    folder = tmp_path_factory.mktemp("kernels")
    levels = [LEVEL_3, LEVEL_4] if own_processor() == LEVEL_4 else [LEVEL_3]
    write_libraries(folder, [rigid.wired()], [Precision.F64], levels)
    return folder


@pytest.fixture
def use(monkeypatch: pytest.MonkeyPatch, made: Path) -> Iterator[pytest.MonkeyPatch]:
    """Let this process find those libraries in place of the package's own."""
    monkeypatch.setattr(machine_code, "FOLDER", made)
    monkeypatch.delenv("COMMONRAIL_KERNELS", raising=False)
    forget()
    yield monkeypatch
    monkeypatch.undo()
    forget()


def forget() -> None:
    """Let libraries be looked for anew."""
    for cache in CACHES:
        cache.cache_clear()


def point_of(variant: Variant) -> cr.OperatingPoint:
    """Short injection of a wiring."""
    rail, course = RAILS[variant.actuation], COURSES.get(variant.drive)
    if course is None:
        return cr.OperatingPoint(rail, 300e-6, horizon=6e-4)
    return cr.OperatingPoint(rail, [], drive=course, horizon=6e-4)


def figures(
    injector: cr.Injector, threads: int = 1, precision: Precision = Precision.F64, same_bits: bool = False
) -> np.ndarray:
    """Figures of a batch and a trace of one injection, in a row."""
    point = point_of(injector.variant)
    batch = cr.simulate_batch(
        injector, [point], NAMES, VALUES, threads=threads, precision=precision, same_bits=same_bits
    )
    one = cr.simulate(injector, point, precision=precision, same_bits=same_bits)
    assert one.injected_mass > 0.0
    of_batch = (batch.injected_mass, batch.returned_mass, batch.opening, batch.closing, batch.greatest_lift)
    return np.concatenate([np.ravel(array) for array in (*of_batch, one.injected, *one.channels.values())])


def origins(injector: cr.Injector, same_bits: bool = False) -> tuple[str, str]:
    code = lanes.load_loop(injector.wired(), Precision.F64, same_bits)
    return code.origin, code.processor


def test_a_library_gives_the_bits_of_the_compiler(use: pytest.MonkeyPatch, rigid: cr.Injector) -> None:
    found = {}
    for switch in ("off", "v3", "v4"):
        use.setenv("COMMONRAIL_KERNELS", switch)
        forget()
        found[switch] = figures(rigid)
        origin, processor = origins(rigid)
        assert (origin == "library") == (switch != "off")
        assert processor == (LEVEL_3.name if switch == "v3" else own_processor().name)
    assert found["off"].tobytes() == found["v4"].tobytes()
    assert figures(rigid, threads=2).tobytes() == found["v4"].tobytes()
    # Levels differ in a last digit, where one has a fused product that the other has not; channels pass through zero.
    np.testing.assert_allclose(found["v3"], found["v4"], rtol=1e-9, atol=1e-12)


def test_exact_loops_have_the_same_bits_on_every_level(use: pytest.MonkeyPatch, rigid: cr.Injector) -> None:
    found = {}
    for switch in ("off", "v3", "v4"):
        use.setenv("COMMONRAIL_KERNELS", switch)
        forget()
        found[switch] = figures(rigid, same_bits=True)
        origin, processor = origins(rigid, same_bits=True)
        assert (origin == "library") == (switch != "off")
        assert processor == (LEVEL_3.name if switch == "v3" else own_processor().name)
    assert found["off"].tobytes() == found["v3"].tobytes() == found["v4"].tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("precision", list(Precision))
@pytest.mark.parametrize("variant", ALL, ids=lambda v: v.label)
def test_every_wiring_has_the_bits_of_the_compiler(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, variant: Variant, precision: Precision
) -> None:
    write_libraries(tmp_path, [variant], [precision])
    direct = variant.actuation is Actuation.DIRECT
    injector = replace(load_injector("direct-acting-kr"), variant=variant) if direct else wired(variant)
    monkeypatch.setattr(machine_code, "FOLDER", tmp_path)
    found, exact = {}, set()
    for switch in ("off", "v3", "v4"):
        monkeypatch.setenv("COMMONRAIL_KERNELS", switch)
        forget()
        found[switch] = figures(injector, precision=precision)
        assert figures(injector, threads=2, precision=precision).tobytes() == found[switch].tobytes()
        assert (lanes.load_loop(variant, precision, False).origin == "library") == (switch != "off")
        if precision is Precision.F64:  # no library holds an exact loop in single precision
            exact.add(figures(injector, precision=precision, same_bits=True).tobytes())
    monkeypatch.undo()
    forget()
    assert found["off"].tobytes() == found["v4"].tobytes()
    assert len(exact) == (precision is Precision.F64)
    # injected masses: last digits, which the needle's bounces magnify
    tolerance = 1e-9 if precision is Precision.F64 else 1e-3
    np.testing.assert_allclose(found["v3"][: len(VALUES)], found["v4"][: len(VALUES)], rtol=tolerance)


def test_sources_that_were_changed_are_compiled(use: pytest.MonkeyPatch, rigid: cr.Injector) -> None:
    assert machine_code.find(symbol_of(rigid.wired(), Precision.F64)) is not None
    use.setattr(machine_code, "digests", lambda files: {})
    forget()
    assert machine_code.find(symbol_of(rigid.wired(), Precision.F64)) is not None  # a comment was changed
    use.setattr(machine_code, "stamp_of", lambda module: "another")
    forget()
    assert machine_code.find(symbol_of(rigid.wired(), Precision.F64)) is None
    assert "sources" in machine_code.objection()


def test_libraries_of_another_compiler_than_the_installed_one_are_not_used(use: pytest.MonkeyPatch) -> None:
    """Results name the installed ones."""
    use.setattr(machine_code, "package_version", lambda package: "0.1" if package == "numba" else "")
    forget()
    assert machine_code.objection().endswith(", and 0.1 is installed")
    use.setattr(machine_code, "package_version", lambda package: "")
    forget()
    assert machine_code.objection() == ""


def test_a_wiring_that_a_library_lacks_is_not_found(use: pytest.MonkeyPatch, pwm: cr.Injector) -> None:
    assert machine_code.find(symbol_of(pwm.wired(), Precision.F64)) is None
    assert machine_code.objection() == ""


def test_a_library_that_cannot_be_loaded_is_not_used(use: pytest.MonkeyPatch, made: Path, tmp_path: Path) -> None:
    shutil.copy(made / machine_code.STAMP, tmp_path)
    (tmp_path / "lanes-v3.so").write_bytes(b"cut")
    use.setattr(machine_code, "FOLDER", tmp_path)
    forget()
    assert machine_code.find("cr_any") is None
    assert machine_code.objection().startswith("they cannot be loaded: ")


@pytest.mark.parametrize("level", ["v3", "v4"])
@pytest.mark.parametrize("spoilt", ["cut", "another", "folder"])
def test_a_library_that_is_not_the_one_that_was_built_is_never_opened(
    use: pytest.MonkeyPatch, made: Path, tmp_path: Path, level: str, spoilt: str
) -> None:
    """The system maps a cut library without a word and ends the process where a page is missing."""
    if not (made / f"lanes-{level}.so").exists():
        pytest.skip(f"this processor has not the level {level}")
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    path = tmp_path / f"lanes-{level}.so"
    whole = path.read_bytes()
    path.unlink()
    if spoilt == "folder":
        path.mkdir()
    else:
        path.write_bytes(whole[: len(whole) // 2] if spoilt == "cut" else whole + b" ")
    use.setattr(machine_code, "FOLDER", tmp_path)
    opened: list[str] = []
    load = ctypes.CDLL
    use.setattr(ctypes, "CDLL", lambda name: opened.append(name) or load(name))
    forget()
    assert machine_code.find("cr_any") is None
    assert str(path) not in opened
    assert machine_code.objection().startswith(f"they cannot be loaded: {path} is not the one that was built")


def test_a_library_is_replaced_whole(use: pytest.MonkeyPatch, made: Path, tmp_path: Path, rigid: cr.Injector) -> None:
    """A process that runs the one before keeps it: written over in place, its code would change under it."""
    path = tmp_path / "lanes-v3.so"
    path.write_bytes(b"before")
    with path.open("rb") as running:
        write_libraries(tmp_path, [rigid.wired()], [Precision.F64], [LEVEL_3])
        assert running.read() == b"before"
    assert sorted(found.name for found in tmp_path.iterdir()) == ["lanes-v3.so", machine_code.STAMP]


def test_processes_beside_each_other_make_the_same_libraries(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, rigid: cr.Injector, regulated: cr.Injector
) -> None:
    monkeypatch.setattr(wheel_libraries, "GROUP", 1)
    how = [rigid.wired(), regulated.wired()], [Precision.F64], [LEVEL_3]
    assert len(wheel_libraries._tasks(*how)) == 2
    for processes in (1, 2):
        write_libraries(tmp_path / str(processes), *how, processes=processes)
    first, second = ((tmp_path / str(processes) / "lanes-v3.so").read_bytes() for processes in (1, 2))
    assert first == second


def _killed(task: wheel_libraries._Task) -> dict[tuple[str, str], bytes]:
    os.kill(os.getpid(), signal.SIGKILL)
    return {}


def test_a_process_that_is_killed_ends_the_making_of_libraries(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, rigid: cr.Injector
) -> None:
    """As for want of memory: it must not be waited for."""
    monkeypatch.setattr(wheel_libraries, "_compile_task", _killed)
    with pytest.raises(BrokenProcessPool):
        write_libraries(tmp_path, [rigid.wired()], list(Precision), [LEVEL_3], processes=2)
    assert not (tmp_path / machine_code.STAMP).exists()


def test_without_a_c_compiler_one_sentence_says_so(tmp_path: Path) -> None:
    """Before the loops are compiled, which takes minutes."""
    code = (
        "import importlib.util, runpy, shutil, sys; shutil.which = lambda name: None; "
        "found = importlib.util.find_spec; "
        "importlib.util.find_spec = lambda name, *more: None if name == 'ziglang' else found(name, *more); "
        f"sys.argv[1:] = [{str(tmp_path)!r}]; "
        "runpy.run_module('tools.wheel_libraries', run_name='__main__')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("commonrail: Binaries for linux64 need a C compiler")
    assert done.stderr.count("\n") == 1


def test_an_unknown_value_of_the_switch_is_refused(use: pytest.MonkeyPatch, rigid: cr.Injector) -> None:
    use.setenv("COMMONRAIL_KERNELS", "OFF")
    with pytest.raises(ConfigurationError, match=r'COMMONRAIL_KERNELS .*"OFF"; .*v3'):
        cr.simulate(rigid, point_of(rigid.variant))


def test_a_damaged_stamp_is_none(use: pytest.MonkeyPatch, tmp_path: Path) -> None:
    use.setattr(machine_code, "FOLDER", tmp_path)
    (tmp_path / machine_code.STAMP).write_text("[", encoding="utf-8")
    assert machine_code.read_stamp() is None
    assert "none came" in machine_code.objection()


@pytest.mark.parametrize("wrong", ["rows", "lanes", "columns", "size"])
def test_a_loop_refuses_a_table_that_was_made_for_another(
    use: pytest.MonkeyPatch, rigid: cr.Injector, wrong: str
) -> None:
    """It writes nothing then: a loop of the wrong wiring would write past the end of its memory."""
    shape = lanes.shape_of(rigid.wired(), VECTORS[Precision.F64])
    other = shape._replace(**{wrong: getattr(shape, wrong) - 1})
    use.setattr(lanes, "shape_of", lambda variant, vector: other)
    with pytest.raises(SimulationError, match="another injector"):
        cr.simulate(rigid, point_of(rigid.variant))


def test_a_library_needs_no_other(use: pytest.MonkeyPatch, made: Path) -> None:
    """Not the C library's sine, whose versions differ, and nothing of Python's."""
    for path in made.glob("*.so"):
        done = subprocess.run(["nm", "-D", "-u", str(path)], capture_output=True, text=True, check=True)
        needed = {line.split()[-1] for line in done.stdout.splitlines()}
        weak = {"__cxa_finalize", "__gmon_start__", "_ITM_deregisterTMCloneTable", "_ITM_registerTMCloneTable"}
        assert {name.partition("@")[0] for name in needed} <= weak
        assert ctypes.CDLL(str(path)).cr_level() in (3, 4)


CODE = """
import json, pathlib, sys
from commonrail.engine import machine_code
machine_code.FOLDER = pathlib.Path(sys.argv[1])
import commonrail as cr
from commonrail.base.choices import Body, Drive
from commonrail.physics.variants import Variant
from dataclasses import replace
injector = replace(cr.load_injector("virtual-lino-2016"), variant=Variant(Body.RIGID, drive=Drive.PWM))
found = cr.simulate(injector, cr.OperatingPoint(160e6, 300e-6, horizon=6e-4))
heavy = ("numba", "llvmlite", "scipy", "plotly", "matplotlib", "pint", "pandas")
print(json.dumps([float(found.injected_mass), [name for name in heavy if name in sys.modules]]))
"""


def test_a_simulation_by_a_library_loads_no_compiler(made: Path, rigid: cr.Injector) -> None:
    done = subprocess.run([sys.executable, "-c", CODE, str(made)], capture_output=True, text=True, check=True)
    mass, loaded = json.loads(done.stdout)
    assert loaded == []
    assert mass == float(cr.simulate(rigid, point_of(rigid.variant)).injected_mass)


def test_the_libraries_hold_what_the_catalogue_needs() -> None:
    assert {load_injector(name).wired() for name in injector_catalogue()} <= set(CATALOGUE) <= set(ALL)
    symbols = [symbol_of(variant, precision) for variant in ALL for precision in Precision]
    symbols += [symbol_of(variant, Precision.F64, exact=True) for variant in ALL]
    assert len(set(symbols)) == len(symbols)
