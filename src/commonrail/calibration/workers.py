"""Many workers, the same bits: a population is cut into pieces that worker processes or a cluster evaluate.

A piece is a whole number of SIMD blocks, so that every candidate has the neighbours that it would have in one process,
and no result depends on them anyway: how many workers there are, which of them took what and how often it had to be
repeated leaves no trace in a result.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from contextlib import closing
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.objective import Objective, Scores
from commonrail.calibration.worker import Answer, Lost, Outcome, Task, own_values, pack, unpack
from commonrail.calibration.worker_pool import USUAL, Limits, WorkerPool
from commonrail.choices import Precision
from commonrail.engine.lanes import VECTORS
from commonrail.engine.simulate import usable_threads
from commonrail.errors import StudyError
from commonrail.injector.definition import parameter_quantities

Floats = NDArray[np.float64]

SHORTEST = 0.05  # a piece should take at least this long [s]: handing it over takes a hundredth of it
LONGEST = 2.0  # and no longer than this, where there are candidates enough: it is what a lost worker costs
BLOCK = VECTORS[Precision.F64].lanes
SHARES = 4  # pieces for each worker, so that one that is late does not keep the others waiting


class Backend(Protocol):
    """Where pieces are evaluated."""

    @property
    def count(self) -> int:
        """Number of pieces that are evaluated at the same time."""

    def run(self, tasks: Sequence[Task]) -> Generator[tuple[int, Outcome]]:
        """Number and outcome of each task, as they come."""

    def close(self) -> None:
        """End it."""


class Piece(NamedTuple):
    """Candidates [first, stop) of a population, and how often they have been lost."""

    first: int
    stop: int
    failures: int = 0

    @property
    def blocks(self) -> int:
        """SIMD blocks in it."""
        return -(-(self.stop - self.first) // BLOCK)


class Workers:
    """Workers that evaluate populations; use it in a `with` block.

    Examples
    --------
    ::

        with Workers.processes(4) as workers:
            scores = workers.spread(objective).costs(values)
    """

    def __init__(self, backend: Backend, limits: Limits) -> None:
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
            If `count` is not between 1 and eight for each processor.
        StudyError
            If the processes cannot be started.
        """
        return cls(WorkerPool(usable_threads() if count is None else count, limits), limits)

    @classmethod
    def cluster(cls, address: str, count: int | None = None, limits: Limits = USUAL) -> Workers:
        """Workers of a Dask cluster.

        Parameters
        ----------
        address : str
            Of its scheduler, "tcp://host:port"; "local" starts a cluster on this machine and ends it with the block.
        count : int, optional
            Workers of a "local" cluster; all usable processors by default.
        limits : Limits
            When a worker is given up.

        Raises
        ------
        InputError
            If distributed is not installed, or there is no cluster at the address.
        StudyError
            If the cluster has no workers, or they have no commonrail.
        """
        from commonrail.calibration.cluster import Cluster

        return cls(Cluster(address, usable_threads() if count is None else count, limits), limits)

    def spread(self, objective: Objective) -> SpreadObjective:
        """The same objective, evaluated by these workers; its kernel is compiled here first."""
        return SpreadObjective(objective, self.backend, self.limits)

    def close(self) -> None:
        """End the workers (those of a cluster that was given by its address go on)."""
        self.backend.close()

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class SpreadObjective(Objective):
    """An `Objective` whose costs and residuals come from workers, to the same bits.

    Raises
    ------
    StudyError
        From `costs` and `residuals`: if a piece was lost as often as the limits allow.
    """

    def __init__(self, objective: Objective, backend: Backend, limits: Limits) -> None:
        own = objective.injector, objective.names, objective.data, objective.time_step
        super().__init__(*own, objective.threads, objective.precision)
        self._backend, self._limits = backend, limits
        self._package = pack(objective)
        seconds = _seconds_of_a_block(unpack(self._package))
        self._seconds = {"costs": seconds, "residuals": seconds}  # of a block, the latest known

    def costs(self, values: Floats) -> Scores:
        """Objective of candidates (n, names), SI."""
        found = [a.result for a in self._answers("costs", values) if isinstance(a.result, Scores)]
        costs, statuses = (np.concatenate(parts) for parts in zip(*[s[:2] for s in found], strict=True))
        return Scores(costs, statuses, sum(s.simulations for s in found))

    def residuals(self, values: Floats) -> Floats:
        """Residuals for least squares (n, all samples and points)."""
        return np.concatenate([np.asarray(a.result) for a in self._answers("residuals", values)])

    def _answers(self, method: str, values: Floats) -> list[Answer]:
        """Answers of all pieces, in the order of the candidates."""
        pieces = cut(len(values), self._backend.count, self._seconds[method])
        found: dict[Piece, Answer] = {}
        while pieces:
            pieces = self._round(method, values, pieces, found)
        spent = sum(answer.seconds for answer in found.values())
        self._seconds[method] = spent / sum(piece.blocks for piece in found)
        return [found[piece] for piece in sorted(found)]

    def _round(self, method: str, values: Floats, pieces: list[Piece], found: dict[Piece, Answer]) -> list[Piece]:
        """Evaluate pieces; what has to be done again."""
        again: list[Piece] = []
        tasks = [Task(self._package, method, values[p.first : p.stop], self._patience(method, p)) for p in pieces]
        with closing(self._backend.run(tasks)) as outcomes:
            for index, outcome in outcomes:
                if isinstance(outcome, Lost):
                    again += self._once_more(pieces[index], outcome, values)
                else:
                    found[pieces[index]] = outcome
        return again

    def _patience(self, method: str, piece: Piece) -> float:
        return max(self._limits.least, self._limits.patience * self._seconds[method] * piece.blocks)

    def _once_more(self, piece: Piece, lost: Lost, values: Floats) -> list[Piece]:
        """A lost piece in two halves: if it is one candidate's fault, fewer are under suspicion each time."""
        failures = piece.failures + 1
        if failures >= self._limits.failures:
            raise StudyError(self._what_failed(piece, lost, values, failures))
        middle = piece.first + BLOCK * -(-piece.blocks // 2)
        if middle >= piece.stop:
            return [piece._replace(failures=failures)]
        return [Piece(piece.first, middle, failures), Piece(middle, piece.stop, failures)]

    def _what_failed(self, piece: Piece, lost: Lost, values: Floats, failures: int) -> str:
        units = parameter_quantities()
        first = list(zip(self.names, values[piece.first], strict=True))
        shown = ", ".join(f"{name} = {value:.6g} {units[name].unit}".strip() for name, value in first[:3])
        more = ", …" if len(first) > 3 else ""
        return (
            f"Candidates {piece.first + 1} to {piece.stop} of {len(values)} were lost {failures} times (the worker "
            f"{lost.reason}), the first of them {shown}{more}; narrow the bounds if it is these candidates, give a "
            "worker more memory or time if not, then go on with the run: what was finished is kept."
        )


def cut(candidates: int, workers: int, seconds: float) -> list[Piece]:
    """Pieces of a population.

    Parameters
    ----------
    candidates : int
    workers : int
        As many pieces as are evaluated at the same time.
    seconds : float
        Time of one SIMD block [s].

    Returns
    -------
    list of Piece
        Each of whole blocks but the last, which may end with a part of one. As many as last `SHORTEST` or longer, a
        multiple of `workers` if there are more than that, `SHARES` for each worker, more only if one would take longer
        than `LONGEST`.
    """
    blocks = -(-candidates // BLOCK)
    most = max(int(blocks * seconds / SHORTEST), 1)
    if most > workers:
        shares = max(SHARES, -(-int(blocks * seconds / LONGEST) // workers))
        most = min(most // workers, shares) * workers
    size = -(-blocks // most) * BLOCK
    return [Piece(first, min(first + size, candidates)) for first in range(0, candidates, size)]


def _seconds_of_a_block(objective: Objective) -> float:
    one = own_values(objective)
    start = time.perf_counter()
    objective.costs(one)
    return time.perf_counter() - start
