"""Worker processes on this machine: one that dies or hangs is replaced, and its task is given back as lost."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.util import Finalize
from typing import Any, NamedTuple

from commonrail.base.arguments import LARGEST_WHOLE, integer
from commonrail.base.child import SAFE_PATH
from commonrail.base.errors import CommonrailError, ConfigurationError, StudyError
from commonrail.base.hooks import STOP_SIGNALS
from commonrail.engine.threads import usable_threads
from commonrail.workers.task import Answer, Lost, Outcome, Package, Task, failure, perform, unpack

# Limits of workers: how many there may be, how long one may take, how often a task may be lost.

CROWD = 8  # workers for each processor; more would only take memory
SLICE = 0.5  # how long to wait at a time [s]


def waiting_time(start: float) -> float:
    """Time since `start`, on the clock of `time.monotonic`, that counts as waiting [s].

    Time during which this process was suspended too (Ctrl-Z, closed lid) does not count.
    """
    return min(time.monotonic() - start, 2.0 * SLICE)


class Limits(NamedTuple):
    """Limits of workers; `failures`: losses of one task, or consecutive failed starts of workers.

    A worker counts as hung if a task of known length takes `patience` times as long and longer than `least` [s].
    `start` is the time allowed for its start, or to load the work [s]; where no kernel can be kept on disk, each worker
    compiles its own in this time.
    """

    failures: int = 3
    patience: float = 20.0
    least: float = 60.0
    start: float = 300.0


USUAL = Limits()


def check_count(count: int) -> None:
    """Refuse (`ConfigurationError`) a number of workers that is not between 1 and eight for each processor."""
    processors = usable_threads()
    count = integer(count, "number of workers", -LARGEST_WHOLE)
    if not 1 <= count <= CROWD * processors:
        raise ConfigurationError(
            f"The number of workers must lie between 1 and {CROWD * processors}, {CROWD} for each processor of this "
            f"machine, not {count}; as many as processors, {processors}, are the fastest."
        )


# Body of a worker process: it serves the process that started it, and ends with it.

SINGLE_THREADED = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Refused(NamedTuple):
    """A task that would have been refused in the calling process too, and the error."""

    error: CommonrailError


class Up(NamedTuple):
    """Message of a worker process that it has started or has loaded the work."""


Reply = Answer | Lost | Refused | Up


def serve(pipe: Connection) -> None:
    """Take packages and arguments until the calling process has gone or kills this one.

    A stop signal goes to the whole group of processes; the calling process alone decides what becomes of it.
    """
    for number in STOP_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_caller, daemon=True).start()
    with suppress(EOFError, BrokenPipeError):
        pipe.send(Up())
        package: Any = None
        while True:
            message = pipe.recv()
            if isinstance(message, Package):
                package = message
                with suppress(Exception):  # the error occurs again with the first task, and is reported then
                    unpack(package)
                    pipe.send(Up())
            else:
                (argument,) = message
                pipe.send(reply(package, argument))


def _end_with_caller() -> None:
    # a killed caller must leave nothing running, not even a task that hangs
    caller = parent_process()
    if caller is not None:
        caller.join()
        os._exit(1)


def reply(package: Package, argument: Any) -> Answer | Lost | Refused:
    """Answer of a task or the error that it met, as a value."""
    try:
        return perform(package, argument)
    except CommonrailError as error:
        return Refused(error)
    except (Exception, KeyboardInterrupt) as error:  # reported after some attempts
        return failure(error)


_STARTING = threading.Lock()  # all threads share the environment


@contextmanager
def restore_variables(*names: str) -> Iterator[None]:
    """Restore environment variables at the end of the block."""
    before = {name: os.environ.get(name) for name in names}
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


@contextmanager
def shield_children() -> Iterator[None]:
    """Child processes use one thread, do not import from the current folder, and do not receive stop signals."""
    settings = (*SINGLE_THREADED, SAFE_PATH)
    with restore_variables(*settings):
        os.environ.update(dict.fromkeys(settings, "1"))  # before the first process, which multiprocessing starts itself
        with _block_signals():
            yield


@contextmanager
def _block_signals() -> Iterator[None]:
    """Hold back stop signals; threads and processes started inside never get them, from their first instruction on."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    with suppress(ImportError):  # the resource tracker unblocks signals when it starts its process
        from multiprocessing.resource_tracker import ensure_running

        ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Worker:
    """A process and our end of its pipe."""

    def __init__(self, limits: Limits) -> None:
        context = get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=serve, args=(other,), daemon=True, name="commonrail worker")
        try:
            with _STARTING, shield_children():
                self.process.start()
        except OSError as error:
            raise StudyError(
                f"A worker process cannot be started ({error.strerror or error}); ask for fewer workers."
            ) from None
        other.close()
        self.up = False
        self.package: Package | None = None
        self.task: Task | None = None
        self.allowed = self.left = limits.start

    def give(self, task: Task, start: float) -> None:
        """Send a task, preceded by the work if the worker does not have it."""
        self.allowed = task.limit
        if self.package != task.package:
            self.pipe.send(task.package)
            self.package = task.package
            self.allowed += start
        self.pipe.send((task.argument,))
        self.task, self.left = task, self.allowed

    def end(self) -> None:
        """Kill the process; it keeps nothing that could be lost."""
        self.process.kill()
        self.process.join()
        self.pipe.close()

    def how_it_ended(self) -> str:
        """End of the sentence that begins with "the worker"."""
        self.process.join(1.0)
        code = self.process.exitcode
        return "broke off" if code is None else how_it_ended(code)


def how_it_ended(code: int) -> str:
    """End of a sentence about a process with an exit code, which is negative if a signal ended it."""
    if code >= 0:
        return f"ended with exit code {code}"
    names = {number.value: number.name for number in signal.Signals}
    return f"was ended by {names.get(-code, f'signal {-code}')}"


class ProcessPool:
    """Worker processes, started at once and ended with `close`, or with this process.

    `ConfigurationError` for a count not between 1 and eight for each processor, `StudyError` if they cannot be started.
    """

    shares_files = True

    def __init__(self, count: int, limits: Limits) -> None:
        check_count(count)
        self.limits = limits
        self._workers: list[_Worker] = []
        self._bad_starts = 0
        # the priority makes this run before multiprocessing waits for processes that ignore its signal
        self._end = Finalize(self, _end_all, (self._workers,), exitpriority=1)
        for _ in range(count):
            self._workers.append(_Worker(limits))

    @property
    def count(self) -> int:
        """Number of workers."""
        return len(self._workers)

    @property
    def busy(self) -> bool:
        """Return whether a worker has a task."""
        return any(worker.task is not None for worker in self._workers)

    @property
    def pids(self) -> list[int]:
        """Process numbers of the workers as they are now."""
        return [worker.process.pid or 0 for worker in self._workers]

    def close(self) -> None:
        """End all workers, whatever they are doing."""
        self._end()

    def submit(self, task: Task) -> bool:
        """Hand a task to a worker; false if none is free."""
        for i, worker in enumerate(self._workers):
            if worker.up and worker.task is None:
                try:
                    worker.give(task, self.limits.start)
                    return True
                except OSError:  # it died while it had nothing to do
                    self._replace(i)
        return False

    def listen(self) -> Iterator[tuple[Task, Outcome]]:
        """Wait a while, and yield the tasks in hand that are done or lost; StudyError if workers do not start."""
        start = time.monotonic()
        ready = wait([worker.pipe for worker in self._workers], SLICE)
        passed = waiting_time(start)
        for i, worker in enumerate(self._workers):
            if worker.pipe in ready:
                outcome = self._take(i, worker)
            elif worker.task is None and worker.up:
                continue
            else:
                worker.left -= passed
                outcome = self._lose(i, f"gave no answer within {worker.allowed:.6g} s") if worker.left < 0.0 else None
            if outcome is not None:
                yield outcome

    def _take(self, i: int, worker: _Worker) -> tuple[Task, Outcome] | None:
        try:
            reply: Reply = worker.pipe.recv()
        except (EOFError, OSError):
            return self._lose(i, worker.how_it_ended())
        if isinstance(reply, Up):
            worker.up, self._bad_starts = True, 0
            if worker.task is not None:
                worker.allowed = worker.left = worker.task.limit
            return None
        task, worker.task = worker.task, None
        if isinstance(reply, Refused):
            raise reply.error
        return (task, reply) if task is not None else None

    def _lose(self, i: int, reason: str) -> tuple[Task, Outcome] | None:
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
        return (worker.task, Lost(reason)) if worker.task is not None else None

    def drop(self) -> None:
        """Abandon the running tasks, so that late answers are not taken for answers to other tasks."""
        for i, worker in enumerate(self._workers):
            if worker.task is not None:
                self._replace(i)

    def _replace(self, i: int) -> None:
        self._workers[i].end()
        self._workers[i] = _Worker(self.limits)


def _end_all(workers: list[_Worker]) -> None:
    for worker in workers:
        worker.process.kill()
    for worker in workers:
        worker.end()
    workers.clear()
