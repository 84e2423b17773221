"""Hooks that are called when a kernel is compiled, which takes its time once, and for a note."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import Any

Listener = Callable[[], AbstractContextManager[Any]]


def _warn(text: str) -> None:
    warnings.warn(text, RuntimeWarning, stacklevel=3)


_listener: Listener = nullcontext
_note: Callable[[str], None] = _warn
_duration = "ten seconds on an idle machine, up to a minute on a busy one"
_named: ContextVar[tuple[str, ...]] = ContextVar("named", default=())  # batches are simulated in threads, too
_under_way = 0  # compilations, each of which another one needs
_spent = 0.0  # [s]
ALL_ENTRIES = "about a minute, more on a busy machine"  # of an export, which has more to compile than one kernel


def tell_of_compiling(listener: Listener) -> Listener:
    """Have a context entered while a kernel is compiled that is in no cache; returns the listener before."""
    global _listener
    before, _listener = _listener, listener
    return before


@contextmanager
def compiling() -> Iterator[None]:
    """The context to compile in: the listener's, and its time counts as `compiling_seconds`."""
    global _under_way, _spent
    start = time.perf_counter()
    _under_way += 1
    try:
        with _listener():
            yield
    finally:
        _under_way -= 1
        if not _under_way:
            _spent += time.perf_counter() - start


def compiling_seconds() -> float:
    """Time that this process has spent compiling, or waiting for another that compiled for it [s]."""
    return _spent


@contextmanager
def naming(words: str) -> Iterator[None]:
    """State what is simulated inside the block, for whoever says that it is compiled; blocks inside add their words."""
    before = _named.set((*_named.get(), words))
    try:
        yield
    finally:
        _named.reset(before)


def compiled_words() -> str:
    """End of a sentence on compiling: of what, where that is stated, and how long it takes."""
    named = ", ".join(_named.get())
    return f": {named} ({_duration})" if named else f" ({_duration})"


@contextmanager
def lasting(words: str) -> Iterator[None]:
    """State inside the block, or in the decorated function, that compilations take longer than one kernel does.

    `words` are such as `ALL_ENTRIES`.
    """
    global _duration
    before, _duration = _duration, words
    try:
        yield
    finally:
        _duration = before


def duration() -> str:
    """Words for the time that a compilation takes."""
    return _duration


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
