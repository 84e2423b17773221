"""Link to the scheduler of a Dask cluster: opened, asked with a deadline, closed; nothing else imports `distributed`.

A cluster on this machine listens on the loopback interface alone, shows no pages, and lets in whoever has the
certificate of this run: it is made for the run, and held in memory. A cluster elsewhere is reached as Dask's own
configuration says (``distributed.comm.tls``).
"""

from __future__ import annotations

import gc
import logging
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from commonrail.errors import InputError, StudyError
from commonrail.notice import note
from commonrail.workers.deadline import Late, within
from commonrail.workers.limits import check_count
from commonrail.workers.process import blocked_signals

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["LOCAL", "Link", "quiet"]

LOCAL = "local"
_ADDRESS = re.compile(r"([a-z]+://.+|[^:/]+:[0-9]+)")  # what Dask takes at once to be an address
_HERE = re.compile(r"(tls|inproc)://.*|(tcp://)?(127\.[0-9.]+|localhost|\[::1\])(:[0-9]+)?")  # nobody listens in
CONNECT = 5.0  # how long to try to reach a scheduler [s]
ANSWER = 30.0  # how long a scheduler may take for an answer; one with thousands of workers takes some seconds [s]
LEAVE = 5.0  # how long to try to say goodbye [s]
# How long a local cluster waits for the replacement of a worker that has died [s]. Dask waits for 15 s, then ends what
# starts it; on a busy machine it takes longer, and the cluster would lose one worker after the other.
RETURN = 3600.0
_MISSING = (
    "A cluster needs the package {package}, which is not installed; install it with "
    "`pip install 'commonrail[cluster]'`, or use processes of this machine."
)

T = TypeVar("T")


class Link:
    """Link to a scheduler.

    Parameters
    ----------
    address : str
        "tcp://host:port", "tls://host:port", or "local" for a cluster of `count` processes on this machine.
    count : int
        Workers of a "local" cluster.

    Raises
    ------
    ConfigurationError
        If `count` is not between 1 and eight for each processor.
    InputError
        If distributed is not installed, or there is no cluster at the address.
    """

    def __init__(self, address: str, count: int) -> None:
        self.address = address
        with _uncollected(), ExitStack() as opened:
            self.client: Client = _local(count, opened) if address == LOCAL else _connect(address)
            opened.callback(self._leave)
            self._opened = opened.pop_all()

    def ask(self, call: Callable[[Client], T], seconds: float | None = None) -> T:
        """Return what a call to the scheduler gives.

        Parameters
        ----------
        call : function of Client
        seconds : float, optional
            Deadline [s]; `ANSWER` by default.

        Raises
        ------
        StudyError
            If the scheduler has gone, or gives no answer.
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
        """Return whether a call succeeded that may as well fail."""
        try:
            with quiet():
                within(seconds, lambda: call(self.client))
        except Exception:
            return False
        return True

    def close(self) -> None:
        """Leave the cluster; end it if it is "local"."""
        with quiet(), _uncollected():
            self._opened.close()

    def _leave(self) -> None:
        self.tell(lambda client: client.close())


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise InputError(_MISSING.format(package="distributed")) from None
    return distributed


def _connect(address: str) -> Client:
    distributed = _distributed()
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
        raise InputError(_unreached(address, error)) from None
    if not _HERE.fullmatch(address):
        note(
            f"The connection to {address} is not encrypted: everybody on the network can read and change the tasks and "
            "answers; use tls:// (docs/howto/workers.md)."
        )
    return client


def _unreached(address: str, error: Exception) -> str:
    cure = f'start one with `dask scheduler` and give its address as "{address.partition("://")[0]}://host:port"'
    if address.startswith("tls://"):
        cure += ", with the certificates in Dask's configuration (distributed.comm.tls)"
    return f"There is no Dask scheduler at {address} that can be used ({error}); {cure}."


def _local(count: int, opened: ExitStack) -> Client:
    """Client of a cluster on this machine that no other user can enter."""
    distributed = _distributed()
    check_count(count)
    try:
        security = distributed.Security.temporary()
    except ImportError:
        raise InputError(_MISSING.format(package="cryptography")) from None
    opened.enter_context(_configured({"distributed.deploy.lost-worker-timeout": f"{RETURN:.0f} s"}))
    folder = opened.enter_context(tempfile.TemporaryDirectory(prefix="commonrail-", ignore_cleanup_errors=True))
    # the scheduler's web server, on loopback, has no page
    with blocked_signals(), quiet(), _configured({"distributed.scheduler.http.routes": []}):
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
def _uncollected() -> Iterator[None]:
    """Keep the garbage collector away from Dask's lock: an abandoned client that it met there would wait for that lock.

    Dask holds it while a loop is started or stopped, and a client closes itself when it is collected: one whose
    scheduler gave no answer is collected at any time after.
    """
    was_on = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _configured(values: Mapping[str, Any]) -> Any:
    """Dask's configuration of this process with other values, as a context."""
    import dask

    return dask.config.set(values)


@contextmanager
def quiet() -> Iterator[None]:
    """Silence of Dask's log: what went wrong is told in our own words."""
    log = logging.getLogger("distributed")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        with suppress(Exception):
            log.setLevel(level)
