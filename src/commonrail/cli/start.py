"""Start of the command: Ctrl-C before a verb runs ends it with a sentence. Only the standard library is imported."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from typing import Any

__all__ = ["INTERRUPTED", "main", "raise_interrupts"]

INTERRUPTED = 130  # 128 + SIGINT, what a shell expects


def main() -> None:
    """Run the command."""
    # One that a shell has set to be ignored, as for `commonrail ... &`, stays ignored.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    from commonrail.cli.command import main as run

    try:
        run()
    except KeyboardInterrupt:  # between the end of a verb and that of the process
        _end(signal.SIGINT, None)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done: the end of the process is not interrupted


def raise_interrupts() -> None:
    """Let Ctrl-C raise `KeyboardInterrupt` again: a verb has begun, and something may have to be kept."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(number: int, frame: Any) -> None:
    """End the process: an exception could be raised in the middle of an import, which may swallow or repeat it."""
    with suppress(OSError):
        os.write(2, b"\ncommonrail: interrupted.\n")
    os._exit(INTERRUPTED)
