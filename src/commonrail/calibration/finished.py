"""Finished pieces of a search, kept until its end: what a dismissed worker of a cluster had found is done again."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, NamedTuple

from commonrail.errors import StudyError
from commonrail.workers.task import Answer, Task, Withdrawn, Work

__all__ = ["Done", "Finished", "WrongGenerationError"]

ROOM = 64 * 2**20  # for the candidates of finished pieces [bytes]: 500,000 with 16 parameters


class WrongGenerationError(StudyError):
    """A finished generation of a search is wrong, or may be: nothing may continue from it."""


class Done(NamedTuple):
    """A task and its answer."""

    task: Task
    answer: Answer


class Finished:
    """Arguments and bits of finished pieces, by the numbers of their tasks.

    Parameters
    ----------
    work : Work
        Finds them again, in this process.
    room : int
        For the candidates [bytes]; where it does not suffice, the oldest pieces are forgotten.
    """

    def __init__(self, work: Work, room: int = ROOM) -> None:
        self._work, self._left = work, room
        self._pieces: dict[int, tuple[Any, bytes]] = {}

    def add(self, found: Mapping[int, Done]) -> None:
        """Keep the pieces of a population that is finished, by the numbers of their tasks."""
        for number, done in found.items():
            method, values = done.task.argument
            self._pieces[number] = (method, values.copy()), self._bits(done.task.argument, done.answer.result)
            self._left -= values.nbytes
        while self._left < 0 and self._pieces:
            (_, values), _ = self._pieces.pop(next(iter(self._pieces)))
            self._left += values.nbytes

    def confirm(self, task: Task, withdrawn: Withdrawn) -> None:
        """Find a piece again whose answer is withdrawn.

        Raises
        ------
        WrongGenerationError
            If its bits were others, or it is forgotten: the search has gone on from it.
        """
        kept = self._pieces.get(task.number)
        if kept is None or self._bits(kept[0], self._work(kept[0])) != kept[1]:
            raise WrongGenerationError(
                f"The worker {withdrawn.worker} has answered wrongly, and finished generations of this search "
                f"{'may stand' if kept is None else 'stand'} on its answers; start the run anew, without that worker."
            )

    def _bits(self, argument: Any, result: Any) -> bytes:
        return hashlib.sha256(self._work.bits(argument, result)).digest()
