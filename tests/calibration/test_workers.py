"""Worker processes: the same bits for any number of them, whatever becomes of one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from commonrail.calibration import worker_pool as pool_module
from commonrail.calibration import workers as module
from commonrail.calibration.objective import Objective
from commonrail.calibration.worker import pack, unpack
from commonrail.calibration.worker_pool import USUAL, Limits, WorkerPool, how_it_ended
from commonrail.calibration.workers import BLOCK, LONGEST, SHORTEST, Workers, cut
from commonrail.errors import ConfigurationError, StudyError
from commonrail.files.study_file import load_study
from commonrail.kinds import Role, of_role
from tests.calibration.misbehaving import Misbehaving
from tests.waiting import PATIENCE, wait_until

CASES = Path(__file__).parents[2] / "cases"
CANDIDATES = 45  # five full blocks and a part of one
MARKED = 20
# A piece of these takes some ms: a second without an answer is a worker that hangs, or a machine with much other work;
# what is taken for hanging by mistake is simulated once more.
HASTY = Limits(failures=10_000, least=1.0)

Floats = NDArray[np.float64]

pytestmark = pytest.mark.process


@pytest.fixture(scope="module")
def objective() -> Objective:
    study = load_study(CASES / "paper" / "study.toml")
    return Objective(study.injector, study.space.names, of_role(study.data, Role.FIT), study.time_step, threads=1)


@pytest.fixture(scope="module")
def population(objective: Objective) -> Floats:
    own = np.array([objective.injector.values[name] for name in objective.names])
    found: Floats = own * np.random.default_rng(1).uniform(0.8, 1.25, (CANDIDATES, len(own)))
    return found


@pytest.fixture(scope="module")
def expected(objective: Objective, population: Floats) -> bytes:
    return objective.costs(population).costs.tobytes()


@pytest.fixture(scope="module")
def two() -> Iterator[Workers]:
    with Workers.processes(2) as workers:
        yield workers


@pytest.fixture
def many_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """A population that lasts some ms is cut up too."""
    monkeypatch.setattr(module, "SHORTEST", 1e-9)


Bad = Callable[[str, int], Misbehaving]


@pytest.fixture
def bad(objective: Objective, population: Floats, tmp_path: Path) -> Bad:
    return lambda what, times: Misbehaving(objective, population[MARKED, 0], what, times, tmp_path)


def pids(workers: Workers) -> list[int]:
    assert isinstance(workers.backend, WorkerPool)
    return workers.backend.pids


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.usefixtures("many_pieces")
def test_any_number_of_processes_gives_the_bits_of_one(
    objective: Objective, population: Floats, expected: bytes, count: int
) -> None:
    with Workers.processes(count) as workers:
        spread = workers.spread(objective)
        assert len(cut(CANDIDATES, count, spread._seconds["costs"])) > 1
        scores = spread.costs(population)
        residuals = spread.residuals(population[:19])
    assert scores.costs.tobytes() == expected
    assert scores.simulations == CANDIDATES
    assert residuals.tobytes() == objective.residuals(population[:19]).tobytes()


def test_a_population_in_one_piece(two: Workers, objective: Objective, population: Floats, expected: bytes) -> None:
    assert two.spread(objective).costs(population).costs.tobytes() == expected


@pytest.mark.usefixtures("many_pieces")
def test_a_failed_candidate_is_a_cost_and_no_failure_of_its_worker(
    two: Workers, objective: Objective, population: Floats
) -> None:
    some = population.copy()
    some[3] = np.nan
    some[11] *= -1.0
    costs = two.spread(objective).costs(some).costs
    assert np.flatnonzero(np.isinf(costs)).tolist() == [3, 11]
    assert costs.tobytes() == objective.costs(some).costs.tobytes()


@pytest.mark.usefixtures("many_pieces")
@pytest.mark.parametrize(("what", "limits"), [("die", USUAL), ("hang", HASTY), ("fail", USUAL)])
def test_a_lost_piece_is_repeated_to_the_same_bits(
    two: Workers, bad: Bad, population: Floats, expected: bytes, what: str, limits: Limits
) -> None:
    spread = Workers(two.backend, limits).spread(bad(what, 1))
    before = pids(two)
    assert spread.costs(population).costs.tobytes() == expected
    assert len(set(before) & set(pids(two))) == (2 if what == "fail" else 1)
    assert spread.costs(population).costs.tobytes() == expected


@pytest.mark.usefixtures("many_pieces")
def test_a_worker_that_dies_while_idle_is_replaced(
    two: Workers, objective: Objective, population: Floats, expected: bytes
) -> None:
    spread = two.spread(objective)
    spread.costs(population)
    for pid in pids(two):
        os.kill(pid, signal.SIGKILL)
    assert spread.costs(population).costs.tobytes() == expected


@pytest.mark.usefixtures("many_pieces")
def test_a_piece_that_always_kills_its_worker_ends_the_run_and_names_few_candidates(
    two: Workers, bad: Bad, objective: Objective, population: Floats, expected: bytes
) -> None:
    spread = two.spread(bad("die", 99))
    spread._seconds["costs"] = 1e-12  # one piece: halved twice, 45 candidates are 16
    with pytest.raises(StudyError) as caught:
        spread.costs(population)
    said = str(caught.value)
    assert said.startswith("Candidates 17 to 24 of 45 were lost 3 times (the worker was ended by SIGKILL), the first")
    assert f"plunger_needle.k1 = {population[16, 0]:.6g} N/m, " in said
    assert two.spread(objective).costs(population).costs.tobytes() == expected  # the workers can go on


@pytest.mark.usefixtures("many_pieces")
def test_what_the_objective_refuses_is_refused_at_once_in_its_own_words(
    two: Workers, bad: Bad, population: Floats, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match=r"^This cannot be simulated\.$"):
        two.spread(bad("refuse", 99)).costs(population)
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.usefixtures("many_pieces")
def test_an_interrupted_population_leaves_no_answers_behind(
    two: Workers, objective: Objective, population: Floats, expected: bytes
) -> None:
    spread = two.spread(objective)
    tasks = [module.Task(spread._package, "costs", population[::-1][:16], 60.0)] * 8
    outcomes = two.backend.run(tasks)
    next(outcomes)
    outcomes.close()  # as Ctrl-C does
    assert spread.costs(population).costs.tobytes() == expected


def test_two_objectives_can_take_turns(two: Workers, objective: Objective, population: Floats, expected: bytes) -> None:
    other = Objective(objective.injector, objective.names, objective.data, 2e-6, threads=1)
    first, second = two.spread(objective), two.spread(other)
    for _ in range(2):
        assert first.costs(population).costs.tobytes() == expected
        assert second.costs(population).costs.tobytes() == other.costs(population).costs.tobytes()


@pytest.mark.parametrize(
    ("number", "wait_until_up"),
    [(signal.SIGINT, False), (signal.SIGINT, True), (signal.SIGTERM, True), (signal.SIGHUP, False)],
)
def test_a_stop_signal_to_the_group_leaves_the_workers_alone(
    objective: Objective, population: Floats, expected: bytes, number: signal.Signals, wait_until_up: bool
) -> None:
    with Workers.processes(1) as workers:
        spread = workers.spread(objective)
        if wait_until_up:
            spread.costs(population)
        before = pids(workers)
        os.kill(before[0], number)
        assert spread.costs(population).costs.tobytes() == expected
        assert pids(workers) == before


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="needs /proc to look into another process")
def test_workers_have_one_thread_and_the_caller_keeps_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "5")
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    with Workers.processes(1) as workers:
        seen = [""]
        while seen == [""]:  # not there before the process is another program
            seen = Path(f"/proc/{pids(workers)[0]}/environ").read_text().split("\0")
    assert {"NUMBA_NUM_THREADS=1", "OMP_NUM_THREADS=1", "OPENBLAS_NUM_THREADS=1"} <= set(seen)
    assert os.environ["OMP_NUM_THREADS"] == "5"
    assert "NUMBA_NUM_THREADS" not in os.environ


SCRIPT = """
import os
from commonrail.calibration.workers import Workers

def main():
    workers = Workers.processes(2)
    while {wait} and not all(worker.up for worker in workers.backend._workers):
        list(workers.backend._listen())
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


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and ") Z " in stat.read_text()  # dead, and nobody to be told


@pytest.mark.parametrize("wait_until_up", [True, False])
@pytest.mark.parametrize("then", ["os.kill(os.getpid(), 9)", "return"], ids=["killed", "without closing"])
def test_workers_end_with_their_caller(tmp_path: Path, then: str, wait_until_up: bool) -> None:
    out, _ = run_script(tmp_path, then, wait_until_up=wait_until_up).communicate(timeout=PATIENCE)
    started = [int(pid) for pid in out.split()]
    assert len(started) == 2
    wait_until(lambda: all(map(gone, started)), "workers end with their caller")


def test_a_script_without_a_guard_is_told_so(tmp_path: Path) -> None:
    then = "next(workers.backend.run([None]))"
    _, err = run_script(tmp_path, then, "True").communicate(timeout=PATIENCE)
    assert "StudyError: A worker ended with exit code 1 before it had begun, 3 times in a row; in a script" in err


@pytest.mark.parametrize("count", [0, -1, 17])
def test_a_number_of_workers_that_makes_no_sense_is_refused(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(pool_module, "usable_threads", lambda: 2)
    with pytest.raises(ConfigurationError, match=rf"must lie between 1 and 16, 8 for each processor .*, not {count}"):
        Workers.processes(count)


def test_a_worker_with_other_software_or_other_bits_is_refused(objective: Objective) -> None:
    package = pack(objective)
    assert unpack(package).threads == 1
    with pytest.raises(StudyError, match=r"than this run \(numpy 0\.1\); install the same versions"):
        unpack(package._replace(software=(*package.software[:1], ("numpy", "0.1"), *package.software[2:])))
    with pytest.raises(StudyError, match="another objective for the start values than this machine, bit for bit"):
        unpack(package._replace(probe=np.nextafter(np.frombuffer(package.probe), 0.0).tobytes()))


@pytest.mark.parametrize("case", ["paper", "cri2-16"])
def test_a_candidate_does_not_know_its_neighbours(case: str) -> None:
    # lengths and temperature set the delays of the waves: lanes that differ in them take another path in the kernel
    study = load_study(CASES / case / "study.toml")
    names = (*study.space.names[:3], "feed_pipe.length", "fuel.temperature", "return_line.length")
    objective = Objective(study.injector, names, of_role(study.data, Role.FIT), study.time_step, threads=1)
    own = np.array([study.injector.values[name] for name in names])
    values = own * np.random.default_rng(2).uniform(0.97, 1.03, (11, len(names)))
    together = objective.costs(values).costs
    assert np.isfinite(together).sum() > 5
    alone = np.concatenate([objective.costs(v[None, :]).costs for v in values])
    assert alone.tobytes() == together.tobytes()
    assert objective.costs(values[::-1]).costs[::-1].tobytes() == together.tobytes()
    backwards = objective.residuals(values[::-1])[::-1]
    assert np.ascontiguousarray(backwards).tobytes() == objective.residuals(values).tobytes()


@given(st.integers(1, 30_000), st.integers(1, 64), st.floats(1e-6, 5.0))
def test_pieces_are_whole_blocks_long_enough_and_spread_evenly(candidates: int, workers: int, seconds: float) -> None:
    pieces = cut(candidates, workers, seconds)
    assert [piece.first for piece in pieces[1:]] == [piece.stop for piece in pieces[:-1]]
    assert (pieces[0].first, pieces[-1].stop) == (0, candidates)
    assert all(piece.first % BLOCK == 0 for piece in pieces)
    longest = max(piece.blocks for piece in pieces)
    for piece in pieces[:-1]:
        assert piece.blocks == longest
        assert piece.blocks * seconds >= 0.999 * SHORTEST or len(pieces) <= 1
    # one block is the least; rounding up to whole blocks at most doubles a piece
    assert longest == 1 or longest * seconds <= 2.0 * LONGEST or len(pieces) >= workers


def test_pieces_of_the_populations_that_are_met() -> None:
    assert len(cut(50, 4, 0.7e-3)) == 1  # the paper's: 5 ms
    assert len(cut(512, 2, 2.3e-3)) == 2  # 147 ms for two: not three pieces
    assert len(cut(100, 2, 35e-3)) == 7  # 13 blocks, two in each
    assert len(cut(20_000, 2, 35e-3)) == 44  # 87 s in pieces of 2 s


@pytest.mark.parametrize(
    ("code", "words"), [(-9, "was ended by SIGKILL"), (-40, "was ended by signal 40"), (3, "ended with exit code 3")]
)
def test_how_a_worker_ended(code: int, words: str) -> None:
    assert how_it_ended(code) == words
