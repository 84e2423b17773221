"""Hooks that are called when a kernel is compiled, which takes its time once, and for a note; requests to stop."""

from __future__ import annotations

import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from typing import Any

Listener = Callable[[], AbstractContextManager[Any]]


def _warn(text: str) -> None:
    """Raise a warning at the line that called this package."""
    frame, level = sys._getframe(), 1
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in ("commonrail", "contextlib"):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, RuntimeWarning, stacklevel=level)


ONE_KERNEL = "ten seconds on an idle machine, up to a minute on a busy one"
ALL_ENTRIES = "about a minute, more on a busy machine"  # of an export, which has more to compile than one kernel

# Listeners of the process, and what a block changes in its own thread and in the threads that it passes its context to.
_of_process: Listener = nullcontext
_note: Callable[[str], None] = _warn
_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
_quiet: ContextVar[bool] = ContextVar("quiet", default=False)
_duration: ContextVar[str] = ContextVar("duration", default=ONE_KERNEL)
_named: ContextVar[tuple[str, ...]] = ContextVar("named", default=())

_turn = threading.RLock()  # of all below
_under_way = 0  # compilations of all threads
_began = _spent = 0.0  # [s]
_noted: set[str] = set()


def set_compiling_listener(listener: Listener) -> None:
    """Have a context entered in this process while a kernel is compiled that is in no cache."""
    global _of_process
    _of_process = listener


@contextmanager
def within(variable: ContextVar[Any], value: object) -> Iterator[None]:
    """Set a variable of the context inside the block."""
    before = variable.set(value)
    try:
        yield
    finally:
        variable.reset(before)


def listen_to_compiling(listener: Listener) -> AbstractContextManager[None]:
    """Have another context than that of the process entered while a kernel is compiled inside the block."""
    return within(_listener, listener)


@contextmanager
def compiling() -> Iterator[None]:
    """The context to compile in: the listener's, and its time counts as `compiling_seconds`.

    A compilation that another one needs, or that another thread does at the same time, is part of that one.
    """
    global _under_way, _began, _spent
    with _turn:
        _under_way += 1
        if is_first := _under_way == 1:
            _began = time.perf_counter()
    try:
        with (_listener.get() or _of_process)() if is_first else nullcontext():
            yield
    finally:
        with _turn:
            _under_way -= 1
            if not _under_way:
                _spent += time.perf_counter() - _began


def compiling_seconds() -> float:
    """Time that this process has spent compiling, or waiting for another that compiled for it [s]."""
    with _turn:
        return _spent + (time.perf_counter() - _began if _under_way else 0.0)


def naming(words: str) -> AbstractContextManager[None]:
    """State what is simulated inside the block, for whoever says that it is compiled; blocks inside add their words."""
    return within(_named, (*_named.get(), words))


def describe_compiling() -> str:
    """End of a sentence on compiling: of what, where that is stated, and how long it takes."""
    subjects = ", ".join(_named.get())
    return f": {subjects} ({duration()})" if subjects else f" ({duration()})"


@contextmanager
def lasting(words: str) -> Iterator[None]:
    """State inside the block, or in the decorated function, that compilations take longer than one kernel does.

    `words` are such as `ALL_ENTRIES`.
    """
    with within(_duration, words):
        yield


def duration() -> str:
    """Words for the time that a compilation takes."""
    return _duration.get()


def tell_notes(listener: Callable[[str], None]) -> None:
    """Pass the notes of this process to a function instead of raising warnings."""
    global _note
    _note = listener


def quiet() -> AbstractContextManager[None]:
    """Leave out notes inside the block, which have been said before."""
    return within(_quiet, True)


def note(text: str, *, once: bool = False) -> None:
    """Say one sentence that changes no result but should be known; `once`: unless this process has said it before."""
    with _turn:
        if not (_quiet.get() or (once and text in _noted)):
            _note(text)
            _noted.add(text)


def note_of_process(text: str) -> None:
    """Say a sentence on this process, inside a quiet block too: a cached function finds the reason for it once."""
    _note(text)


# Ctrl-C and the batch system's stop signal as a request to stop after the current generation; a second Ctrl-C ends.
#
# What is kept is safe at any instant, so that nothing is lost but the generation at hand.

# SIGBREAK is Windows' Ctrl-Break, which reaches processes that Ctrl-C does not.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
STOP_SIGNALS = tuple(getattr(signal, name) for name in _NAMES if hasattr(signal, name))


class StopRequest:
    """Request to stop: whether the user has asked for it, and whether by Ctrl-C.

    `tell` is called at the first Ctrl-C where a second one ends the process.
    """

    def __init__(self) -> None:
        self.asked = self.pressed = False
        self.holders = 0  # blocks of `hold_interrupts`, which look after the request themselves
        self.tell: Callable[[str], None] | None = None

    def check(self) -> None:
        """Raise KeyboardInterrupt, here and now, if a stop was asked for."""
        if self.asked:
            raise KeyboardInterrupt


_STOP = StopRequest()


def check_stop() -> None:
    """Raise KeyboardInterrupt if a stop was asked for: within long steps that cannot be handed the request."""
    _STOP.check()


def check_unheld_stop() -> None:
    """Raise KeyboardInterrupt if a stop was asked for, unless a block of `hold_interrupts` looks after that."""
    if not _STOP.holders:
        _STOP.check()


def end_at_second(tell: Callable[[str], None]) -> None:
    """Let a second Ctrl-C end this process at once, as commands do; in a library it raises `KeyboardInterrupt`.

    `tell` is called with a sentence at the first one.
    """
    _STOP.tell = tell


@contextmanager
def hold_interrupts() -> Iterator[StopRequest]:
    """As `catch_stops`; what is being computed or written is finished, `check_unheld_stop` raises nothing."""
    with catch_stops() as stop:
        stop.holders += 1
        try:
            yield stop
        finally:
            stop.holders -= 1


@contextmanager
def catch_stops() -> Iterator[StopRequest]:
    """While inside, `STOP_SIGNALS` only request a stop, and raise nothing into whatever is at work.

    An exception could be lost in a library, which would go on with half of what it was about to read.

    One that was ignored at the start, as by ``nohup``, stays ignored. A second Ctrl-C raises `KeyboardInterrupt` at
    once, or ends the process if `end_at_second` was called.

    Outside the main thread, where signals cannot be caught, nothing changes. Inside another such block the outer one's
    request goes on.
    """
    nested = any(signal.getsignal(number) is _ask for number in STOP_SIGNALS)
    if threading.current_thread() is not threading.main_thread() or nested:
        yield _STOP
        return
    _STOP.asked = _STOP.pressed = False
    taken = [number for number in STOP_SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, _ask) for number in taken}
    try:
        yield _STOP
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _STOP.asked = _STOP.pressed = False


def _ask(number: int, frame: Any) -> None:
    _STOP.asked = True
    if number != signal.SIGINT:
        return
    first, _STOP.pressed = not _STOP.pressed, True
    if _STOP.tell is None:
        if not first:
            raise KeyboardInterrupt
    elif first:
        with suppress(OSError, ValueError):  # a terminal that went away
            _STOP.tell("stopping as soon as what was done is kept; Ctrl-C once more ends at once.")
        # The system's own action, which waits for nothing: not for a simulation that is running either.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    else:  # it came before the first was noticed
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.raise_signal(signal.SIGINT)
