"""Sweeps and compensated energising times as tables and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.csv_output import write_csv
from commonrail.base.text import number, numbers
from commonrail.base.units import convert
from commonrail.plugins.maps.choices import CellState
from commonrail.plugins.maps.compensation import Compensation
from commonrail.plugins.maps.file import conditions_record
from commonrail.plugins.maps.sweep import Sweep, table_unit, without_number
from commonrail.plugins.maps.table import notes_of


def write_sweep(path: Path, found: Sweep) -> None:
    """Write a row for each combination."""
    head = [f"{v.name} [{table_unit(v.unit)}]" for v in found.variables] + ["quantity [mm3]"]
    if found.two:
        head += ["second_quantity [mm3]", "fused"]
    lacking = [f"{g.combinations} of {found.volume.size} without a number: {g.sentence}" for g in without_number(found)]
    note = f"simulated by commonrail, not measured: {found.injector.name} ({found.injector.variant.label})"
    dwell = "dwell: from the end of the first energising to the start of the second"
    axes = [convert(v.values, v.unit, table_unit(v.unit)) for v in found.variables]
    places = product(*([f"{value:.9g}" for value in axis.tolist()] for axis in axes))
    columns = [[_text(value) for value in (volume.ravel() * 1e9).tolist()] for volume in (found.volume, found.second)]
    columns.append(["yes" if fused else "no" for fused in found.fused.ravel().tolist()])
    columns = columns if found.two else columns[:1]
    rows = ((*place, *values) for place, *values in zip(places, *columns, strict=True))
    write_csv(path, (note, *([dwell] if found.two else []), *lacking), head, rows)


def write_compensation(path: Path, found: Compensation) -> None:
    """Write a row for each value of the condition, rail pressure and quantity."""
    head = [f"{found.condition.name} [{found.unit}]", "rail_pressure [MPa]", "quantity [mm3]"]
    head += ["energising_time [us]", "alone [us]", "state"]
    axes = found.alone.axes

    def rows() -> Iterator[Sequence[str]]:
        for d, i, j in np.ndindex(found.energising_time.shape):
            yield [
                f"{found.values[d]:.9g}",
                f"{axes.rail_pressure[i] * 1e-6:.9g}",
                f"{axes.quantity[j] * 1e9:.9g}",
                _text(float(found.energising_time[d, i, j]) * 1e6),
                _text(float(found.alone.inverse.energising_time[i, j]) * 1e6),
                CellState(int(found.inverses[d].state[i, j])).name.lower(),
            ]

    note = f"varied: {found.condition.name}"
    if found.first_energising_time > 0.0:
        note = f"energising time of the first injection {found.first_energising_time * 1e6:g} us; dwell: end to start"
    write_csv(path, (*notes_of(found.alone), note), head, rows())


def sweep_record(found: Sweep) -> dict[str, Any]:
    """Record of a sweep [SI]; null where there is no number."""
    base = {name: value for name, value in found.base._asdict().items() if name != "conditions"}
    return {
        "schema": 1,
        "kind": "sweep",
        "injector": found.injector.name,
        "synthetic": found.injector.synthetic,
        "base": base | conditions_record(found.base.conditions),
        "variables": [{"name": v.name, "unit": v.unit, "values": v.values.tolist()} for v in found.variables],
        "injected_volume": numbers(found.volume),
        "second_volume": numbers(found.second) if found.two else None,
        "fused": found.fused.tolist() if found.two else None,
        "opening": numbers(found.opening),
        "without_number": [
            {**g._asdict(), "status": g.status.name, "sentence": g.sentence} for g in without_number(found)
        ],
        "fusion": [{"rail_pressure": p, "dwell": number(d)} for p, d in found.fusion],
    }


def compensation_record(found: Compensation) -> dict[str, Any]:
    """Record of compensated energising times [SI]."""
    axes = found.alone.axes
    return {
        "schema": 1,
        "kind": "compensation",
        "injector": found.alone.injector.name,
        "synthetic": found.alone.injector.synthetic,
        "first_energising_time": found.first_energising_time,
        "condition": {**found.condition._asdict(), "values": found.condition.values.tolist()},
        "rail_pressure": axes.rail_pressure.tolist(),
        "quantity": axes.quantity.tolist(),
        "energising_time": numbers(found.energising_time),
        "alone": numbers(found.alone.inverse.energising_time),
        "state": [[[CellState(s).name for s in row] for row in part.state.tolist()] for part in found.inverses],
    }


def _text(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else ""
