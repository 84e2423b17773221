"""Rows of a lane: a nested NamedTuple of numbers laid out in one column of a (rows × lanes) array.

An engine keeps everything behind one base pointer, so the compiler can prove that lanes do not overlap.
Physics never sees a row number: `Layout.load` gives it the NamedTuple back by name. The two functions are
generated from the NamedTuple itself, as plain straight-line Python, when they are first asked for.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any, get_type_hints

from commonrail.physics.law import physics

Choices = tuple[tuple[str, type], ...]

# One running index: Numba takes milliseconds for each operation of a text, and there are hundreds of rows.
_ON = "    i += stride"


class Layout:
    """Rows of the fields of a nested NamedTuple.

    Parameters
    ----------
    kind, choices
        As of `layout_of`.

    Attributes
    ----------
    paths : tuple of str
        Dotted field names in row order: ``plunger_needle.k1``.
    """

    def __init__(self, kind: type, choices: Choices = ()) -> None:
        self.paths = tuple(field_paths(kind, choices))
        self._kind, self._choices = kind, choices

    @functools.cached_property
    def load(self) -> Callable[..., Any]:
        """Function (array, start, stride) -> NamedTuple that reads the fields from index `start` on, `stride` apart."""
        names: dict[str, Any] = {}
        made = _constructor(self._kind, self._choices, names, iter(range(10_000)))
        reads = [line for row, _ in enumerate(self.paths) for line in (f"    r{row} = a[i]", _ON)]
        return self._law("load(a, start, stride)", [*reads[:-1], f"    return {made}"], names)

    @functools.cached_property
    def store(self) -> Callable[..., Any]:
        """Function (array, start, stride, value) -> None that writes them."""
        values = (".".join(filter(None, ("value", path))) for path in self.paths)
        writes = [line for value in values for line in (f"    a[i] = {value}", _ON)]
        return self._law("store(a, start, stride, value)", writes[:-1], {})

    def row(self, path: str) -> int:
        """Row of a dotted field name, the first one of a group of fields."""
        return next(i for i, known in enumerate(self.paths) if f"{known}.".startswith(f"{path}."))

    def _law(self, head: str, lines: list[str], names: dict[str, Any]) -> Callable[..., Any]:
        """Law of a text, which only what compiles it asks for.

        `head`: name and arguments; `names`: types that the lines name.
        """
        names["__name__"] = __name__
        text = "\n".join([f"def {head}:", "    i = start", *lines, ""])
        exec(compile(text, f"<layout of {self._kind.__qualname__}>", "exec"), names)
        law: Callable[..., Any] = physics(names[head.partition("(")[0]])
        return law


def field_paths(kind: type, choices: Choices = (), prefix: str = "") -> Iterator[str]:
    """Dotted names of the float fields of a nested NamedTuple.

    `kind`: NamedTuple, or float itself; `choices` (tuple of (field name, type)): types of the fields annotated ``Any``;
    `prefix`: in front of each name.
    """
    if kind is float:
        yield prefix
    else:
        for name, hint in _fields(kind, choices):
            yield from field_paths(hint, choices, f"{prefix}.{name}" if prefix else name)


@functools.cache
def _fields(kind: type, choices: Choices) -> tuple[tuple[str, type], ...]:
    hints, chosen = get_type_hints(kind), dict(choices)
    names = kind._fields  # type: ignore[attr-defined]
    return tuple((name, chosen.get(name, hints[name]) if hints[name] is Any else hints[name]) for name in names)


@functools.cache
def layout_of(kind: type, choices: Choices = ()) -> Layout:
    """Layout of a nested NamedTuple type, one for all who ask.

    `kind`: A NamedTuple whose fields are float or such NamedTuples, or float itself; `choices` (tuple of (field name,
    type)): types of the fields annotated ``Any``, such as ``(("body", rigid_body.State),)``.
    """
    return Layout(kind, choices)


def _constructor(kind: type, choices: Choices, names: dict[str, Any], rows: Iterator[int]) -> str:
    if kind is float:
        return f"r{next(rows)}"
    alias = f"T{len(names)}"
    names[alias] = kind
    parts = [_constructor(hint, choices, names, rows) for _, hint in _fields(kind, choices)]
    return f"{alias}({', '.join(parts)})"
