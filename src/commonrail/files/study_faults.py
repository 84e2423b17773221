"""Checking the tables of a study file: the first fault as one sentence with its dotted key."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from commonrail.errors import InputError
from commonrail.files.place import Place
from commonrail.files.study_models import StudyModel

__all__ = ["read_model"]


def read_model(data: Mapping[str, Any], at: Place) -> StudyModel:
    """Check the tables of a study file.

    Raises
    ------
    InputError
        The first fault; the message has the dotted key.
    """
    try:
        return StudyModel.model_validate(data)
    except ValidationError as error:
        raise _translated(error.errors(include_url=False)[0], at) from error


def _translated(fault: ErrorDetails, at: Place) -> InputError:
    for part in fault["loc"]:
        if isinstance(part, int):
            at = at[part]
        elif not part.startswith("<"):  # a tag: which form of a key was tried
            at = at / part
    return at.error(_sentence(fault))


def _sentence(fault: ErrorDetails) -> str:
    kind, message, found = fault["type"], fault["msg"], fault["input"]
    if kind in ("unknown_key", "kind"):
        return message
    if kind == "missing":
        return "this key is missing; add it"
    if kind == "model_type":
        return "this must be a table"
    if kind == "list_type":
        name = fault["loc"][-1]
        if name in _LISTS_OF_TABLES:
            return f"this must be a list, and a list of tables is written [[{name}]]"
        return f"this must be a list in brackets{_EXAMPLES.get(str(name), '')}"
    if kind in ("too_short", "too_long"):
        limit = fault["ctx"].get("min_length") or fault["ctx"].get("max_length")
        return f"this must be a list of {'at least' if kind == 'too_short' else 'at most'} {limit}"
    message = message.removeprefix("Input should be ").removeprefix("a valid ").removeprefix("must be ")
    shown = f"not {reprlib.repr(found)}" if isinstance(found, (str, int, float)) else "which it is not"
    return f"this must be {_plain(kind, message)}, {shown}"


_LISTS_OF_TABLES = ("data", "parameter")
_EXAMPLES = {
    "window": ', such as ["0 us", "1600 us"]',
    "energisings": ', such as [{ start = "0 us", duration = "700 us" }]',
    "rail_pressure": ', such as ["80 MPa", "160 MPa"]',
    "energising_time": ', such as ["400 us", "700 us"]',
    "order": ', such as ["nozzle.lift_transition_slope < nozzle.lift_maximum_slope"]',
    "linear": ', such as ["2 plunger_needle.k1 > plunger_needle.k2"]',
    "factor": ", such as [0.4, 1.0]",
}


def _plain(kind: str, message: str) -> str:
    known = {
        "string_type": "a text in quotes",
        "int_type": "a whole number",
        "float_type": "a number",
        "string_too_short": "a text that is not empty",
        "string_too_long": "a text of at most 200 characters",
    }
    return known.get(kind, message)
