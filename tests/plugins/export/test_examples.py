"""Examples in the folder of a library: each is run where its language is, with the command line that it states."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.status import Status
from commonrail.plugins.export.library import Library
from commonrail.readers.injector import load_injector
from tests.conftest import DRAWN
from tests.plugins.export.native import Native

SIMULINK = Path(__file__).with_name("simulink")


def mass(rail: float, start: float = 0.0) -> float:
    """Mass of an example's injection by the lanes [kg]."""
    point = OperatingPoint(rail, [Energising(start, 700e-6)], horizon=3e-3)
    return simulate(load_injector(DRAWN), point).injected_mass


def program(name: str) -> str:
    """Program of this machine; the test is skipped where there is none."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"there is no {name} on this machine")
    return found


def stated(library: Library, example: str, compiler: str) -> list[str]:
    """Command line in the first comment of an example, after the compiler's name."""
    lines = [line.strip(" *") for line in (library.folder / example).read_text().splitlines()]
    (line,) = (line for line in lines if line.startswith(f"{compiler} "))
    return line.replace("PLATFORM", next(iter(library.shared))).split()[1:]


def compiled(library: Library, words: list[str], out: Path) -> list[str]:
    """Lines that a compiled example prints.

    Parameters
    ----------
    library : Library
    words : list of str
        Command line; its last word is the program, for which `out` is taken.
    out : Path
    """
    subprocess.run([words[0], "-Wall", "-Wextra", "-Werror", *words[1:-1], str(out)], cwd=library.folder, check=True)
    return subprocess.run([str(out)], capture_output=True, text=True, check=True).stdout.splitlines()


def test_python(library: Library) -> None:
    said = subprocess.run([sys.executable, "-I", str(library.folder / "example.py")], capture_output=True, text=True)
    assert said.stdout.splitlines()[-2].startswith(f"3000 us: injected {mass(160e6) * 1e6:.3f} mg"), said.stderr


def test_c(library: Library, tmp_path: Path) -> None:
    lines = compiled(library, [program("cc"), *stated(library, "example.c", "cc")], tmp_path / "example")
    assert f"injected {mass(160e6) * 1e6:.3f} mg" in lines[-2]
    assert lines[-1] == Status.OK.sentence


def test_four_cylinders_in_cpp(library: Library, native: Native, tmp_path: Path) -> None:
    lines = compiled(library, [program("c++"), *stated(library, "example.cpp", "c++")], tmp_path / "example")
    assert lines[0] == f"4 injectors, {native.vectors()} computed at once"
    for i, line in enumerate(lines[-5:-1]):
        assert f"injector {i + 1}: injected {mass(160e6 - 10e6 * i, 100e-6 * i) * 1e6:.3f} mg" in line
    assert lines[-1] == Status.OK.sentence


def test_julia(library: Library) -> None:
    julia = program("julia")
    said = subprocess.run([julia, str(library.folder / "example.jl")], capture_output=True, text=True)
    lines = said.stdout.splitlines()
    assert lines[-2].startswith("3000 us: injected "), said.stderr
    assert float(lines[-2].split()[3]) == pytest.approx(mass(160e6) * 1e6, abs=6e-4)
    assert lines[-1] == Status.OK.sentence


def test_the_s_function_with_a_stand_in_for_simulink(library: Library, tmp_path: Path) -> None:
    name, out = library.model.name, tmp_path / "block"
    words = stated(library, f"{name}_sfunction.c", "mex")
    assert words[0] == f"{name}_sfunction.c"
    strict = ("-std=c11", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function", f"-I{SIMULINK}")
    subprocess.run([program("cc"), *strict, *words, "-lm", "-o", str(out)], cwd=library.folder, check=True)
    injected, width, sample = subprocess.run([str(out)], capture_output=True, text=True, check=True).stdout.split()
    assert float(injected) == pytest.approx(mass(160e6), rel=1e-11)
    assert [int(width), float(sample)] == [15, 10e-6]
    refused = subprocess.run([str(out), "10.5e-6"], capture_output=True, text=True)
    assert "sample time" in refused.stdout


def test_every_function_that_the_julia_example_calls_is_in_the_header(library: Library) -> None:
    text, header = (library.folder / "example.jl").read_text(), library.model.header
    called = {part.split(",")[0] for part in text.split("(:")[1:]}
    assert len(called) == 8
    assert all(f" {one}(" in header or f"*{one}(" in header for one in called)
    assert " cr_" not in text
