"""Typer's declarations for the verbs without importing typer: a plain command line is read without it.

A verb's module has ``from commonrail.cli import typer_later as typer`` and is written as for typer. `direct` reads its
declarations itself; `with_typer` hands them to typer, for help, errors and whatever `direct` leaves to it.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple, get_args, get_origin

__all__ = ["Argument", "Declared", "Exit", "Option", "declared", "echo", "with_typer"]

_STYLE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Declared(NamedTuple):
    """Declaration of a parameter: typer's class of it, and what that takes."""

    kind: str
    names: tuple[str, ...]
    settings: Mapping[str, Any]


def Option(*names: str, **settings: Any) -> Any:
    """Declare an option as `typer.Option` does."""
    return Declared("Option", names, settings)


def Argument(**settings: Any) -> Any:
    """Declare an argument as `typer.Argument` does."""
    return Declared("Argument", (), settings)


class Exit(SystemExit):
    """End of the command with an exit status."""


def echo(message: str = "", *, err: bool = False, nl: bool = True) -> None:
    """Print a line as `typer.echo` does: without styles where the stream is no terminal.

    Parameters
    ----------
    message : str
    err : bool
        On stderr.
    nl : bool
        With a line end.
    """
    stream = sys.stderr if err else sys.stdout
    text = message if stream.isatty() else _STYLE.sub("", message)
    try:
        stream.write(text + "\n" if nl else text)
        stream.flush()
    except UnicodeEncodeError:  # an encoding that typer knows to mend
        import typer

        typer.echo(text, err=err, nl=nl)


def declared(verb: Callable[..., Any]) -> Mapping[str, tuple[inspect.Parameter, Declared | None]]:
    """Parameters of a verb with their types evaluated, and their declarations as far as they are of this module."""
    found = {}
    for name, parameter in inspect.signature(verb, eval_str=True).parameters.items():
        kind, *notes = get_args(parameter.annotation) if _is_annotated(parameter) else (parameter.annotation,)
        note = next((note for note in notes if isinstance(note, Declared)), None)
        found[name] = (parameter if note is None else parameter.replace(annotation=kind), note)
    return found


def _is_annotated(parameter: inspect.Parameter) -> bool:
    return get_origin(parameter.annotation) is Annotated


def with_typer(verb: Callable[..., Any]) -> Callable[..., Any]:
    """Give a verb the declarations of typer in place of those of this module."""
    import typer

    parameters = []
    for parameter, note in declared(verb).values():
        if note is not None:
            made = getattr(typer, note.kind)(*note.names, **note.settings)
            parameter = parameter.replace(annotation=Annotated[parameter.annotation, made])
        parameters.append(parameter)
    verb.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    verb.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return verb
