"""A run folder that is renamed, replaced or robbed of its lock while a process is at work in it."""

from __future__ import annotations

import errno
import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from commonrail.base.errors import OutputError, StudyError
from commonrail.calibration.study_file import load_study
from commonrail.runs import lock as lock_module
from commonrail.runs.fit import Listener, calibrate_into, resume
from commonrail.runs.journal import JOURNAL, LOCK, Journal
from commonrail.runs.listing import list_runs
from commonrail.runs.lock import Lock
from tests.robustness.attack.samples import after_steps, contents
from tests.runs.conftest import Whole, timeless


def test_a_folder_renamed_at_work_writes_nothing_into_its_successor(whole: Whole, tmp_path: Path) -> None:
    run, moved = tmp_path / "run", tmp_path / "moved"

    def replace() -> None:
        run.rename(moved)
        shutil.copytree(whole.run, run)

    with pytest.raises(StudyError, match=r"run: .*renamed"):
        calibrate_into(run, load_study(whole.study), threads=1, listener=after_steps(4, replace))
    assert contents(run) == contents(whole.run)
    resume(moved, threads=1)
    assert timeless(moved) == timeless(whole.run)


def test_a_successors_log_outlives_the_end_of_the_first(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    first = Journal(run)
    first.describe({"title": "first"})
    run.rename(tmp_path / "moved")
    run.mkdir()
    with Journal(run) as second:
        second.describe({"title": "second"})
        before = sorted(path.name for path in run.iterdir() if path.name.startswith(JOURNAL))
        with pytest.raises(StudyError, match="renamed"):
            first.describe({"title": "third"})
        first.close()
        assert sorted(path.name for path in run.iterdir() if path.name.startswith(JOURNAL)) == before
        with closing(sqlite3.connect(run / JOURNAL)) as reader:  # as another process, which needs the log
            assert reader.execute("SELECT text FROM about WHERE name = 'title'").fetchone() == ("second",)
    with Journal(tmp_path / "moved") as journal:
        assert journal.about["title"] == "first"


def test_a_folder_renamed_before_its_first_step_is_not_cleared(whole: Whole, tmp_path: Path) -> None:
    run = tmp_path / "run"

    def replace(_: str) -> None:
        if not (tmp_path / "moved").exists():
            run.rename(tmp_path / "moved")
            shutil.copytree(whole.run, run)

    text = whole.study.read_text(encoding="utf-8")
    warned = whole.study.with_name("warned.toml")
    warned.write_text(text.replace('energising_time = "700 us"', 'energising_time = "0.7 us"'), encoding="utf-8")
    with pytest.raises(StudyError, match="renamed"):
        calibrate_into(run, load_study(warned), threads=1, listener=Listener(note=replace))
    assert contents(run) == contents(whole.run)


def test_a_removed_lock_lets_nobody_in(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        (tmp_path / LOCK).unlink()
        with pytest.raises(StudyError, match=r"process \d+ on "):
            Journal(tmp_path)
        journal.describe({"title": "goes on", "state": "running", "generations": "3"})
        assert [run.state for run in list_runs(tmp_path)] == ["running"]
    Journal(tmp_path).close()


def test_without_locks_of_folders_a_removed_lock_ends_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def flock(*_: object) -> None:
        raise OSError("no such locks here")

    monkeypatch.setattr(lock_module.fcntl, "flock", flock)
    with Journal(tmp_path) as journal:
        journal.describe({"title": "a"})
        (tmp_path / LOCK).unlink()
        with pytest.raises(StudyError, match="lock removed"):
            journal.describe({"title": "b"})


def test_a_lock_that_cannot_be_taken_leaves_the_folder_free(tmp_path: Path) -> None:
    (tmp_path / LOCK).symlink_to("elsewhere")
    with pytest.raises(OutputError, match="symbolic link"):
        Lock(tmp_path / LOCK)
    (tmp_path / LOCK).unlink()
    (tmp_path / LOCK).write_text("this is no database, but a text that is long enough to be taken for one" * 20)
    with pytest.raises(StudyError):
        Lock(tmp_path / LOCK)
    (tmp_path / LOCK).unlink()
    Lock(tmp_path / LOCK).close()


@pytest.mark.skipif(lock_module.fcntl is None, reason="this system has no such locks")
def test_a_file_system_without_locks_is_not_told_as_another_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_locks(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    path = tmp_path / LOCK
    with closing(sqlite3.connect(path, isolation_level=None)) as other:  # SQLite reports both cases alike
        other.execute("PRAGMA journal_mode=MEMORY")
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(BlockingIOError):
            Lock(path)
        monkeypatch.setattr(lock_module.fcntl, "lockf", without_locks)
        with pytest.raises(OutputError, match="no locks"):
            Lock(path)
