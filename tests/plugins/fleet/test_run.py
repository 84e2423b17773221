"""A fleet as a whole: the same bits however it is run, killed and gone on with; what has changed is refused."""

from __future__ import annotations

import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from commonrail.base.errors import InputError, StudyError
from commonrail.base.hooks import _ask
from commonrail.calibration.record import StartAndBest
from commonrail.calibration.run import calibrate
from commonrail.calibration.study_file import load_study
from commonrail.compiler.target import describe
from commonrail.plugins.fleet import member as begun_module
from commonrail.plugins.fleet.journal import FAILED, JOURNAL, Journal
from commonrail.plugins.fleet.run import FleetProgress, FleetRun
from commonrail.plugins.fleet.run import fleet as run_fleet
from commonrail.plugins.fleet.study import load_fleet
from tests.cli.conftest import run_command
from tests.plugins.fleet.conftest import COUNT, edited, results
from tests.waiting import wait_until
from tests.workers.crews import gone

ROOT = Path(__file__).resolve().parents[3]
pytestmark = [pytest.mark.process, pytest.mark.usefixtures("forked_workers")]


@pytest.fixture
def begun(whole: FleetRun, tmp_path: Path) -> tuple[Path, Path]:
    """A copy of the small fleet and of its finished folder: the fleet's file, and the folder."""
    shutil.copytree(whole.folder.parent, tmp_path / "copy")
    return tmp_path / "copy" / "fleet" / "fleet.toml", tmp_path / "copy" / "run"


def ended(folder: Path) -> dict[str, tuple[str, float]]:
    """Time at which each injector in a journal was done, and the seconds that it took."""
    with closing(sqlite3.connect(f"file:{folder / JOURNAL}?mode=ro", uri=True)) as connection:
        return {name: (at, s) for name, at, s in connection.execute("SELECT name, ended, seconds FROM injector")}


def test_the_number_of_workers_and_the_order_of_the_table_are_no_matter(
    fleet_file: Path, whole: FleetRun, tmp_path: Path
) -> None:
    table = fleet_file.parent / "injectors.csv"
    note, head, *rows = table.read_text(encoding="utf-8").splitlines()
    table.write_text("\n".join([note, head, *reversed(rows)]) + "\n", encoding="utf-8")
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2)
    head_row, *found = results(tmp_path / "run")
    expected = results(whole.folder)
    assert [head_row, *reversed(found)] == expected
    assert {e.name: e.record for e in run.entries} == {e.name: e.record for e in whole.entries}


def test_an_injectors_own_study_gives_its_result(whole: FleetRun) -> None:
    found = calibrate(load_study(whole.folder / "injectors" / "SN000004" / "study.toml"))
    record = whole.entries[3].record
    assert record is not None
    assert record.cost.best == found.cost
    assert {name: p.best for name, p in record.parameters.items()} == found.best


# A fleet that is killed once some injectors are done, and says before what its workers' process numbers are.
KILLED = """
import multiprocessing, os, signal, sys
import commonrail.plugins.fleet.run as module
usual = module.fleet
def run_fleet(*arguments, progress, **how):
    def stop(p):
        if p.done == 2:
            print(*(worker.pid for worker in multiprocessing.active_children()), flush=True)
            os.kill(os.getpid(), signal.SIGKILL)
    return usual(*arguments, progress=stop, **how)
module.fleet = run_fleet
from commonrail.cli.start import main
from tests.workers.forked import forked
with forked():
    main()
"""


def test_a_killed_fleet_goes_on_without_doing_anything_twice(fleet_file: Path, whole: FleetRun, tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = ["fleet", str(fleet_file), "--out", str(out), "--workers", "2"]
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, *command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    workers = [int(pid) for pid in killed.stdout.split()]
    assert len(workers) == 2
    before = ended(out)
    assert 2 <= len(before) < COUNT
    wait_until(lambda: all(map(gone, workers)), "the workers end with their caller")
    done = run_command(*command, "--json")
    assert done.status == 0, done.err
    after = ended(out)
    assert {name: after[name] for name in before} == before
    assert f'"calibrated_now": {COUNT - len(before)}' in done.out
    assert results(out) == results(whole.folder)


def test_an_interrupted_fleet_keeps_what_is_done(fleet_file: Path, whole: FleetRun, tmp_path: Path) -> None:
    def stop(p: FleetProgress) -> None:
        if p.done == 3:
            os.kill(os.getpid(), signal.SIGINT)

    assert signal.getsignal(signal.SIGINT) is not _ask
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=1, progress=stop)
    assert run.interrupted
    assert run.record["counts"] == {"injectors": COUNT, "finished": 3, "failed": 0, "pending": 3}
    assert [row[1] for row in results(tmp_path / "run")[1:]] == ["finished"] * 3 + ["pending"] * 3
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2)
    assert run.record["clock"]["calibrated_now"] == 3
    assert results(tmp_path / "run") == results(whole.folder)


def test_a_bad_file_costs_one_injector_and_is_tried_again_once_it_is_mended(
    fleet_file: Path, whole: FleetRun, tmp_path: Path
) -> None:
    bad = fleet_file.parent / "data" / "SN000002_160MPa.csv"
    good = bad.read_text(encoding="utf-8")
    bad.write_text(good.replace("\n6,", "\n6,x", 1), encoding="utf-8")
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2)
    (failure,) = run.record["failures"]
    assert failure["injector"] == "SN000002"
    assert 'SN000002_160MPa.csv, line 4, column "rate": "x' in failure["reason"]
    assert run.record["counts"]["finished"] == COUNT - 1
    again = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2)
    assert again.record["clock"]["calibrated_now"] == 0  # nothing has changed
    again = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=1, retry=True)
    assert again.record["clock"]["calibrated_now"] == 1
    bad.write_text(good, encoding="utf-8")
    run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2)
    assert results(tmp_path / "run") == results(whole.folder)


def test_a_failed_injector_may_leave_the_table(fleet_file: Path, whole: FleetRun, tmp_path: Path) -> None:
    (fleet_file.parent / "data" / "SN000001_160MPa.csv").unlink()
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2)
    assert [failure["injector"] for failure in run.record["failures"]] == ["SN000001"]
    edited(fleet_file.parent / "injectors.csv", "SN000001,data/SN000001_160MPa.csv,data/SN000001_80MPa.csv\n", "")
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2)
    assert run.record["counts"] == {"injectors": COUNT - 1, "finished": COUNT - 1, "failed": 0, "pending": 0}
    assert results(tmp_path / "run")[1:] == results(whole.folder)[2:]


def test_a_fault_of_all_is_told_before_any_work(fleet_file: Path, tmp_path: Path) -> None:
    for data in (fleet_file.parent / "data").iterdir():
        data.unlink()
    with pytest.raises(InputError, match=r"\b3\b.*160MPa.csv"):
        run_fleet(load_fleet(fleet_file), tmp_path / "run")
    assert ended(tmp_path / "run") == {}


def test_a_fault_of_the_common_study_is_told_before_any_work(fleet_file: Path, tmp_path: Path) -> None:
    edited(fleet_file.parent / "study.toml", 'name = "valve.spring_preload"', 'name = "valve.spring_prelaod"')
    with pytest.raises(InputError, match=r"study.toml, parameter\[4\].name: .*spring_prelaod"):
        run_fleet(load_fleet(fleet_file), tmp_path / "run")
    assert not (tmp_path / "run").exists() or ended(tmp_path / "run") == {}


def test_injectors_may_be_added(begun: tuple[Path, Path], whole: FleetRun) -> None:
    file, folder = begun
    table = file.parent / "injectors.csv"
    first = table.read_text(encoding="utf-8").splitlines()[2]
    with table.open("a", encoding="utf-8") as stream:
        stream.write(first.replace("SN000001,", "late,", 1) + "\n")
    run = run_fleet(load_fleet(file), folder, workers=1)
    assert run.record["clock"]["calibrated_now"] == 1
    assert results(folder)[:-1] == results(whole.folder)
    late, like = results(folder)[-1], results(folder)[1]
    assert late[0] == "late"
    assert late[3] == like[3]  # J of the start values: the same data
    assert late[-1] != like[-1]  # a seed of its own


def test_a_moved_folder_goes_on(begun: tuple[Path, Path], tmp_path: Path) -> None:
    file, folder = begun
    moved = shutil.move(folder, tmp_path / "elsewhere")
    assert run_fleet(load_fleet(file), Path(moved)).record["clock"]["calibrated_now"] == 0


CHANGES = {
    "template": ("study.toml", "generations = 3", "generations = 4", r"study\.toml"),
    "seed": ("fleet.toml", "seed = 1", "seed = 2", 'seed "1".*"2"'),
    "left out": ("fleet.toml", "seed = 1", 'leave_out = ["80 MPa"]', 'leave_out "".*"80 MPa"'),
    "data": (
        "data/SN000005_80MPa.csv",
        "\n9,",
        "\n9,1",
        '"SN000005" .*"80 MPa"',
    ),
    "file": (
        "injectors.csv",
        "data/SN000005_80MPa",
        "data/SN000004_80MPa",
        '"SN000005" .*"80 MPa"',
    ),
    "removed": ("injectors.csv", "SN000005,", "other,", '"SN000005".*injectors.csv'),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_refused_and_named(begun: tuple[Path, Path], change: str) -> None:
    file, folder = begun
    name, old, new, message = CHANGES[change]
    edited(file.parent / name, old, new)
    before = ended(folder)
    with pytest.raises(StudyError, match=message):
        run_fleet(load_fleet(file), folder)
    assert ended(folder) == before


def test_other_software_is_refused(begun: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    file, folder = begun
    monkeypatch.setattr(begun_module, "package_versions", lambda: {"numpy": "1.0"})
    with pytest.raises(StudyError, match=r'commonrail ".+".*""'):
        run_fleet(load_fleet(file), folder)


def test_another_target_or_other_bits_are_said(begun: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    file, folder = begun
    with Journal(folder) as journal:
        assert journal.targets == [describe().record]
        first, *_, last = journal.entries().values()
        journal.write(last._replace(status=FAILED, reason="lost", record=None))
        best = first.result.best_cost
        wrong = best * (1.0 + 2.0**-52)
        journal.write(first._replace(record=first.result._replace(cost=StartAndBest(first.result.cost.start, wrong))))
    other = describe()._replace(cpu="znver9")
    monkeypatch.setattr("commonrail.runs.journal.describe", lambda: other)
    told: list[str] = []
    monkeypatch.setattr("commonrail.plugins.fleet.run.note", told.append)
    run = run_fleet(load_fleet(file), folder, workers=1, retry=True)
    (warning,) = run.record["warnings"]
    assert (warning["code"], warning["injectors"], warning["first"]) == ("target", COUNT - 1, "SN000001")
    assert warning["sentence"] in told[0]
    for words in (describe().cpu, "znver9", "SN000001", repr(best), repr(wrong)):
        assert words in warning["sentence"]
    again = run_fleet(load_fleet(file), folder).record["warnings"]  # nothing is calibrated: the mixture stays
    assert "znver9" in again[0]["sentence"]
    assert repr(wrong) not in again[0]["sentence"]


def test_a_title_may_change(begun: tuple[Path, Path]) -> None:
    file, folder = begun
    fleet = replace(load_fleet(file), title="Another title")
    assert run_fleet(fleet, folder).record["title"] == "Another title"


def test_another_folder_is_not_touched(fleet_file: Path) -> None:
    with pytest.raises(InputError, match=re.escape(str(fleet_file.parent))):
        run_fleet(load_fleet(fleet_file), fleet_file.parent)


def test_a_fault_of_the_template_can_be_mended(fleet_file: Path, tmp_path: Path) -> None:
    study = edited(fleet_file.parent / "study.toml", 'name = "valve.spring_preload"', 'name = "valve.spring_prelaod"')
    with pytest.raises(InputError, match="spring_prelaod"):
        run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=1)
    edited(study, 'name = "valve.spring_prelaod"', 'name = "valve.spring_preload"')
    assert run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2).record["counts"]["finished"] == COUNT


def test_a_fleet_killed_before_its_journal_was_there_can_be_begun(fleet_file: Path, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "fleet.lock").touch()
    assert run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2).record["counts"]["finished"] == COUNT


def test_an_emptied_journal_beside_results_is_refused(begun: tuple[Path, Path]) -> None:
    path, folder = begun
    (folder / JOURNAL).write_bytes(b"")
    before = (folder / "results.csv").read_bytes()
    with pytest.raises(InputError, match=r"fleet\.sqlite: this journal is empty.*nothing was overwritten"):
        run_fleet(load_fleet(path), folder, workers=1)
    assert (folder / "results.csv").read_bytes() == before
    assert not (folder / JOURNAL).stat().st_size
