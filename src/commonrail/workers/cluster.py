"""A Dask cluster as the place where tasks are done."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from commonrail.errors import StudyError
from commonrail.notice import note
from commonrail.workers.held import Missing, perform_held
from commonrail.workers.limits import SLICE, waited
from commonrail.workers.link import ANSWER, CONNECT, LOCAL, Link, quiet
from commonrail.workers.process import Refused
from commonrail.workers.task import Answer, Lost, Outcome, Task, failure

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")

FETCH = 10.0  # how long to wait for a result that is said to be there [s]
APPEAR = 30.0  # how long to wait for its first worker [s]
REAPPEAR = 300.0  # how long to wait for another one when all are lost [s]
FRESH = 1.0  # how long the workers are taken to be as they were [s]
AHEAD = 2  # tasks submitted for each thread, so that none waits for the next one


class Sent(NamedTuple):
    """A task that is out.

    Attributes
    ----------
    task : Task
    complete : bool
        True if the work went with it.
    bound : frozenset of str
        Workers that alone may do it; empty if all may.
    """

    task: Task
    complete: bool
    bound: frozenset[str]


class Cluster:
    """Workers of a Dask cluster.

    A worker that dies is Dask's to replace, and its tasks Dask's to repeat: a task is lost here once Dask gives it up.
    A task that only certain workers may do is sent anew once these have gone: those that replace them have other
    addresses, and Dask would keep the task for ever.
    A worker that hangs is not noticed by Dask: if nothing at all has come back for as long as a task may take, the
    workers that still have tasks are started anew, or dropped if they cannot be started.

    Parameters, errors: see `Workers.cluster`.
    """

    shares_files = False

    def __init__(self, address: str, count: int) -> None:
        self.address = address
        self._left_out: set[str] = set()
        self._open: dict[Future[Any], Sent] = {}
        self._unsent: list[Task] = []  # for want of workers
        self._done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        self._silence = self._alone = 0.0  # since something came back, since there was a worker [s]
        self._threads: dict[str, int] = {}
        self._looked = -FRESH
        self._link = Link(address, count)
        try:
            self._meet()
        except BaseException:
            self.close()
            raise

    def _meet(self) -> None:
        if not (self._link.ask(_has_workers, APPEAR + ANSWER) and self._known()):
            raise self._without_workers(APPEAR)

    @property
    def count(self) -> int:
        """Threads of all workers that are used."""
        return max(sum(self._known().values()), 1)

    @property
    def busy(self) -> bool:
        """Return whether tasks are out."""
        return bool(self._open or self._unsent)

    def close(self) -> None:
        """Leave the cluster; end it if it is "local"."""
        self._link.close()

    def run_on_each(self, call: Callable[[], T]) -> dict[str, T]:
        """Results of a call on each worker, by its address."""
        return dict(self._link.ask(lambda client: client.run(call)))

    def submit(self, task: Task) -> bool:
        """Hand a task to the cluster; false if it has enough.

        Raises
        ------
        StudyError
            If the scheduler has gone.
        """
        if len(self._open) + len(self._unsent) >= AHEAD * max(sum(self._lately().values()), 1):
            return False
        self._send(task)
        return True

    def listen(self) -> Iterator[tuple[Task, Outcome]]:
        """Wait a while, and yield the tasks that are done or lost; StudyError if scheduler or workers have gone."""
        start = time.monotonic()
        try:
            future = self._done.get(timeout=SLICE)
        except queue.Empty:
            yield from self._after_silence(waited(start))
            return
        sent = self._open.pop(future, None)
        if sent is None:  # withdrawn, and sent anew
            return
        self._silence = 0.0
        with quiet():  # Dask says what it could not gather, and has it done again
            outcome = _outcome(future)
        if isinstance(outcome, Answer | Lost):
            yield sent.task, outcome
        elif sent.complete:
            yield sent.task, Lost("did not keep the work that it was given")
        else:
            self._send(sent.task, complete=True)

    def _after_silence(self, passed: float) -> Iterator[tuple[Task, Outcome]]:
        known = self._known()
        self._silence += passed
        self._alone = 0.0 if known else self._alone + passed
        if self._alone > REAPPEAR:
            raise self._without_workers(REAPPEAR)
        if known and self._unsent:
            tasks, self._unsent = self._unsent, []
            for task in tasks:
                self._send(task)
        self._send_stranded(known)
        limit = max((sent.task.limit for sent in self._open.values()), default=self._silence)
        if self._silence > limit:
            yield from ((task, Lost(f"gave no answer within {limit:.6g} s")) for task in self._shake())

    def _send_stranded(self, known: Mapping[str, int]) -> None:
        """Send anew the tasks whose workers have all gone."""
        stranded = [future for future, sent in self._open.items() if sent.bound and sent.bound.isdisjoint(known)]
        if stranded:
            self._link.tell(lambda client: client.cancel(stranded))
        for future in stranded:
            self._send(self._open.pop(future).task)

    def drop(self) -> None:
        """Forget the tasks that are out."""
        futures = list(self._open)
        if futures:  # a scheduler that has gone needs no telling
            self._link.tell(lambda client: client.cancel(futures))
        self._open, self._unsent, self._done = {}, [], queue.SimpleQueue()
        self._silence = self._alone = 0.0

    def _send(self, task: Task, *, complete: bool = False) -> None:
        known = self._lately()
        if not known:
            self._unsent.append(task)
            return
        package = task.package if complete else None
        bound = frozenset(known if self._left_out else ())
        future: Future[Any] = self._link.ask(
            lambda client: client.submit(
                perform_held, task.package.key, package, task.argument, pure=False, workers=sorted(bound) or None
            )
        )
        self._silence = 0.0 if not self._open else self._silence
        self._open[future] = Sent(task, complete, bound)
        future.add_done_callback(self._done.put)

    def _shake(self) -> list[Task]:
        """Start the workers anew that have our tasks; the tasks that they were at are lost, all others sent again."""
        threads = self._link.ask(lambda client: client.nthreads())
        held = self._link.ask(lambda client: client.processing())
        lost: set[Future[Any]] = set()
        stuck = []
        for name, keys in held.items():
            own = [future for future in self._open if future.key in set(keys)]
            if own:
                stuck.append(name)
                lost.update(own[: threads.get(name, 1)])  # the others had not begun
        out = self._open
        self.drop()
        for name in stuck:
            if not self._link.tell(partial(_restart, name), 2.0 * CONNECT):
                note(f"The worker {name} of the cluster {self.address} gives no answer: it is used no more.")
                self._left_out.add(name)  # not started by a nanny, or too stuck
        self._known()
        for future, sent in out.items():
            if future not in lost:
                self._send(sent.task)
        return [out[future].task for future in lost]

    def _lately(self) -> dict[str, int]:
        """Threads of each worker that is used, as they were when last looked."""
        return self._threads if time.monotonic() < self._looked + FRESH else self._known()

    def _known(self) -> dict[str, int]:
        """Threads of each worker that is used."""
        threads: dict[str, int] = dict(self._link.ask(lambda client: client.nthreads()))
        self._threads = {name: n for name, n in threads.items() if name not in self._left_out}
        self._looked = time.monotonic()
        return self._threads

    def _without_workers(self, seconds: float) -> StudyError:
        cure = "see what they print" if self.address == LOCAL else f"start some with `dask worker {self.address}`"
        if self._left_out:
            return StudyError(
                f"The cluster {self.address} has no worker left that can be used: {len(self._left_out)} have given no "
                "answer; replace them, then resume the run."
            )
        return StudyError(f"The cluster {self.address} has had no worker for {seconds:.0f} s; {cure}.")


def _has_workers(client: Client) -> bool:
    with suppress(TimeoutError):
        client.wait_for_workers(1, timeout=APPEAR)
        return True
    return False


def _restart(name: str, client: Client) -> None:
    client.restart_workers([name], timeout=CONNECT)


def _outcome(future: Future[Any]) -> Outcome | Missing:
    try:
        found = future.result(timeout=FETCH)
    except TimeoutError:
        return Lost(f"did not hand over what it had found within {FETCH:.0f} s")
    except Exception as error:  # told in a sentence after some attempts
        return failure(error)
    if isinstance(found, Refused):
        raise found.error
    return found if isinstance(found, Answer | Lost | Missing) else Lost("gave no answer but something else")
