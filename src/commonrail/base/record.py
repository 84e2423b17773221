"""Records of results: conversion of typed objects to JSON and back.

A result is a dataclass or a named tuple of numbers, texts, enums, arrays and such objects. `to_record` converts a
result for its JSON file, `from_record` converts it back. Pages and tables use attributes, whose names a type checker
verifies.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import types
import typing
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar, get_args, get_origin, overload

import numpy as np

from commonrail.base.declare import Setting

_Result = TypeVar("_Result")


class Key(NamedTuple):
    """Annotation of a field whose key in the record differs from its name: ``Annotated[float, Key("clock.seconds")]``.

    `path`: key, or nested keys joined by points; empty to merge the keys of an object into the record.
    """

    path: str


class Interval(NamedTuple):
    """Estimate with the lower and the upper end of its interval."""

    value: float
    low: float
    high: float


class _Field(NamedTuple):
    """Field of a result: its name, the keys that lead to it, its type and its default, which is `MISSING` if absent."""

    name: str
    keys: tuple[str, ...]
    kind: Any
    default: Any


@overload
def to_record(value: Mapping[str, object]) -> dict[str, Any]: ...
@overload
def to_record(value: object) -> Any: ...
def to_record(value: object) -> Any:
    """JSON-able form of a result, SI.

    Enums become their values, arrays and tuples lists, numbers that are not finite None. An optional field that has
    its default None is left out.
    """
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.ndarray | np.generic):
        return to_record(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): to_record(item) for key, item in value.items()}
    if dataclasses.is_dataclass(value) or hasattr(value, "_fields"):
        record: dict[str, Any] = {}
        kind: Any = type(value)
        for field in _fields(kind):
            item = getattr(value, field.name)
            if item is not None or field.default is not None:
                _put(record, field.keys, to_record(item))
        return record
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [to_record(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def from_record(kind: type[_Result], record: Any) -> _Result:
    """Result of a kind from its record; None for a number becomes not-a-number.

    Raises KeyError for a key that is missing, TypeError or ValueError for a value of another type, which
    `ResultKind.refusing_broken` turns into a sentence.
    """
    result: _Result = _read(kind, record)
    return result


def _read(kind: Any, value: Any) -> Any:
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return None if value is None else _read(next(option for option in inner if option is not types.NoneType), value)
    if kind is Any:
        return value
    if kind is float:
        return math.nan if value is None else float(value)
    if origin is tuple and inner[-1] is Ellipsis:
        return tuple(_read(inner[0], item) for item in value)
    if origin is tuple:
        return tuple(_read(option, item) for option, item in zip(inner, value, strict=True))
    if origin is np.ndarray:
        return np.array(value, dtype=get_args(inner[1])[0])
    if origin is not None and issubclass(origin, Mapping):
        return {key: _read(inner[1], item) for key, item in value.items()}
    if isinstance(kind, type) and issubclass(kind, Enum | Path):
        return kind(value)
    if dataclasses.is_dataclass(kind) or hasattr(kind, "_fields"):
        return kind(**{field.name: _of(value, field) for field in _fields(kind) if _has(value, field)})
    if isinstance(kind, type) and not isinstance(value, kind):
        raise TypeError(f"{value!r} in place of {kind.__name__}")
    return value


def _of(record: Any, field: _Field) -> Any:
    for key in field.keys:
        record = record[key]
    return _read(field.kind, record)


def _has(record: Any, field: _Field) -> bool:
    """True unless the record leaves out a field that has a default."""
    return field.default is dataclasses.MISSING or not field.keys or field.keys[0] in record


def _put(record: dict[str, Any], keys: Sequence[str], item: Any) -> None:
    if not keys:
        record |= item
        return
    for key in keys[:-1]:
        record = record.setdefault(key, {})
    record[keys[-1]] = item


@functools.cache
def _fields(kind: Any) -> tuple[_Field, ...]:
    if dataclasses.is_dataclass(kind):
        defaults = {field.name: field.default for field in dataclasses.fields(kind) if field.init}
    else:
        defaults = {name: kind._field_defaults.get(name, dataclasses.MISSING) for name in kind._fields}
    hints = typing.get_type_hints(kind, include_extras=True)
    return tuple(_field(name, hints[name], default) for name, default in defaults.items())


def _field(name: str, hint: Any, default: Any) -> _Field:
    path = name
    if get_origin(hint) is Annotated:
        hint, *notes = get_args(hint)
        path = next((note.path for note in notes if isinstance(note, Key)), name)
    kind = get_args(hint)[0] if get_origin(hint) is Setting else hint
    return _Field(name, tuple(filter(None, path.split("."))), kind, default)
