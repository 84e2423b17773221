"""The verbs of ``python -m benchmarks``: tables or one JSON object, a file, Ctrl-C."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from benchmarks import __main__ as verbs
from benchmarks.run import Stage
from tests.benchmarks.test_run import ROW, rows


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> list[Stage]:
    """One stage in place of all."""
    planned = [Stage("throughput", "populations", 1, lambda: rows(ROW))]
    monkeypatch.setattr(verbs, "stages", lambda quick: planned)
    return planned


def test_json_is_one_object_and_nothing_else(short: list[Stage], capsys: pytest.CaptureFixture[str]) -> None:
    assert verbs.main(["speed", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["throughput"] == [ROW]
    assert record["kind"] == "bench"


def test_tables_go_to_stdout_and_progress_to_stderr(short: list[Stage], capsys: pytest.CaptureFixture[str]) -> None:
    assert verbs.main(["speed", "--quick"]) == 0
    done = capsys.readouterr()
    assert "Populations" in done.out
    assert "populations 1/1" in done.err


def test_the_record_is_written(short: list[Stage], tmp_path: Path) -> None:
    path = tmp_path / "bench.json"
    assert verbs.main(["speed", "--out", str(path)]) == 0
    written: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    assert written["throughput"] == [ROW]


def test_ctrl_c_prints_what_was_measured(short: list[Stage], capsys: pytest.CaptureFixture[str]) -> None:
    short.append(Stage("searches", "calibrations", 1, lambda: rows(stop=True)))
    assert verbs.main(["speed", "--json"]) == 130
    done = capsys.readouterr()
    assert json.loads(done.out)["throughput"] == [ROW]
    assert "interrupted" in done.err


def test_a_place_that_does_not_exist_is_refused_before_anything_is_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert verbs.main(["speed", "--out", str(tmp_path / "nowhere" / "bench.json")]) == 2
    done = capsys.readouterr()
    assert done.out == ""
    assert "no folder" in done.err


def test_optimisers_compares_and_writes_every_step(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = tmp_path / "record.json"
    words = ["optimisers", "--seeds", "1", "--evaluations", "60", "--method", "staged", "--out", str(record)]
    assert verbs.main(words) == 0
    done = capsys.readouterr()
    assert "staged" in done.out
    assert "multi-start" not in done.out
    found = json.loads(record.read_text(encoding="utf-8"))
    assert [row["optimiser"] for row in found["searches"]] == ["differential evolution", "staged least squares"]
    assert found["searches"][0]["evaluations"] == [50, 100]


def test_an_unknown_optimiser_is_refused_in_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert verbs.main(["optimisers", "--method", "annealing"]) == 2
    assert re.search(r'"annealing"; .*differential evolution, ', capsys.readouterr().err)
