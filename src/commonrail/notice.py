"""Listeners to what happens far below: a simulation that is compiled, some ten seconds once on a machine, and notes."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

__all__ = ["Listener", "compiling", "note", "quiet", "tell_notes", "tell_of_compiling"]

Listener = Callable[[], AbstractContextManager[Any]]


def _warn(text: str) -> None:
    warnings.warn(text, RuntimeWarning, stacklevel=3)


_listener: Listener = nullcontext
_note: Callable[[str], None] = _warn


def tell_of_compiling(listener: Listener) -> Listener:
    """Have a context entered while a kernel is compiled that is in no cache; returns the listener before."""
    global _listener
    before, _listener = _listener, listener
    return before


def compiling() -> AbstractContextManager[Any]:
    """The context to compile in."""
    return _listener()


def tell_notes(listener: Callable[[str], None]) -> None:
    """Have notes given to a function instead of raised as warnings."""
    global _note
    _note = listener


@contextmanager
def quiet() -> Iterator[None]:
    """Leave notes untold inside the block: they have been told before."""
    before = _note
    tell_notes(lambda _: None)
    try:
        yield
    finally:
        tell_notes(before)


def note(text: str) -> None:
    """Say one sentence that changes no result but should be known."""
    _note(text)
