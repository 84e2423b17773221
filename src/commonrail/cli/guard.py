"""Ends of the command but the good one: one sentence on stderr and an exit status, no traceback.

It is imported before Ctrl-C is caught, and so imports little; `click` and the console come late.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn

from commonrail.base.errors import CommonrailError, InputError, OutputError, nearest
from commonrail.base.output import line_text

INTERRUPTED = 130  # 128 + SIGINT, what a shell expects
UNEXPECTED = 1
UNUSABLE = 2
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)

_DASH = Path("-")
_OUTPUTS = ("out", "quantity_out", "report")  # options with files that are written
OTHERS = "close other programs or take a machine with more"


def end_process(number: int, frame: Any) -> None:
    """End the process at Ctrl-C: an exception could be raised in the middle of an import, which may swallow it."""
    with suppress(OSError):
        os.write(2, b"\ncommonrail: interrupted.\n")
    os._exit(INTERRUPTED)


@contextmanager
def end_on_errors() -> Iterator[None]:
    """Turn what a verb raises into a sentence and an exit status.

    A `CommonrailError` has its own status, an operating system's error 2, Ctrl-C 130. Whatever else is raised is a
    fault of the program (1), or of the plug-in whose verb it is (2); its traceback is shown on demand.
    """
    try:
        yield
    except CommonrailError as error:
        _end(str(error), error.exit_code, getattr(error, "__notes__", ()))
    except KeyboardInterrupt:
        _end("interrupted.", INTERRUPTED)
    except BrokenPipeError:
        raise  # the reader of stdout has closed it; click ends quietly
    except OSError as error:
        if error.errno in NO_ROOM:
            place = error.filename or "standard output"
            _end(f"{place} cannot be written ({error.strerror}); make room there.", OutputError.exit_code)
        place = f"{error.filename}: " if error.filename else ""
        _end(f"{place}{error.strerror or error}.", UNUSABLE)
    except ModuleNotFoundError as error:
        _end(*_lacking(error))
    except MemoryError:
        from commonrail.base.registry import words_on_shipped

        _end(f"not enough memory; {words_on_shipped('MEMORY').get(_state()[0], OTHERS)}.", UNUSABLE)
    except Exception as error:
        if type(error).__module__.partition(".")[0] == "click":  # an end, or a mistake on the command line
            _end_of_click(error)
            raise
        _end(*_fault(error))


def _end_of_click(error: Exception) -> None:
    """End with a sentence at an option, a value or a verb that click refuses; return at all else of click."""
    import click

    if isinstance(error, click.UsageError) and type(error).__name__ != "NoArgsIsHelpError":
        name = "commonrail" if error.ctx is None else error.ctx.command_path
        name = f"{name} {_state()[0]}".rstrip() if name == "commonrail" else name  # of an option without its value
        text = error.format_message().rstrip(".")
        if isinstance(error, click.BadParameter) and isinstance(
            kind := getattr(error.param, "type", None), click.Choice
        ):
            text += nearest(error.message.split("'")[1], map(str, kind.choices))  # "'VALUE' is not one of …"
        _end(f"{text}. `{name} --help` shows what there is.", error.exit_code)


def _lacking(error: ModuleNotFoundError) -> tuple[str, int]:
    """Sentence and exit status for a package that cannot be imported: some are loaded only where they are used."""
    from commonrail.engine.machine_code import COMPILERS, INSTALL  # late: most commands end otherwise

    package = (error.name or "").partition(".")[0]
    if package in COMPILERS:
        compiled = (
            f"machine code that no library of this installation holds, and the package {package}, which compiles it"
        )
        return f"this needs {compiled}, is not installed: {INSTALL}.", UNUSABLE
    if package == "scipy":
        return "the package scipy, which this needs, is not installed: pip install scipy.", UNUSABLE
    return _fault(error)


def check_paths(options: Mapping[str, Any]) -> None:
    """Refuse "-" as a file, names that a terminal obeys, and an output that would take the place of an input.

    `options` are those of a verb by name. Raises `InputError` if there is one.
    """
    _refuse_names(options)
    _refuse_inputs_as_outputs(options)


def _refuse_names(options: Mapping[str, Any]) -> None:
    """Refuse names that a terminal obeys, and "-", which elsewhere means standard input or output."""
    for name, value in options.items():
        if any(isinstance(path, Path) and line_text(str(path)) != str(path) for path in _several(value)):
            raise InputError(f"{value}: the name has control characters, which a terminal obeys; rename it.")
        if any(path == _DASH for path in _several(value)):
            raise InputError(
                f'{name.replace("_", "-")} "-": files are not read from standard input nor written to standard output; '
                "name a file or folder (--json prints the result)."
            )


def _refuse_inputs_as_outputs(options: Mapping[str, Any]) -> None:
    """Refuse an output that would take the place of a file that the command reads."""
    outputs = [(name, path) for name in _OUTPUTS for path in _several(options.get(name)) if isinstance(path, Path)]
    inputs = [v for name, value in options.items() if name not in _OUTPUTS for v in _several(value)]
    for name, path in outputs:
        for value in inputs:
            if isinstance(value, (str, Path)) and _are_one(path, value):
                option = name.replace("_", "-")
                raise InputError(
                    f"--{option}: {path} is read by this command and would be replaced; name another file."
                )


def _several(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _are_one(path: Path, name: str | Path) -> bool:
    try:
        return path.is_file() and os.path.samefile(path, name)
    except (OSError, ValueError):  # no file of that name, or no name of a file
        return False


def _end(sentence: str, status: int, notes: Sequence[str] = ()) -> NoReturn:
    from commonrail.cli.console import say

    if _state()[1] or os.environ.get("COMMONRAIL_TRACEBACK"):
        import traceback

        say(traceback.format_exc().rstrip())
    say("\n".join([f"commonrail: {' '.join(sentence.split())}", *notes]))
    raise SystemExit(status) from None


def _state() -> tuple[str, bool]:
    """Name of the verb that is run, and whether the command has the option --traceback."""
    import click

    ctx = click.get_current_context(silent=True)
    if ctx is None:
        return "", False
    name = f"{getattr(ctx.command, 'prefix', '')}{ctx.invoked_subcommand or ''}"
    return name, ctx.find_root().params.get("traceback", False)


def _fault(error: Exception) -> tuple[str, int]:
    """Sentence and exit status for an unexpected exception: a fault of the plug-in of the verb, or of the program."""
    from commonrail.base import registry

    what, shows = f"{type(error).__name__}: {_short(error)}", "`commonrail --traceback ...` shows where it happened."
    entry = registry.find("verbs", name) if (name := _state()[0]) else None
    if entry is not None and entry.distribution != registry.PACKAGE:
        plugin = f"{entry.distribution} {entry.version}"
        return f"the verb {name} of the plug-in {plugin} failed ({what}); tell its authors. {shows}", UNUSABLE
    return f"internal fault ({what}); please report it with the command line. {shows}", UNEXPECTED


def _short(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if len(text) <= 200 else text[:197] + "..."
