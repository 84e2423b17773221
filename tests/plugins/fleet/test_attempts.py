"""Workers that die or hang cost their injector an attempt and nothing else, whoever they are."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from commonrail.base.errors import StudyError
from commonrail.calibration.study import Study
from commonrail.plugins.fleet import run as run_module
from commonrail.plugins.fleet.member import Attempt, Calibrations, write_study
from commonrail.plugins.fleet.run import FleetRun
from commonrail.plugins.fleet.run import fleet as run_fleet
from commonrail.plugins.fleet.study import load_fleet
from commonrail.workers.workers import Workers
from tests.plugins.fleet.conftest import COUNT, edited, results
from tests.waiting import wait_until
from tests.workers.crews import NO_DASK, gone
from tools.make_fleet import make_fleet

pytestmark = [pytest.mark.process, pytest.mark.usefixtures("forked_workers")]

BAD = "SN000002"

Misbehave = Callable[[signal.Signals, int], None]


class Misbehaving(Calibrations):
    """Calibrations of which one does something to its worker, so many times; a folder counts them."""

    def __init__(self, first: Study | None, what: int, times: int, folder: Path) -> None:
        super().__init__(first)
        self.what, self.times, self.folder, self.home = what, times, folder, os.getpid()

    def __call__(self, given: Study | Path) -> Attempt:
        """Attempt at a study, which may be its file."""
        if isinstance(given, Path) and given.parent.name == BAD and os.getpid() != self.home:
            so_far = len(list(self.folder.iterdir()))
            (self.folder / str(so_far)).touch()
            if so_far < self.times:
                os.kill(os.getpid(), self.what)
        return super().__call__(given)


@pytest.fixture
def misbehave(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Misbehave:
    """Lets one injector misbehave."""

    def one(what: signal.Signals, times: int) -> None:
        (tmp_path / "counted").mkdir()
        monkeypatch.setattr(
            run_module, "Calibrations", lambda first: Misbehaving(first, what, times, tmp_path / "counted")
        )

    return one


def attempts(run: FleetRun) -> dict[str, int]:
    return {entry.name: entry.attempts for entry in run.entries}


def test_an_injector_whose_worker_dies_is_tried_again(
    fleet_file: Path, whole: FleetRun, tmp_path: Path, misbehave: Misbehave
) -> None:
    misbehave(signal.SIGKILL, 1)
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2)
    assert results(tmp_path / "run") == results(whole.folder)
    assert attempts(run) == dict.fromkeys(attempts(whole), 1) | {BAD: 2}


def test_an_injector_that_kills_every_worker_is_given_up_alone(
    fleet_file: Path, whole: FleetRun, tmp_path: Path, misbehave: Misbehave
) -> None:
    edited(fleet_file, "seed = 1", "seed = 1\nattempts = 2")
    misbehave(signal.SIGKILL, 9)
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2)
    reason = "Each of 2 attempts was lost; the last time the worker was ended by SIGKILL."
    assert run.record["failures"] == [{"injector": BAD, "reason": reason}]
    assert attempts(run)[BAD] == 2
    assert results(tmp_path / "run")[3:] == results(whole.folder)[3:]


def test_workers_that_are_no_more_leave_a_table_with_the_reason(
    fleet_file: Path, whole: FleetRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = Workers.run

    def run(self: Workers, *given: object, **how: object) -> Iterator[object]:
        answers = usual(self, *given, **how)  # type: ignore[arg-type]
        yield next(answers)
        answers.close()
        raise StudyError("A worker was ended by SIGKILL before it had begun, 3 times in a row.")

    monkeypatch.setattr(Workers, "run", run)
    with pytest.raises(StudyError, match=r"\b3\b"):
        run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=1)
    _, first, *others = results(tmp_path / "run")
    assert first == results(whole.folder)[1]
    assert [row[1:3] for row in others] == [
        ["pending", "A worker was ended by SIGKILL before it had begun, 3 times in a row."]
    ] * (COUNT - 1)
    monkeypatch.undo()
    assert run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=1).record["clock"]["calibrated_now"] == COUNT - 1
    assert results(tmp_path / "run") == results(whole.folder)


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system cannot halt a process")
def test_a_worker_that_hangs_is_replaced(
    fleet_file: Path, whole: FleetRun, tmp_path: Path, misbehave: Misbehave
) -> None:
    # 3 s is a hundred times what a calibration here takes. On a machine with much other work a sound one may be taken
    # for hanging, and is then tried again, too.
    edited(fleet_file, "seed = 1", 'seed = 1\nattempts = 10_000\ntime_limit = "3 s"')
    misbehave(signal.SIGSTOP, 1)
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2)
    assert results(tmp_path / "run") == results(whole.folder)
    assert attempts(run)[BAD] >= 2


@pytest.mark.parametrize("cluster", [None, "local"])
def test_an_injector_that_cannot_be_read_is_not_tried_again(
    fleet_file: Path, whole: FleetRun, tmp_path: Path, cluster: str | None
) -> None:
    if cluster:
        pytest.importorskip("cryptography", reason=NO_DASK)
    (fleet_file.parent / "data" / f"{BAD}_160MPa.csv").write_text("time [us]\n1\n", encoding="utf-8")
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2, cluster=cluster)
    (failure,) = run.record["failures"]
    assert failure["reason"].endswith(f'{BAD}_160MPa.csv: there is no column "rate"; the header has "time".')
    assert attempts(run) == dict.fromkeys(attempts(whole), 1)
    assert results(tmp_path / "run")[3:] == results(whole.folder)[3:]


def test_a_cluster_finds_the_same_table(fleet_file: Path, whole: FleetRun, tmp_path: Path) -> None:
    pytest.importorskip("cryptography", reason=NO_DASK)
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=2, cluster="local")
    assert run.record["counts"]["finished"] == COUNT
    assert run.record["clock"]["workers"] == 2
    assert results(tmp_path / "run") == results(whole.folder)
    assert {e.name: e.record for e in run.entries} == {e.name: e.record for e in whole.entries}


ENDLESS = """
import multiprocessing, sys
from pathlib import Path
from commonrail.plugins.fleet.member import Calibrations
from commonrail.workers.task import Task, pack
from commonrail.workers.workers import Workers

if __name__ == "__main__":
    with Workers.processes(1) as workers:
        (pid,) = workers.backend.pids
        said = []
        def check_stop():
            if workers.backend.busy and not said:
                said.append(print(pid, flush=True))
        list(workers.run([Task("A", pack(Calibrations(None)), Path(sys.argv[1]), 3600.0)], check_stop=check_stop))
"""


@pytest.mark.skipif(not Path("/proc/self/stat").is_file(), reason="looks at processes through /proc")
def test_a_worker_ends_with_its_caller_even_in_the_middle_of_its_work(tmp_path: Path) -> None:
    file = make_fleet(tmp_path / "fleet", 1, members=50, generations=1_000_000)
    study = write_study(load_fleet(file), "SN000001", tmp_path / "own")
    script = tmp_path / "endless.py"
    script.write_text(ENDLESS, encoding="utf-8")
    with subprocess.Popen([sys.executable, script, study], stdout=subprocess.PIPE, text=True) as caller:
        assert caller.stdout is not None
        pid = int(caller.stdout.readline())
        busy = processor_time(pid)
        # it reads the study, then searches
        wait_until(lambda: processor_time(pid) > busy + 0.5, "the worker has something to do")
        caller.kill()
    try:
        wait_until(lambda: gone(pid), "the worker ends with its caller")
    except AssertionError:
        os.kill(pid, signal.SIGKILL)
        raise


def processor_time(pid: int) -> float:
    """User time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return int(fields[11]) / os.sysconf("SC_CLK_TCK")
