"""Records of results: conversion of typed objects to JSON and back.

A result is a dataclass or a named tuple of numbers, texts, enums, arrays and such objects. `to_record` converts a
result for its JSON file, `from_record` converts it back. Pages and tables use attributes, whose names a type checker
verifies.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import types
import typing
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar, get_args, get_origin, overload

import numpy as np

from commonrail.base.declare import Setting
from commonrail.base.errors import CommonrailError, InputError

_Result = TypeVar("_Result")
_LONGEST = 40  # characters of a value in a sentence


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


class BrokenRecordError(InputError, ValueError):
    """A record lacks a key, or has a value of another kind; the sentence begins with the path of the key."""


def from_record(kind: type[_Result], record: Any) -> _Result:
    """Result of a kind from its record; None for a number becomes not-a-number.

    Raises `BrokenRecordError` if a key is missing or a value is of another kind; who knows the file adds it.
    """
    result: _Result = _read(kind, record, "")
    return result


def _read(kind: Any, value: Any, path: str) -> Any:
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (typing.Union, types.UnionType):
        option = next(option for option in inner if option is not types.NoneType)
        return None if value is None else _read(option, value, path)
    if kind is Any:
        return value
    if kind is float:
        return math.nan if value is None else _number(value, path)
    if origin is tuple:
        return _read_tuple(inner, _expect(value, Sequence, path), path)
    if origin is typing.Literal:
        return _one_of(inner, value, path)
    if origin is np.ndarray:
        try:
            return np.array(value, dtype=get_args(inner[1])[0])
        except (ArithmeticError, TypeError, ValueError) as error:
            raise _wrong(path, "numbers", value) from error
    if origin is not None and issubclass(origin, Mapping):
        items = _expect(value, Mapping, path).items()
        return {key: _read(inner[1], item, _join(path, str(key))) for key, item in items}
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind(_one_of([member.value for member in kind], value, path))
    if kind is Path:
        return Path(_expect(value, str, path))
    if dataclasses.is_dataclass(kind) or hasattr(kind, "_fields"):
        _expect(value, Mapping, path)
        fields = {field.name: _of(value, field, path) for field in _fields(kind) if _has(value, field)}
        try:
            return kind(**fields)
        except (CommonrailError, ArithmeticError, TypeError, ValueError) as error:
            raise BrokenRecordError(f"{path or 'the record'}: {str(error).rstrip('.')}") from error
    return _expect(value, kind, path) if isinstance(kind, type) else value


def _read_tuple(inner: tuple[Any, ...], value: Sequence[Any], path: str) -> tuple[Any, ...]:
    kinds = [inner[0]] * len(value) if inner[-1] is Ellipsis else list(inner)
    if len(kinds) != len(value):
        raise _wrong(path, f"a list of {len(kinds)}", value)
    return tuple(_read(kind, item, f"{path}[{i}]") for i, (kind, item) in enumerate(zip(kinds, value, strict=True)))


_WORDS = {Mapping: "an object", Sequence: "a list", str: "a text", int: "a whole number", bool: "true or false"}


def _expect(value: Any, kind: Any, path: str) -> Any:
    if not isinstance(value, kind) or (kind is Sequence and isinstance(value, str)):
        raise _wrong(path, _WORDS.get(kind, f"a {kind.__name__}"), value)
    return value


def _one_of(choices: Sequence[Any], value: Any, path: str) -> Any:
    if value not in choices:
        raise _wrong(path, " or ".join(map(_quote, choices)), value)
    return value


def _number(value: Any, path: str) -> float:
    try:
        if isinstance(value, str):
            raise TypeError("a text")
        return float(value)
    except (OverflowError, TypeError, ValueError) as error:
        raise _wrong(path, "a number", value) from error


def _wrong(path: str, expected: str, value: Any) -> BrokenRecordError:
    return BrokenRecordError(f"{path or 'the record'}: {expected} was expected, and {_quote(value)} was read")


def _quote(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ..."


def _join(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


def _of(record: Any, field: _Field, path: str) -> Any:
    for key in field.keys:
        _expect(record, Mapping, path)
        path = _join(path, key)
        if key not in record:
            raise BrokenRecordError(f"{path}: this key is missing")
        record = record[key]
    return _read(field.kind, record, path)


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
