"""The demo: two cases, the paper's study, and a folder that it may replace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from commonrail.cli.fit import Outcome
from tests.cli.conftest import Done, invoke
from tests.report import reproduction_sample
from tests.report.samples import map_record, rate_record
from tools import demo as module


def run(*arguments: object) -> Done:
    """Run the demo with arguments."""
    return invoke(module.demo, *arguments)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Cases whose calibration takes no time; returns the folder of the cases."""
    for name in module.CASES:
        (tmp_path / "cases" / name / "data").mkdir(parents=True)
        (tmp_path / "cases" / name / "study.toml").touch()
    records = {"paper": rate_record(), "cri2-16": map_record()}
    reproduction = reproduction_sample.record()

    def run_study(study: str, folder: Path, _threads: object) -> Outcome:
        folder.mkdir()
        (folder / "result.json").touch()
        return Outcome(folder, folder / "report.html", records[study])

    def run_reproduction(_truth: str, count: int, folder: Path, _threads: object, quick: bool) -> Outcome:
        assert quick
        folder.mkdir()
        claims = [claim for claim in reproduction["claims"] if claim["verdict"] != "cannot be told"]
        changed = {"seeds": list(range(1, count + 1)), "claims": claims}
        return Outcome(folder, folder / "report.html", reproduction | changed)

    def write_bench(case: Path, seed: int) -> list[Path]:
        (case / "data" / f"seed-{seed}.csv").touch()
        return []

    monkeypatch.setattr(module, "FOLDER", tmp_path / "cases")
    monkeypatch.setattr(module, "run_study", run_study)
    monkeypatch.setattr(module, "run_reproduction", run_reproduction)
    monkeypatch.setattr("commonrail.calibration.study_file.load_study", lambda path: path.parent.name)
    monkeypatch.setattr("commonrail.plugins.paper.bench_file.virtual_bench", write_bench)
    return tmp_path / "cases"


@pytest.mark.usefixtures("fake")
def test_both_cases_are_summed_up(tmp_path: Path) -> None:
    done = run("--out", tmp_path / "demo")
    assert done.status == 0, done.err
    for words in (
        "SYNTHETIC: Curves",
        "2 hold and 1 do not hold here",
        "all took",
    ):
        assert words in done.out
    for name in (*module.CASES, module.STUDY):
        assert f"  {tmp_path / 'demo' / name / 'report.html'}" in done.out


def test_missing_bench_data_are_made_once(fake: Path, tmp_path: Path) -> None:
    data = fake / "paper" / "data" / "seed-1.csv"
    assert "test bench" in run("--out", tmp_path / "demo").err
    assert data.is_file()
    assert "test bench" not in run("--out", tmp_path / "demo").err


@pytest.mark.usefixtures("fake")
def test_a_former_demo_is_replaced_and_other_files_stay(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    run("--out", out)
    (out / "paper" / "old.txt").touch()
    (out / "notes.txt").touch()
    assert run("--out", out).status == 0
    assert not (out / "paper" / "old.txt").exists()
    assert (out / "notes.txt").exists()


@pytest.mark.usefixtures("fake")
def test_a_folder_that_is_no_demo_is_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "mine"
    (out / "paper").mkdir(parents=True)
    (out / "paper" / "work.txt").touch()
    done = run("--out", out)
    assert done.status == 2
    assert "the demo" in done.sentence
    assert (out / "paper" / "work.txt").exists()


@pytest.mark.usefixtures("fake")
def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert "the demo" in run("--out", tmp_path / "file").sentence


@pytest.mark.usefixtures("fake")
def test_an_interrupted_case_ends_the_demo(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    calls: list[Any] = []

    def interrupted(_study: object, folder: Path, _threads: object) -> Outcome:
        calls.append(folder)
        return Outcome(folder, folder, rate_record() | {"status": "interrupted"})

    monkeypatch.setattr(module, "run_study", interrupted)
    assert run("--out", tmp_path / "demo").status == 130
    assert len(calls) == 1


def test_the_cases_are_in_the_source_tree() -> None:
    assert all((module.FOLDER / name / "study.toml").is_file() for name in module.CASES)
