"""Finished pieces of a search: found again where the worker that found them is dismissed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from commonrail.calibration.finished import Done, Finished
from commonrail.errors import StudyError
from commonrail.workers.task import Answer, Package, Task, Withdrawn

PACKAGE = Package("", (), b"", b"")
WITHDRAWN = Withdrawn("tcp://b")


class Doubles:
    """Work that doubles numbers."""

    def __call__(self, argument: tuple[str, Any], /) -> Any:
        return 2.0 * argument[1]

    same_bits = False

    def probe(self) -> bytes:
        return b""

    def bits(self, argument: tuple[str, Any], result: Any, /) -> bytes:
        return bytes(result.tobytes())


def done(number: int, factor: float = 2.0) -> Done:
    values = np.array([[float(number)]])
    return Done(Task("piece", PACKAGE, ("costs", values), 1.0, number=number), Answer(factor * values, 0.1))


def test_a_right_piece_of_a_dismissed_worker_stands() -> None:
    finished = Finished(Doubles())
    finished.add({1: done(1)})
    finished.confirm(done(1).task, WITHDRAWN)


def test_a_wrong_piece_of_a_dismissed_worker_ends_the_search() -> None:
    finished = Finished(Doubles())
    finished.add({1: done(1), 2: done(2, 2.5)})
    finished.confirm(done(1).task, WITHDRAWN)
    with pytest.raises(
        StudyError, match=r"The worker tcp://b has answered wrongly, and finished .* stand on its answers"
    ):
        finished.confirm(done(2).task, WITHDRAWN)


def test_a_piece_that_was_forgotten_ends_the_search_too() -> None:
    finished = Finished(Doubles(), room=16)  # two numbers
    finished.add({number: done(number) for number in (1, 2, 3)})
    finished.confirm(done(3).task, WITHDRAWN)
    finished.confirm(done(2).task, WITHDRAWN)
    with pytest.raises(StudyError, match="may stand on its answers"):
        finished.confirm(done(1).task, WITHDRAWN)
