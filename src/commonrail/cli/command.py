"""The command `commonrail`, as a process starts it."""

from __future__ import annotations

import os
import sys
import warnings

from commonrail.cli import direct
from commonrail.cli.console import compiling, say, say_of_ending
from commonrail.notice import tell_notes, tell_of_compiling
from commonrail.workers.interrupt import end_at_second

__all__ = ["main"]


def main() -> None:
    """Run the command."""
    _open_standard_streams()
    leave_out_warnings()
    tell_of_compiling(compiling)
    tell_notes(say)
    end_at_second(say_of_ending)
    if not direct.run(sys.argv[1:]):
        from commonrail.cli.app import app

        app(prog_name="commonrail")


def leave_out_warnings() -> None:
    """Keep NumPy's warnings, of an overflow or a mean of nothing, off the terminal; `python -W` and its like count."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore", RuntimeWarning)


def _open_standard_streams() -> None:
    """Open a sink for a closed stdout or stderr (`>&-`): the next file opened would take its number."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            sink = os.open(os.devnull, os.O_WRONLY)
            if sink != number:
                os.dup2(sink, number)
                os.close(sink)
            setattr(sys, name, os.fdopen(number, "w", encoding="utf-8"))
