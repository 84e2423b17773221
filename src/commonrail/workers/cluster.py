"""A Dask cluster as the place where tasks are done; the only file that imports `distributed`."""

from __future__ import annotations

import logging
import queue
import re
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

from commonrail.errors import CommonrailError, InputError, StudyError
from commonrail.workers.limits import SLICE, check_count
from commonrail.workers.process import blocked_signals
from commonrail.workers.task import Answer, Lost, Outcome, Package, Task, failure, perform

if TYPE_CHECKING:
    from distributed import Client, Future

_ADDRESS = re.compile(r"([a-z]+://.+|[^:/]+:[0-9]+)")  # what Dask takes at once to be an address
CONNECT = 5.0  # how long to try to reach a scheduler [s]
FETCH = 10.0  # how long to wait for a result that is said to be there [s]
APPEAR = 30.0  # how long to wait for its first worker [s]
REAPPEAR = 300.0  # how long to wait for another one when all are lost [s]
FRESH = 1.0  # how long the number of workers is taken to be as it was [s]
AHEAD = 2  # tasks submitted for each thread, so that none waits for the next one


class Cluster:
    """Workers of a Dask cluster.

    A worker that dies is Dask's to replace, and its tasks Dask's to repeat: a task is lost here once Dask gives it up.
    A worker that hangs is not noticed by Dask: if nothing at all has come back for as long as a task may take, the
    workers that still have tasks are started anew, or left out if nobody can start them.

    Parameters
    ----------
    address : str
        "tcp://host:port", or "local" for a cluster of `count` processes on this machine.
    count : int

    Raises
    ------
    InputError
        If distributed is not installed, or there is no cluster at the address.
    StudyError
        If the cluster has no workers, or they have no commonrail.
    """

    shares_files = False

    def __init__(self, address: str, count: int) -> None:
        self.address = address
        self._shunned: set[str] = set()
        self._open: dict[Future[Any], Task] = {}
        self._done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        self._silence = self._alone = 0.0  # since something came back, since there was a worker [s]
        self._seats, self._looked = 1, -FRESH
        with ExitStack() as opened:
            self._client = opened.enter_context(_local(count, opened) if address == "local" else _connect(address))
            _greet(self._client, address)
            self._opened = opened.pop_all()

    @property
    def count(self) -> int:
        """Threads of all workers that are used."""
        self._seats, self._looked = max(sum(self._known().values()), 1), time.monotonic()
        return self._seats

    def _known(self) -> dict[str, int]:
        """Threads of each worker that is used."""
        with self._connection():
            threads: dict[str, int] = self._client.nthreads()
        return {name: n for name, n in threads.items() if name not in self._shunned}

    @property
    def busy(self) -> bool:
        """Return whether tasks are out."""
        return bool(self._open)

    def close(self) -> None:
        """Leave the cluster; end it if it is "local"."""
        with _quiet():
            self._opened.close()

    def submit(self, task: Task) -> bool:
        """Hand a task to the cluster; false if it has enough.

        Raises
        ------
        StudyError
            If the scheduler has gone.
        """
        seats = self._seats if time.monotonic() < self._looked + FRESH else self.count
        if len(self._open) >= AHEAD * seats:
            return False
        self._send(task)
        return True

    def _send(self, task: Task, package: Package | None = None) -> None:
        with self._connection():
            allowed = (list(self._known()) if self._shunned else None) or None
            future = self._client.submit(
                perform_held, task.package.key, package, task.argument, pure=False, workers=allowed
            )
        self._silence = 0.0 if not self._open else self._silence
        self._open[future] = task
        future.add_done_callback(self._done.put)

    def listen(self) -> Iterator[tuple[Task, Outcome]]:
        """Wait a while, and yield the tasks that are done or lost.

        Raises
        ------
        CommonrailError
            What the work raises, and StudyError if the scheduler has gone.
        """
        start = time.monotonic()
        try:
            future = self._done.get(timeout=SLICE)
        except queue.Empty:
            # not what the clock says: where this process was halted too, nobody was late
            passed = min(time.monotonic() - start, 2.0 * SLICE)
            self._silence += passed
            self._alone = 0.0 if self._known() else self._alone + passed
            if self._alone > REAPPEAR:
                raise _without_workers(self.address, REAPPEAR) from None
            limit = max(task.limit for task in self._open.values())
            if self._silence > limit:
                yield from ((task, Lost(f"gave no answer within {limit:.6g} s")) for task in self._shake())
            return
        self._silence = 0.0
        task = self._open.pop(future)
        outcome = _outcome(future)
        if isinstance(outcome, Missing):
            self._send(task, task.package)
        else:
            yield task, outcome

    def _shake(self) -> list[Task]:
        """Start the workers anew that have our tasks; the tasks that they were at are lost, all others sent again."""
        with self._connection():
            threads, held = self._client.nthreads(), self._client.processing()
        lost: set[Future[Any]] = set()
        stuck = []
        for name, keys in held.items():
            own = [future for future in self._open if future.key in set(keys)]
            if own:
                stuck.append(name)
                lost.update(own[: threads.get(name, 1)])  # the others had not begun
        tasks = self._open
        self.drop()
        for name in stuck:
            try:
                with _quiet():
                    self._client.restart_workers([name], timeout=CONNECT)
            except Exception:  # not started by a nanny, or too stuck: no more for us
                self._shunned.add(name)
        for future, task in tasks.items():
            if future not in lost:
                self._send(task)
        return [tasks[future] for future in lost]

    def drop(self) -> None:
        """Forget the tasks that are out."""
        with suppress(Exception):  # a scheduler that has gone needs no telling
            self._client.cancel(list(self._open))
        self._open, self._done, self._silence, self._alone = {}, queue.SimpleQueue(), 0.0, 0.0

    @contextmanager
    def _connection(self) -> Iterator[None]:
        """Say so if the scheduler has gone."""
        broken = StudyError(
            f"The connection to the cluster {self.address} is broken; see whether its scheduler runs, then go on with "
            "the run: what was finished is kept."
        )
        if self._client.status != "running":
            raise broken
        try:
            with _quiet():
                yield
        except OSError:
            raise broken from None


class Missing(NamedTuple):
    """Answer of a worker that does not have the work."""


_HELD: dict[str, Package] = {}  # on a worker; two, so that two studies on one cluster can take turns


def perform_held(key: str, package: Package | None, argument: Any) -> Answer | Missing:
    """Answer of a task, on its worker, by the work that is given, or that was given before.

    Parameters
    ----------
    key : str
        Of the package.
    package : Package or None
    argument : picklable

    Notes
    -----
    Data of Dask's own would be lost with the workers that have them, and out of reach behind one that hangs.
    """
    if package is not None:
        while key not in _HELD and len(_HELD) > 1:
            _HELD.pop(next(iter(_HELD)), None)
        _HELD[key] = package
    held = _HELD.get(key)
    return Missing() if held is None else perform(held, argument)


def _outcome(future: Future[Any]) -> Outcome | Missing:
    try:
        found: Answer | Missing = future.result(timeout=FETCH)
        return found
    except CommonrailError:
        raise
    except TimeoutError:
        return Lost(f"did not hand over what it had found within {FETCH:.0f} s")
    except Exception as error:  # told in a sentence after some attempts
        return failure(error)


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise InputError(
            "A cluster needs the package distributed, which is not installed; install it with "
            "`pip install 'commonrail[cluster]'`, or use processes of this machine."
        ) from None
    return distributed


def _connect(address: str) -> Client:
    distributed = _distributed()
    if not _ADDRESS.fullmatch(address):
        raise InputError(f'"{address}" is no address of a scheduler; give one as "tcp://host:port", or "local".')
    try:
        with _quiet():
            return distributed.Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"There is no Dask scheduler at {address} ({error}); start one with `dask scheduler` and give its address "
            'as "tcp://host:port".'
        ) from None


def _local(count: int, opened: ExitStack) -> Client:
    distributed = _distributed()
    check_count(count)
    with blocked_signals(), _quiet():
        cluster = distributed.LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        )
        opened.enter_context(cluster)
        return distributed.Client(cluster, set_as_default=False)


def _greet(client: Client, address: str) -> None:
    """See that there are workers and that they know commonrail."""
    try:
        client.wait_for_workers(1, timeout=APPEAR)
        client.run(version, "commonrail")
    except TimeoutError:
        raise _without_workers(address, APPEAR) from None
    except Exception as error:
        raise StudyError(
            f"The workers of the cluster {address} have no commonrail ({error}); install there what is installed here."
        ) from None


def _without_workers(address: str, seconds: float) -> StudyError:
    cure = "see what they print" if address == "local" else f"start some with `dask worker {address}`"
    return StudyError(f"The cluster {address} has had no worker for {seconds:.0f} s; {cure}.")


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence of Dask's log: what went wrong is told in our own words."""
    log = logging.getLogger("distributed")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        log.setLevel(level)
