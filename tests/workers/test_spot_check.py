"""Spot checks: a wrong answer is found, its worker dismissed, and nothing that it answered is left."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.workers.limits import Limits
from commonrail.workers.task import Answer, Task, Withdrawn, pack
from commonrail.workers.workers import Workers
from tests.workers.crews import Deed, Deeds, expected, tasks
from tests.workers.imagined import Imagined

MANY = [Deed(number) for number in range(300)]
LIES = np.cos(0.1).tobytes()


def found(workers: Workers, many: list[Task]) -> dict[object, bytes]:
    """Answers as a caller keeps them: what is withdrawn is asked for again."""
    results: dict[object, bytes] = {}
    left = many
    while left:
        now, left = left, []
        for task, outcome in workers.run(now):
            if isinstance(outcome, Withdrawn):
                del results[task.name]
                left += [one for one in many if one.name == task.name]
            else:
                assert isinstance(outcome, Answer)
                results[task.name] = outcome.result
    return results


def given(wrong: dict[tuple[str, int], object]) -> Callable[[str, Task, Any], Any]:
    """Spoils what these workers answer to these numbers."""
    return lambda worker, task, right: wrong.get((worker, task.argument.number), right)


def always_wrong(worker: str) -> dict[tuple[str, int], object]:
    return {(worker, deed.number): LIES for deed in MANY}


@pytest.mark.filterwarnings("ignore:The worker b has answered")
@pytest.mark.parametrize("from_on", [0, 150, 290])
def test_a_worker_that_lies_is_dismissed_and_its_answers_found_again(tmp_path: Path, from_on: int) -> None:
    wrong = {key: value for key, value in always_wrong("b").items() if key[1] >= from_on}
    backend = Imagined("abc", given(wrong))
    results = found(Workers(backend, Limits(check_one_in=3, seed=1)), tasks(pack(Deeds(tmp_path)), MANY))
    assert results == expected(MANY)
    assert backend.names == ["a", "c"]


def test_without_checks_a_lie_stays(tmp_path: Path) -> None:
    backend = Imagined("abc", given(always_wrong("b")))
    results = found(Workers(backend, Limits(check_one_in=0)), tasks(pack(Deeds(tmp_path)), MANY))
    assert results != expected(MANY)
    assert backend.names == ["a", "b", "c"]


def test_the_stated_share_is_checked_and_the_seed_determines_it(tmp_path: Path) -> None:
    package = pack(Deeds(tmp_path))

    def extra(seed: int, one_in: int) -> int:
        backend = Imagined("ab", given({}))
        assert found(Workers(backend, Limits(check_one_in=one_in, seed=seed)), tasks(package, MANY)) == expected(MANY)
        return len(backend.done) - len(MANY)

    assert extra(1, 1) == len(MANY)
    assert extra(7, 10) == extra(7, 10)
    # binomial with mean 30 and deviation 5.2; five deviations either way
    assert all(4 <= extra(seed, 10) <= 56 for seed in range(8))


def test_a_wrong_first_answer_is_found_even_if_it_is_the_only_one(tmp_path: Path) -> None:
    backend = Imagined("ab", given(always_wrong("a")))
    with pytest.warns(RuntimeWarning, match="The worker a has answered with other bits than this machine"):
        results = found(Workers(backend, Limits(seed=1)), tasks(pack(Deeds(tmp_path)), MANY[1:2]))
    assert results == expected(MANY[1:2])


def test_a_single_worker_is_compared_with_this_process(tmp_path: Path) -> None:
    backend = Imagined("a", given({}))
    assert found(Workers(backend, Limits(check_one_in=1)), tasks(pack(Deeds(tmp_path)), MANY)) == expected(MANY)
    assert len(backend.done) == len(MANY)  # nothing twice by itself


@pytest.mark.filterwarnings("ignore:The worker a has answered")
def test_a_worker_whose_copy_is_wrong_leaves_the_first_one_in_its_place(tmp_path: Path) -> None:
    backend = Imagined("ab", given({("a", 1): LIES}))
    backend.done = ["b"]  # "b" is first, and "a" does the copy
    assert found(Workers(backend, Limits(seed=1)), tasks(pack(Deeds(tmp_path)), MANY[1:2])) == expected(MANY[1:2])
    assert backend.names == ["b"]


@pytest.mark.parametrize("thing", [None, b"", b"123", 3, "text", b"0123456789"])
def test_a_thing_that_is_no_result_is_found_whether_it_is_checked_or_not(tmp_path: Path, thing: object) -> None:
    backend = Imagined("ab", given({("b", 200): thing, ("b", 201): thing}))
    with pytest.warns(RuntimeWarning, match="The worker b has answered with a result that is none"):
        results = found(Workers(backend, Limits(check_one_in=0)), tasks(pack(Deeds(tmp_path)), MANY))
    assert results == expected(MANY)
    assert backend.names == ["a"]


@pytest.mark.filterwarnings("ignore:The worker b has answered")
def test_answers_of_an_earlier_call_are_withdrawn_by_their_numbers(tmp_path: Path) -> None:
    package = pack(Deeds(tmp_path))
    workers = Workers(Imagined("ab", given({("b", 0): LIES})), Limits(check_one_in=2, seed=1))
    earlier = {task.number for task, _ in workers.run(tasks(package, MANY[1:100]))}
    lying = [task for task in tasks(package, MANY[:1] * 8)]
    withdrawn = {task.number for task, outcome in workers.run(lying) if isinstance(outcome, Withdrawn)}
    assert withdrawn & earlier
