"""Measuring plan as CSV file and JSON record."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from commonrail.base.csv_output import write_csv
from commonrail.base.record import to_record
from commonrail.plugins.next.run import Measurement, MeasurementPlan

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
    rows = []
    for order, measurement in enumerate(plan.measurements, 1):
        candidate, (rail, time, dwell) = measurement.candidate, measurement.place
        pulses = candidate.point.pulses
        before = [f"{1e6 * value:.6g}" for value in (pulses[0].duration, dwell)] if len(pulses) > 1 else ["", ""]
        quantities = [f"{1e9 * v:.4g}" if math.isfinite(v) else "" for v in (measurement.value, measurement.deviation)]
        numbers = [f"{time * 1e6:.6g}", f"{candidate.cost:g}", *quantities, f"{measurement.factor:.4g}"]
        rows.append([str(order), candidate.kind, f"{rail * 1e-6:.6g}", *before, *numbers])
    write_csv(path, ["commonrail measuring plan", *plan.notes], HEADER, rows)


def plan_record(plan: MeasurementPlan) -> dict[str, Any]:
    """JSON-able form of a plan [SI]."""
    record = {
        "kind": "next",
        "criterion": plan.settings.criterion,
        "seed": plan.settings.seed,
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
        "notes": plan.notes,
    }
    return dict(to_record(record))


def _record(measurement: Measurement) -> dict[str, Any]:
    candidate, (rail, time, dwell) = measurement.candidate, measurement.place
    return {
        "kind": candidate.kind,
        "rail_pressure": rail,
        "energisings": [list(pulse) for pulse in candidate.point.pulses],
        "energising_time": time,
        "dwell": dwell,
        "cost": candidate.cost,
        "quantity": measurement.value,
        "standard_deviation": measurement.deviation,
        "factor": measurement.factor,
        "widest_ratio": measurement.ratio,
    }
