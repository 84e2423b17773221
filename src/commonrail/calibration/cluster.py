"""A Dask cluster as the place where pieces of a population are evaluated; the only file that imports `distributed`."""

from __future__ import annotations

import logging
import queue
import re
import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.worker import Answer, Lost, Outcome, Package, Task, evaluate
from commonrail.calibration.worker_pool import SLICE, Limits, blocked_signals, check_count
from commonrail.errors import CommonrailError, InputError, StudyError

if TYPE_CHECKING:
    from distributed import Client, Future

_ADDRESS = re.compile(r"([a-z]+://.+|[^:/]+:[0-9]+)")  # what Dask takes at once to be an address
CONNECT = 5.0  # how long to try to reach a scheduler [s]
FETCH = 10.0  # how long to wait for a result that is said to be there [s]
APPEAR = 30.0  # how long to wait for its first worker [s]


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
    limits : Limits

    Raises
    ------
    InputError
        If distributed is not installed, or there is no cluster at the address.
    StudyError
        If the cluster has no workers, or they have no commonrail.
    """

    def __init__(self, address: str, count: int, limits: Limits) -> None:
        self.address, self.limits = address, limits
        self._shunned: set[str] = set()
        with ExitStack() as opened:
            self._client = opened.enter_context(_local(count, opened) if address == "local" else _connect(address))
            _greet(self._client, address)
            self._opened = opened.pop_all()

    @property
    def count(self) -> int:
        """Threads of all workers that are used."""
        return max(sum(self._known().values()), 1)

    def _known(self) -> dict[str, int]:
        """Threads of each worker that is used."""
        with self._connection():
            threads: dict[str, int] = self._client.nthreads()
        return {name: n for name, n in threads.items() if name not in self._shunned}

    def close(self) -> None:
        """Leave the cluster; end it if it is "local"."""
        with _quiet():
            self._opened.close()

    def run(self, tasks: Sequence[Task]) -> Generator[tuple[int, Outcome]]:
        """Number and outcome of each task, as they come.

        Raises
        ------
        CommonrailError
            What the objective raises, and StudyError if the scheduler has gone.
        """
        done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        with self._connection():
            open_ = {self._submit(task, None, done): i for i, task in enumerate(tasks)}
        try:
            while open_:
                limit = max(tasks[i].limit for i in open_.values())
                future = self._next(done, limit)
                if future is None:
                    self._shake(open_)
                    yield from ((i, Lost(f"gave no answer within {limit:.3g} s")) for i in open_.values())
                    return
                index = open_.pop(future)
                outcome = _outcome(future)
                if isinstance(outcome, Missing):
                    open_[self._submit(tasks[index], tasks[index].package, done)] = index
                else:
                    yield index, outcome
        finally:
            with suppress(Exception):  # a scheduler that has gone needs no telling
                self._client.cancel(list(open_))

    def _submit(self, task: Task, package: Package | None, done: queue.SimpleQueue[Future[Any]]) -> Future[Any]:
        allowed = (list(self._known()) if self._shunned else None) or None
        future = self._client.submit(
            evaluate_held, task.package.key, package, task.method, task.values, pure=False, workers=allowed
        )
        future.add_done_callback(done.put)
        return future

    def _next(self, done: queue.SimpleQueue[Future[Any]], limit: float) -> Future[Any] | None:
        """The next future that is done; None if there is none for too long."""
        left = limit
        while left > 0.0:
            start = time.monotonic()
            try:
                return done.get(timeout=SLICE)
            except queue.Empty:
                # not what the clock says: where this process was halted too, nobody was late
                left -= min(time.monotonic() - start, 2.0 * SLICE)
            with self._connection():
                pass
        return None

    def _shake(self, open_: dict[Future[Any], int]) -> None:
        """Start the workers anew that have our tasks."""
        keys = {future.key for future in open_}
        with self._connection():
            stuck = [name for name, held in self._client.processing().items() if keys & set(held)]
            self._client.cancel(list(open_))
        for name in stuck:
            try:
                with _quiet():
                    self._client.restart_workers([name], timeout=CONNECT)
            except Exception:  # not started by a nanny, or too stuck: no more for us
                self._shunned.add(name)

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
    """Answer of a worker that does not have the objective."""


_HELD: dict[str, Package] = {}  # on a worker; two, so that two studies on one cluster can take turns


def evaluate_held(key: str, package: Package | None, method: str, values: NDArray[np.float64]) -> Answer | Missing:
    """On a worker: the result of a piece, with the objective that is given, or that was given before.

    Data of Dask's own would be lost with the workers that have them, and out of reach behind one that hangs.
    """
    if package is not None:
        while key not in _HELD and len(_HELD) > 1:
            _HELD.pop(next(iter(_HELD)), None)
        _HELD[key] = package
    held = _HELD.get(key)
    return Missing() if held is None else evaluate(held, method, values)


def _outcome(future: Future[Any]) -> Outcome | Missing:
    try:
        found: Answer | Missing = future.result(timeout=FETCH)
        return found
    except CommonrailError:
        raise
    except TimeoutError:
        return Lost(f"did not hand over what it had found within {FETCH:.0f} s")
    except Exception as error:  # told in a sentence after some attempts
        return Lost(f"met {type(error).__name__}: {error}")


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
        raise InputError(
            f'--cluster: "{address}" is no address of a scheduler; give one as "tcp://host:port", or "local".'
        )
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
            count, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=logging.CRITICAL
        )
        opened.enter_context(cluster)
        return distributed.Client(cluster, set_as_default=False)


def _greet(client: Client, address: str) -> None:
    """See that there are workers and that they know commonrail."""
    try:
        client.wait_for_workers(1, timeout=APPEAR)
        client.run(version, "commonrail")
    except TimeoutError:
        raise StudyError(
            f"The cluster {address} has had no worker for {APPEAR:.0f} s; start some with `dask worker {address}`."
        ) from None
    except Exception as error:
        raise StudyError(
            f"The workers of the cluster {address} have no commonrail ({error}); install there what is installed here."
        ) from None


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
