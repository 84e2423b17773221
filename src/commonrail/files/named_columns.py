"""Operating points that the names of columns state, such as "500bar_300us"."""

from __future__ import annotations

import re
from collections.abc import Sequence

from commonrail.errors import InputError
from commonrail.reading.pattern import ColumnPattern, NamedPoint
from commonrail.reading.place import Place

__all__ = ["named_points", "pattern_of"]

_POINT = re.compile(r"(\d+(?:[.,]\d+)?)(\s*[_ ]?)(MPa|bar|hPa|us|µs|ms)(?![A-Za-z])")
_LAST_NUMBER = re.compile(r"(\d+)(?=\D*$)")


def pattern_of(names: Sequence[str]) -> str | None:
    """Pattern of names that state operating points, if all have one form."""
    if len(names) < 2:
        return None
    made = [_POINT.sub(lambda m: _placeholder(m) + m[2] + m[3], name) for name in names]
    made = made if len(set(made)) == 1 else [_LAST_NUMBER.sub("{shot}", name) for name in made]
    pattern = made[0]
    if len(set(made)) > 1 or "{" not in pattern.replace("{shot}", ""):
        return None
    try:
        read = ColumnPattern(pattern, {}, Place(""))
    except InputError:
        return None
    return pattern if all(read.read(name) for name in names) else None


def named_points(names: Sequence[str]) -> tuple[NamedPoint, ...]:
    """Operating points that the names of columns state; empty where there is one name, or not all state one."""
    text = pattern_of(names)
    if text is None:
        return ()
    pattern = ColumnPattern(text, {}, Place(""))
    return tuple(point for name in names if (point := pattern.read(name)) is not None)


def _placeholder(found: re.Match[str]) -> str:
    return "{et}" if found[3] in ("us", "µs", "ms") else "{p}"
