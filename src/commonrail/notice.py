"""Hook that is called while a kernel is compiled: some ten seconds, once on a machine."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

__all__ = ["Listener", "compiling", "tell_of_compiling"]

Listener = Callable[[], AbstractContextManager[Any]]

_listener: Listener = nullcontext


def tell_of_compiling(listener: Listener) -> Listener:
    """Set the context that is entered while an uncached kernel is compiled; return the previous one."""
    global _listener
    before, _listener = _listener, listener
    return before


def compiling() -> AbstractContextManager[Any]:
    """Return the context to compile in."""
    return _listener()
