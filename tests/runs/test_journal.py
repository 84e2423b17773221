"""The journal: whole after every step, read by others, refused where it is not to be trusted."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import StudyError
from commonrail.calibration.study_file import load_study
from commonrail.engine.status import Status
from commonrail.runs.fit import Listener, calibrate_into, resume
from commonrail.runs.journal import JOURNAL, Journal, read_about
from commonrail.runs.listing import list_runs
from tests.runs.conftest import GENERATIONS, REFINEMENTS, Stop, Whole, timeless


def rows(run: Path, text: str) -> list[tuple[object, ...]]:
    with closing(sqlite3.connect(run / JOURNAL)) as connection:
        return connection.execute(text).fetchall()


def test_a_run_keeps_one_row_for_every_step(whole: Whole) -> None:
    assert rows(whole.run, "SELECT COUNT(*) FROM generation") == [(1 + GENERATIONS,)]
    assert rows(whole.run, "SELECT COUNT(*) FROM refinement") == [(REFINEMENTS,)]
    assert rows(whole.run, "PRAGMA integrity_check") == [("ok",)]


def test_members_costs_and_statuses_are_those_of_the_simulation(whole: Whole) -> None:
    study = load_study(whole.study)
    from commonrail.calibration.objective import Objective

    objective = Objective(study.injector, study.space.names, study.data, study.time_step)
    for trials, costs, statuses in rows(whole.run, "SELECT trials, costs, statuses FROM generation"):
        x = np.frombuffer(trials).reshape(-1, study.space.dimension)  # type: ignore[call-overload]
        told = np.frombuffer(costs)  # type: ignore[call-overload]
        codes = np.frombuffer(statuses, np.int8)  # type: ignore[call-overload]
        simulated = codes >= 0
        scores = objective.costs(x[simulated])
        np.testing.assert_array_equal(told[simulated], scores.costs)
        np.testing.assert_array_equal(codes[simulated], scores.statuses)
        assert np.all(np.isinf(told[~simulated]))
        assert np.array_equal(codes == Status.OK, np.isfinite(told))


def test_a_finished_run_has_one_journal_file(whole: Whole) -> None:
    assert sorted(p.name for p in whole.run.glob("journal*")) == ["journal.lock", JOURNAL]


def test_others_read_it_while_it_is_written(whole: Whole, tmp_path: Path) -> None:
    run, seen = tmp_path / "run", []

    def look(_: object) -> None:
        about = read_about(run)
        seen.append(about["generations done"] + about["refinements"])
        assert [r.state for r in list_runs(tmp_path)] == ["running"]

    calibrate_into(run, load_study(whole.study), listener=Listener(look))
    assert seen == list(range(1, 2 + GENERATIONS + REFINEMENTS))


def test_a_read_only_folder_can_be_read(stopped: Stop, monkeypatch: pytest.MonkeyPatch) -> None:
    from commonrail.runs import journal as journal_file

    run, opened = stopped(2), []

    def connect(address: str, **how: object) -> sqlite3.Connection:
        opened.append(address)
        if "immutable" not in address:  # what SQLite says of a log where it may not write beside it
            raise sqlite3.OperationalError("unable to open database file")
        return sqlite3.connect(address, **how)  # type: ignore[arg-type,call-overload]

    monkeypatch.setattr(journal_file, "_connect", connect)
    assert read_about(run)["title"]
    assert len(opened) == 2


@pytest.mark.parametrize("other", [2, 3])
def test_a_journal_of_another_version_is_refused(whole: Whole, tmp_path: Path, other: int) -> None:
    run = tmp_path / "run"
    shutil.copytree(whole.run, run)
    rows(run, f"PRAGMA user_version = {other}")
    for use in (resume, read_about):
        with pytest.raises(StudyError, match="another version"):
            use(run)


def test_tables_that_are_not_the_journal_s_are_refused(whole: Whole, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(whole.run, run)
    with closing(sqlite3.connect(run / JOURNAL)) as connection:
        connection.executescript(
            "ALTER TABLE about RENAME TO hidden; CREATE VIEW about AS "
            "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS name, i AS text FROM n;"
        )
    for use in (resume, read_about):
        with pytest.raises(StudyError, match="other tables"):
            use(run)


@pytest.mark.parametrize(
    "damage",
    [
        "UPDATE state SET arrays = x'00'",
        "UPDATE state SET arrays = 3 WHERE stage = 1",
        "UPDATE state SET search = '{}'",
        "UPDATE state SET search = '['",
        "UPDATE state SET search = replace(search, 'PCG64', 'PCG65') WHERE stage = 1",
        "UPDATE state SET sha256 = 3 WHERE stage = 1",
        "DELETE FROM state WHERE stage = 0",
        "DELETE FROM generation WHERE number = 2",
        "UPDATE generation SET best = 'good'",
        "DELETE FROM about WHERE name = 'generations'",
        "UPDATE about SET text = 'many' WHERE name = 'generations'",
        "UPDATE session SET software = '[1]'",
        "UPDATE input SET name = '../../etc/passwd' WHERE rowid = 2",
        "UPDATE input SET copy = 3",
    ],
)
def test_a_damaged_journal_is_a_sentence(stopped: Stop, damage: str) -> None:
    run = stopped(2 + GENERATIONS)
    with closing(sqlite3.connect(run / JOURNAL)) as connection, connection:
        connection.execute(damage)
    with pytest.raises(StudyError, match=r"damaged|changed|leaves"):
        resume(run)


def test_no_database_at_all(tmp_path: Path) -> None:
    (tmp_path / JOURNAL).write_bytes(b"nothing of the kind" * 100)
    for use in (resume, read_about):
        with pytest.raises(StudyError, match=r"journal\.sqlite: .*\bread as"):
            use(tmp_path)
    assert [(r.state, r.generation) for r in list_runs(tmp_path)] == [("damaged", 0)]


def test_a_checkpoint_is_what_was_kept(whole: Whole) -> None:
    with Journal(whole.run) as journal:
        found = journal.checkpoint()
    assert found is not None
    study = load_study(whole.study)
    result = timeless(whole.run)
    assert f'"injections": {found.stages[1].simulations},'.encode() in result
    assert found.stages[1].state["steps"] == REFINEMENTS
    assert len(found.history) == 1 + study.method.evolution.generations


def test_all_is_kept_whatever_the_size_of_the_numbers(whole: Whole) -> None:
    facts = timeless(whole.run).decode()
    (text,) = rows(whole.run, "SELECT search FROM state")[0]
    assert '"state": ' in str(text)  # 128 bits of the generator, as a whole number
    assert "Infinity" not in facts
