"""Figures of a program outside the project, from the table that ships with the package."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.outside import INTERVAL, Run
from commonrail.analysis.virtual_bench import PAPER_OPTIMUM
from commonrail.engine.operating_point import OperatingPoint
from commonrail.files.injector_file import load_injector

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
    runs = []
    for row in _table("runs.csv"):
        rail, energising = float(row["rail_pressure [MPa]"]), float(row["energising_time [us]"])
        runs.append(
            Run(
                injectors[row["stiffness"]],
                OperatingPoint(1e6 * rail, 1e-6 * energising, 5e6, 0.5e6, horizon=samples * INTERVAL),
                1e-9 * float(row["injected [mm3]"]),
                1e-6 * float(row["opening [us]"]),
                rates.get(f"{row['stiffness']} {rail:g} {energising:g}"),
            )
        )
    return tuple(runs)


def _rates() -> dict[str, NDArray[np.float64]]:
    """Rates [m³/s] by stiffness, rail pressure and energising time, as the columns are headed."""
    rows = _table("rates.csv")
    return {name: 1e-6 * np.array([float(row[name]) for row in rows]) for name in list(rows[0])[1:]}


def _table(name: str) -> list[dict[str, str]]:
    lines = (_FOLDER / name).read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))
