"""Stages of long work, for whoever shows its progress."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from contextvars import ContextVar

from commonrail.base.hooks import within

# Called with a phase, its completed steps, its largest number of steps, and figures as text.
Listener = Callable[[str, int, int, str], None]
_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def telling(listener: Listener | None) -> AbstractContextManager[None]:
    """Call a listener at each stage inside the block; None: no listener."""
    return within(_listener, listener)


def tell(phase: str, done: int, most: int, figures: str) -> None:
    """Call the listener, if there is one."""
    if (listener := _listener.get()) is not None:
        listener(phase, done, most, figures)
