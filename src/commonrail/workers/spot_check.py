"""Spot checks: some tasks are done twice, by two workers, and a worker that has answered wrongly is dismissed."""

from __future__ import annotations

import hashlib
import secrets
from typing import NamedTuple, Protocol, runtime_checkable

from commonrail.notice import note
from commonrail.workers.limits import Limits
from commonrail.workers.task import Answer, Lost, Outcome, Task, Withdrawn, unpack

__all__ = ["Inspected", "SpotChecks"]


@runtime_checkable
class Inspected(Protocol):
    """Backend whose workers are not of this process: their answers say which worker gave them, and are checked."""

    def others(self, worker: str) -> bool:
        """Return whether there are workers beside this one."""

    def dismiss(self, worker: str) -> None:
        """Use a worker no more; what it has in hand is given to others."""


class Copy(NamedTuple):
    """Name of a task that is done a second time, by its number."""

    number: int


class Ruling(NamedTuple):
    """Outcomes to be yielded, and tasks to be done before all others."""

    told: list[tuple[Task, Outcome]]
    again: list[Task]


class SpotChecks:
    """Checks of the answers of workers.

    Every answer must be a result of its task. One of `Limits.check_one_in`, and the first, is compared with that of
    another worker. Where the bits differ, this process does the task: the worker that gave other bits is dismissed, and
    each answer that it has given is withdrawn.

    Parameters
    ----------
    backend : Inspected
    limits : Limits
    """

    def __init__(self, backend: Inspected, limits: Limits) -> None:
        self._backend, self._one_in = backend, limits.check_one_in
        self._seed = secrets.randbits(128) if limits.seed is None else limits.seed
        self._given: dict[str, list[Task]] = {}  # by worker, without their arguments
        self._held: dict[Copy, tuple[Task, Answer]] = {}

    def judge(self, task: Task, outcome: Outcome) -> Ruling:
        """Ruling on an outcome of a task.

        Raises
        ------
        CommonrailError
            What the work raises, where this process does it.
        """
        if isinstance(task.name, Copy):
            return self._compare(*self._held.pop(task.name), outcome)
        if not isinstance(outcome, Answer):
            return Ruling([(task, outcome)], [])
        if _bits(task, outcome) is None:
            return Ruling(self._dismiss(outcome.worker, "a result that is none"), [task])
        if not self._is_due(task.number):
            return Ruling([self._accepted(task, outcome)], [])
        copy = Copy(task.number)
        self._held[copy] = task, outcome
        if not self._backend.others(outcome.worker):
            return self._compare(*self._held.pop(copy), Lost("is the only one"))
        return Ruling([], [task._replace(name=copy, losses=0, avoid=outcome.worker)])

    def drop(self) -> None:
        """Forget the answers that wait for their copy."""
        self._held.clear()

    def _is_due(self, number: int) -> bool:
        if self._one_in == 0:
            return False
        drawn = hashlib.sha256(f"{self._seed} {number}".encode()).digest()
        return number == 0 or int.from_bytes(drawn[:8], "big") % self._one_in == 0

    def _compare(self, task: Task, first: Answer, second: Outcome) -> Ruling:
        bits = _bits(task, first)
        both = isinstance(second, Answer) and second.worker != first.worker
        if both and _bits(task, second) == bits:
            return Ruling([self._accepted(task, first)], [])
        work = unpack(task.package)
        own = Answer(work(task.argument), first.seconds)
        right, told = work.bits(task.argument, own.result), []
        for answer in (first, second):
            if isinstance(answer, Answer) and _bits(task, answer) != right:
                told += self._dismiss(answer.worker, "other bits than this machine")
        return Ruling([*told, self._accepted(task, first) if bits == right else (task, own)], [])

    def _accepted(self, task: Task, answer: Answer) -> tuple[Task, Outcome]:
        self._given.setdefault(answer.worker, []).append(task._replace(argument=None))
        return task, answer

    def _dismiss(self, worker: str, why: str) -> list[tuple[Task, Outcome]]:
        note(
            f"The worker {worker} has answered with {why}: it is used no more, and what it had answered is done again."
        )
        self._backend.dismiss(worker)
        return [(task, Withdrawn(worker)) for task in self._given.pop(worker, [])]


def _bits(task: Task, outcome: Outcome) -> bytes | None:
    """Bits of an answer; None if it is no result of its task."""
    try:
        return unpack(task.package).bits(task.argument, outcome.result) if isinstance(outcome, Answer) else None
    except Exception:  # of a thing that is anything but a result
        return None
