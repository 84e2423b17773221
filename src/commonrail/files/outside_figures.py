"""Figures of a program outside the project, from the table that ships with the package."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources

from commonrail.analysis.outside import INTERVAL, Run
from commonrail.analysis.virtual_bench import PAPER_OPTIMUM
from commonrail.arrays import Floats
from commonrail.engine.operating_point import OperatingPoint
from commonrail.files.injector_file import load_injector
from commonrail.reading.csv_file import CsvFile
from commonrail.reading.sheet import Column

__all__ = ["load_outside"]

_FOLDER = resources.files("commonrail.analysis") / "outside_figures"
_STIFFNESS: Mapping[str, Mapping[str, float]] = {"theoretical": {}, "optimal": PAPER_OPTIMUM}  # of runs.csv


def load_outside() -> tuple[Run, ...]:
    """Read the runs with their injectors, points and, where there are some, rates."""
    with resources.as_file(_FOLDER / "injector.toml") as path:
        theoretical = load_injector(path)
    injectors = {name: theoretical.with_values(values) for name, values in _STIFFNESS.items()}
    rates = _rates()
    samples = len(next(iter(rates.values())))
    numbers = ("rail_pressure", "energising_time", "injected", "opening")
    table = _sheet("runs.csv").take([Column("stiffness"), *(Column(name, "1") for name in numbers)])
    rows = zip(table.texts["stiffness"], *(table.columns[name].tolist() for name in numbers), strict=True)
    return tuple(
        Run(
            injectors[stiffness],
            OperatingPoint(1e6 * rail, 1e-6 * energising, 5e6, 0.5e6, horizon=samples * INTERVAL),
            1e-9 * injected,
            1e-6 * opening,
            rates.get(f"{stiffness} {rail:g} {energising:g}"),
        )
        for stiffness, rail, energising, injected, opening in rows
    )


def _rates() -> dict[str, Floats]:
    """Rates [m³/s] by stiffness, rail pressure and energising time, as the columns are headed."""
    sheet = _sheet("rates.csv")
    names = sheet.names[1:]
    columns = sheet.take([Column(name, "1") for name in names]).columns
    return {name: 1e-6 * columns[name] for name in names}


def _sheet(name: str) -> CsvFile:
    with resources.as_file(_FOLDER / name) as path:
        return CsvFile(path)
