"""commonrail resume and runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from commonrail.calibration.study_file import load_study
from tests.cli.conftest import Command
from tests.runs.conftest import GENERATIONS, stopped_run, timeless, write_small


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was killed."""
    folder = tmp_path_factory.mktemp("resume")
    return stopped_run(folder / "runs" / "first", load_study(write_small(folder / "small")), 3)


def test_runs_lists_state_progress_and_best(command: Command, stopped: Path) -> None:
    words = command("runs", stopped.parent).out.split()  # a long name of the folder is broken
    state = words.index("failed")  # by a fault that stands for a kill
    assert words[state + 1] == f"3/{1 + GENERATIONS}"
    (run,) = command("runs", stopped.parent, "--json").record["runs"]
    assert run["best"] == pytest.approx(float(words[state + 3]), rel=1e-4)
    assert run["folder"] == str(stopped)
    assert 0.0 <= run["age"] < 600.0


def test_runs_says_where_there_are_none(command: Command, tmp_path: Path) -> None:
    assert command("runs", tmp_path).out == f"{tmp_path}: no runs in it.\n"
    done = command("runs", tmp_path / "none")
    assert done.status == 2
    assert "no such" in done.sentence


def test_a_damaged_run_does_not_hide_the_others(command: Command, stopped: Path) -> None:
    broken = stopped.parent / "broken"
    broken.mkdir()
    (broken / "journal.sqlite").write_text("no journal", encoding="utf-8")
    found = command("runs", stopped.parent, "--json").record["runs"]
    assert [run["state"] for run in found] == ["damaged", "failed"]


def test_resume_ends_the_run_with_its_report(command: Command, stopped: Path) -> None:
    done = command("resume", stopped, "--json")
    assert done.status == 0, done.err
    assert f"resuming {stopped}" in done.err
    assert "evolution 4/6" in done.err
    assert "evolution 3/6" not in done.err
    own = json.loads((stopped / "result.json").read_text(encoding="utf-8"))
    assert done.record["result"] == own
    assert Path(done.record["report"]).is_file()
    (run,) = [r for r in command("runs", stopped.parent, "--json").record["runs"] if r["title"]]
    assert (run["state"], run["best"]) == ("finished", own["objective"]["best"])


@pytest.mark.usefixtures("forked_workers")
def test_workers_may_go_on_where_threads_stopped(command: Command, tmp_path: Path) -> None:
    study = load_study(write_small(tmp_path / "small"))
    runs = [stopped_run(tmp_path / name, study, 2) for name in ("threads", "workers")]
    assert command("resume", runs[0]).status == 0
    assert command("resume", runs[1], "--workers", "2").status == 0
    assert timeless(runs[0]) == timeless(runs[1])


def test_more_generations(command: Command, stopped: Path) -> None:
    result = command("resume", stopped, "--generations", "2", "--json").record["result"]
    assert len(result["generations"]) == 1 + GENERATIONS + 2


@pytest.mark.parametrize("verb", [("resume",), ("resume", "--generations", "3")])
def test_a_folder_without_a_run_ends_with_2(command: Command, tmp_path: Path, verb: tuple[str, ...]) -> None:
    done = command(*verb, tmp_path)
    assert (done.status, done.out) == (2, "")
    assert f"`commonrail runs {tmp_path}` lists those in it" in done.sentence
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_another_verb_names_that_verb(command: Command, tmp_path: Path) -> None:
    (tmp_path / "journal.sqlite").touch()
    (tmp_path / "fleet.json").write_text('{"schema": 1, "kind": "fleet"}', encoding="utf-8")
    done = command("resume", tmp_path)
    assert done.status == 2
    assert "`commonrail fleet`" in done.sentence
