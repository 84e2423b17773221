"""Stages of long work, for whoever shows its progress."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from contextvars import ContextVar

from commonrail.base.hooks import within

# Called with a phase, its steps done, the most that it may take, and figures as text.
Listener = Callable[[str, int, int, str], None]
_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def telling(listener: Listener | None) -> AbstractContextManager[None]:
    """Have a function called at each stage inside the block, or none."""
    return within(_listener, listener)


def tell(phase: str, done: int, most: int, figures: str) -> None:
    """Call the listener, if there is one."""
    if (listener := _listener.get()) is not None:
        listener(phase, done, most, figures)
