"""Objective spread over workers: a population is cut into pieces, and the bits are those of one process.

A piece is a whole number of SIMD blocks, so that every candidate has the neighbours that it would have in one process,
and no result depends on them anyway: how many workers there are, which of them took what and how often it had to be
repeated leaves no trace in a result.
"""

from __future__ import annotations

import copy
import time
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.choices import Precision
from commonrail.base.errors import StudyError
from commonrail.calibration.objective import Objective, Scores
from commonrail.engine.job import VECTORS
from commonrail.physics.meters import known_quantity
from commonrail.workers.task import Answer, Lost, Task, pack
from commonrail.workers.workers import Workers

SHORTEST = 0.05  # a piece should take at least this long [s]: handing it over takes a hundredth of it
LONGEST = 2.0  # and no longer than this, where there are candidates enough: it is what a lost worker costs
BLOCK = VECTORS[Precision.F64].lanes
SHARES = 4  # pieces for each worker, so that one that is late does not keep the others waiting


class Piece(NamedTuple):
    """Candidates [first, stop) of a population."""

    first: int
    stop: int

    @property
    def blocks(self) -> int:
        """SIMD blocks in it."""
        return -(-(self.stop - self.first) // BLOCK)

    def halves(self) -> list[Piece]:
        """Both halves, of whole blocks; one block is not divided."""
        middle = self.first + BLOCK * -(-self.blocks // 2)
        return [self] if middle >= self.stop else [Piece(self.first, middle), Piece(middle, self.stop)]


class Evaluation:
    """Costs or residuals of candidates, on one thread: the work of a calibration's workers.

    They are tried with the start values (names,) [SI].
    """

    def __init__(self, objective: Objective, start: Floats) -> None:
        self.objective, self.start = copy.copy(objective), start
        self.objective.use_threads(1)

    def __call__(self, argument: tuple[str, Floats]) -> Any:
        """Result of "costs", "residuals" or "screened" of candidates (n, names)."""
        method, values = argument
        return getattr(self.objective, method)(values)

    @property
    def same_bits(self) -> bool:
        """As the study has it."""
        return self.objective.simulator.same_bits

    def probe(self) -> bytes:
        """Bits of the objective of the start values."""
        return self.objective.costs(self.start[None, :]).costs.tobytes()


class SpreadObjective(Objective):
    """An `Objective` whose costs and residuals come from workers, to the same bits; its kernel is compiled here first.

    `costs` and `residuals` raise a `StudyError` if a piece was lost as often as the limits allow.
    """

    def __init__(self, objective: Objective, workers: Workers, reference: Floats) -> None:
        vars(self).update(vars(objective))  # the same injector, data and settings
        self._workers = workers
        work = Evaluation(objective, reference)
        self._package = pack(work)
        start = time.perf_counter()
        work.probe()
        seconds = time.perf_counter() - start
        self._seconds = dict.fromkeys(("costs", "residuals", "screened"), seconds)  # of a block, the latest known

    def costs(self, values: Floats) -> Scores:
        """Objective of candidates (n, names), SI."""
        piece_scores = self._results("costs", values)
        costs, statuses = (np.concatenate(parts) for parts in zip(*[s[:2] for s in piece_scores], strict=True))
        return Scores(costs, statuses, sum(s.simulations for s in piece_scores))

    def residuals(self, values: Floats) -> Floats:
        """Residuals for least squares (n, all samples and points)."""
        return np.concatenate(self._results("residuals", values))

    def screened(self, values: Floats) -> Floats:
        """Residuals (n, all samples and points) that screen candidates."""
        return np.concatenate(self._results("screened", values))

    def _results(self, method: str, values: Floats) -> list[Any]:
        """Results of all pieces, in the order of the candidates."""
        limits, seconds = self._workers.limits, self._seconds[method]

        def task(piece: Piece, losses: int = 0) -> Task:
            argument = method, values[piece.first : piece.stop]
            patience = max(limits.least, limits.patience * seconds * piece.blocks)
            return Task(piece, self._package, argument, patience, losses)

        def halves(lost: Task) -> list[Task]:
            # if it is one candidate's fault, fewer are under suspicion each time
            return [task(half, lost.losses) for half in _piece(lost).halves()]

        answers: dict[Piece, Answer] = {}
        pieces = cut(len(values), self._workers.backend.count, seconds)
        for done, outcome in self._workers.run(map(task, pieces), halves):
            if isinstance(outcome, Lost):
                raise StudyError(self._what_failed(done, outcome, values))
            answers[_piece(done)] = outcome
        blocks = sum(piece.blocks for piece in answers)
        self._seconds[method] = sum(answer.seconds for answer in answers.values()) / blocks
        return [answers[piece].result for piece in sorted(answers)]

    def _what_failed(self, task: Task, lost: Lost, values: Floats) -> str:
        piece = _piece(task)
        first = list(zip(self.names, values[piece.first], strict=True))
        shown = ", ".join(f"{name} = {value:.6g} {known_quantity(name).unit}".strip() for name, value in first[:3])
        more = ", …" if len(first) > 3 else ""
        return (
            f"Candidates {piece.first + 1} to {piece.stop} of {len(values)} were lost {task.losses} times (the worker "
            f"{lost.reason}), the first of them {shown}{more}; narrow the bounds if it is these candidates, give a "
            "worker more memory or time if not, then go on with the run: what was finished is kept."
        )


def _piece(task: Task) -> Piece:
    assert isinstance(task.name, Piece)
    return task.name


def cut(candidates: int, workers: int, seconds: float) -> list[Piece]:
    """Pieces of a population, each of whole SIMD blocks but the last, which may end with a part of one.

    As many as last `SHORTEST` or longer by the time of one block [s], a multiple of `workers` if there are more than
    that, `SHARES` for each worker, more only if one would take longer than `LONGEST`.
    """
    blocks = -(-candidates // BLOCK)
    most = max(int(blocks * seconds / SHORTEST), 1)
    if most > workers:
        shares = max(SHARES, -(-int(blocks * seconds / LONGEST) // workers))
        most = min(most // workers, shares) * workers
    size = -(-blocks // most) * BLOCK
    return [Piece(first, min(first + size, candidates)) for first in range(0, candidates, size)]
