"""The record: whole or as far as it got, JSON-able, with what is missing and load told."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks import run as bench_run
from benchmarks.run import Stage, grids, run_bench, sentences, stages
from commonrail.base.output import write_text
from commonrail.plugins.doctor.run import busy
from commonrail.runs.folder import read_record

OPTIONS = {"quick": False}
ROW = {
    "candidates": 7,
    "threads": 1,
    "precision": "f64",
    "time_step": 1e-6,
    "L1_percent": 0.02,
    "worst_L1_percent": 0.04,
    "seconds": 0.25,
    "cpu_seconds": 0.25,
    "runs": 3,
    "per_second": 28.0,
}


def rows(*found: dict[str, Any], stop: bool = False) -> Iterator[dict[str, Any]]:
    """Rows, then Ctrl-C if asked for."""
    yield from found
    if stop:
        raise KeyboardInterrupt


def one_stage(stop: bool) -> list[Stage]:
    """A stage of one row, and another behind it."""
    return [
        Stage("throughput", "populations", 2, lambda: rows(ROW, stop=stop)),
        Stage("searches", "calibrations", 1, lambda: rows({"J": 1.0})),
    ]


def test_the_record_round_trips(tmp_path: Path) -> None:
    record = run_bench(one_stage(False), options=OPTIONS)
    path = tmp_path / "bench.json"
    write_text(path, json.dumps(record, allow_nan=False))
    assert read_record(path, "bench") == record
    assert record["status"] == "finished"
    assert record["searches"] == [{"J": 1.0}]
    assert any(sentence.startswith("SYNTHETIC") for sentence in sentences(record))


def test_ctrl_c_leaves_what_was_measured() -> None:
    record = run_bench(one_stage(True), options=OPTIONS)
    assert record["status"] == "interrupted"
    assert record["throughput"] == [ROW]
    assert "searches" not in record
    assert [grid.title for grid in grids(record)] == ["Populations at one operating point"]
    assert "Interrupted" in sentences(record)[-1]


def test_progress_counts_rows() -> None:
    told: list[tuple[str, int, int]] = []
    run_bench(one_stage(True), lambda *t: told.append(t), options=OPTIONS)
    assert told == [("populations", 0, 2), ("populations", 1, 2)]


def test_what_is_missing_is_named_with_its_cure() -> None:
    missing = {"peer": "pycma", "install": "pip install 'commonrail[bench]'"}
    said = sentences(run_bench([], options=OPTIONS, missing=[missing]))
    assert re.search(r"pycma .*'commonrail\[bench\]'", " ".join(said))


def test_other_methods_and_optimisers_are_measured_behind_the_own_ones() -> None:
    planned = {stage.key: stage.rows for stage in stages(True)}
    more = {stage.key: stage.rows for stage in stages(True, bench_run.own_methods(True)[:3], [bench_run.OWN] * 2)}
    assert planned["methods"] == len(bench_run.own_methods(True))
    assert more["methods"] == planned["methods"] + 3
    assert (planned["searches"], more["searches"]) == (1, 3)
    assert planned["throughput"] == more["throughput"]


@pytest.mark.parametrize(("load", "threads", "is_busy"), [(1.1, 2, True), (1.0, 2, False), (None, 2, False)])
def test_more_than_half_a_process_a_core_is_busy(load: float | None, threads: int, is_busy: bool) -> None:
    assert busy(load, threads) is is_busy


@pytest.mark.parametrize("loads", [[98.0, 0.0, 0.0], [0.0, 98.0, 0.0]], ids=["before", "meanwhile"])
def test_a_busy_machine_is_told(loads: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    given = iter(loads)
    monkeypatch.setattr(bench_run, "load", lambda: next(given))
    record = run_bench([Stage("throughput", "populations", 1, lambda: rows(ROW))], options=OPTIONS)
    assert "busy" in record["notes"][0]


def test_its_own_load_is_not_other_work(monkeypatch: pytest.MonkeyPatch) -> None:
    given = iter([0.0, float(bench_run.usable_threads()), 0.0])
    monkeypatch.setattr(bench_run, "load", lambda: next(given))
    assert run_bench([Stage("throughput", "", 1, lambda: rows(ROW))], options=OPTIONS)["notes"] == []
