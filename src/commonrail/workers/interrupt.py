"""Ctrl-C and the batch system's stop signal as a wish that is looked at between generations."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

STOP_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class Wish:
    """Return whether the user has asked to stop."""

    def __init__(self) -> None:
        self.asked = False

    def heed(self) -> None:
        """Raise KeyboardInterrupt, here and now, if a stop was asked for."""
        if self.asked:
            raise KeyboardInterrupt


_WISH = Wish()


@contextmanager
def held_interrupts() -> Iterator[Wish]:
    """While inside, SIGINT, SIGTERM and SIGHUP only leave a wish: what is being computed or written is finished.

    One that was ignored at the start, as by ``nohup``, stays ignored.

    Outside the main thread, where signals cannot be caught, nothing changes. Inside another such block the outer one's
    wish goes on.
    """
    held = any(signal.getsignal(number) is _ask for number in STOP_SIGNALS)
    if threading.current_thread() is not threading.main_thread() or held:
        yield _WISH
        return
    _WISH.asked = False
    heeded = [number for number in STOP_SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, _ask) for number in heeded}
    try:
        yield _WISH
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _WISH.asked = False


def _ask(number: int, frame: Any) -> None:
    _WISH.asked = True
