"""The record: whole or as far as it got, JSON-able, with missing peers and load told."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from commonrail.bench import run as bench_run
from commonrail.bench.machine import busy
from commonrail.bench.record import grids, sentences
from commonrail.bench.run import Options, Stage, missing_peers, run_bench, stages
from commonrail.files.atomic import write_text
from commonrail.files.record_file import read_record

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
    record = run_bench(Options(), planned=lambda _: one_stage(False))
    path = tmp_path / "bench.json"
    write_text(path, json.dumps(record, allow_nan=False))
    assert read_record(path, "bench") == record
    assert record["status"] == "finished"
    assert record["searches"] == [{"J": 1.0}]
    assert any(sentence.startswith("SYNTHETIC") for sentence in sentences(record))


def test_ctrl_c_leaves_what_was_measured() -> None:
    record = run_bench(Options(), planned=lambda _: one_stage(True))
    assert record["status"] == "interrupted"
    assert record["throughput"] == [ROW]
    assert "searches" not in record
    assert [grid.title for grid in grids(record)] == ["Populations at one operating point"]
    assert "Interrupted" in sentences(record)[-1]


def test_progress_counts_rows() -> None:
    told: list[tuple[str, int, int]] = []
    run_bench(Options(), lambda *t: told.append(t), planned=lambda _: one_stage(True))
    assert told == [("populations", 0, 2), ("populations", 1, 2)]


def test_a_missing_peer_is_named_with_its_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = missing_peers(lambda module: None if module == "cma" else object())
    assert missing == [{"peer": "pycma", "install": "pip install 'commonrail[bench]'"}]
    monkeypatch.setattr(bench_run, "missing_peers", lambda: missing)
    said = sentences(run_bench(Options(peers=True), planned=lambda _: []))
    assert "pycma is not installed; `pip install 'commonrail[bench]'` installs it." in said


def test_what_is_not_installed_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_run, "find_spec", lambda module: None)
    planned = {stage.key: stage.rows for stage in stages(Options(peers=True))}
    everything = len(bench_run.own_methods(False)) + len(bench_run.peer_methods())
    assert planned["methods"] == everything - 2  # CVODE twice
    assert planned["searches"] == 2 * len(bench_run.SEEDS)  # commonrail's and SciPy's


def test_without_peers_there_are_none() -> None:
    planned = {stage.key: stage.rows for stage in stages(Options())}
    assert planned["methods"] == len(bench_run.own_methods(False))
    assert "extrapolated" not in planned
    assert "candidates" not in planned


@pytest.mark.parametrize(("load", "threads", "is_busy"), [(1.1, 2, True), (1.0, 2, False), (None, 2, False)])
def test_more_than_half_a_process_a_core_is_busy(load: float | None, threads: int, is_busy: bool) -> None:
    assert busy(load, threads) is is_busy


@pytest.mark.parametrize("loads", [[98.0, 0.0, 0.0], [0.0, 98.0, 0.0]], ids=["before", "meanwhile"])
def test_a_busy_machine_is_told(loads: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    given = iter(loads)
    monkeypatch.setattr(bench_run, "load", lambda: next(given))
    record = run_bench(Options(), planned=lambda _: [Stage("throughput", "populations", 1, lambda: rows(ROW))])
    assert "busy with other work" in record["notes"][0]


def test_its_own_load_is_not_other_work(monkeypatch: pytest.MonkeyPatch) -> None:
    given = iter([0.0, float(bench_run.usable_threads()), 0.0])
    monkeypatch.setattr(bench_run, "load", lambda: next(given))
    assert run_bench(Options(), planned=lambda _: [Stage("throughput", "", 1, lambda: rows(ROW))])["notes"] == []
