"""Write the curves of the virtual test bench as the data files of a case."""

from __future__ import annotations

from pathlib import Path

from commonrail.analysis.truth import Truth
from commonrail.analysis.virtual_bench import Curve, bench_curve
from commonrail.errors import InputError
from commonrail.files.atomic import write_csv
from commonrail.files.injector_file import load_injector
from commonrail.files.truth_file import load_truth
from commonrail.reading.guarded_file import read_plain

__all__ = ["DEFAULT_TRUTH", "ENERGISING_TIME", "RAIL_PRESSURES", "write_bench_data"]

DEFAULT_TRUTH = "virtual-lino-2016"
RAIL_PRESSURES = (160e6, 120e6, 80e6)  # Sec. 5
ENERGISING_TIME = 700e-6

OWN = "# SYNTHETIC: virtual test bench of commonrail, not a measurement"  # first line of a file of the bench


def write_bench_data(folder: Path, seed: int, truth: Truth | None = None) -> list[Path]:
    """Simulate the paper's three injection curves on the virtual test bench and write them to ``folder/data``.

    Parameters
    ----------
    folder : Path
        Folder of the case.
    seed : int
        Of scatter and noise: the same seed gives the same files.
    truth : Truth, optional
        `DEFAULT_TRUTH` if left out.

    Raises
    ------
    InputError
        If the files cannot be written, or one of them exists and is not the bench's own.
    SimulationError
        If the truth cannot be simulated.
    """
    truth = truth or load_truth(DEFAULT_TRUTH)
    injector = load_injector(truth.injector)
    for pressure in RAIL_PRESSURES:
        _refuse_to_overwrite(_path(folder / "data", pressure))
    curves = [bench_curve(truth, injector, pressure, ENERGISING_TIME, seed) for pressure in RAIL_PRESSURES]
    try:
        (folder / "data").mkdir(parents=True, exist_ok=True)
        return [_write(folder / "data", curve, seed, truth) for curve in curves]
    except OSError as error:
        raise InputError(f"{folder}: the data cannot be written ({error.strerror}); name another folder.") from error


def _path(folder: Path, rail_pressure: float) -> Path:
    return folder / f"evi_{round(rail_pressure * 1e-6)}MPa.csv"


def _refuse_to_overwrite(path: Path) -> None:
    """Refuse a file that the bench has not made: it may be a measurement."""
    if path.exists() and not read_plain(path).startswith(OWN.encode()):
        raise InputError(f"{path}: this file was not made by the virtual test bench; move it or name another folder.")


def _write(folder: Path, curve: Curve, seed: int, truth: Truth) -> Path:
    mpa = round(curve.rail_pressure * 1e-6)
    path = _path(folder, curve.rail_pressure)
    notes = (
        OWN.removeprefix("# "),
        f"truth {truth.name} ({' '.join(truth.title.split())}), seed {seed}",
        f"asked for: rail pressure {mpa} MPa, energising time {ENERGISING_TIME * 1e6:g} us",
        "a row: mean rate over the 3 us that end at its time, and pressure at the injector's inlet at",
        "its time, each as its sensor shows it",
    )
    samples = zip(curve.time, curve.rate, curve.rail, strict=True)
    rows = ([f"{time * 1e6:.3f}", f"{rate * 1e6:.9g}", f"{rail * 1e-6:.9g}"] for time, rate, rail in samples)
    write_csv(path, notes, ["time [us]", "rate [mm3/ms]", "rail pressure [MPa]"], rows)
    return path
