"""Worker processes for whole injectors: one that dies or hangs is replaced, and its injector is tried again."""

from __future__ import annotations

import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from multiprocessing import get_context
from multiprocessing.connection import wait
from pathlib import Path
from typing import NamedTuple

from commonrail.calibration.worker_pool import check_count, shielded
from commonrail.errors import StudyError
from commonrail.fleet.task import Answer, Lost, Refused, Up, serve

__all__ = ["Limits", "Outcome", "Pool"]

SLICE = 0.5  # how long to wait at a time [s]


class Limits(NamedTuple):
    """What is borne: attempts for each injector, time for each attempt [s], time to start a worker [s]."""

    attempts: int = 3
    seconds: float = 3600.0
    start: float = 300.0


class Outcome(NamedTuple):
    """What became of an injector, and at which attempt."""

    name: str
    answer: Answer
    attempts: int


class _Order(NamedTuple):
    """An injector whose turn it is, and how often it was lost."""

    name: str
    study: Path
    losses: int = 0


class _Worker:
    """A process and our end of its pipe."""

    def __init__(self, limits: Limits) -> None:
        context = get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=serve, args=(other,), daemon=True, name="commonrail fleet worker")
        try:
            with shielded():
                self.process.start()
        except OSError as error:
            raise StudyError(
                f"A worker process cannot be started ({error.strerror or error}); ask for fewer workers."
            ) from None
        other.close()
        self.up = False
        self.order: _Order | None = None
        self.left = limits.start

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
        return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"


class Pool:
    """Worker processes; use it in a `with` block, which ends them whatever they are doing.

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
        self._bad_starts = 0
        self._workers: list[_Worker] = []
        for _ in range(count):
            self._workers.append(_Worker(limits))

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.end()

    @property
    def pids(self) -> Mapping[int, str]:
        """Process numbers of the workers, and the injector that each has in hand."""
        return {w.process.pid or 0: w.order.name if w.order else "" for w in self._workers}

    def up(self, pid: int) -> bool:
        """Whether a worker has begun to answer."""
        return any(w.up for w in self._workers if w.process.pid == pid)

    def run(self, names: Iterator[str], study_of: Callable[[str], Path], heed: Callable[[], None]) -> Iterator[Outcome]:
        """Outcome of each injector, as they come.

        Parameters
        ----------
        names : iterator of str
        study_of : function of a name
            Makes the injector's study when its turn comes.
        heed : function
            Called now and then; may raise to end it all.
        """
        again: deque[_Order] = deque()
        while True:
            heed()
            for i in range(len(self._workers)):
                self._hand_out(i, names, study_of, again)
            if not again and all(worker.order is None for worker in self._workers):
                return
            yield from self._listen(again)

    def _hand_out(self, i: int, names: Iterator[str], study_of: Callable[[str], Path], again: deque[_Order]) -> None:
        """Give the worker something to do, even while it still starts: the pipe keeps it."""
        worker = self._workers[i]
        if worker.order is not None:
            return
        if again:
            order = again.popleft()
        elif (name := next(names, None)) is not None:
            order = _Order(name, study_of(name))
        else:
            return
        worker.order = order
        worker.left = self.limits.seconds + (0.0 if worker.up else self.limits.start)
        try:
            worker.pipe.send(str(order.study))
        except OSError:  # it died while it had nothing to do: no fault of this injector's
            worker.order = None
            again.appendleft(order)
            self._replace(i)

    def _listen(self, again: deque[_Order]) -> Iterator[Outcome]:
        start = time.monotonic()
        ready = wait([worker.pipe for worker in self._workers], SLICE)
        # not what the clock says: where this process was halted too (Ctrl-Z, a lid), nobody was late
        passed = min(time.monotonic() - start, 2.0 * SLICE)
        for i, worker in enumerate(self._workers):
            answer: Answer | Up | None = None
            if worker.pipe in ready:
                answer = self._take(worker)
            elif worker.order is not None:
                worker.left -= passed
                answer = Lost("gave no answer in time") if worker.left < 0.0 else None
            if isinstance(answer, Up):
                worker.up, self._bad_starts = True, 0
                worker.left = self.limits.seconds
            elif answer is not None:
                yield from self._settle(i, answer, again)

    def _take(self, worker: _Worker) -> Answer | Up:
        try:
            answer: Answer | Up = worker.pipe.recv()
        except (EOFError, OSError):
            return Lost(worker.how_it_ended())
        return answer

    def _settle(self, i: int, answer: Answer, again: deque[_Order]) -> Iterator[Outcome]:
        """What an answer means for its injector; a worker that lost one is replaced."""
        worker = self._workers[i]
        order, worker.order = worker.order, None
        if not isinstance(answer, Lost):
            if order is not None:
                yield Outcome(order.name, answer, order.losses + 1)
            return
        if not worker.up:
            self._check_start(answer)
        self._replace(i)
        if order is None:
            return
        losses = order.losses + (1 if worker.up else 0)
        if losses < self.limits.attempts:
            again.append(order._replace(losses=losses))
            return
        reason = f"Each of {losses} attempts was lost; the last time the worker {answer.reason}."
        yield Outcome(order.name, Refused(reason, 0.0), losses)

    def _check_start(self, answer: Lost) -> None:
        self._bad_starts += 1
        if self._bad_starts >= self.limits.attempts:
            raise StudyError(
                f"A worker {answer.reason} before it had begun, {self._bad_starts} times in a row; in a script, start "
                'the fleet below `if __name__ == "__main__":`, else see what it printed.'
            )

    def _replace(self, i: int) -> None:
        self._workers[i].end()
        self._workers[i] = _Worker(self.limits)
