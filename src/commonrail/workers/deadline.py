"""Deadlines for calls that have none of their own."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import TypeVar

__all__ = ["Late", "within"]

T = TypeVar("T")


class Late(Exception):
    """A call that has not returned by its deadline."""


def within(seconds: float, call: Callable[[], T]) -> T:
    """Return the result of a call, made on a thread of its own.

    A call that is late is left to itself: its thread ends with the process at the latest, and its result is dropped.

    Parameters
    ----------
    seconds : float
        Deadline [s].
    call : function

    Raises
    ------
    Late
        If the call has not returned by then; else any error of the call.
    """
    ended: queue.SimpleQueue[tuple[T | None, BaseException | None]] = queue.SimpleQueue()

    def body() -> None:
        try:
            ended.put((call(), None))
        except BaseException as error:
            ended.put((None, error))

    threading.Thread(target=body, daemon=True, name="commonrail call").start()
    try:
        result, error = ended.get(timeout=seconds)
    except queue.Empty:
        raise Late from None
    if error is not None:
        raise error
    return result  # type: ignore[return-value]
