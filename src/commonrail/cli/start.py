"""Start of the command `commonrail`."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
import warnings

from commonrail.cli.guard import end_process


def main() -> None:
    """Run the command."""
    # SIGINT stays ignored if a shell has set it so, as for `commonrail ... &`.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, end_process)
    open_standard_streams()
    show_what_can_be_shown()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")  # Pydantic would search all installed packages for plug-ins
    leave_out_warnings()
    # A start, imports and all, makes 150,000 objects that stay: searches for garbage among them take 90 ms.
    gc.set_threshold(300_000)
    from commonrail.base.hooks import end_at_second, set_compiling_listener, tell_notes
    from commonrail.cli.console import compiling, say_of_ending, say_once
    from commonrail.cli.grammar import cli

    set_compiling_listener(compiling)
    tell_notes(say_once)
    end_at_second(say_of_ending)
    try:
        cli(prog_name="commonrail")
    except SystemExit as end:
        if end.code:
            drop_unwritten()
        raise
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done: the end of the process is not interrupted
        gc.freeze()  # no garbage collection at exit, which takes 0.2 s after `calibrate`


def drop_unwritten() -> None:
    """Discard output that stdout could not take; otherwise Python's flush at exit sets the status to 120."""
    try:
        sys.stdout.flush()
    except (OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def leave_out_warnings() -> None:
    """Suppress NumPy's warnings, such as of an overflow, unless `python -W` or a similar option is set."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore", RuntimeWarning)


def show_what_can_be_shown() -> None:
    """Let stdout write "?" for what its encoding lacks, as Windows' cp1252 in a pipe lacks ξ and −."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def open_standard_streams() -> None:
    """Open a sink for a closed stdout or stderr (`>&-`): the next file opened would take its number."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            sink = os.open(os.devnull, os.O_WRONLY)
            if sink != number:
                os.dup2(sink, number)
                os.close(sink)
            setattr(sys, name, os.fdopen(number, "w", encoding="utf-8"))
