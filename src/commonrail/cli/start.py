"""Start of the command: Ctrl-C before a verb runs ends it with a sentence. Only the standard library is imported."""

from __future__ import annotations

import signal

from commonrail.cli.interrupt import end_process

__all__ = ["main"]


def main() -> None:
    """Run the command."""
    # One that a shell has set to be ignored, as for `commonrail ... &`, stays ignored.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, end_process)
    from commonrail.cli.command import main as run

    try:
        run()
    except KeyboardInterrupt:  # between the end of a verb and that of the process
        end_process(signal.SIGINT, None)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done: the end of the process is not interrupted
