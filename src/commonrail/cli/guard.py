"""Exceptions of the verbs: one sentence on stderr and an exit status, no traceback."""

from __future__ import annotations

import errno
import functools
import os
import traceback
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

from commonrail.cli import typer_later as typer
from commonrail.cli.console import say
from commonrail.cli.interrupt import INTERRUPTED, raise_interrupts
from commonrail.errors import CommonrailError, InputError, OutputError

__all__ = ["INTERRUPTED", "guarded", "show_traceback"]

UNEXPECTED = 1
UNUSABLE = 2
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)

# Cure of too little memory by verb, and of the others.
MEMORY = {
    "simulate": "shorten --horizon or lengthen --time-step",
    "calibrate": "lower --workers or --threads, or the members of the study's [optimiser]",
    "resume": "lower --workers or --threads",
    "compare": "lower --threads, or name fewer models or studies",
    "reproduce": "lower --threads or --seeds",
    "sensitivity": "lower --threads or --samples, or name fewer parameters or features",
    "tolerance": "lower --threads or --parts",
    "fleet": "lower --workers, or divide the fleet's table",
}
_DASH = Path("-")
_OUTPUTS = ("out", "quantity_out", "report", "plot", "gallery")  # options with files that are written
OTHERS = "close other programs or take a machine with more"

show_traceback: ContextVar[bool] = ContextVar("show_traceback", default=False)

_Verb = TypeVar("_Verb", bound=Callable[..., Any])


def guarded(verb: _Verb) -> _Verb:
    """Turn what a verb raises into a sentence and an exit status.

    A `CommonrailError` has its own status, an operating system's error 2, Ctrl-C 130; whatever else
    is raised is a fault of the program (1), whose traceback is shown on demand.
    """

    @functools.wraps(verb)
    def run(*args: Any, **options: Any) -> Any:
        try:
            raise_interrupts()
            _refuse_dash(options)
            _refuse_inputs_as_outputs(options)
            return verb(*args, **options)
        except CommonrailError as error:
            _end(str(error), error.exit_code)
        except KeyboardInterrupt:
            _end("interrupted.", INTERRUPTED)
        except BrokenPipeError:
            raise  # the reader of stdout has closed it; typer ends quietly
        except OSError as error:
            if error.errno in NO_ROOM:
                place = error.filename or "standard output"
                _end(f"{place} cannot be written ({error.strerror}); make room there.", OutputError.exit_code)
            place = f"{error.filename}: " if error.filename else ""
            _end(f"{place}{error.strerror or error}.", UNUSABLE)
        except ModuleNotFoundError as error:
            _end(*_lacking(error))
        except MemoryError:
            _end(f"not enough memory; {MEMORY.get(verb.__name__, OTHERS)}.", UNUSABLE)
        except Exception as error:
            if type(error).__module__.partition(".")[0] == "typer":  # an end, or a mistake for typer to show
                raise
            _end(_fault(error), UNEXPECTED)

    return run  # type: ignore[return-value]


def _lacking(error: ModuleNotFoundError) -> tuple[str, int]:
    """Sentence and exit status for a package that cannot be imported: some are loaded only where they are used."""
    from commonrail.engine.library import COMPILERS, INSTALL  # late: most commands end otherwise

    package = (error.name or "").partition(".")[0]
    if package in COMPILERS:
        compiled = (
            f"machine code that no library of this installation holds, and the package {package}, which compiles it"
        )
        return f"this needs {compiled}, is not installed: {INSTALL}.", UNUSABLE
    if package == "scipy":
        return "the package scipy, which this needs, is not installed: pip install scipy.", UNUSABLE
    return _fault(error), UNEXPECTED


def _refuse_dash(options: Mapping[str, Any]) -> None:
    """Refuse "-" as the name of a file or folder: elsewhere it means standard input or output, here it would be a file.

    Raises
    ------
    InputError
        If an option or argument is it.
    """
    for name, given in options.items():
        if any(path == _DASH for path in _several(given)):
            raise InputError(
                f'{name.replace("_", "-")} "-": files are not read from standard input nor written to standard output; '
                "name a file or folder (--json prints the result)."
            )


def _refuse_inputs_as_outputs(options: Mapping[str, Any]) -> None:
    """Refuse an output that would take the place of a file that the command reads.

    Raises
    ------
    InputError
        If there is one.
    """
    outputs = [(name, path) for name in _OUTPUTS for path in _several(options.get(name)) if isinstance(path, Path)]
    inputs = [v for name, given in options.items() if name not in _OUTPUTS for v in _several(given)]
    for name, path in outputs:
        for given in inputs:
            if isinstance(given, (str, Path)) and _are_one(path, given):
                option = name.replace("_", "-")
                raise InputError(
                    f"--{option}: {path} is read by this command and would be replaced; name another file."
                )


def _several(given: Any) -> list[Any]:
    return given if isinstance(given, list) else [given]


def _are_one(path: Path, given: str | Path) -> bool:
    try:
        return path.is_file() and os.path.samefile(path, given)
    except (OSError, ValueError):  # no file of that name, or no name of a file
        return False


def _end(sentence: str, status: int) -> None:
    if show_traceback.get() or os.environ.get("COMMONRAIL_TRACEBACK"):
        say(traceback.format_exc().rstrip())
    say(f"commonrail: {' '.join(sentence.split())}")
    raise typer.Exit(status) from None


def _fault(error: Exception) -> str:
    return (
        f"internal fault ({type(error).__name__}: {_short(error)}); please report it with "
        "the command line. `commonrail --traceback ...` shows where it happened."
    )


def _short(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if len(text) <= 200 else text[:197] + "..."
