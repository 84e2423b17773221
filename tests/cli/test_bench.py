"""commonrail bench: tables or one JSON object, a file, Ctrl-C."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from commonrail.bench import run as bench_run
from commonrail.bench.run import Stage
from tests.bench.test_run import ROW, rows
from tests.cli.conftest import Command


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> list[Stage]:
    """One stage in place of all."""
    planned = [Stage("throughput", "populations", 1, lambda: rows(ROW))]
    monkeypatch.setattr(bench_run, "stages", lambda quick: planned)
    return planned


def test_json_is_one_object_and_nothing_else(command: Command, short: list[Stage]) -> None:
    done = command("bench", "--json")
    assert done.status == 0
    assert done.record["throughput"] == [ROW]
    assert done.record["kind"] == "bench"


def test_tables_go_to_stdout_and_progress_to_stderr(command: Command, short: list[Stage]) -> None:
    done = command("bench", "--quick")
    assert "Populations" in done.out
    assert "populations 1/1" in done.err


def test_the_record_is_written(command: Command, short: list[Stage], tmp_path: Path) -> None:
    path = tmp_path / "bench.json"
    assert command("bench", "--out", path).status == 0
    written: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    assert written["throughput"] == [ROW]


def test_ctrl_c_prints_what_was_measured(command: Command, short: list[Stage]) -> None:
    short.append(Stage("searches", "calibrations", 1, lambda: rows(stop=True)))
    done = command("bench", "--json")
    assert done.status == 130
    assert done.record["throughput"] == [ROW]
    assert "interrupted" in done.sentence


def test_a_place_that_does_not_exist_is_refused_before_anything_is_measured(command: Command, tmp_path: Path) -> None:
    done = command("bench", "--out", tmp_path / "nowhere" / "bench.json")
    assert (done.status, done.out) == (2, "")
    assert "there is no folder" in done.sentence


def test_a_bad_option_ends_with_2(command: Command) -> None:
    done = command("bench", "--quic")
    assert done.status == 2
    assert "--quick" in done.err
