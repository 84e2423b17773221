"""Contract of every backend: the same answers whoever works, whatever becomes of a worker, and nothing left behind."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from commonrail.base.errors import ConfigurationError, StudyError
from commonrail.workers.pool import Limits
from commonrail.workers.task import Lost, Package, Task, pack
from commonrail.workers.workers import Workers
from tests.waiting import wait_until
from tests.workers.crews import (
    CREWS,
    LIMIT,
    Crew,
    Deed,
    Deeds,
    cluster,
    expected,
    gone,
    pids_of,
    processes,
    sines,
    tasks,
    with_other,
)

# How workers of our own start is the subject of test_pool.py.
pytestmark = [pytest.mark.process, pytest.mark.usefixtures("forked_workers")]

MANY = [Deed(number) for number in range(40)]
BAD = 7
# An answer takes some ms: so long without one is a worker that hangs, or a machine with much other work; what is taken
# for hanging by mistake is done once more. A worker of a cluster, once started anew, must answer within it [s].
HASTY = Limits(failures=10_000)
SHORT = {"processes": 2.0, "cluster": 20.0}


@pytest.fixture(params=CREWS)
def crew(request: pytest.FixtureRequest) -> Crew:
    return CREWS[request.param]


@pytest.fixture(scope="module", params=CREWS)
def two(forked_workers: None, request: pytest.FixtureRequest) -> Iterator[Workers]:
    """Two workers for all tests that leave them as they were."""
    with CREWS[request.param](2) as workers:
        yield workers


@pytest.fixture
def package(tmp_path: Path) -> Package:
    return pack(Deeds(tmp_path))


def with_a(deed: str, times: int = 1) -> list[Deed]:
    """Many deeds, and one of them another than sines."""
    return [d._replace(instead=deed, times=times) if d.number == BAD else d for d in MANY]


@pytest.mark.parametrize(("crew", "count"), [(processes, 1), (processes, 4), (cluster, 1)])
def test_any_number_of_workers_gives_each_task_its_answer(crew: Crew, count: int, package: Package) -> None:
    with crew(count) as workers:
        assert workers.backend.count == count
        assert sines(workers.run(tasks(package, MANY))) == expected(MANY)
        assert not workers.backend.busy


def test_no_tasks_are_done_at_once(two: Workers) -> None:
    assert list(two.run([])) == []


def test_tasks_are_taken_as_workers_get_free(two: Workers, package: Package) -> None:
    coming = iter(tasks(package, MANY))
    outcomes = two.run(coming)
    next(outcomes)
    left = len(list(coming))
    assert left >= len(MANY) - 10  # each of two workers has one or two in hand, and one more waits
    assert len(list(outcomes)) == len(MANY) - left - 1


def test_two_kinds_of_work_take_turns(two: Workers, package: Package, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    packages = [package, pack(Deeds(tmp_path / "other"))]
    mixed = [Task(deed.number, packages[deed.number % 2], deed, LIMIT) for deed in MANY]
    assert sines(two.run(mixed)) == expected(MANY)


@pytest.mark.parametrize("deed", ["die", "fail"])
def test_a_task_that_is_lost_once_is_repeated_to_the_same_bits(
    two: Workers, package: Package, tmp_path: Path, deed: str
) -> None:
    before = pids_of(two)
    assert sines(two.run(tasks(package, with_a(deed)))) == expected(MANY)
    tries = len(list((tmp_path / str(BAD)).iterdir()))
    assert tries == 2
    if deed == "die":
        wait_until(lambda: len(set(pids_of(two)) - set(before)) == 1, "another worker takes the place")


@pytest.mark.parametrize("crew", ["processes", pytest.param("cluster", marks=pytest.mark.slow)], indirect=True)
def test_a_worker_that_hangs_is_replaced(
    crew: Crew, package: Package, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    limit = SHORT[request.node.callspec.params["crew"]]
    with crew(2, HASTY) as workers:
        assert sines(workers.run(tasks(package, with_a("hang"), limit))) == expected(MANY)
    assert len(list((tmp_path / str(BAD)).iterdir())) >= 2


@pytest.mark.parametrize(
    ("crew", "failures", "reason"),
    [
        pytest.param("processes", 2, "was ended by SIGKILL", id="processes"),
        # Dask itself repeats it before
        pytest.param("cluster", 1, "met KilledWorker: .*", id="cluster", marks=pytest.mark.slow),
    ],
    indirect=["crew"],
)
def test_a_task_that_always_kills_its_worker_is_lost_alone(
    crew: Crew, failures: int, reason: str, package: Package
) -> None:
    with crew(2, Limits(failures=failures)) as workers:
        found = dict(workers.run(tasks(package, with_a("die", 99))))
        lost = {task: outcome for task, outcome in found.items() if isinstance(outcome, Lost)}
        ((task, outcome),) = lost.items()
        assert (task.name, task.losses) == (BAD, failures)
        assert re.fullmatch(reason, outcome.reason)
        others = [deed for deed in MANY if deed.number != BAD]
        assert sines((t, o) for t, o in found.items() if t != task) == expected(others)
        assert sines(workers.run(tasks(package, MANY))) == expected(MANY)  # the workers can go on


def test_an_error_of_no_kind_of_ours_is_told_after_some_attempts(two: Workers, package: Package) -> None:
    ((task, outcome),) = two.run(tasks(package, [Deed(BAD, "fail", 99)]))
    assert outcome == Lost("met MemoryError: no room for 8 GiB")
    assert task.losses == two.limits.failures


def test_in_place_of_a_lost_task_others_can_be_done(two: Workers, package: Package) -> None:
    parts = [Deed(100), Deed(101)]

    def divided(lost: Task) -> list[Task]:
        assert (lost.name, lost.losses) == (BAD, 1)
        return [task._replace(losses=lost.losses) for task in tasks(package, parts)]

    found = list(two.run(tasks(package, with_a("fail", 99)), divided))
    assert {task.name: task.losses for task, _ in found if task.losses} == {100: 1, 101: 1}
    assert sines(found) == expected([*(deed for deed in MANY if deed.number != BAD), *parts])


def test_an_error_of_ours_ends_it_at_once_in_its_own_words(two: Workers, package: Package, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"^This cannot be done\.$"):
        list(two.run(tasks(package, with_a("refuse", 99))))
    assert len(list((tmp_path / str(BAD)).iterdir())) <= 1  # not repeated
    assert not two.backend.busy


def test_other_software_and_other_bits_are_refused(two: Workers, package: Package) -> None:
    other = package._replace(key="other", software=with_other(package, "numpy", "0.1"))
    with pytest.raises(StudyError, match=r"numpy [0-9.]+ .*0\.1"):
        list(two.run(tasks(other, MANY)))
    with pytest.raises(StudyError, match="another objective"):
        list(two.run(tasks(package._replace(key="rounded", probe=b"other"), MANY)))
    assert sines(two.run(tasks(package, MANY))) == expected(MANY)


def test_an_interrupt_leaves_no_answers_behind(two: Workers, package: Package) -> None:
    heeded = iter(range(3))

    def check_stop() -> None:
        if next(heeded, None) is None:
            raise KeyboardInterrupt

    old = [Task("old", package, deed, LIMIT) for deed in MANY * 5]
    with pytest.raises(KeyboardInterrupt):
        list(two.run(old, check_stop=check_stop))
    assert not two.backend.busy
    assert sines(two.run(tasks(package, MANY))) == expected(MANY)


def test_all_processes_end_with_the_workers(crew: Crew, package: Package) -> None:
    with crew(2) as workers:
        outcomes = workers.run(tasks(package, MANY))
        next(outcomes)  # in the middle of their work
        pids = pids_of(workers)
        assert len(pids) == 2
    wait_until(lambda: all(map(gone, pids)), "the workers end")


def test_a_number_that_makes_no_sense_is_refused(crew: Crew) -> None:
    with pytest.raises(ConfigurationError, match=r"between 1 and \d+.* 0"):
        crew(0)
