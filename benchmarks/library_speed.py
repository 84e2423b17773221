"""Time and error of an exported library by step size: one injector, and eight in one call.

    python -m benchmarks.library_speed [INJECTIONS]

Prints Markdown tables for docs/performance.md. It needs a C compiler; run nothing else meanwhile.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from commonrail.plugins.export.library import Library, write_library
from commonrail.plugins.export.object_files import compiler_for, find_target, list_vectors, own_platform
from commonrail.plugins.export.sources import insert_model_name
from commonrail.readers.injector import load_injector

MODEL = "virtual-lino-2016"
STEPS = (0.25e-6, 0.5e-6, 1e-6, 1.5e-6, 2e-6)
FINEST = 1e-6 / 16.0  # whose mass the errors are taken from [s]
WIDTHS = {"avx2": 4, "avx512": 8}


class Timing(NamedTuple):
    """Figures that the program prints: mass [kg], times [ns], ticks."""

    mass: float
    whole: float
    ticks: float
    usual_step: float
    longest_step: float
    interrupted_step: float
    steps: float


def build(folder: Path) -> tuple[Library, Path]:
    """Library and timing program in a folder."""
    target = find_target(own_platform()[0])
    library = write_library(load_injector(MODEL), folder, [target])
    source, out = folder / "speed.c", folder / "speed"
    text = Path(__file__).with_suffix(".c").read_text(encoding="utf-8")
    source.write_text(insert_model_name(text, library.model.name), encoding="utf-8")
    static = folder / f"lib{library.model.name}.a"
    command = [*compiler_for(target).command, "-O2", str(source), str(static), "-lm", "-o", str(out)]
    subprocess.run(command, cwd=folder, check=True)
    return library, out


def timing(program: Path, step: float, width: int, rounds: int) -> Timing:
    """Timing of so many injections in steps of `step` [s].

    `width` are lanes computed at once in a block of eight; 0: one injector alone.
    """
    words = [str(program), repr(step), str(width), str(rounds)]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    return Timing(*map(float, said.split()))


def main(rounds: int) -> None:
    """Print the tables."""
    with tempfile.TemporaryDirectory() as name:
        _, program = build(Path(name))
        finest = timing(program, FINEST, 0, 1).mass
        print(f"load before: {os.getloadavg()[0]:.1f}")
        print("| injectors | lanes at once | step, us | ns per step | ticks per step | times real time | error, % |")
        print("| --- | --- | --- | --- | --- | --- | --- |")
        widths = [0, 1, *(WIDTHS[one] for one in list_vectors(find_target(own_platform()[0])))]
        found = {(width, step): timing(program, step, width, rounds) for width in widths for step in STEPS}
        for (width, step), one in found.items():
            each, error = one.whole / one.steps, 100.0 * (one.mass / finest - 1.0)
            row = [8 if width else 1, width or 1, f"{step * 1e6:g}", f"{each:.0f}", f"{one.ticks / one.steps:.0f}"]
            print("|", " | ".join(map(str, [*row, f"{step * 1e9 / each:.1f}", f"{error:.4f}"])), "|")
        print(
            "\n| injectors | lanes at once | a step of 1 us called alone, ns: median | longest | with interruptions |"
        )
        print("| --- | --- | --- | --- | --- |")
        for width in widths:
            one = found[width, 1e-6]
            times = one.usual_step, one.longest_step, one.interrupted_step
            row = [8 if width else 1, width or 1, *(f"{time:.0f}" for time in times)]
            print("|", " | ".join(map(str, row)), "|")
        print(f"load after: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
