"""The whole benchmark: peers that are installed, their tables, and what is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks import __main__ as verbs
from benchmarks.methods import own_methods, peer_methods
from benchmarks.run import SEEDS, Stage, grids
from commonrail.runs.folder import read_record


def test_a_missing_peer_is_named_with_its_cure() -> None:
    missing = verbs.missing_peers(lambda module: None if module == "cma" else object())
    assert missing == [{"peer": "pycma", "install": "pip install 'commonrail[bench]'"}]


def test_what_is_not_installed_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verbs, "find_spec", lambda module: None)
    planned = {stage.key: stage.rows for stage in verbs.plan_stages(False)}
    assert planned["methods"] == len(own_methods(False)) + len(peer_methods()) - 2  # CVODE twice
    assert planned["searches"] == 2 * len(SEEDS)  # commonrail's and SciPy's


def test_curves_and_extrapolations_have_tables() -> None:
    curve = {"seconds": 0.5, "per_second": 2000.0, "threads": 2, "points": 1, "horizon": 3e-3}
    record: dict[str, Any] = {
        "extrapolated": [{"optimiser": "slow", "measured_simulations": 8, "simulations": 3550, "seconds": 7887.0}],
        "horizon": [curve],
        "candidates": [
            {"candidates": 1, "failed": "not done within 900 s"},
            {"candidates": 8, "seconds": 0.5, "per_second": 16.0, "peak_bytes": 201e6},
            {"candidates": 9, "seconds": 0.5, "per_second": 18.0, "peak_bytes": None},
        ],
    }
    extrapolated, horizon, candidates = grids(record, verbs.ALL_TABLES)
    assert "EXTRAPOLATED" in extrapolated.title
    assert extrapolated.rows == [("slow", "8", "3550", "7,887")]
    assert horizon.rows == [("3", "0.5", "2,000", "2")]
    assert candidates.rows == [
        ("1", "not done within 900 s", "", ""),
        ("8", "0.5", "16", "201"),
        ("9", "0.5", "18", ""),
    ]


def test_the_record_is_written_where_figures_are_drawn_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    row = {"cells": 60.0, "compiled_seconds": 1e-6, "from_python_seconds": 2e-6}
    monkeypatch.setattr(verbs, "plan_stages", lambda quick: [Stage("right_hand_side", "", 1, lambda: iter([row]))])
    path = tmp_path / "record.json"
    assert verbs.main(["speed", "--peers", "--quick", "--out", str(path)]) == 0
    record = read_record(path, "python -m benchmarks speed")
    assert record["options"] == {"peers": True, "curves": True, "quick": True}
    assert record["right_hand_side"] == [row]
    assert {m["peer"] for m in record["missing"]} == {m["peer"] for m in verbs.missing_peers()}
