"""Records of data sets, as result.json and comparison.json hold them, read by the labels of the models in them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from commonrail.base.arrays import Floats
from commonrail.base.record import to_record
from commonrail.compiler.target import describe, package_versions
from commonrail.engine.operating_point import OperatingPoint

Record = Mapping[str, Any]
Texts = Mapping[str, str]  # of the labels, in order
Traces = Mapping[str, Mapping[str, Floats]]  # by data set: "time_s", "measured", and rates by label

SCHEMA = 1  # of all records

MM3 = 1e9  # of 1 m³
MM3_PER_MS = 1e6  # of 1 m³/s: the unit of the paper's J
MICROSECOND = 1e6  # of 1 s
MPA = 1e-6  # of 1 Pa

# What a calibration compares, in the order in which a reader meets it; the paper says rigid, theoretical, optimised.
MEAN = "mean"  # the label of what several optima predict on average
LABELS = {"rigid": "rigid body", "start": "start values", "best": "calibrated", MEAN: "mean of the members"}
JUDGED = "best"  # the label whose errors are told
MEASURED = "measured"


def origin_word(data: Record) -> str:
    """Word for the values of a data set: synthetic ones are never shown as measured."""
    return "synthetic" if data.get("synthetic") else "measured"


def record_head(kind: str, title: str, synthetic: str) -> dict[str, Any]:
    """First keys of a record that a folder keeps: what it is, what made it where, what of it is not measured."""
    head = {"software": package_versions(), "target": describe().machine}
    return {"schema": SCHEMA, "kind": kind, **head, "title": title, "synthetic": synthetic}


def make_record(kind: str, result: Any) -> dict[str, Any]:
    """Record that a folder keeps of a typed result with a title: its head, and its fields by `to_record`."""
    record: dict[str, Any] = to_record(result)
    return record_head(kind, result.title, result.synthetic) | record


def point_record(point: OperatingPoint) -> dict[str, float]:
    """Pressures [Pa] at time zero and first energising time [s] of an operating point."""
    pulses = point.pulses
    rail, cylinder, low = point.initial_pressures()
    return {
        "rail_pressure": rail,
        "cylinder_pressure": cylinder,
        "return_pressure": low,
        "energising_time": pulses[0].duration if pulses else 0.0,
    }


def relative_error(value: float | None, measured: float) -> float | None:
    """Error of a value in percent of the measured one; None where either is missing."""
    return None if value is None or not measured else 100.0 * (value / measured - 1.0)
