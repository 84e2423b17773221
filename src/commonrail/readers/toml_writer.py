"""TOML text of tables: exact, and without a document that could be edited, which takes a hundred times as long."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

_SHORT = {"\b": "\\b", "\t": "\\t", "\n": "\\n", "\f": "\\f", "\r": "\\r", '"': '\\"', "\\": "\\\\"}
_ESCAPED = re.compile(r'[\x00-\x1f\x7f"\\]')
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def value_text(value: Any) -> str:
    """A text, a number, true or false, or a list of them; numbers as the shortest decimals that are the same floats."""
    if isinstance(value, str):
        return f'"{_ESCAPED.sub(_escape, value)}"'
    if isinstance(value, list):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return repr(float(value)) if isinstance(value, float) else repr(value)  # a NumPy float writes its type


def _escape(found: re.Match[str]) -> str:
    sign = found.group()
    return _SHORT.get(sign) or f"\\u{ord(sign):04x}"


def key_text(key: str) -> str:
    """A key, quoted if it has to be."""
    return key if _BARE.fullmatch(key) else value_text(key)


def inline_table(values: Mapping[str, Any]) -> str:
    """``{key = value, …}`` in one line."""
    return "{" + ", ".join(f"{key_text(key)} = {value_text(value)}" for key, value in values.items()) + "}"


def table_lines(path: str, values: Mapping[str, Any]) -> Iterator[str]:
    """Lines of a table and of those in it, each below an empty line.

    The path is its dotted key; behind texts, numbers and lists the values hold mappings.
    """
    yield ""
    yield f"[{path}]"
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from table_lines(f"{path}.{key_text(key)}", value)
        else:
            yield f"{key_text(key)} = {value_text(value)}"
