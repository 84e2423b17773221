"""Ctrl-C before and after a verb. Only the standard library is imported."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from typing import Any

INTERRUPTED = 130  # 128 + SIGINT, what a shell expects


def raise_interrupts() -> None:
    """Let Ctrl-C raise `KeyboardInterrupt` again: a verb has begun, and something may have to be kept."""
    if signal.getsignal(signal.SIGINT) is end_process:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def end_process(number: int, frame: Any) -> None:
    """End the process: an exception could be raised in the middle of an import, which may swallow or repeat it."""
    with suppress(OSError):
        os.write(2, b"\ncommonrail: interrupted.\n")
    os._exit(INTERRUPTED)
