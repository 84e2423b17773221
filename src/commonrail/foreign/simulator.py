"""Candidates of a foreign FMU simulated in processes of their own, any of which may crash or hang."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.arrays import Floats
from commonrail.foreign.child import FATAL_EXIT, Answered, Asked, FmuWork
from commonrail.foreign.data import FmuData
from commonrail.foreign.fmu import Fmu, unpacked
from commonrail.foreign.statuses import FmuStatus
from commonrail.workers.limits import USUAL
from commonrail.workers.task import Answer, Lost, Task, pack
from commonrail.workers.workers import Workers

__all__ = ["FmuSimulator", "Simulated", "opened"]


class Simulated(NamedTuple):
    """Values (n, m) of candidates, NaN in the runs that failed, and statuses (n,): of the first run that failed."""

    values: Floats
    statuses: NDArray[np.int8]


class FmuSimulator:
    """Simulator of an FMU.

    Parameters
    ----------
    work : FmuWork
    data : sequence of FmuData
        All of whose runs are those of the work, in this order.
    workers : Workers
        Processes.
    time_limit : float
        Of one simulation [s].
    """

    def __init__(self, work: FmuWork, data: Sequence[FmuData], workers: Workers, time_limit: float) -> None:
        self._package, self._workers, self._limit = pack(work), workers, time_limit
        self._runs = work.runs
        self._first: dict[str, int] = {}
        for one in data:
            self._first[one.name] = sum(len(before.runs) for before in data[: len(self._first)])
        self.heed: Callable[[], None] = lambda: None
        self.told: dict[FmuStatus, str] = {}  # the first message with each status

    def simulate(self, data: Sequence[FmuData], values: Floats, finer: int = 1) -> Simulated:
        """Values of data sets, one after the other, for candidates (n, names).

        Parameters
        ----------
        data : sequence of FmuData
        values : (n, names)
            In the units of the FMU.
        finer : int
            Communication steps that replace one.
        """
        numbers = [self._first[one.name] + i for one in data for i in range(len(one.runs))]
        edges = np.cumsum([0, *(self._runs[number].size for number in numbers)])
        found = np.full((len(values), edges[-1]), np.nan)
        statuses = np.zeros((len(values), len(numbers)), np.int8)
        rows = enumerate(tuple(row) for row in values.tolist())
        tasks = (self._task((i, k), Asked(n, row, finer)) for i, row in rows for k, n in enumerate(numbers))
        for task, outcome in self._workers.run(tasks, heed=self.heed):
            assert isinstance(task.name, tuple)
            i, k = task.name
            answered = self._answered(outcome, edges[k + 1] - edges[k])
            statuses[i, k] = answered.status
            found[i, edges[k] : edges[k + 1]] = answered.values
            if answered.status:
                self.told.setdefault(FmuStatus(answered.status), answered.told)
        first = np.argmax(statuses > 0, axis=1)
        return Simulated(found, statuses[np.arange(len(values)), first])

    def _task(self, name: tuple[int, int], asked: Asked) -> Task:
        # a simulation that was lost once is not tried again: an FMU that crashed would do so again
        return Task(name, self._package, asked, self._limit, losses=USUAL.failures - 1)

    def _answered(self, outcome: object, size: int) -> Answered:
        if isinstance(outcome, Answer):
            assert isinstance(outcome.result, Answered)
            return outcome.result
        assert isinstance(outcome, Lost)
        status = FmuStatus.FMU_CRASHED
        if outcome.reason.startswith("gave no answer"):
            status = FmuStatus.FMU_TOO_LONG
        elif outcome.reason == f"ended with exit code {FATAL_EXIT}":
            status = FmuStatus.FMU_FATAL
        return Answered(np.full(size, np.nan), int(status), f"the process {outcome.reason}")


@contextmanager
def opened(
    fmu: Fmu, names: Sequence[str], data: Sequence[FmuData], step: float, time_limit: float, processes: int | None
) -> Iterator[FmuSimulator]:
    """Simulator of an FMU with its processes, ended with the block.

    Parameters
    ----------
    fmu : Fmu
    names : sequence of str
        Variables that are calibrated.
    data : sequence of FmuData
    step : float
        Communication step [s].
    time_limit : float
        Of one simulation [s].
    processes : int or None
        All usable processors if None.

    Raises
    ------
    InputError
        If the FMU cannot be unpacked.
    StudyError
        If the processes cannot be started.
    """
    runs = tuple(run for one in data for run in one.runs)
    with unpacked(fmu) as folder:
        work = FmuWork(str(folder), fmu.digest, tuple(names), runs, step)
        with Workers.processes(processes) as workers:
            yield FmuSimulator(work, data, workers, time_limit)
