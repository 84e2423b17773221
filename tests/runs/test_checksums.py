"""Damage to a journal: found in every value of every row, in what SQLite keeps of tables, and when the log is lost."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from commonrail.base.errors import StudyError
from commonrail.calibration.study_file import load_study
from commonrail.runs.fit import Listener, calibrate_into, resume
from commonrail.runs.journal import JOURNAL, Journal, State, read_about
from commonrail.runs.listing import list_runs
from commonrail.runs.tables import RUN, seal
from tests.runs.conftest import Stop, Stopped, Whole, timeless

TABLES = sorted(RUN.tables)
LOG = f"{JOURNAL}-wal"


def opened(run: Path) -> closing[sqlite3.Connection]:
    return closing(sqlite3.connect(run / JOURNAL, isolation_level=None))


def changed(value: Any) -> Any:
    """A value of the same kind that is another one by little."""
    if isinstance(value, str | bytes):
        mark = "!" if isinstance(value, str) else b"!"
        return mark + value[1:]  # type: ignore[operator]
    return 1 if value is None else value + 1


def every_value(run: Path) -> Iterator[str]:
    """Journals with one value changed in the last row of each table, one after the other; the table's column."""
    for table in TABLES:
        with opened(run) as connection:
            found = connection.execute(f"SELECT rowid, * FROM {table} ORDER BY rowid DESC LIMIT 1")
            names = [column[0] for column in found.description][1:]
            row, *values = found.fetchone()
            for name, value in zip(names, values, strict=True):
                keep = "UPDATE {} SET {} = ? WHERE {}".format(table, name, "rowid = ?" if name != "number" else "1")
                connection.execute("BEGIN")
                if name in ("number", "stage"):  # the row's own key
                    connection.execute(f"UPDATE {table} SET {name} = {name} + 1 WHERE rowid = ?", (row,))
                else:
                    connection.execute(keep, (changed(value), row))
                connection.execute("COMMIT")
                yield f"{table}.{name}"
                if name in ("number", "stage"):
                    connection.execute(f"UPDATE {table} SET {name} = {name} - 1 WHERE rowid = ?", (row + 1,))
                else:
                    connection.execute(keep, (value, row))


def test_a_change_of_any_value_is_found_by_all_readers(whole: Whole, tmp_path: Path) -> None:
    run = Path(shutil.copytree(whole.run, tmp_path / "run"))
    count = 0
    for column in every_value(run):
        before = (run / JOURNAL).read_bytes()
        for use in (read_about, resume, resume):
            with pytest.raises(StudyError, match=r"journal\.sqlite: .*damaged"):
                use(run)
        assert [r.state for r in list_runs(run)] == ["damaged"], column
        assert (run / JOURNAL).read_bytes() == before, f"{column}: who refuses a journal changes nothing"
        count += 1
    assert count == 38  # columns of all tables, their seals included
    resume(run, threads=1)  # all is as it was
    assert timeless(run) == timeless(whole.run)


def test_rows_of_different_kinds_have_different_seals() -> None:
    rows: list[tuple[Any, ...]] = [(1,), ("1",), (b"1",), (None,), ("",), (b"",), ("1", ""), ("", "1"), (2**60,)]
    assert len({seal("about", row) for row in rows} | {seal("input", (1,))}) == len(rows) + 1
    assert seal("about", (2.0,)) == seal("about", (2,))  # as a column of real numbers returns it


def test_a_table_that_was_made_otherwise_is_refused(whole: Whole, tmp_path: Path) -> None:
    run = Path(shutil.copytree(whole.run, tmp_path / "run"))
    with opened(run) as connection:
        connection.execute("PRAGMA writable_schema = 1")
        connection.execute("UPDATE sqlite_master SET sql = replace(sql, 'best REAL NOT NULL', 'best REAL')")
    for use in (read_about, resume):
        with pytest.raises(StudyError, match="other tables"):
            use(run)


@pytest.fixture
def killed(whole: Whole, tmp_path: Path) -> Path:
    """A run as SIGKILL leaves it after three steps: most of its journal is in the log."""
    run, left = tmp_path / "run", tmp_path / "killed"

    def progress(p: Any) -> None:
        if p.generation == 3:
            shutil.copytree(run, left)
            raise Stopped

    with pytest.raises(Stopped):
        calibrate_into(run, load_study(whole.study), threads=1, listener=Listener(progress))
    return left


def test_a_killed_run_goes_on_from_its_log(whole: Whole, killed: Path) -> None:
    assert (killed / LOG).stat().st_size > 0
    assert [(r.state, r.generation) for r in list_runs(killed)] == [("stopped", 3)]
    resume(killed, threads=1)
    assert timeless(killed) == timeless(whole.run)


@pytest.mark.parametrize("loss", ["gone", "empty"])
def test_a_lost_log_is_damage_however_often_it_is_tried(killed: Path, loss: str) -> None:
    (killed / LOG).unlink()
    if loss == "empty":
        (killed / LOG).touch()
    for use in (read_about, resume, read_about, resume):
        with pytest.raises(StudyError, match=r"journal\.sqlite: .*journal\.sqlite-wal"):
            use(killed)
    assert [r.state for r in list_runs(killed)] == ["damaged"]


def test_a_log_that_another_program_has_merged_is_not_missed(whole: Whole, killed: Path) -> None:
    with opened(killed) as connection:
        connection.execute("SELECT COUNT(*) FROM about").fetchone()
    assert not (killed / LOG).exists()
    resume(killed, threads=1)
    assert timeless(killed) == timeless(whole.run)


def test_a_long_log_is_taken_into_the_journal(whole: Whole, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commonrail.runs.journal.LONGEST_LOG", 1000)
    run = Path(shutil.copytree(whole.run, tmp_path / "run"))
    with Journal(run) as journal:
        for _ in range(50):
            journal.end_session(State.FAILED, "x" * 1000)
        # 29 kB with a limit of 1 kB, 626 kB with the 4 MB of a run, which these rows do not come to
        assert (run / LOG).stat().st_size < 100_000
        left = Path(shutil.copytree(run, tmp_path / "left"))
    (left / LOG).unlink()
    with pytest.raises(StudyError, match="-wal "):
        resume(left)


def test_a_number_of_generations_other_than_the_study_s_is_damage(stopped: Stop) -> None:
    run = stopped(2)
    with Journal(run) as journal:
        journal.describe({"generations": "9"})
    with pytest.raises(StudyError, match=r"damaged: .*\b9\b.*study\.toml.*\b5\b"):
        resume(run)
