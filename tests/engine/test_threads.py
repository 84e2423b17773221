"""Threads that stay: every item once, at the same time, errors told, and a forked process gets its own."""

from __future__ import annotations

import itertools
import os
import threading
import time
import weakref
from collections.abc import Sequence
from queue import SimpleQueue

import numpy as np
import pytest

from commonrail.engine.threads import side_by_side
from tests.waiting import PATIENCE, wait_until


def threads_of(items: Sequence[int]) -> dict[int, threading.Thread]:
    """Thread of each item; none continues before all have begun."""
    taken: dict[int, threading.Thread] = {}
    together = threading.Barrier(len(items), timeout=PATIENCE)

    def work(item: int) -> None:
        taken[item] = threading.current_thread()
        together.wait()

    side_by_side(work, items)
    return taken


def test_items_run_at_the_same_time_the_first_in_the_calling_thread() -> None:
    taken = threads_of(range(0, 12, 4))
    assert sorted(taken) == [0, 4, 8]
    assert len(set(taken.values())) == 3
    assert taken[0] is threading.current_thread()


def test_threads_stay() -> None:
    threads_of(range(4))
    before = set(threading.enumerate())
    assert set(threads_of(range(4)).values()) <= before
    assert set(threading.enumerate()) == before


def test_what_was_worked_on_is_let_go() -> None:
    array = np.zeros(3)
    kept = weakref.ref(array)
    side_by_side(lambda item, given=array: given.sum(), range(2))  # type: ignore[misc]
    del array
    # the other thread has told that it is done a moment before it lets go
    wait_until(lambda: kept() is None, "the other thread let go")


def test_an_error_is_raised_once_all_have_ended() -> None:
    begun, ended = threading.Event(), threading.Event()

    def work(item: int) -> None:
        if item == 0:
            begun.wait(PATIENCE)
            raise ValueError("first")
        begun.set()
        time.sleep(0.1)  # time enough for one who does not wait
        ended.set()

    with pytest.raises(ValueError, match="first"):
        side_by_side(work, range(2))
    assert ended.is_set()
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda item: 1 // (1 - item), range(2))  # type: ignore[arg-type, return-value]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is nothing to fork with")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_process_starts_its_own() -> None:
    threads_of(range(3))
    child = os.fork()
    if child == 0:
        threading.Timer(PATIENCE, os._exit, (1,)).start()  # it would wait for threads that are not there for ever
        os._exit(0 if len(threads_of(range(3))) == 3 else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_three_inside_three_end_from_any_thread() -> None:
    done: SimpleQueue[tuple[int, int]] = SimpleQueue()

    def outer(item: int) -> None:
        side_by_side(lambda inner: done.put((item, inner)), range(3))

    callers = [threading.Thread(target=side_by_side, args=(outer, range(3)), daemon=True) for _ in range(2)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join(PATIENCE)
    assert sorted(done.get_nowait() for _ in range(18)) == sorted(2 * list(itertools.product(range(3), range(3))))
