"""Checking the tables of a file: the first fault as one sentence with its dotted key."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from commonrail.errors import InputError
from commonrail.reading.place import Place

__all__ = ["read_model"]

_Model = TypeVar("_Model", bound=BaseModel)


def read_model(kind: type[_Model], document: Mapping[str, Any], at: Place) -> _Model:
    """Check the tables of a file.

    Parameters
    ----------
    kind : type
        Model of the file.
    document : mapping
        Its tables.
    at : Place

    Raises
    ------
    InputError
        The first fault; the message has the dotted key.
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
