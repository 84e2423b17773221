"""Worker processes of our own: one that dies or hangs is replaced, and what it had in hand is given back as lost."""

from __future__ import annotations

import os
import signal
import time
import weakref
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import wait
from typing import NamedTuple

from commonrail.arguments import LARGEST_WHOLE, whole
from commonrail.calibration.worker import (
    STOP_SIGNALS,
    Lost,
    Outcome,
    Package,
    Refused,
    Reply,
    Task,
    Up,
    serve,
)
from commonrail.engine.simulate import usable_threads
from commonrail.errors import ConfigurationError, StudyError

CROWD = 8  # workers for each processor; more would only take memory
SLICE = 0.5  # how long to wait at a time [s]
SINGLE_THREADED = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Limits(NamedTuple):
    """What is borne of a worker.

    Attributes
    ----------
    failures : int
        Times that a piece may be lost before the run ends.
    patience : float
        A worker hangs if it takes this many times as long as expected …
    least : float
        … and longer than this [s].
    start : float
        Time that a worker may take to start, or to load an objective [s]; where no kernel can be kept on disk, each
        worker compiles its own in this time.
    """

    failures: int = 3
    patience: float = 20.0
    least: float = 60.0
    start: float = 300.0


USUAL = Limits()


def check_count(count: int) -> None:
    """Refuse a number of workers that makes no sense.

    Raises
    ------
    ConfigurationError
        If it is not between 1 and eight for each processor.
    """
    processors = usable_threads()
    count = whole(count, "number of workers", -LARGEST_WHOLE)
    if not 1 <= count <= CROWD * processors:
        raise ConfigurationError(
            f"The number of workers must lie between 1 and {CROWD * processors}, {CROWD} for each processor of this "
            f"machine, not {count}; as many as processors, {processors}, are the fastest."
        )


class _Worker:
    """A process and our end of its pipe."""

    def __init__(self, limits: Limits) -> None:
        context = get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=serve, args=(other,), daemon=True, name="commonrail worker")
        try:
            with shielded():
                self.process.start()
        except OSError as error:
            raise StudyError(
                f"A worker process cannot be started ({error.strerror or error}); ask for fewer workers."
            ) from None
        other.close()
        self.up = False
        self.package: Package | None = None
        self.task: tuple[int, Task] | None = None
        self.allowed = self.left = limits.start

    def give(self, index: int, task: Task, start: float) -> None:
        """Send a task, and before it the objective if the worker does not hold it."""
        self.allowed = task.limit
        if self.package != task.package:
            self.pipe.send(task.package)
            self.package = task.package
            self.allowed += start
        self.pipe.send((task.method, task.values))
        self.task, self.left = (index, task), self.allowed

    def end(self) -> None:
        """Kill the process; it keeps nothing that could be lost."""
        self.process.kill()
        self.process.join()
        self.pipe.close()

    def how_it_ended(self) -> str:
        """End of the sentence that begins with "the worker"."""
        self.process.join(1.0)
        code = self.process.exitcode
        if code is None:
            return "broke off"
        return how_it_ended(code)


def how_it_ended(code: int) -> str:
    """End of a sentence about a process with an exit code, which is negative if a signal ended it."""
    if code >= 0:
        return f"ended with exit code {code}"
    known = {number.value: number.name for number in signal.Signals}
    return f"was ended by {known.get(-code, f'signal {-code}')}"


class WorkerPool:
    """Worker processes, started at once and ended with `close`, or with this process.

    Parameters
    ----------
    count : int
    limits : Limits

    Raises
    ------
    ConfigurationError
        If `count` is not between 1 and eight for each processor.
    StudyError
        If processes cannot be started.
    """

    def __init__(self, count: int, limits: Limits) -> None:
        check_count(count)
        self.limits = limits
        self._workers: list[_Worker] = []
        self._bad_starts = 0
        self._end = weakref.finalize(self, _end_all, self._workers)
        for _ in range(count):
            self._workers.append(_Worker(limits))

    @property
    def count(self) -> int:
        """Number of workers."""
        return len(self._workers)

    @property
    def pids(self) -> list[int]:
        """Process numbers of the workers as they are now."""
        return [worker.process.pid or 0 for worker in self._workers]

    def close(self) -> None:
        """End all workers, whatever they are doing."""
        self._end()

    def run(self, tasks: Sequence[Task]) -> Generator[tuple[int, Outcome]]:
        """Number and outcome of each task, as they come.

        Raises
        ------
        CommonrailError
            What the objective raises, and StudyError if workers do not start.
        """
        waiting = deque(enumerate(tasks))
        missing = len(waiting)
        try:
            while missing:
                self._hand_out(waiting)
                for found in self._listen():
                    missing -= 1
                    yield found
        finally:
            for i, worker in enumerate(self._workers):
                if worker.task is not None:  # after an error or Ctrl-C: its answer must not meet another question
                    self._replace(i)

    def _hand_out(self, waiting: deque[tuple[int, Task]]) -> None:
        for i, worker in enumerate(self._workers):
            if not waiting or not worker.up or worker.task is not None:
                continue
            index, task = waiting.popleft()
            try:
                worker.give(index, task, self.limits.start)
            except OSError:  # it died while it had nothing to do
                waiting.appendleft((index, task))
                self._replace(i)

    def _listen(self) -> Iterator[tuple[int, Outcome]]:
        start = time.monotonic()
        ready = wait([worker.pipe for worker in self._workers], SLICE)
        # not what the clock says: where this process was halted too (Ctrl-Z, a lid), nobody was late
        passed = min(time.monotonic() - start, 2.0 * SLICE)
        for i, worker in enumerate(self._workers):
            if worker.pipe in ready:
                outcome = self._take(i, worker)
            elif worker.task is None and worker.up:
                continue
            else:
                worker.left -= passed
                outcome = self._lose(i, f"gave no answer within {worker.allowed:.3g} s") if worker.left < 0.0 else None
            if outcome is not None:
                yield outcome

    def _take(self, i: int, worker: _Worker) -> tuple[int, Outcome] | None:
        try:
            reply: Reply = worker.pipe.recv()
        except (EOFError, OSError):
            return self._lose(i, worker.how_it_ended())
        if isinstance(reply, Up):
            worker.up, self._bad_starts = True, 0
            return None
        task, worker.task = worker.task, None
        if isinstance(reply, Refused):
            raise reply.error
        return (task[0], reply) if task is not None else None

    def _lose(self, i: int, reason: str) -> tuple[int, Outcome] | None:
        """Replace a worker; its task is lost."""
        worker = self._workers[i]
        if not worker.up:
            self._bad_starts += 1
            if self._bad_starts >= self.limits.failures:
                raise StudyError(
                    f"A worker {reason} before it had begun, {self._bad_starts} times in a row; in a script, start "
                    'workers below `if __name__ == "__main__":`, else see what it printed.'
                )
        self._replace(i)
        return (worker.task[0], Lost(reason)) if worker.task is not None else None

    def _replace(self, i: int) -> None:
        self._workers[i].end()
        self._workers[i] = _Worker(self.limits)


def _end_all(workers: list[_Worker]) -> None:
    for worker in workers:
        worker.process.kill()
    for worker in workers:
        worker.end()
    workers.clear()


@contextmanager
def shielded() -> Iterator[None]:
    """Processes started inside do arithmetic on one thread, and stop signals never reach them."""
    before = {name: os.environ.get(name) for name in SINGLE_THREADED}
    os.environ.update(dict.fromkeys(SINGLE_THREADED, "1"))
    try:
        with blocked_signals():
            yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


@contextmanager
def blocked_signals() -> Iterator[None]:
    """Hold back stop signals; threads and processes started inside never get them, from their first instruction on."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    with suppress(ImportError):  # it would unblock them when it starts its own process
        from multiprocessing.resource_tracker import ensure_running

        ensure_running()
    numbers = [getattr(signal, name) for name in STOP_SIGNALS]
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
