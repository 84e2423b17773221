"""Who is told that a simulation is being compiled: it takes some ten seconds, once on a machine."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

__all__ = ["Listener", "compiling", "tell_of_compiling"]

Listener = Callable[[], AbstractContextManager[Any]]

_listener: Listener = nullcontext


def tell_of_compiling(listener: Listener) -> Listener:
    """Have a context entered while a kernel is compiled that is in no cache; returns the listener before."""
    global _listener
    before, _listener = _listener, listener
    return before


def compiling() -> AbstractContextManager[Any]:
    """The context to compile in."""
    return _listener()
