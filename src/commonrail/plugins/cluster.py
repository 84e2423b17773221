"""A Dask cluster as the place where tasks are done."""

from __future__ import annotations

import gc
import logging
import queue
import re
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, TypeVar

from commonrail.base.child import SAFE_PATH
from commonrail.base.errors import InputError, StudyError
from commonrail.base.hooks import note
from commonrail.workers.pool import SLICE, Refused, check_count, reply, restore_variables, shield_children, waiting_time
from commonrail.workers.task import Answer, Lost, Outcome, Package, Task, failure

if TYPE_CHECKING:
    from distributed import Client, Future

# Deadlines for calls without their own.

T = TypeVar("T")


class Late(Exception):
    """A call that has not returned by its deadline."""


def within(seconds: float, call: Callable[[], T]) -> T:
    """Return the result of a call, made on a thread of its own; `Late` if it has not returned by the deadline [s].

    A call that is late is left to itself: its thread ends with the process at the latest, and its result is dropped.
    """
    ended: queue.SimpleQueue[tuple[T | None, BaseException | None]] = queue.SimpleQueue()

    def body() -> None:
        try:
            ended.put((call(), None))
        except BaseException as error:
            ended.put((None, error))

    threading.Thread(target=body, daemon=True, name="commonrail call").start()
    try:
        result, error = ended.get(timeout=seconds)
    except queue.Empty:
        raise Late from None
    if error is not None:
        raise error
    return result  # type: ignore[return-value]


# Side of a worker of a cluster: it keeps the work that it was given, and does tasks of it.


class Missing(NamedTuple):
    """Answer of a worker that does not have the work."""


_HELD: dict[str, Package] = {}  # packages on a worker; two, for two studies that alternate on one cluster


def perform_held(key: str, package: Package | None, argument: Any) -> Answer | Lost | Refused | Missing:
    """Answer of a task on its worker, computed with `package` or with the package that was sent before under `key`.

    Data stored by Dask would be lost with a worker that dies, and out of reach if the worker hangs. Errors are
    returned, because Dask does not deliver all raised errors.
    """
    if package is not None:
        while key not in _HELD and len(_HELD) > 1:
            _HELD.pop(next(iter(_HELD)), None)
        _HELD[key] = package
    package_held = _HELD.get(key)
    return Missing() if package_held is None else reply(package_held, argument)


# Link to the scheduler of a Dask cluster: opened, asked with a deadline, closed; nothing else imports `distributed`.
#
# A cluster on this machine listens on the loopback interface alone, shows no pages, and lets in whoever has the
# certificate of this run: it is made for the run, and held in memory. A cluster elsewhere is reached as Dask's own
# configuration says (``distributed.comm.tls``).

LOCAL = "local"
_ADDRESS = re.compile(r"([a-z]+://.+|[^:/]+:[0-9]+)")  # recognised by Dask as an address
_HERE = re.compile(r"(tls|inproc)://.*|(tcp://)?(127\.[0-9.]+|localhost|\[::1\])(:[0-9]+)?")  # private links
CONNECT = 5.0  # how long to try to reach a scheduler [s]
ANSWER = 30.0  # how long a scheduler may take for an answer; one with thousands of workers takes some seconds [s]
LEAVE = 5.0  # how long to try to say goodbye [s]
# How long a local cluster waits for the replacement of a worker that has died [s]. Dask waits for 15 s, then ends the
# starting process. A start takes longer on a busy machine, and the cluster would lose its workers one by one.
RETURN = 3600.0
_MISSING = (
    "A cluster needs the package {package}, which is not installed; install it with "
    "`pip install 'commonrail[cluster]'`, or use processes of this machine."
)


class Link:
    """Link to a scheduler at "tcp://host:port" or "tls://host:port", or of a "local" cluster of `count` processes here.

    `ConfigurationError` if the count is not between 1 and eight per processor; `InputError` if distributed is not
    installed, or there is no cluster at the address.
    """

    def __init__(self, address: str, count: int) -> None:
        self.address = address
        with _pause_collection(), ExitStack() as opened:
            self.client: Client = _local(count, opened) if address == LOCAL else _connect(address)
            opened.callback(lambda: self.tell(lambda client: client.close()))
            self._opened = opened.pop_all()

    def ask(self, call: Callable[[Client], T], seconds: float | None = None) -> T:
        """Return what a call to the scheduler gives within a deadline [s], `ANSWER` by default.

        `StudyError` if the scheduler has gone, or gives no answer.
        """
        seconds = ANSWER if seconds is None else seconds
        if self.client.status != "running":
            self._say_broken()
        try:
            with quiet():
                return within(seconds, lambda: call(self.client))
        except OSError:
            self._say_broken()
        except Late:
            raise StudyError(
                f"The scheduler of the cluster {self.address} has given no answer within {seconds:.6g} s; see whether "
                "it hangs, then resume the run: what was finished is kept."
            ) from None

    def _say_broken(self) -> NoReturn:
        raise StudyError(
            f"The connection to the cluster {self.address} is broken; see whether its scheduler runs, then resume the "
            "run: what was finished is kept."
        ) from None

    def tell(self, call: Callable[[Client], object], seconds: float = LEAVE) -> bool:
        """Make a call that may fail, and return whether it succeeded."""
        try:
            with quiet():
                within(seconds, lambda: call(self.client))
        except Exception:
            return False
        return True

    def close(self) -> None:
        """Leave the cluster; end it if it is "local"."""
        with quiet(), _pause_collection():
            self._opened.close()


def _load_distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise InputError(_MISSING.format(package="distributed")) from None
    return distributed


def _connect(address: str) -> Client:
    distributed = _load_distributed()
    if not _ADDRESS.fullmatch(address):
        raise InputError(
            f'"{address}" is no address of a scheduler; give one as "tcp://host:port" or "tls://host:port", or "local".'
        )
    try:
        with quiet():
            client: Client = within(
                2.0 * CONNECT, lambda: distributed.Client(address, timeout=CONNECT, set_as_default=False)
            )
    except Late:
        raise InputError(
            f"The scheduler at {address} has given no answer within {2.0 * CONNECT:.6g} s; see whether it is a Dask "
            "scheduler and whether it hangs."
        ) from None
    except Exception as error:  # no such host, no certificate, other versions of Dask
        raise InputError(_explain_unreachable(address, error)) from None
    if not _HERE.fullmatch(address):
        note(
            f"The connection to {address} is not encrypted: everybody on the network can read and change the tasks and "
            "answers; use tls:// (docs/howto/workers.md)."
        )
    return client


def _explain_unreachable(address: str, error: Exception) -> str:
    cure = f'start one with `dask scheduler` and give its address as "{address.partition("://")[0]}://host:port"'
    if address.startswith("tls://"):
        cure += ", with the certificates in Dask's configuration (distributed.comm.tls)"
    return f"There is no Dask scheduler at {address} that can be used ({error}); {cure}."


def _local(count: int, opened: ExitStack) -> Client:
    """Client of a cluster on this machine that no other user can enter."""
    distributed = _load_distributed()
    from dask import config

    check_count(count)
    try:
        security = distributed.Security.temporary()
    except ImportError:
        raise InputError(_MISSING.format(package="cryptography")) from None
    opened.enter_context(config.set({"distributed.deploy.lost-worker-timeout": f"{RETURN:.0f} s"}))
    folder = opened.enter_context(tempfile.TemporaryDirectory(prefix="commonrail-", ignore_cleanup_errors=True))
    opened.enter_context(
        restore_variables(SAFE_PATH)
    )  # Dask sets what its workers need in this process, and leaves it there
    # the scheduler's local web server has no pages; workers that Dask restarts do not run modules of this folder
    settings = {"distributed.scheduler.http.routes": [], f"distributed.nanny.pre-spawn-environ.{SAFE_PATH}": "1"}
    with shield_children(), quiet(), config.set(settings):
        cluster = distributed.LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            protocol="tls://",
            security=security,
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
            local_directory=folder,
            config={"distributed.worker.http.routes": []},
            silence_logs=logging.CRITICAL,
        )
        opened.enter_context(cluster)
        return distributed.Client(cluster, set_as_default=False)


@contextmanager
def _pause_collection() -> Iterator[None]:
    """Pause the garbage collector while Dask holds its lock, because a collected client would wait for the lock.

    Dask holds the lock while a loop starts or stops. A client closes itself when it is collected; a client whose
    scheduler did not answer may be collected at any later time.
    """
    was_on = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


_TURN = threading.Lock()
_LEVELS: list[int] = []  # log levels before each block that a thread is in; the first level is restored last


@contextmanager
def quiet() -> Iterator[None]:
    """Silence Dask's log: errors are reported in our own messages."""
    log = logging.getLogger("distributed")
    with _TURN:
        _LEVELS.append(log.level)
        log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        with _TURN, suppress(Exception):
            log.setLevel(_LEVELS.pop())


FETCH = 10.0  # how long to wait for a result that is said to be there [s]
APPEAR = 30.0  # how long to wait for its first worker [s]
REAPPEAR = 300.0  # how long to wait for another one when all are lost [s]
FRESH = 1.0  # how long the list of workers is considered current [s]
AHEAD = 2  # tasks submitted per thread, to keep it busy


class Sent(NamedTuple):
    """Task that was sent; `complete`: together with its package.

    `bound`: addresses of the only workers that may perform the task; empty if all workers may.
    """

    task: Task
    complete: bool
    bound: frozenset[str]


class Cluster:
    """Workers of a Dask cluster.

    Dask replaces a worker that dies and repeats its tasks; a task is lost here when Dask gives it up. A task bound to
    certain workers is sent again when these workers are gone: their replacements have other addresses, and Dask would
    keep the task for ever. Dask does not notice a worker that hangs: if no task returns within the time limit of a
    task, the workers that still have tasks are restarted, or dropped if the restart fails.

    Parameters, errors: see `Workers.cluster`.
    """

    shares_files = False

    def __init__(self, address: str, count: int) -> None:
        self.address = address
        self._left_out: set[str] = set()
        self._open: dict[Future[Any], Sent] = {}
        self._unsent: list[Task] = []  # because no worker is available
        self._done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        self._silence = self._alone = 0.0  # time without an answer, time without a worker [s]
        self._threads: dict[str, int] = {}
        self._looked = -FRESH
        self._link = Link(address, count)
        try:
            if not (self._link.ask(_has_workers, APPEAR + ANSWER) and self._fetch_threads()):
                raise _without_workers(address, len(self._left_out), APPEAR)
        except BaseException:
            self.close()
            raise

    @property
    def count(self) -> int:
        """Threads of all workers that are used."""
        return max(sum(self._fetch_threads().values()), 1)

    @property
    def busy(self) -> bool:
        """Return whether tasks are out."""
        return bool(self._open or self._unsent)

    def close(self) -> None:
        """Leave the cluster; end it if it is "local"."""
        self._link.close()

    def submit(self, task: Task) -> bool:
        """Hand a task to the cluster; false if it has enough. `StudyError` if the scheduler has gone."""
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
            yield from self._after_silence(waiting_time(start))
            return
        sent = self._open.pop(future, None)
        if sent is None:  # cancelled, and sent again
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
        workers = self._fetch_threads()
        self._silence += passed
        self._alone = 0.0 if workers else self._alone + passed
        if self._alone > REAPPEAR:
            raise _without_workers(self.address, len(self._left_out), REAPPEAR)
        if workers and self._unsent:
            tasks, self._unsent = self._unsent, []
            for task in tasks:
                self._send(task)
        # those whose workers have all gone
        stranded = [future for future, sent in self._open.items() if sent.bound and sent.bound.isdisjoint(workers)]
        if stranded:
            self._link.tell(lambda client: client.cancel(stranded))
        for future in stranded:
            self._send(self._open.pop(future).task)
        limit = max((sent.task.limit for sent in self._open.values()), default=self._silence)
        if self._silence > limit:
            yield from ((task, Lost(f"gave no answer within {limit:.6g} s")) for task in self._shake())

    def drop(self) -> None:
        """Forget the tasks that were sent."""
        futures = list(self._open)
        if futures:  # without tasks a lost scheduler is not contacted
            self._link.tell(lambda client: client.cancel(futures))
        self._open, self._unsent, self._done = {}, [], queue.SimpleQueue()
        self._silence = self._alone = 0.0

    def _send(self, task: Task, *, complete: bool = False) -> None:
        workers = self._lately()
        if not workers:
            self._unsent.append(task)
            return
        package = task.package if complete else None
        bound = frozenset(workers if self._left_out else ())
        future: Future[Any] = self._link.ask(
            lambda client: client.submit(
                perform_held, task.package.key, package, task.argument, pure=False, workers=sorted(bound) or None
            )
        )
        self._silence = 0.0 if not self._open else self._silence
        self._open[future] = Sent(task, complete, bound)
        future.add_done_callback(self._done.put)

    def _shake(self) -> list[Task]:
        """Restart the workers that have our tasks; running tasks are lost, all others sent again."""
        threads = self._link.ask(lambda client: client.nthreads())
        keys_by_worker = self._link.ask(lambda client: client.processing())
        lost: set[Future[Any]] = set()
        stuck = []
        for name, keys in keys_by_worker.items():
            futures = [future for future in self._open if future.key in set(keys)]
            if futures:
                stuck.append(name)
                lost.update(futures[: threads.get(name, 1)])  # the others had not begun
        out = self._open
        self.drop()
        for name in stuck:
            if not self._link.tell(partial(_restart, name), 2.0 * CONNECT):
                note(f"The worker {name} of the cluster {self.address} gives no answer: it is used no more.")
                self._left_out.add(name)  # it has no nanny, or its nanny does not answer
        self._fetch_threads()
        for future, sent in out.items():
            if future not in lost:
                self._send(sent.task)
        return [out[future].task for future in lost]

    def _lately(self) -> dict[str, int]:
        """Threads of each worker in use, at most `FRESH` old."""
        return self._threads if time.monotonic() < self._looked + FRESH else self._fetch_threads()

    def _fetch_threads(self) -> dict[str, int]:
        """Threads of each worker in use, from the scheduler."""
        threads: dict[str, int] = dict(self._link.ask(lambda client: client.nthreads()))
        self._threads = {name: n for name, n in threads.items() if name not in self._left_out}
        self._looked = time.monotonic()
        return self._threads


def _without_workers(address: str, left_out: int, seconds: float) -> StudyError:
    """Error for a cluster without usable workers, with the number of dropped workers and the waiting time [s]."""
    cure = "see what they print" if address == LOCAL else f"start some with `dask worker {address}`"
    if left_out:
        return StudyError(
            f"The cluster {address} has no worker left that can be used: {left_out} have given no answer; replace "
            "them, then resume the run."
        )
    return StudyError(f"The cluster {address} has had no worker for {seconds:.0f} s; {cure}.")


def _has_workers(client: Client) -> bool:
    with suppress(TimeoutError):
        client.wait_for_workers(1, timeout=APPEAR)
        return True
    return False


def _restart(name: str, client: Client) -> None:
    client.restart_workers([name], timeout=CONNECT)


def _outcome(future: Future[Any]) -> Outcome | Missing:
    try:
        outcome = future.result(timeout=FETCH)
    except TimeoutError:
        return Lost(f"did not hand over what it had found within {FETCH:.0f} s")
    except Exception as error:  # reported after some attempts
        return failure(error)
    if isinstance(outcome, Refused):
        raise outcome.error
    return outcome if isinstance(outcome, Answer | Lost | Missing) else Lost("gave no answer but something else")
