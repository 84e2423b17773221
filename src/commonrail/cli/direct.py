"""Plain command lines, read from the declarations of a verb: what typer needs Pydantic for, and a tenth of the time.

Whatever is not plain (help, a mistake, an unusual spelling) is left to typer, which alone has sentences for it.
"""

from __future__ import annotations

import errno
import math
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from enum import Enum
from inspect import Parameter
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, NamedTuple, get_args, get_origin

from commonrail.cli.guard import guarded
from commonrail.cli.names import VERBS, function_of
from commonrail.cli.typer_later import Declared, declared

__all__ = ["arguments_of", "run"]

_KNOWN = {"help", "metavar", "min", "max"}  # settings of a declaration
_NUMBER = r"[0-9]+(\.[0-9]+)?([eE]-?[0-9]+)?"


class _NotPlainError(Exception):
    """The command line, or a declaration, is one for typer."""


class _Field(NamedTuple):
    """Parameter of a verb: name in Python, type of one value, whether there may be several, smallest and largest."""

    name: str
    kind: Any
    repeated: bool
    required: bool
    low: float
    high: float

    def value(self, word: str) -> Any:
        """Value of a word."""
        if self.kind is str:
            return word
        if self.kind is Path:
            return Path(word)
        if issubclass(self.kind, Enum):
            return {member.value: member for member in self.kind}[word]
        if not re.fullmatch("[0-9]+" if self.kind is int else _NUMBER, word):
            raise _NotPlainError
        number = self.kind(word)
        if not self.low <= number <= self.high:
            raise _NotPlainError
        return number


def run(words: Sequence[str]) -> bool:
    """Run the verb of a plain command line; False where typer has to read it.

    Raises
    ------
    SystemExit
        At the verb's end.
    """
    if not words or words[0] not in VERBS or os.name != "posix":
        return False
    verb = function_of(words[0])
    if "typer" in sys.modules:  # the verb is declared with it, and may raise what it alone can show
        return False
    options = arguments_of(verb, words[1:])
    if options is None:
        return False
    try:
        guarded(verb)(**options)
    except OSError as error:
        if error.errno != errno.EPIPE:
            raise
        _leave_the_pipe()
        sys.exit(1)
    sys.exit(0)


def arguments_of(verb: Callable[..., Any], words: Sequence[str]) -> dict[str, Any] | None:
    """Arguments of a verb from the words behind its name; None where they are not plain.

    Parameters
    ----------
    verb : function
    words : sequence of str
    """
    try:
        return _read(declared(verb), words)
    except (_NotPlainError, KeyError, ValueError):
        return None


def _read(known: Mapping[str, tuple[Parameter, Declared | None]], words: Sequence[str]) -> dict[str, Any]:
    options, places = _fields(known)
    found: dict[str, Any] = {name: parameter.default for name, (parameter, _) in known.items()}
    given: dict[str, Any] = {}
    waiting = list(words)
    while waiting:
        word = waiting.pop(0)
        if not word.startswith("-"):
            field = places[0] if places else None
            if field is not None and not field.repeated:
                places = places[1:]
        else:
            option, equals, rest = word.partition("=")
            field = options[option]
            if field.kind is bool:
                if equals:
                    raise _NotPlainError
                given[field.name] = True
                continue
            word = rest if equals else waiting.pop(0) if waiting else ""
        if field is None or not word or word.startswith("-") or (field.name in given and not field.repeated):
            raise _NotPlainError
        value = field.value(word)
        given[field.name] = [*given.get(field.name, []), value] if field.repeated else value
    if any(field.required and field.name not in given for field in (*options.values(), *places)):
        raise _NotPlainError
    return found | given


def _fields(known: Mapping[str, tuple[Parameter, Declared | None]]) -> tuple[dict[str, _Field], list[_Field]]:
    """Options by name, and positional arguments in their order."""
    options, places = {}, []
    for name, (parameter, note) in known.items():
        if note is None or not set(note.settings) <= _KNOWN:
            raise _NotPlainError
        kind, repeated = _kind(parameter.annotation)
        low, high = note.settings.get("min", -math.inf), note.settings.get("max", math.inf)
        field = _Field(name, kind, repeated, parameter.default is Parameter.empty, low, high)
        if note.kind == "Argument":
            places.append(field)
            continue
        for option in note.names or ("--" + name.replace("_", "-"),):
            if not re.fullmatch(r"--[a-z][a-z-]*", option) or (kind is bool and parameter.default is not False):
                raise _NotPlainError
            options[option] = field
    if any(place.repeated for place in places[:-1]):
        raise _NotPlainError
    return options, places


def _kind(annotation: Any) -> tuple[Any, bool]:
    """Type of one value, and whether there may be several."""
    if get_origin(annotation) is UnionType:
        kinds = [kind for kind in get_args(annotation) if kind is not NoneType]
        if len(kinds) != 1:
            raise _NotPlainError
        annotation = kinds[0]
    repeated = get_origin(annotation) is list
    kind = get_args(annotation)[0] if repeated else annotation
    if kind not in (str, int, float, bool, Path) and not (isinstance(kind, type) and issubclass(kind, Enum)):
        raise _NotPlainError
    return kind, repeated


def _leave_the_pipe() -> None:
    """Write what is still buffered nowhere: the reader of the pipe has closed it."""
    with suppress(OSError):
        sink = os.open(os.devnull, os.O_WRONLY)
        for number in (1, 2):
            with suppress(OSError):
                os.dup2(sink, number)
