"""Threads that share the simulations of a batch."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from typing import NamedTuple

from commonrail.base.hooks import check_unheld_stop


def usable_threads() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


# Permanent threads: starting some for every batch would cost a good part of a small batch's time.


class _Task(NamedTuple):
    work: Callable[[int], None]
    item: int
    done: SimpleQueue[BaseException | None]


class _Crew:
    """Threads that wait for tasks; they end with the process."""

    def __init__(self) -> None:
        self.tasks: SimpleQueue[_Task] = SimpleQueue()
        self.threads: list[threading.Thread] = []
        self._growth = threading.Lock()

    def grow(self, size: int) -> None:
        """Start threads up to this number."""
        with self._growth:
            while len(self.threads) < size:
                thread = threading.Thread(target=self._serve, name="commonrail", daemon=True)
                thread.start()
                self.threads.append(thread)

    def _serve(self) -> None:
        while True:
            work, item, done = self.tasks.get()
            try:
                work(item)
            except BaseException as error:  # raised again by the caller
                done.put(error)
            else:
                done.put(None)
            del work, item, done  # frees the arrays of a batch before the next one


_crew = _Crew()


def _start_anew() -> None:
    global _crew
    _crew = _Crew()


if hasattr(os, "register_at_fork"):  # a forked process inherits the crew's tasks, but none of its threads
    os.register_at_fork(after_in_child=_start_anew)


def side_by_side(work: Callable[[int], None], items: Sequence[int]) -> None:
    """Call `work` with every item at the same time: the first in the calling thread, the others in threads.

    `KeyboardInterrupt` before that if a stop was requested, see `check_unheld_stop`.
    """
    check_unheld_stop()
    if threading.current_thread() in _crew.threads:  # threads must not wait for one another
        for item in items:
            work(item)
        return
    done: SimpleQueue[BaseException | None] = SimpleQueue()
    _crew.grow(len(items) - 1)
    for item in items[1:]:
        _crew.tasks.put(_Task(work, item, done))
    try:
        work(items[0])
    finally:
        errors = [done.get() for _ in items[1:]]
    for error in errors:
        if error is not None:
            raise error
