"""A solver that calls for its values, as a conversation: what it asks comes out, the answer is sent in."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from queue import SimpleQueue
from typing import Any, TypeVar

from commonrail.arrays import Floats

__all__ = ["conversation"]

Result = TypeVar("Result")


class _Dropped(BaseException):
    """The conversation was given up; ends the solver."""


def conversation(solve: Callable[[Callable[[Floats], Floats]], Result]) -> Generator[Floats, Floats, Result]:
    """Run ``solve(call)`` so that each ``call(question)`` is yielded, and returns what is sent.

    Solver and caller take turns: the solver runs in a thread of its own, but never while the caller does. Closing the
    generator, or dropping it, ends the thread.

    Parameters
    ----------
    solve : callable
        Takes the function that answers; its result is the generator's, what it raises is raised here.
    """
    said: SimpleQueue[tuple[str, Any]] = SimpleQueue()
    heard: SimpleQueue[Any] = SimpleQueue()

    def call(question: Floats) -> Floats:
        said.put(("question", question))
        answer = heard.get()
        if answer is _Dropped:
            raise _Dropped
        return answer  # type: ignore[no-any-return]

    def work() -> None:
        try:
            said.put(("result", solve(call)))
        except BaseException as error:
            said.put(("error", error))

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        while True:
            event, item = said.get()
            if event == "result":
                return item  # type: ignore[no-any-return]
            if event == "error":
                raise item
            heard.put((yield item))
    finally:
        heard.put(_Dropped)
        thread.join()
