"""The folder that a comparison leaves behind."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from commonrail.calibration.comparison import Comparison
from commonrail.files.record_file import write_record
from commonrail.files.run_folder import TRACES, rate_curves
from commonrail.files.sums import summed
from commonrail.files.traces_file import write_traces
from commonrail.kinds.records import MEASURED

__all__ = ["COMPARISON", "write_comparison"]

COMPARISON = "comparison.json"


def write_comparison(folder: Path, comparison: Comparison, record: Mapping[str, Any]) -> None:
    """Write comparison.json and traces.csv; J of every curve can be computed again from the latter."""
    synthetic = record["synthetic"]
    notes = (
        record["title"],
        f"SYNTHETIC: {synthetic}" if synthetic else "measured data",
        "a row is the mean rate of one sample, whose middle is the time; J is the sum of |model - measured|",
    )
    curves = rate_curves(comparison.data, comparison.scores)
    with summed(folder, COMPARISON, TRACES):
        write_record(folder / COMPARISON, record)
        write_traces(folder / TRACES, notes, (MEASURED, *comparison.models), curves)
