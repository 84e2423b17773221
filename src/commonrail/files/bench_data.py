"""Write the curves of the virtual test bench as the data files of a case."""

from __future__ import annotations

import csv
from pathlib import Path

from commonrail.analysis.virtual_bench import Curve, bench_curves
from commonrail.errors import InputError
from commonrail.files.injector_file import load_injector

RAIL_PRESSURES = (160e6, 120e6, 80e6)
ENERGISING_TIME = 700e-6


def write_bench_data(folder: Path, seed: int) -> list[Path]:
    """Simulate the paper's three injection curves on the virtual test bench and write them to ``folder/data``.

    Parameters
    ----------
    folder : Path
        Folder of the case.
    seed : int
        Of the rate meter's noise: the same seed gives the same files.

    Raises
    ------
    InputError
        If the files cannot be written.
    """
    injector = load_injector("virtual-lino-2016")
    curves = bench_curves(injector, RAIL_PRESSURES, ENERGISING_TIME, seed)
    try:
        (folder / "data").mkdir(parents=True, exist_ok=True)
        return [_write(folder / "data", curve, seed) for curve in curves]
    except OSError as error:
        raise InputError(f"{folder}: the data cannot be written ({error.strerror}); name another folder.") from error


def _write(folder: Path, curve: Curve, seed: int) -> Path:
    mpa = round(curve.rail_pressure * 1e-6)
    path = folder / f"evi_{mpa}MPa.csv"
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write("# SYNTHETIC: virtual test bench of commonrail, not a measurement\n")
        stream.write(f"# rail pressure {mpa} MPa, energising time 700 us, seed {seed}; a row is the mean rate of the\n")
        stream.write("# 3 us that end at its time, seen through a rate meter with limited bandwidth and noise\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["time [us]", "rate [mm3/ms]"])
        for moment, rate in zip(curve.time, curve.rate, strict=True):
            writer.writerow([f"{moment * 1e6:.3f}", f"{rate * 1e6:.2f}"])
    return path
