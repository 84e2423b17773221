"""Ctrl-C and the batch system's stop signal as a request to stop after the current generation; a second Ctrl-C ends.

What is kept is safe at any instant, so that nothing is lost but the generation at hand.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

STOP_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class StopRequest:
    """Request to stop: whether the user has asked for it, and whether by Ctrl-C.

    `tell` is called at the first Ctrl-C where a second one ends the process.
    """

    def __init__(self) -> None:
        self.asked = self.pressed = False
        self.tell: Callable[[str], None] | None = None

    def check(self) -> None:
        """Raise KeyboardInterrupt, here and now, if a stop was asked for."""
        if self.asked:
            raise KeyboardInterrupt


_STOP = StopRequest()


def check_stop() -> None:
    """Raise KeyboardInterrupt if a stop was asked for: within long steps that cannot be handed the request."""
    _STOP.check()


def end_at_second(tell: Callable[[str], None]) -> None:
    """Let a second Ctrl-C end this process at once, as commands do; in a library it raises `KeyboardInterrupt`.

    `tell` is called with a sentence at the first one.
    """
    _STOP.tell = tell


@contextmanager
def held_interrupts() -> Iterator[StopRequest]:
    """While inside, SIGINT, SIGTERM and SIGHUP only request a stop: what is being computed or written is finished.

    One that was ignored at the start, as by ``nohup``, stays ignored. A second Ctrl-C raises `KeyboardInterrupt` at
    once, or ends the process if `end_at_second` was called.

    Outside the main thread, where signals cannot be caught, nothing changes. Inside another such block the outer one's
    request goes on.
    """
    held = any(signal.getsignal(number) is _ask for number in STOP_SIGNALS)
    if threading.current_thread() is not threading.main_thread() or held:
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
