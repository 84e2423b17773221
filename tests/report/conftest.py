"""Run folders made up by hand: one with injection curves, one with a quantity map."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.report.samples import map_record, rate_record, rate_traces

WriteRun = Callable[..., Path]


def write_traces(path: Path, traces: dict[str, dict[str, np.ndarray]]) -> None:
    """traces.csv in the form that the run folder keeps."""
    labels = ("measured", "rigid", "start", "best")
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write("# made up for a test\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["data", "time [us]", *(f"{label} [mm3/ms]" for label in labels)])
        for name, trace in traces.items():
            for k, moment in enumerate(trace["time_s"]):
                cells = [repr(float(trace[c][k] * 1e6)) if c in trace else "" for c in labels]
                writer.writerow([name, repr(float(moment * 1e6)), *cells])


@pytest.fixture
def write_run(tmp_path: Path) -> WriteRun:
    """Write a record and its traces as a run folder."""

    def write(record: dict[str, Any], traces: dict[str, Any] | None = None) -> Path:
        folder = tmp_path / "run"
        folder.mkdir()
        (folder / "result.json").write_text(json.dumps(record), encoding="utf-8")
        write_traces(folder / "traces.csv", traces or {})
        return folder

    return write


@pytest.fixture
def rate_run(write_run: WriteRun) -> Path:
    """Run folder of a synthetic study of injection curves."""
    record = rate_record()
    return write_run(record, rate_traces(record))


@pytest.fixture
def map_run(write_run: WriteRun) -> Path:
    """Run folder of a study of a measured quantity map."""
    return write_run(map_record())
