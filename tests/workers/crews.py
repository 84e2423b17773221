"""Work whose answers are known and that misbehaves on demand, and who may do it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.workers.pool import USUAL, Limits, ProcessPool
from commonrail.workers.task import Answer, Outcome, Package, Task
from commonrail.workers.workers import Workers

NO_DASK = "distributed or cryptography is not installed: pip install 'commonrail[cluster]'"
LIMIT = 120.0  # no task of a test takes as long [s]


class Deed(NamedTuple):
    """Number to be answered with its sine, and what a worker does instead, so many times."""

    number: int
    instead: str = ""
    times: int = 1


class Deeds:
    """Sines of numbers, but for the deeds that are asked for instead.

    `folder` counts those: workers share no memory.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.home = folder, os.getpid()

    def __call__(self, deed: Deed, /) -> bytes:
        """Bits of the sine."""
        if deed.instead and os.getpid() != self.home:
            mine = self.folder / f"{deed.number}"
            mine.mkdir(exist_ok=True)
            so_far = len(list(mine.iterdir()))
            (mine / str(so_far)).touch()
            if so_far < deed.times:
                self._do(deed.instead)
        return np.sin(float(deed.number)).tobytes()

    def _do(self, what: str) -> None:
        if what == "die":
            time.sleep(0.5)  # a nanny of Dask that does not know yet that its worker has begun would not replace it
            os.kill(os.getpid(), signal.SIGKILL)
        if what == "hang":
            os.kill(os.getpid(), signal.SIGSTOP)
        if what == "fail":
            raise MemoryError("no room for 8 GiB")
        raise ConfigurationError("This cannot be done.")

    same_bits = False

    def probe(self) -> bytes:
        """Bits of a sine."""
        return np.sin(0.5).tobytes()


def tasks(package: Package, deeds: Iterable[Deed], limit: float = LIMIT) -> list[Task]:
    """Task of each deed, called by its number."""
    return [Task(deed.number, package, deed, limit) for deed in deeds]


def with_other(package: Package, name: str, value: str) -> tuple[tuple[str, str], ...]:
    """Software of a package, but for one version or property of the compiler's target."""
    assert name in dict(package.software)
    return tuple((dict(package.software) | {name: value}).items())


def sines(outcomes: Iterable[tuple[Task, Outcome]]) -> dict[object, bytes]:
    """Answers by the names of their tasks."""
    found: dict[object, bytes] = {}
    for task, outcome in outcomes:
        assert isinstance(outcome, Answer), outcome
        assert task.name not in found
        found[task.name] = outcome.result
    return found


def expected(deeds: Iterable[Deed]) -> dict[object, bytes]:
    """Expected sines."""
    return {deed.number: np.sin(float(deed.number)).tobytes() for deed in deeds}


def processes(count: int = 2, limits: Limits = USUAL) -> AbstractContextManager[Workers]:
    """Processes of this machine."""
    return Workers.processes(count, limits)


def cluster(count: int = 2, limits: Limits = USUAL) -> AbstractContextManager[Workers]:
    """A Dask cluster on this machine; the test is skipped if Dask is not installed."""
    for package in ("distributed", "cryptography"):
        pytest.importorskip(package, reason=NO_DASK)
    return Workers.cluster("local", count, limits)


Crew = Callable[..., AbstractContextManager[Workers]]
CREWS: dict[str, Crew] = {"processes": processes, "cluster": cluster}


def pids_of(workers: Workers) -> list[int]:
    """Process numbers of workers on this machine as they are now."""
    if isinstance(workers.backend, ProcessPool):
        return workers.backend.pids
    from commonrail.plugins.cluster import Cluster

    assert isinstance(workers.backend, Cluster)
    return list(workers.backend._link.ask(lambda client: client.run(os.getpid)).values())


def gone(pid: int) -> bool:
    """Return whether a process has ended."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and ") Z " in stat.read_text()  # dead, and nobody to be told
