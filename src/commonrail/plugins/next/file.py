"""Measuring plan as CSV file and JSON record."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from commonrail.base.csv_output import write_csv
from commonrail.base.text import number
from commonrail.plugins.next.run import Measurement, MeasurementPlan
from commonrail.plugins.next.study import locate

HEADER = (
    "order",
    "kind",
    "rail_pressure [MPa]",
    "first_energising_time [us]",
    "dwell [us]",
    "energising_time [us]",
    "cost",
    "expected_quantity [mm3]",
    "standard_deviation [mm3]",
    "factor",
)


def write_plan(path: Path, plan: MeasurementPlan) -> None:
    """Write a measuring plan, one line for each measurement."""
    rows = [[str(k), *_row(measurement)] for k, measurement in enumerate(plan.measurements, 1)]
    write_csv(path, ["commonrail measuring plan", *plan.notes], HEADER, rows)


def _row(measurement: Measurement) -> list[str]:
    rail, time, dwell = locate(measurement.candidate.point)
    pulses = measurement.candidate.point.pulses
    first = f"{pulses[0].duration * 1e6:.6g}" if len(pulses) > 1 else ""
    numbers = [
        f"{1e9 * value:.4g}" if number(value) is not None else ""
        for value in (measurement.value, measurement.deviation)
    ]
    between = f"{dwell * 1e6:.6g}" if first else ""
    return [
        measurement.candidate.kind,
        f"{rail * 1e-6:.6g}",
        first,
        between,
        f"{time * 1e6:.6g}",
        f"{measurement.candidate.cost:g}",
        *numbers,
        f"{measurement.factor:.4g}",
    ]


def _record(measurement: Measurement) -> dict[str, Any]:
    rail, time, dwell = locate(measurement.candidate.point)
    return {
        "kind": measurement.candidate.kind,
        "rail_pressure": rail,
        "energisings": [list(pulse) for pulse in measurement.candidate.point.pulses],
        "energising_time": time,
        "dwell": dwell,
        "cost": measurement.candidate.cost,
        "quantity": number(measurement.value),
        "standard_deviation": number(measurement.deviation),
        "factor": measurement.factor,
        "widest_ratio": measurement.ratio,
    }


def plan_record(plan: MeasurementPlan) -> dict[str, Any]:
    """JSON-able form of a plan [SI]."""
    settings = plan.settings
    return {
        "kind": "next",
        "criterion": settings.criterion.value,
        "seed": settings.seed,
        "candidates": plan.candidates,
        "failed": plan.failed,
        "cost": plan.cost,
        "measurements": [_record(measurement) for measurement in plan.measurements],
        "standard_errors": {
            name: {"before": before, "after": plan.after[name]} for name, before in plan.before.items()
        },
        "widest": plan.widest,
        "worth_measuring": plan.is_worth_measuring,
        "alternatives": [_record(measurement) for measurement in plan.alternatives],
        "notes": list(plan.notes),
    }
