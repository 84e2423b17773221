"""Sweeps and compensated energising times as tables and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.csv_output import write_csv
from commonrail.base.record import to_record
from commonrail.base.units import convert
from commonrail.plugins.maps.choices import CellState
from commonrail.plugins.maps.compensation import Compensation
from commonrail.plugins.maps.file import conditions_record
from commonrail.plugins.maps.sweep import Sweep, table_unit, without_number
from commonrail.plugins.maps.table import describe_conditions


def write_sweep(path: Path, swept: Sweep) -> None:
    """Write one row per combination."""
    head = [f"{v.name} [{table_unit(v.unit)}]" for v in swept.variables] + ["quantity [mm3]"]
    if swept.two:
        head += ["second_quantity [mm3]", "fused"]
    lacking = [f"{g.combinations} of {swept.volume.size} without a number: {g.sentence}" for g in without_number(swept)]
    note = f"simulated by commonrail, not measured: {swept.injector.name} ({swept.injector.variant.label})"
    dwell = "dwell: from the end of the first energising to the start of the second"
    axes = [convert(v.values, v.unit, table_unit(v.unit)) for v in swept.variables]
    places = product(*([f"{value:.9g}" for value in axis.tolist()] for axis in axes))
    columns = [[_text(value) for value in (volume.ravel() * 1e9).tolist()] for volume in (swept.volume, swept.second)]
    columns.append(["yes" if fused else "no" for fused in swept.fused.ravel().tolist()])
    columns = columns if swept.two else columns[:1]
    rows = ((*place, *values) for place, *values in zip(places, *columns, strict=True))
    write_csv(path, (note, *([dwell] if swept.two else []), *lacking), head, rows)


def write_compensation(path: Path, compensated: Compensation) -> None:
    """Write one row per value of the condition, rail pressure and quantity."""
    head = [f"{compensated.condition.name} [{compensated.unit}]", "rail_pressure [MPa]", "quantity [mm3]"]
    head += ["energising_time [us]", "alone [us]", "state"]
    axes = compensated.alone.axes

    def rows() -> Iterator[Sequence[str]]:
        for d, i, j in np.ndindex(compensated.energising_time.shape):
            yield [
                f"{compensated.values[d]:.9g}",
                f"{axes.rail_pressure[i] * 1e-6:.9g}",
                f"{axes.quantity[j] * 1e9:.9g}",
                _text(float(compensated.energising_time[d, i, j]) * 1e6),
                _text(float(compensated.alone.inverse.energising_time[i, j]) * 1e6),
                CellState(int(compensated.inverses[d].state[i, j])).name.lower(),
            ]

    note = f"varied: {compensated.condition.name}"
    if compensated.first_energising_time > 0.0:
        first = f"energising time of the first injection {compensated.first_energising_time * 1e6:g} us"
        note = f"{first}; dwell: end to start"
    write_csv(path, (*describe_conditions(compensated.alone), note), head, rows())


def sweep_record(swept: Sweep) -> dict[str, Any]:
    """Record of a sweep [SI]; null if a number is missing."""
    base = {name: value for name, value in swept.base._asdict().items() if name != "conditions"}
    record: dict[str, Any] = to_record(
        {
            "schema": 1,
            "kind": "sweep",
            "injector": swept.injector.name,
            "synthetic": swept.injector.synthetic,
            "base": base | conditions_record(swept.base.conditions),
            "variables": swept.variables,
            "injected_volume": swept.volume,
            "second_volume": swept.second if swept.two else None,
            "fused": swept.fused if swept.two else None,
            "opening": swept.opening,
            "without_number": [
                {**g._asdict(), "status": g.status.name, "sentence": g.sentence} for g in without_number(swept)
            ],
            "fusion": [{"rail_pressure": p, "dwell": d} for p, d in swept.fusion],
        }
    )
    return record


def compensation_record(compensated: Compensation) -> dict[str, Any]:
    """Record of compensated energising times [SI]."""
    axes = compensated.alone.axes
    record: dict[str, Any] = to_record(
        {
            "schema": 1,
            "kind": "compensation",
            "injector": compensated.alone.injector.name,
            "synthetic": compensated.alone.injector.synthetic,
            "first_energising_time": compensated.first_energising_time,
            "condition": compensated.condition,
            "rail_pressure": axes.rail_pressure,
            "quantity": axes.quantity,
            "energising_time": compensated.energising_time,
            "alone": compensated.alone.inverse.energising_time,
            "state": [
                [[CellState(s).name for s in row] for row in inverse.state.tolist()] for inverse in compensated.inverses
            ],
        }
    )
    return record


def _text(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else ""
