"""Values of a search that was stopped are told as such, once."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from commonrail.cli.model_name import read_model_name
from commonrail.readers.injector import load_injector
from commonrail.readers.injector_writer import dump_injector
from commonrail.report.fit.rules import BAD, TITLES
from commonrail.runs.folder import note_stopped
from tests.report.samples import map_record


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Notes that were given."""
    found: list[str] = []
    monkeypatch.setattr("commonrail.base.hooks._note", found.append)
    return found


def run(folder: Path, status: str) -> Path:
    """Run folder with a calibrated injector and as much of a result as is asked for."""
    folder.mkdir()
    dump_injector(load_injector("virtual-lino-2016"), folder / "calibrated.toml", {})
    (folder / "result.json").write_text(json.dumps({"status": status}), encoding="utf-8")
    return folder


def test_a_stopped_search_is_told_once_whoever_asks(tmp_path: Path, told: list[str]) -> None:
    stopped = run(tmp_path / "stopped", "interrupted")
    read_model_name(str(stopped))
    read_model_name(f"{stopped}@rigid")
    note_stopped(stopped, {"status": "interrupted"})
    (sentence,) = told
    assert sentence.startswith(f"{stopped}: the search was stopped before its end")
    assert f"`commonrail resume {stopped}`" in sentence


@pytest.mark.parametrize("result", ['{"status": "finished"}', "{", None])
def test_a_search_that_has_ended_is_not_told(tmp_path: Path, told: list[str], result: str | None) -> None:
    folder = run(tmp_path / "run", "finished")
    if result is None:
        (folder / "result.json").unlink()
    else:
        (folder / "result.json").write_text(result, encoding="utf-8")
    read_model_name(str(folder))
    assert told == []


@pytest.mark.parametrize(("percent", "is_told"), [(40.0, True), (2.0, False)])
def test_a_run_that_is_not_usable_is_told(tmp_path: Path, told: list[str], percent: float, is_told: bool) -> None:
    """Whoever simulates it, or computes a map for a control unit."""
    folder = run(tmp_path / "run", "finished")
    record = map_record()
    for data in record["data"]:
        data["figures"]["best"]["rms_large_percent"] = percent
    (folder / "result.json").write_text(json.dumps(record), encoding="utf-8")
    read_model_name(str(folder))
    assert any(TITLES[BAD] in sentence for sentence in told) is is_told
