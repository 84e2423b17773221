"""What a worker does, a process of our own or one of a cluster: it holds an objective and evaluates pieces with it."""

from __future__ import annotations

import functools
import hashlib
import os
import pickle
import platform
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.objective import Objective, Scores
from commonrail.errors import CommonrailError, StudyError

Floats = NDArray[np.float64]
Result = Scores | Floats

STOP_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # those that `interrupt.held_interrupts` turns into a wish


class Package(NamedTuple):
    """An objective on its way to a worker.

    Attributes
    ----------
    key : str
        Digest of the content.
    software : tuple of (name, version)
        Of the process that packed it; a worker with another one refuses it.
    content : bytes
        The objective.
    probe : bytes
        Bits of the objective of the injector's own values; a worker that finds others refuses it.
    """

    key: str
    software: tuple[tuple[str, str], ...]
    content: bytes
    probe: bytes


class Task(NamedTuple):
    """A piece of a population, (n, names), what to find ("costs" or "residuals"), and how long it may take [s]."""

    package: Package
    method: str
    values: Floats
    limit: float


class Answer(NamedTuple):
    """Result of a task and the seconds it took."""

    result: Result
    seconds: float


class Lost(NamedTuple):
    """A task without a result, and what became of it: the end of a sentence that begins with "the worker"."""

    reason: str


class Refused(NamedTuple):
    """A task that would have been refused in the calling process too, and the error."""

    error: CommonrailError


class Up(NamedTuple):
    """First word of a worker process."""


Outcome = Answer | Lost
Reply = Answer | Lost | Refused | Up


def pack(objective: Objective) -> Package:
    """Objective for workers, probed here: its kernel is compiled and on disk before any worker asks for it."""
    content = pickle.dumps(objective)
    return Package(hashlib.sha256(content).hexdigest(), software(), content, _probe(objective))


@functools.lru_cache(maxsize=2)
def unpack(package: Package) -> Objective:
    """The objective, on one thread.

    Raises
    ------
    StudyError
        If this worker has other software, or finds other bits than the process that packed it.
    """
    differing = [f"{name} {there}" for name, there in package.software if dict(software())[name] != there]
    if differing:
        here = ", ".join(" ".join(pair) for pair in software())
        raise StudyError(
            f"A worker on {platform.node()} has other software ({here}) than this run ({', '.join(differing)}); "
            "install the same versions, for instance with constraints.txt."
        )
    objective: Objective = pickle.loads(package.content)
    objective.threads = 1
    if _probe(objective) != package.probe:
        raise StudyError(
            f"A worker on {platform.node()} ({platform.machine()}) finds another objective for the start values than "
            "this machine, bit for bit; start the run on a machine with the processors of the workers."
        )
    return objective


def software() -> tuple[tuple[str, str], ...]:
    """Versions that decide over the bits of a result."""
    return tuple((name, version(name)) for name in ("commonrail", "numpy", "scipy", "numba"))


def _probe(objective: Objective) -> bytes:
    return objective.costs(own_values(objective)).costs.tobytes()


def own_values(objective: Objective) -> Floats:
    """The injector's own values as one candidate, (1, names)."""
    return np.array([[objective.injector.values[name] for name in objective.names]])


def evaluate(package: Package, method: str, values: Floats) -> Answer:
    """Result of a piece.

    Raises
    ------
    StudyError
        If this worker must not be used: see `unpack`.
    """
    objective = unpack(package)
    start = time.perf_counter()
    call: Callable[[Floats], Result] = objective.costs if method == "costs" else objective.residuals
    result = call(values)
    return Answer(result, time.perf_counter() - start)


def serve(pipe: Connection) -> None:
    """Body of a worker process: take packages and tasks until told to end, or until the calling process has gone.

    A stop signal goes to the whole group of processes; the calling process alone decides what becomes of it.
    """
    heed_caller_alone()
    with suppress(EOFError, BrokenPipeError):
        pipe.send(Up())
        package: Any = None
        while True:
            message = pipe.recv()
            if isinstance(message, Package):
                package = message
            else:
                pipe.send(_reply(package, *message))


def heed_caller_alone() -> None:
    """In a worker process: let stop signals pass, and end when the calling process does, however that ends."""
    for name in STOP_SIGNALS:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    threading.Thread(target=_end_with_caller, daemon=True).start()


def _end_with_caller() -> None:
    # a killed caller must leave nothing running, not even a piece that hangs
    caller = parent_process()
    if caller is not None:
        caller.join()
        os._exit(1)


def _reply(package: Package, method: str, values: Floats) -> Reply:
    try:
        return evaluate(package, method, values)
    except CommonrailError as error:
        return Refused(error)
    except Exception as error:  # told in a sentence after some attempts
        return Lost(f"met {type(error).__name__}: {error}")
