"""Processes of our own: replaced when they die idle, deaf to stop signals, gone with their caller."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from commonrail.base.errors import ConfigurationError, StudyError
from commonrail.workers import pool as limits_module
from commonrail.workers import pool as pool_module
from commonrail.workers.pool import how_it_ended
from commonrail.workers.task import pack
from commonrail.workers.workers import Workers
from tests.waiting import PATIENCE, wait_until
from tests.workers.crews import Deed, Deeds, expected, gone, pids_of, sines, tasks

pytestmark = pytest.mark.process

MANY = [Deed(number) for number in range(20)]


def test_a_worker_that_dies_while_idle_is_replaced(tmp_path: Path) -> None:
    with Workers.processes(2) as workers:
        package = pack(Deeds(tmp_path))
        list(workers.run(tasks(package, MANY)))
        for pid in pids_of(workers):
            os.kill(pid, signal.SIGKILL)
        assert sines(workers.run(tasks(package, MANY))) == expected(MANY)


@pytest.mark.parametrize(
    ("number", "wait_until_up"),
    [
        (signal.SIGINT, False),
        pytest.param(signal.SIGINT, True, marks=pytest.mark.slow),
        (signal.SIGTERM, True),
        pytest.param(signal.SIGHUP, False, marks=pytest.mark.slow),
    ],
)
def test_a_stop_signal_to_the_group_leaves_the_workers_alone(
    tmp_path: Path, number: signal.Signals, wait_until_up: bool
) -> None:
    package = pack(Deeds(tmp_path))
    with Workers.processes(1) as workers:
        if wait_until_up:
            list(workers.run(tasks(package, MANY)))
        before = pids_of(workers)
        os.kill(before[0], number)
        assert sines(workers.run(tasks(package, MANY))) == expected(MANY)
        assert pids_of(workers) == before


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="needs /proc to look into another process")
def test_workers_have_one_thread_and_the_caller_keeps_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "5")
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    with Workers.processes(1) as workers:
        seen = [""]
        while seen == [""]:  # not there before the process is another program
            seen = Path(f"/proc/{pids_of(workers)[0]}/environ").read_text().split("\0")
    assert {"NUMBA_NUM_THREADS=1", "OMP_NUM_THREADS=1", "OPENBLAS_NUM_THREADS=1"} <= set(seen)
    assert os.environ["OMP_NUM_THREADS"] == "5"
    assert "NUMBA_NUM_THREADS" not in os.environ


SCRIPT = """
import os
from commonrail.workers.task import Task
from commonrail.workers.workers import Workers

def main():
    workers = Workers.processes(2)
    while {wait} and not all(worker.up for worker in workers.backend._workers):
        list(workers.backend.listen())
    print(*workers.backend.pids, flush=True)
    {then}

if {guard}:
    main()
"""


def run_script(
    folder: Path, then: str, guard: str = '__name__ == "__main__"', wait_until_up: bool = False
) -> subprocess.Popen[str]:
    script = folder / "script.py"
    script.write_text(SCRIPT.format(then=then, guard=guard, wait=wait_until_up))
    return subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder
    )


# Each end with workers that are up, or that are starting, and all pairs of them among the slow tests.
@pytest.mark.parametrize(
    ("then", "wait_until_up"),
    [
        ("os.kill(os.getpid(), 9)", True),
        ("return", False),
        pytest.param("raise ValueError", True, marks=pytest.mark.slow),
        pytest.param("os.kill(os.getpid(), 9)", False, marks=pytest.mark.slow),
        pytest.param("return", True, marks=pytest.mark.slow),
        ("raise ValueError", False),
    ],
    ids=["killed", "not closed-starting", "fails", "killed-starting", "not closed", "fails-starting"],
)
def test_workers_end_with_their_caller(tmp_path: Path, then: str, wait_until_up: bool) -> None:
    out, _ = run_script(tmp_path, then, wait_until_up=wait_until_up).communicate(timeout=PATIENCE)
    started = [int(pid) for pid in out.split()]
    assert len(started) == 2
    wait_until(lambda: all(map(gone, started)), "workers end with their caller")


def test_a_script_without_a_guard_is_told_so(tmp_path: Path) -> None:
    then = 'next(workers.run([Task("any", None, None, 1.0)]))'
    _, err = run_script(tmp_path, then, "True").communicate(timeout=PATIENCE)
    assert re.search(r"StudyError: .*exit code 1 .*3 times .*script", err)


def test_workers_that_never_start_end_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(pool_module, "serve", os._exit)  # given the pipe: an error, and the process ends
    with (
        Workers.processes(1) as workers,
        pytest.raises(StudyError, match=r"code 1 .*\b3 times"),
    ):
        list(workers.run(tasks(pack(Deeds(tmp_path)), MANY)))


@pytest.mark.parametrize("count", [0, -1, 17])
def test_a_number_of_workers_that_makes_no_sense_is_refused(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(limits_module, "usable_threads", lambda: 2)
    with pytest.raises(ConfigurationError, match=rf"between 1 and 16.* {count}\b"):
        Workers.processes(count)


@pytest.mark.parametrize(
    ("code", "words"), [(-9, "was ended by SIGKILL"), (-40, "was ended by signal 40"), (3, "ended with exit code 3")]
)
def test_how_a_worker_ended(code: int, words: str) -> None:
    assert how_it_ended(code) == words
