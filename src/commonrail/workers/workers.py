"""Workers: processes of this machine or a cluster that take tasks and give answers, whatever becomes of one of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from typing import Protocol

from commonrail.base import registry
from commonrail.base.hooks import check_unheld_stop
from commonrail.engine.threads import usable_threads
from commonrail.workers.pool import USUAL, Limits, ProcessPool
from commonrail.workers.task import Lost, Outcome, Task


class Backend(Protocol):
    """Backend of the workers."""

    @property
    def count(self) -> int:
        """Number of tasks that are done at the same time."""

    @property
    def busy(self) -> bool:
        """Return whether it has tasks in hand."""

    @property
    def shares_files(self) -> bool:
        """Return whether its workers surely see the files of this process."""

    def submit(self, task: Task) -> bool:
        """Take a task in hand; false if there are enough for the moment."""

    def listen(self) -> Iterator[tuple[Task, Outcome]]:
        """Wait a while, and yield the tasks in hand that are done or lost.

        Raises the `CommonrailError` of the work, and `StudyError` if the workers are gone for good.
        """

    def drop(self) -> None:
        """Forget the tasks in hand."""

    def close(self) -> None:
        """End it."""


class Workers:
    """Workers that do tasks; use them in a `with` block.

    Answers do not depend on the number of workers, on the assignment of tasks or on repetitions.

    Examples
    --------
    ::

        with Workers.processes(4) as workers:
            calibrate(study, workers=workers)
    """

    def __init__(self, backend: Backend, limits: Limits = USUAL) -> None:
        self.backend, self.limits = backend, limits

    @classmethod
    def processes(cls, count: int | None = None, limits: Limits = USUAL) -> Workers:
        """Processes on this machine, one thread each.

        Parameters
        ----------
        count : int, optional
            All usable processors by default.
        limits : Limits
            When a worker is given up.

        Raises
        ------
        ConfigurationError
            If `count` is not between 1 and 8 × number of processors.
        StudyError
            If the processes cannot be started.
        """
        return cls(ProcessPool(usable_threads() if count is None else count, limits), limits)

    @classmethod
    def cluster(cls, address: str, count: int | None = None, limits: Limits = USUAL) -> Workers:
        """Workers of a Dask cluster.

        Parameters
        ----------
        address : str
            Address of the scheduler, "tls://host:port" or "tcp://host:port". "local" starts a cluster on this machine,
            closed to other users, and ends it with the block.
        count : int, optional
            Workers of a "local" cluster; all usable processors by default.
        limits : Limits
            When a worker is given up.

        Raises
        ------
        InputError
            If distributed (for "local" cryptography, too) is not installed, or no cluster answers at the address.
        StudyError
            If the cluster has no workers.
        """
        backend = registry.require("workers", "cluster")
        return cls(backend.call(address, usable_threads() if count is None else count), limits)

    def run(
        self,
        tasks: Iterable[Task],
        again: Callable[[Task], Sequence[Task]] = lambda task: [task],
        check_stop: Callable[[], None] = check_unheld_stop,
    ) -> Generator[tuple[Task, Outcome]]:
        """Each task and what became of it, as they come; a lost one is repeated as often as the limits allow.

        Tasks are taken one by one, as workers get free; `again` says what to do in place of a lost task. `check_stop`
        is called now and then and may raise to end it all. Raises the `CommonrailError` of the work; `StudyError` if
        workers do not start or the cluster has gone.
        """
        coming, waiting = iter(tasks), deque[Task]()
        try:
            while True:
                check_stop()
                self._hand_out(waiting, coming)
                if not (waiting or self.backend.busy):
                    return
                for task, outcome in self.backend.listen():
                    if isinstance(outcome, Lost):
                        task = task._replace(losses=task.losses + 1)
                        if task.losses < self.limits.failures:
                            waiting.extend(again(task))
                            continue
                    yield task, outcome
        finally:
            self.backend.drop()

    def _hand_out(self, waiting: deque[Task], coming: Iterator[Task]) -> None:
        while True:
            if not waiting:
                waiting.extend(task for task in [next(coming, None)] if task is not None)
            if not (waiting and self.backend.submit(waiting[0])):
                return
            waiting.popleft()

    def close(self) -> None:
        """End the workers (those of a cluster that was given by its address go on)."""
        self.backend.close()

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
