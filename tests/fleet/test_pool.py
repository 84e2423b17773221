"""Workers that die or hang cost their injector an attempt and nothing else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from commonrail.calibration import worker_pool
from commonrail.errors import ConfigurationError, StudyError
from commonrail.fleet import pool as pool_module
from commonrail.fleet.fleet_file import load_fleet
from commonrail.fleet.member import write_study
from commonrail.fleet.pool import Limits, Outcome, Pool
from commonrail.fleet.run import FleetRun
from commonrail.fleet.task import Done, Refused
from tests.fleet.conftest import alive
from tests.waiting import wait_until
from tools.make_fleet import make_fleet

pytestmark = pytest.mark.process

NAMES = ("SN000001", "SN000002", "SN000003")
BAD = "SN000002"


@pytest.fixture
def study_of(fleet_file: Path, tmp_path: Path) -> Callable[[str], Path]:
    """Study of an injector of the small fleet."""
    fleet = load_fleet(fleet_file)
    return lambda name: write_study(fleet, name, tmp_path / "own" / name)


def signalled(pool: Pool, number: signal.Signals, times: int) -> Callable[[], None]:
    """Sends a signal to the worker that has the bad injector in hand, so many times, each to another process.

    The second of two workers has it in hand when it says that it is up: the pool looks at what is asked of it then.
    """
    met: set[int] = set()

    def heed() -> None:
        for pid, name in pool.pids.items():
            if name == BAD and pool.up(pid) and pid not in met and len(met) < times:
                met.add(pid)
                os.kill(pid, number)

    return heed


def outcomes(pool: Pool, study_of: Callable[[str], Path], heed: Callable[[], None]) -> dict[str, Outcome]:
    return {outcome.name: outcome for outcome in pool.run(iter(NAMES), study_of, heed)}


def check_bits(found: dict[str, Outcome], whole: FleetRun, names: tuple[str, ...] = NAMES) -> None:
    expected = {entry.name: entry.record for entry in whole.entries}
    for name in names:
        answer = found[name].answer
        assert isinstance(answer, Done)
        assert answer.record == expected[name]


def test_an_injector_whose_worker_dies_is_tried_again(study_of: Callable[[str], Path], whole: FleetRun) -> None:
    with Pool(2, Limits(attempts=3)) as pool:
        found = outcomes(pool, study_of, signalled(pool, signal.SIGKILL, 1))
    check_bits(found, whole)
    assert {name: outcome.attempts for name, outcome in found.items()} == dict.fromkeys(NAMES, 1) | {BAD: 2}


def test_an_injector_that_kills_every_worker_is_given_up_alone(
    study_of: Callable[[str], Path], whole: FleetRun
) -> None:
    with Pool(2, Limits(attempts=2)) as pool:
        found = outcomes(pool, study_of, signalled(pool, signal.SIGKILL, 9))
    check_bits(found, whole, ("SN000001", "SN000003"))
    assert found[BAD].attempts == 2
    reason = "Each of 2 attempts was lost; the last time the worker was ended by SIGKILL."
    assert found[BAD].answer == Refused(reason, 0.0)


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system cannot halt a process")
def test_a_worker_that_hangs_is_replaced(study_of: Callable[[str], Path], whole: FleetRun) -> None:
    # 3 s is a hundred times what a calibration here takes. On a machine with much other work a sound one may be taken
    # for hanging, and is then tried again, too.
    with Pool(2, Limits(attempts=10_000, seconds=3.0)) as pool:
        found = outcomes(pool, study_of, signalled(pool, signal.SIGSTOP, 1))
    check_bits(found, whole)
    assert found[BAD].attempts >= 2


def test_stop_signals_do_not_reach_the_workers(study_of: Callable[[str], Path], whole: FleetRun) -> None:
    def heed() -> None:
        for pid in pool.pids:
            os.kill(pid, signal.SIGINT)
            os.kill(pid, signal.SIGTERM)

    with Pool(1, Limits(attempts=1)) as pool:
        check_bits(outcomes(pool, study_of, heed), whole)


def test_an_injector_that_cannot_be_read_is_not_tried_again(study_of: Callable[[str], Path]) -> None:
    (study_of(BAD).parents[2] / "fleet" / "data" / f"{BAD}_160MPa.csv").write_text("time [us]\n1\n", encoding="utf-8")
    with Pool(1, Limits()) as pool:
        found = outcomes(pool, study_of, lambda: None)
    answer = found[BAD].answer
    assert isinstance(answer, Refused)
    assert answer.reason.endswith(f'{BAD}_160MPa.csv: there is no column "rate"; the header has "time".')
    assert found[BAD].attempts == 1


def test_workers_that_never_start_end_it(study_of: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool_module, "serve", os._exit)  # given the pipe: an error, and the process ends
    with Pool(1, Limits()) as pool, pytest.raises(StudyError, match="before it had begun, 3 times in a row"):
        outcomes(pool, study_of, lambda: None)


def test_all_processes_end_with_the_pool() -> None:
    with Pool(2, Limits()) as pool:
        pids = list(pool.pids)
        os.kill(pids[0], 0)
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.parametrize("count", [-1, 0, 17])
def test_the_number_of_workers_has_limits(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(worker_pool, "usable_threads", lambda: 2)
    with pytest.raises(ConfigurationError, match=rf"must lie between 1 and 16, 8 for each .*, not {count}"):
        Pool(count, Limits())


ENDLESS = """
import sys
from pathlib import Path
from commonrail.fleet.pool import Limits, Pool

if __name__ == "__main__":
    with Pool(1, Limits()) as pool:
        (pid,) = pool.pids
        said = []
        def heed():
            if pool.up(pid) and not said:
                said.append(print(pid, flush=True))
        list(pool.run(iter(["A"]), lambda name: Path(sys.argv[1]), heed))
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
        wait_until(lambda: not alive(pid), "the worker ends with its caller")
    except AssertionError:
        os.kill(pid, signal.SIGKILL)
        raise


def processor_time(pid: int) -> float:
    """User time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return int(fields[11]) / os.sysconf("SC_CLK_TCK")
