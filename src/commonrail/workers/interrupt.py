"""Ctrl-C and the batch system's stop signal as a wish that is looked at between generations; a second Ctrl-C ends.

What is kept is safe at any instant, so that nothing is lost but the generation at hand.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

Told = Callable[[str], None]

STOP_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class Wish:
    """Request to stop: whether the user has asked for it, and whether by Ctrl-C.

    `tell` is called at the first Ctrl-C where a second one ends the process.
    """

    def __init__(self) -> None:
        self.asked = self.pressed = False
        self.tell: Told | None = None

    def heed(self) -> None:
        """Raise KeyboardInterrupt, here and now, if a stop was asked for."""
        if self.asked:
            raise KeyboardInterrupt


_WISH = Wish()


def end_at_second(tell: Told) -> None:
    """Let a second Ctrl-C end this process at once, as commands do; in a library it raises `KeyboardInterrupt`.

    `tell` is called with a sentence at the first one.
    """
    _WISH.tell = tell


@contextmanager
def held_interrupts() -> Iterator[Wish]:
    """While inside, SIGINT, SIGTERM and SIGHUP only leave a wish: what is being computed or written is finished.

    One that was ignored at the start, as by ``nohup``, stays ignored. A second Ctrl-C raises `KeyboardInterrupt` at
    once, or ends the process if `end_at_second` was called.

    Outside the main thread, where signals cannot be caught, nothing changes. Inside another such block the outer one's
    wish goes on.
    """
    held = any(signal.getsignal(number) is _ask for number in STOP_SIGNALS)
    if threading.current_thread() is not threading.main_thread() or held:
        yield _WISH
        return
    _WISH.asked = _WISH.pressed = False
    heeded = [number for number in STOP_SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, _ask) for number in heeded}
    try:
        yield _WISH
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _WISH.asked = _WISH.pressed = False


def _ask(number: int, frame: Any) -> None:
    _WISH.asked = True
    if number != signal.SIGINT:
        return
    first, _WISH.pressed = not _WISH.pressed, True
    if _WISH.tell is None:
        if not first:
            raise KeyboardInterrupt
    elif first:
        with suppress(OSError, ValueError):  # a terminal that went away
            _WISH.tell("stopping as soon as what was done is kept; Ctrl-C once more ends at once.")
        # The system's own action, which waits for nothing: not for a simulation that is running either.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    else:  # it came before the first was heeded
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.raise_signal(signal.SIGINT)
