"""Rows of a lane: a nested NamedTuple of numbers laid out in one column of a (rows × lanes) array.

An engine keeps everything behind one base pointer, so the compiler can prove that lanes do not overlap.
Physics never sees a row number: `Layout.load` gives it the NamedTuple back by name. The two functions are
generated from the NamedTuple itself, as plain straight-line Python.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, get_type_hints

from commonrail.compile import physics

__all__ = ["Layout", "field_paths", "layout_of"]

Choices = tuple[tuple[str, type], ...]


class Layout(NamedTuple):
    """Rows of the fields of a nested NamedTuple.

    Attributes
    ----------
    paths : tuple of str
        Dotted field names in row order: ``plunger_needle.k1``.
    load : function (array, start, stride) -> NamedTuple
        Reads the fields from index `start` on, `stride` apart.
    store : function (array, start, stride, value) -> None
        Writes them.
    """

    paths: tuple[str, ...]
    load: Callable[..., Any]
    store: Callable[..., Any]

    def row(self, path: str) -> int:
        """Row of a dotted field name, the first one of a group of fields."""
        return next(i for i, known in enumerate(self.paths) if f"{known}.".startswith(f"{path}."))


def field_paths(kind: type, choices: Choices = (), prefix: str = "") -> Iterator[str]:
    """Dotted names of the float fields of a nested NamedTuple.

    Parameters
    ----------
    kind : type
        NamedTuple, or float itself.
    choices : tuple of (field name, type)
        Types of the fields annotated ``Any``.
    prefix : str
        In front of each name.
    """
    if kind is float:
        yield prefix
    else:
        for name, hint in _fields(kind, choices):
            yield from field_paths(hint, choices, f"{prefix}.{name}" if prefix else name)


def _fields(kind: type, choices: Choices) -> Iterator[tuple[str, type]]:
    hints = get_type_hints(kind)
    for name in kind._fields:  # type: ignore[attr-defined]
        yield name, dict(choices).get(name, hints[name]) if hints[name] is Any else hints[name]


@functools.cache
def layout_of(kind: type, choices: Choices = ()) -> Layout:
    """Layout of a nested NamedTuple type.

    Parameters
    ----------
    kind : type
        A NamedTuple whose fields are float or such NamedTuples, or float itself.
    choices : tuple of (field name, type)
        Types of the fields annotated ``Any``, such as ``(("body", rigid_body.State),)``.
    """
    names: dict[str, Any] = {"__name__": __name__}
    made = _constructor(kind, choices, names, iter(range(10_000)))
    paths = tuple(field_paths(kind, choices))
    # one running index: Numba takes milliseconds for each operation of a text, and there are hundreds of rows
    on = "    i += stride"
    loads = [line for row, _ in enumerate(paths) for line in (f"    r{row} = a[i]", on)]
    stores = [line for path in paths for line in (f"    a[i] = {'.'.join(filter(None, ('value', path)))}", on)]
    load = ["def load(a, start, stride):", "    i = start", *loads[:-1], f"    return {made}", ""]
    store = ["def store(a, start, stride, value):", "    i = start", *stores[:-1], ""]
    exec(compile("\n".join(load + store), f"<layout of {kind.__qualname__}>", "exec"), names)
    return Layout(paths, physics(names["load"]), physics(names["store"]))


def _constructor(kind: type, choices: Choices, names: dict[str, Any], rows: Iterator[int]) -> str:
    if kind is float:
        return f"r{next(rows)}"
    alias = f"T{len(names)}"
    names[alias] = kind
    parts = [_constructor(hint, choices, names, rows) for _, hint in _fields(kind, choices)]
    return f"{alias}({', '.join(parts)})"
