"""The folder that a comparison leaves behind: a record and traces."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from commonrail.base.output import summed
from commonrail.data.records import MEASURED
from commonrail.plugins.compare.run import Comparison
from commonrail.runs.folder import TRACES, rate_curves, write_record
from commonrail.runs.traces import write_traces

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
