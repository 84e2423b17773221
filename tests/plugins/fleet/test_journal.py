"""The journal: what it keeps, who may hold it, and what is said when it cannot be used."""

from __future__ import annotations

import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from commonrail.base.errors import OutputError, StudyError
from commonrail.compiler.target import describe
from commonrail.plugins.fleet.journal import FAILED, FINISHED, JOURNAL, Entry, Journal
from tests.plugins.fleet.conftest import calibrated

DONE = Entry("A", FINISHED, "", 1, {"160 MPa": "f"}, calibrated(0.1 + 0.2, a=0.7), 1.5)
BROKEN = Entry("B", FAILED, "Because.", 3, {}, None, 0.0)


def test_entries_are_kept_bit_by_bit(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        assert not journal.has_begun
        journal.describe({"content": "{}"})
        journal.write(DONE)
        journal.write(BROKEN)
    with Journal(tmp_path) as journal:
        assert journal.has_begun
        assert journal.entries() == {"A": DONE, "B": BROKEN}


def test_an_entry_takes_the_place_of_an_older_one(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        journal.write(BROKEN)
        journal.write(Entry("B", FINISHED, "", 1, {}, calibrated(1.0), 2.0))
        assert journal.entries()["B"].status == FINISHED


def test_others_can_read_while_it_is_held(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        journal.write(DONE)
        reader = sqlite3.connect(f"file:{tmp_path / JOURNAL}?mode=ro", uri=True)
        assert reader.execute("SELECT name FROM injector").fetchall() == [("A",)]
        assert reader.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        reader.close()


HOLD = """
import sys
from contextlib import closing
from pathlib import Path
from commonrail.plugins.fleet.journal import Journal
journal = Journal(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


@pytest.mark.process
def test_a_second_process_is_told_who_holds_it_and_a_killed_one_holds_nothing(tmp_path: Path) -> None:
    line = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(StudyError, match=rf"\b{holder.pid}\b.* 20"):
            Journal(tmp_path)
        holder.kill()
    Journal(tmp_path).close()


def test_a_change_of_any_value_is_found(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        journal.start_session()
        journal.write(DONE)
        journal.end_session("finished", "")
    whole = (tmp_path / JOURNAL).read_bytes()
    count = 0
    for table in ("about", "session", "injector"):
        with closing(sqlite3.connect(tmp_path / JOURNAL)) as connection:
            names = [column[0] for column in connection.execute(f"SELECT * FROM {table}").description]
        for name in names:
            with closing(sqlite3.connect(tmp_path / JOURNAL)) as connection, connection:
                first = f"CASE substr({name}, 1, 1) WHEN '7' THEN '8' ELSE '7' END"  # a digest may begin with 7
                connection.execute(f"UPDATE {table} SET {name} = {first} || substr({name}, 2)")
            spoilt = (tmp_path / JOURNAL).read_bytes()
            for _ in range(2):
                with pytest.raises(StudyError, match=r"fleet\.sqlite: "):
                    Journal(tmp_path)
            assert (tmp_path / JOURNAL).read_bytes() == spoilt  # who refuses a journal changes nothing
            (tmp_path / JOURNAL).write_bytes(whole)
            count += 1
    assert count == 20  # columns of all tables, their seals included
    with Journal(tmp_path) as journal:
        assert journal.entries() == {"A": DONE}


def test_a_lost_log_is_damage(tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    (tmp_path / "fleet").mkdir()
    with Journal(tmp_path / "fleet") as journal:
        journal.write(DONE)
        shutil.copytree(tmp_path / "fleet", copy)  # as SIGKILL leaves it
    (copy / f"{JOURNAL}-wal").unlink()
    for _ in range(2):
        with pytest.raises(StudyError, match=r"fleet\.sqlite-wal"):
            Journal(copy)


def test_targets_are_listed_by_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = describe()
    for cpu in ("znver3", "generic", "znver3"):
        target = usual._replace(cpu=cpu)
        monkeypatch.setattr("commonrail.runs.journal.describe", lambda target=target: target)
        with Journal(tmp_path) as journal:
            journal.start_session()
    with Journal(tmp_path) as journal:
        assert [target["cpu"] for target in journal.list_targets({1, 2})] == ["znver3", "generic"]


def test_a_journal_of_another_version_is_refused(tmp_path: Path) -> None:
    connection = sqlite3.connect(tmp_path / JOURNAL)
    connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(StudyError, match="version"):
        Journal(tmp_path)


def test_what_is_no_journal_is_refused(tmp_path: Path) -> None:
    (tmp_path / JOURNAL).write_bytes(b"something else" * 100)
    with pytest.raises(StudyError, match=r"\(.*database\)"):
        Journal(tmp_path)


def test_a_full_disk_is_an_output_error_and_costs_nothing_that_was_kept(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        journal.write(DONE)
        (pages,) = journal._connection.execute("PRAGMA page_count").fetchone()
        journal._connection.execute(f"PRAGMA max_page_count = {pages}")  # as a disk with no room left
        with pytest.raises(OutputError):
            journal.write(Entry("C", FINISHED, "", 1, {}, calibrated(1.0, **{"x" * 100_000: 1.0}), 1.0))
    with Journal(tmp_path) as journal:
        assert journal.entries() == {"A": DONE}


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(OutputError):
        Journal(tmp_path / "nowhere")
