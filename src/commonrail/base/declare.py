"""Settings that are declared once.

A field states its words, unit, limits, default and meaning in one place. Its check, the sentence of its error, the
option of a command (`commonrail.cli.grammar`), the docstring and the reference page, the facts of a page and the record
(`commonrail.base.record`) follow from that. `docs/howto/extend.md` has an example.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import sys
import types
import typing
from collections.abc import Callable, Collection, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar, dataclass_transform, get_args, get_origin, overload

from commonrail.base.arguments import (
    LARGEST_WHOLE,
    Limits,
    Quantity,
    amount,
    array,
    enum_member,
    file_path,
    flag,
    instance,
    instances,
    integer,
    number,
    plain_text,
    settle,
)
from commonrail.base.units import to_text

_Value = TypeVar("_Value")
_Accepted = TypeVar("_Accepted")
_Choice = TypeVar("_Choice", bound=Enum)
_Class = TypeVar("_Class")


class Setting(Generic[_Value, _Accepted]):
    """Annotation of a field: the type of its value, and the types that the constructor reads it from.

    Only type checkers see the two methods: an instance has plain attributes.
    """

    if typing.TYPE_CHECKING:

        @overload
        def __get__(self, instance: None, owner: Any) -> Setting[_Value, _Accepted]: ...
        @overload
        def __get__(self, instance: object, owner: Any) -> _Value: ...
        def __get__(self, instance: object, owner: Any) -> Any: ...
        def __set__(self, instance: object, value: _Accepted) -> None: ...


Number = Setting[float, Quantity]
OptionalNumber = Setting[float | None, Quantity | None]
Choice = Setting[_Choice, _Choice | str]


class Declared(NamedTuple):
    """Declaration of a field: the parameters of `setting`, and the type of the value."""

    kind: Any
    words: str
    unit: str
    limits: Limits | None
    text: str
    read: Callable[[Any, str], Any] | None
    option: bool
    default: Any

    @property
    def type(self) -> Any:
        """Type of the value without None."""
        return next((kind for kind in _members(self.kind) if kind is not types.NoneType), self.kind)

    @property
    def whole_limits(self) -> tuple[int, int]:
        """Limits of a whole number: zero or greater if none are declared."""
        low, high = (0, math.inf) if self.limits is None else self.limits[:2]
        return int(low), LARGEST_WHOLE if high == math.inf else int(high)

    @property
    def meaning(self) -> str:
        """Meaning in one sentence, by default the words alone."""
        return self.text or f"{self.words[:1].upper()}{self.words[1:]}."

    @property
    def optional(self) -> bool:
        """True if the value may be None."""
        return types.NoneType in _members(self.kind)

    def value_of(self, value: Any) -> Any:
        """Read and check a value; `ConfigurationError` if it is of another kind or beyond the limits."""
        if value is None and self.optional:
            return None
        if self.read is not None:
            return self.read(value, self.words)
        kind = self.type
        origin = get_origin(kind) or kind
        if kind is float:
            return self._number(value)
        if kind is int:
            return integer(value, self.words, *self.whole_limits)
        if isinstance(origin, type) and issubclass(origin, Enum):
            return enum_member(value, origin, self.words)
        if getattr(origin, "__name__", "") == "ndarray":  # without an import of NumPy
            return array(value, self.unit, self.words)
        if origin is tuple:
            item = get_args(kind)[0]
            if item is float:
                return tuple(self._number(element) for element in array(value, self.unit, self.words, 1).tolist())
            return instances(value, item, self.words)
        return _READ[kind](value, self.words) if kind in _READ else instance(value, origin, self.words)

    def _number(self, value: object) -> float:
        if self.limits is None:
            return number(value, self.unit, self.words)
        return amount(value, self.unit, self.words, self.limits)

    def text_of(self, value: Any) -> str:
        """Value as a reader says it: with its unit, shares of at most one in percent."""
        if isinstance(value, Enum):
            return str(value.value)
        if isinstance(value, bool) or value is None:
            return "" if value is None else "yes" if value else "no"
        if isinstance(value, float):
            share = self.unit == "1" and self.limits is not None and self.limits.high <= 1.0
            return f"{100.0 * value:g} %" if share else to_text(value, self.unit)
        if isinstance(value, tuple):
            return ", ".join(map(self.text_of, value))
        return str(value)

    @property
    def accepted(self) -> str:
        """Kind of value, with unit, limits or choices, for the reference."""
        kind = self.type
        if isinstance(kind, type) and issubclass(kind, Enum):
            return " or ".join(f'"{member.value}"' for member in kind)
        plain = {float: "number" if self.unit == "1" else f"quantity [{self.unit}]", int: "whole number"}
        words = (plain | {bool: "true or false", str: "text", Path: "path"}).get(
            kind, getattr(kind, "__name__", "list")
        )
        if self.limits is None:
            return words
        low, high = (f"{end:,.0f}" if kind is int else to_text(end, self.unit) for end in self.limits[:2])
        return f"{words}, {low} or more" if math.isinf(self.limits.high) else f"{words}, {low} to {high}"

    @property
    def default_text(self) -> str:
        """Default for the reference: empty for None, "required" if absent."""
        if self.default is dataclasses.MISSING:
            return "required"
        return self.default if isinstance(self.default, str) else self.text_of(self.default)


_READ = {bool: flag, str: plain_text, Path: file_path}


def _members(kind: Any) -> tuple[Any, ...]:
    return get_args(kind) if get_origin(kind) in (typing.Union, types.UnionType) else ()


def setting(
    *,
    words: str = "",
    default: Any = dataclasses.MISSING,
    unit: str = "1",
    limits: Limits | None = None,
    text: str = "",
    read: Callable[[Any, str], Any] | None = None,
    option: bool = True,
) -> Any:
    """Declare a field of a class under `settings`.

    Parameters
    ----------
    words : str
        Its name in sentences, as "share of failures"; by default the field's name with spaces.
    default : object
        As the constructor takes it, such as ``"10 %"``; without a default the field is required.
    unit : str
        SI unit of a number.
    limits : Limits, optional
        Smallest and largest value, both included, in the SI unit.
    text : str
        Meaning in one sentence: help of the option and text of the reference.
    read : function of (value, words), optional
        Reads and checks the value, where its type and limits do not say it all.
    option : bool
        Whether a command that takes the settings has an option for it.
    """
    declared = Declared(None, words, unit, limits, text, read, option, default)
    return dataclasses.field(default=default, metadata={"setting": declared})


@overload
@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(setting, dataclasses.field))
def settings(cls: type[_Class]) -> type[_Class]: ...
@overload
def settings(*, kw_only: bool) -> Callable[[type[_Class]], type[_Class]]: ...
def settings(cls: Any = None, *, kw_only: bool = True) -> Any:
    """Make a frozen dataclass whose constructor reads and checks the declared fields, all of them by keyword.

    ``@settings(kw_only=False)`` takes them in order too. A ``__post_init__`` of the class runs afterwards, for what
    concerns several fields. The docstring gets a section on the parameters.
    """
    if cls is None:
        return lambda decorated: _settings(decorated, kw_only, sys._getframe(1))
    return _settings(cls, kw_only, sys._getframe(1))


def _settings(cls: Any, kw_only: bool, frame: types.FrameType) -> Any:
    """Dataclass of settings; its annotations are resolved with the names of `frame`, where the class is defined."""
    check = getattr(cls, "__post_init__", None)

    def read(self: Any) -> None:
        settle(
            self, **{name: field.value_of(getattr(self, name)) for name, field in read_declarations(type(self)).items()}
        )
        if check is not None:
            check(self)

    cls.__post_init__ = read
    new_class = dataclasses.dataclass(frozen=True, kw_only=kw_only)(cls)
    declared = dict(read_declarations(new_class))
    annotations: dict[str, Any] = inspect.get_annotations(cls)
    for name, kind in annotations.items():
        field = new_class.__dataclass_fields__.get(name)
        if field is not None and "setting" in field.metadata:
            kind = eval(kind, frame.f_globals, frame.f_locals) if isinstance(kind, str) else kind
            kind = get_args(kind)[0] if get_origin(kind) is Setting else kind
            declaration: Declared = field.metadata["setting"]
            declared[name] = declaration._replace(kind=kind, words=declaration.words or name.replace("_", " "))
    new_class.__settings__ = declared
    new_class.__doc__ = f"{inspect.getdoc(new_class)}\n\nParameters\n----------\n{_parameters(new_class)}"
    return new_class


def _parameters(cls: type) -> str:
    lines = []
    for name, field in read_declarations(cls).items():
        default = f"; {field.default_text} by default" if field.default_text not in ("", "required") else ""
        lines.append(f"{name} : {field.accepted}{', optional' * field.optional}{default}\n    {field.meaning}")
    return "\n".join(lines)


def read_declarations(cls: type) -> Mapping[str, Declared]:
    """Declared fields of a class by name; empty for one that is not under `settings`."""
    declared: Mapping[str, Declared] = getattr(cls, "__settings__", {})
    return declared


def list_facts(settings: Any, names: Collection[str]) -> list[tuple[str, str]]:
    """Words and values of fields, for the facts at the end of a page; None is left out."""
    declared = read_declarations(type(settings))
    values = ((declared[name], getattr(settings, name)) for name in names)
    return [
        (field.words[:1].upper() + field.words[1:], field.text_of(value))
        for field, value in values
        if value is not None
    ]
