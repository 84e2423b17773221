"""TOML from disk: tables of moderate size, depth and texts, whatever was in the file."""

from __future__ import annotations

import math
import re
import reprlib
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from commonrail.base.errors import InputError
from commonrail.readers.limits import Reach, read_text
from commonrail.readers.location import Place
from commonrail.readers.toml_fields import FileModel

# Checking the tables of a file: the first fault as one sentence with its dotted key.

_Model = TypeVar("_Model", bound=BaseModel)


def read_model(kind: type[_Model], document: Mapping[str, Any], at: Place) -> _Model:
    """Check the tables of a file.

    Raises `InputError` for the first fault; the message has the dotted key.
    """
    if "format" in kind.model_fields:
        at.check_format(document, get_args(kind.model_fields["format"].annotation)[0])
    try:
        return kind.model_validate(document)
    except ValidationError as error:
        raise _translated(error.errors(include_url=False)[0], at) from error


def _translated(found: ErrorDetails, at: Place) -> InputError:
    for part in found["loc"]:
        if isinstance(part, int):
            at = at[part]
        elif not part.startswith("<"):  # a tag: which form of a key was tried
            at = at / part
    return at.error(_sentence(found, at.key))


def _sentence(found: ErrorDetails, key: str) -> str:
    kind, message, value = found["type"], found["msg"], found["input"]
    last = key.rpartition(".")[2]
    if kind == "sentence":
        return message
    if kind == "missing":
        return f"this key is missing; add {_MISSING.get(last, 'it')}"
    if kind in ("model_type", "dict_type"):
        return "this must be a table" + ("" if not key or key.endswith("]") else f", written [{key}]")
    if kind == "list_type":
        if last in _LISTS_OF_TABLES:
            return f"this must be a list, and a list of tables is written [[{last}]]"
        return f"this must be a list in brackets{_LISTS.get(last, '')}"
    if kind in ("too_short", "too_long"):
        limit = found["ctx"].get("min_length") or found["ctx"].get("max_length")
        return f"this must be a list of {'at least' if kind == 'too_short' else 'at most'} {limit}"
    message = message.removeprefix("Input should be ").removeprefix("a valid ").removeprefix("must be ")
    shown = f"not {reprlib.repr(value)}" if isinstance(value, (str, int, float)) else "which it is not"
    return f"this must be {_TYPES.get(kind, message)}, {shown}"


_MISSING = {"injector": 'injector = "virtual-lino-2016"', "temperature": 'temperature = "80 degC"'}
_LISTS_OF_TABLES = ("data", "parameter", "dimension", "point", "correlation")
_LISTS = {
    "window": ', such as ["0 us", "1600 us"]',
    "energisings": ', such as [{ start = "0 us", duration = "700 us" }]',
    "rail_pressure": ', such as ["80 MPa", "160 MPa"]',
    "energising_time": ', such as ["400 us", "700 us"]',
    "order": ', such as ["nozzle.lift_transition_slope < nozzle.lift_maximum_slope"]',
    "linear": ', such as ["2 plunger_needle.k1 > plunger_needle.k2"]',
    "factor": ", such as [0.4, 1.0]",
}
_TYPES = {
    "string_type": "a text in quotes",
    "int_type": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "string_too_short": "a text that is not empty",
    "string_too_long": "a text of at most 200 characters",
}


LARGEST_TOML = 1_000_000  # [bytes]; a file of settings has some thousands. Its tables take up to 600 times as much.
LONGEST_LINE = 10_000  # [characters]
LONGEST_TEXT = 10_000
LONGEST_KEY = 200
DEEPEST = 20
LARGEST_INTEGER = 2**63 - 1  # all that TOML promises

# The reader copies a dotted key once for each of its parts, and each level of tables takes a kilobyte.
# Repetitions that give nothing back (++): otherwise a line of spaces is split in every possible way.
_DEEP_KEY = re.compile(rf"""\s*+\[*+\s*+(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')\s*+\.\s*+){{{DEEPEST}}}""")

# What moves a terminal's cursor or turns the direction of writing; tab and line end may stand in a text.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def read_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Tables and text of a TOML file.

    Raises `InputError` if it cannot be read or `parse_toml` refuses it.
    """
    text = read_text(path, LARGEST_TOML)
    return parse_toml(text, str(path)), text


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Tables of a TOML text.

    Raises `InputError` if it is not TOML, or a line, key, text or number in it is beyond its limit; the message has
    line or key.
    """
    _check_lines(text, where)
    try:
        tables = tomllib.loads(text)
    except RecursionError as error:
        raise InputError(f"{where}: tables and lists stand too deep in one another.") from error
    except ValueError as error:  # not TOML, or an integer of more digits than Python reads
        found = re.search(r"\(at line (\d+), column \d+\)", str(error))
        line = found[1] if found else text.rstrip().count("\n") + 1
        raise InputError(f"{where}, line {line}: this is not TOML ({_reason(error)}); {_cure(error)}.") from error
    _check(tables, Place(where))
    return tables


def _reason(error: ValueError) -> str:
    if not isinstance(error, tomllib.TOMLDecodeError):
        return "an integer has too many digits"
    reason = re.sub(r"\s*\(at .*", "", str(error))
    return reason[:1].lower() + reason[1:]


def _cure(error: ValueError) -> str:
    if re.search("overwrite|twice|mutable", str(error)):
        return "a key and a table stand once each, and every table of a list is written [[name]]"
    return 'texts stand in quotes, as in key = "160 MPa"'


def _check_lines(text: str, where: str) -> None:
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > LONGEST_LINE:
            raise InputError(
                f"{where}, line {number}: the line has {len(line)} characters, and at most {LONGEST_LINE} are read; "
                "break it."
            )
        if _DEEP_KEY.match(line):
            raise InputError(f"{where}, line {number}: the key stands more than {DEEPEST} deep in tables.")


def _check(tables: dict[str, Any], at: Place) -> None:
    """Refuse values beyond the limits; a list of what is still to be looked at, because the depth is not known."""
    waiting: list[tuple[Any, Place, int]] = [(tables, at, 0)]
    while waiting:
        value, place, depth = waiting.pop()
        if isinstance(value, dict | list):
            if depth == DEEPEST:
                raise place.error(f"tables and lists stand more than {DEEPEST} deep in one another")
            waiting += [(inner, inside, depth + 1) for inner, inside in _inside(value, place)]
        else:
            _check_value(value, place)


def _inside(value: dict[str, Any] | list[Any], place: Place) -> Iterator[tuple[Any, Place]]:
    if isinstance(value, list):
        yield from ((inner, place[i]) for i, inner in enumerate(value))
        return
    for key, inner in value.items():
        if len(key) > LONGEST_KEY or _CONTROL.search(key) or not key.isprintable():
            raise place.error(f'the key "{_shown(key)}" is too long or has a character that is not printed')
        yield inner, place / key


def _check_value(value: Any, place: Place) -> None:
    if isinstance(value, str):
        if len(value) > LONGEST_TEXT:
            raise place.error(f"the text has {len(value)} characters, and at most {LONGEST_TEXT} are read; shorten it")
        if found := _CONTROL.search(value):
            raise place.error(f"the text holds the control character U+{ord(found[0]):04X}; remove it")
    elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        raise place.error("the integer is larger than 64 bits hold")
    elif isinstance(value, float) and not math.isfinite(value):
        raise place.error("the number is not finite")


def _shown(key: str) -> str:
    return "".join(sign if sign.isprintable() else "?" for sign in key[:40])


# TOML file that names other files: read, checked, and with the folder that those may lie in.

_FileContent = TypeVar("_FileContent", bound=FileModel)


class ModelFile(NamedTuple, Generic[_FileContent]):
    """Content of a file."""

    model: _FileContent
    at: Place  # the file, for messages
    reach: Reach  # where the files that it names may lie
    text: str  # the file as given


def read_model_file(kind: type[_FileContent], file: Path) -> ModelFile[_FileContent]:
    """Read and check a file.

    `kind`: model of the file, with the key `allow_outside`. Raises `InputError` if it cannot be read, or something in
    it is unknown, missing or of the wrong kind.
    """
    document, text = read_toml(file)
    at = Place(str(file))
    model: Any = read_model(kind, document, at)
    return ModelFile(model, at, Reach(file, model.allow_outside), text)
