"""A run folder from somebody else, or changed since the fit: nothing outside it is touched, no verb takes it."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from commonrail.base.errors import InputError, StudyError
from commonrail.cli.model_name import read_model_name
from commonrail.report.page import write_report
from commonrail.runs.fit import resume
from commonrail.runs.folder import read_fit
from commonrail.runs.journal import JOURNAL, LOCK, Journal, held_run, read_about
from tests.cli.conftest import run_command
from tests.robustness.attack.samples import add_rollback
from tests.runs.conftest import Whole


@pytest.fixture
def run(whole: Whole, tmp_path: Path) -> Path:
    """A finished run."""
    return Path(shutil.copytree(whole.run, tmp_path / "run"))


@pytest.mark.parametrize("name", [JOURNAL, LOCK])
def test_a_rollback_journal_deletes_no_file(run: Path, tmp_path: Path, name: str) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    if name == LOCK:
        shutil.copy(run / JOURNAL, run / LOCK)
    add_rollback(run / name, victim)
    with pytest.raises(StudyError):
        resume(run)
    assert victim.is_file()


def test_a_journal_at_work_has_no_rollback_journal(tmp_path: Path) -> None:
    seen = []
    with Journal(tmp_path) as journal:
        seen += tmp_path.iterdir()
        journal.describe({"title": "a"})
        seen += tmp_path.iterdir()
    seen += tmp_path.iterdir()
    assert not [path for path in seen if path.name.endswith("-journal")]


def test_conditions_of_foreign_tables_are_not_computed(run: Path) -> None:
    (run / JOURNAL).unlink()
    with closing(sqlite3.connect(run / JOURNAL)) as connection, connection:
        connection.execute("PRAGMA ignore_check_constraints = on")
        connection.execute("CREATE TABLE about (name, CHECK (abs(-9223372036854775808 + 0 * length(name)) > 0))")
        connection.execute("INSERT INTO about VALUES ('a')")  # to compute the condition is an error of SQLite
        connection.execute("PRAGMA user_version = 1")
    for use in (resume, read_about):
        with pytest.raises(StudyError) as caught:
            use(run)
        assert caught.value.__cause__ is None


@pytest.mark.parametrize("name", ["study.toml", "injector.toml", "data/evi.csv", "result.json"])
@pytest.mark.parametrize("use", [read_fit, write_report, lambda run: read_model_name(str(run))])
def test_a_changed_file_is_refused_by_all_that_read_the_run(run: Path, name: str, use: Callable[[Path], Any]) -> None:
    with (run / name).open("a", encoding="utf-8") as stream:
        stream.write("\n")
    with pytest.raises(InputError, match=name):
        use(run)


def test_who_writes_into_a_run_takes_its_lock(run: Path) -> None:
    with Journal(run):
        assert run_command("certainty", run).status == StudyError.exit_code
        with pytest.raises(StudyError):
            write_report(run)
    moved = run.with_name("moved")
    with held_run(run) as lock:
        run.rename(moved)
        shutil.copytree(moved, run)
        with pytest.raises(StudyError):
            lock.check_place()
