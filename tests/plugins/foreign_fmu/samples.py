"""A foreign FMU of two equations with known solutions, compiled for the tests, and data of it."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

import commonrail.plugins.export
from commonrail.plugins.export.object_files import compiler_for, find_target, run_compiler
from commonrail.plugins.foreign_fmu.data import FmuData, fmu_curve

HERE = Path(__file__).parent
HEADERS = Path(commonrail.plugins.export.__file__).parent / "c" / "fmi"
TIMES = np.linspace(0.1, 2.0, 20)
TRUTH = 1.7305  # of k; no failing value lies within 0.0005 of it, where a share of 0.2 fails


def write_decay(folder: Path, platform: str) -> Path:
    """FMU of decay.c for a platform."""
    target = find_target(platform)
    build = folder / "build"
    build.mkdir()
    sources = [HERE / "decay.c", HERE / "absent.c"]
    for name in ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"):
        (build / name).write_text((HEADERS / name).read_text())
    binary = build / f"decay{target.suffix}"
    own = compiler_for(target).command
    run_compiler([*own, "-O2", "-fPIC", "-shared", "-I.", *map(str, sources), "-o", str(binary), "-lm"], build)
    path = folder / "decay.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(HERE / "decay.xml", "modelDescription.xml")
        archive.write(binary, f"binaries/{target.fmi2}/{binary.name}")
    return path


def decay(k: float = TRUTH, x0: float = 1.0) -> np.ndarray:
    """Solution of Dahlquist's equation without input at `TIMES`."""
    return x0 * np.exp(-k * TIMES)


def decay_data(failing: float = 0.0, kind: int = 2, **more) -> FmuData:
    """The solution as measured data, of a model in which a share of all candidates fails in the stated way."""
    start = {"failing.share": failing, "failing.kind": float(kind)} if failing else {}
    return fmu_curve("decay", TIMES, {"x": decay()}, tolerance=0.01, start=start, **more)
