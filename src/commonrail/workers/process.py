"""Body of a worker process: it serves the process that started it, and ends with it."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from commonrail.errors import CommonrailError
from commonrail.workers.interrupt import STOP_SIGNALS
from commonrail.workers.task import Answer, Lost, Package, failure, perform, unpack

SINGLE_THREADED = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Refused(NamedTuple):
    """A task that would have been refused in the calling process too, and the error."""

    error: CommonrailError


class Up(NamedTuple):
    """Word of a worker process that has begun, or has loaded the work."""


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
                with suppress(Exception):  # met again, and told, when the work is to be done
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
    except (Exception, KeyboardInterrupt) as error:  # told in a sentence after some attempts
        return failure(error)


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
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
