"""Tables as plain text, where every cell fits into its line: rich, which folds the others, takes long to import."""

from __future__ import annotations

import re
from collections.abc import Sequence

__all__ = ["plain_pairs", "plain_rows"]

# Characters of one column: Latin and Greek letters, signs of punctuation and mathematics.
_NARROW = re.compile(
    "[ -~\u00a0-\u00ac\u00ae-\u02ff\u0370-\u0377\u0384-\u03ff\u2010-\u2027\u2030-\u205e\u2070-\u20cf\u2100-\u22ff]*"
)


def plain_rows(rows: Sequence[Sequence[str]], title: str, texts: int, width: int) -> list[str] | None:
    """Lines of a table as rich draws it with `box.SIMPLE_HEAD`; None if a line has to be folded.

    Parameters
    ----------
    rows : sequence of sequences of str
        The heads, and the rows below them.
    title : str
        Line above the heads, if any.
    texts : int
        Number of leading columns with text; those after them are numbers, at the right.
    width : int
        Columns of a line.
    """
    sizes = _sizes(rows)
    within = sum(size + 3 for size in sizes or []) - 1
    if sizes is None or within + 2 > width or len(title) > within + 2 or not _NARROW.fullmatch(title):
        return None
    aligned = [
        "   ".join(c.ljust(n) if i < texts else c.rjust(n) for i, (c, n) in enumerate(zip(row, sizes, strict=True)))
        for row in rows
    ]
    lines = ["", f"  {aligned[0]}", f" {'─' * within}", *(f"  {line}" for line in aligned[1:]), ""]
    return [line.rstrip() for line in ([title] if title else []) + lines]


def plain_pairs(rows: Sequence[Sequence[str]], width: int) -> list[str] | None:
    """Lines of names and values; None if one has to be folded."""
    sizes = _sizes(rows)
    if sizes is None or sum(sizes) + 3 > width:
        return None
    return [f"{name.ljust(sizes[0])}   {value}".rstrip() for name, value in rows]


def _sizes(rows: Sequence[Sequence[str]]) -> list[int] | None:
    """Width of each column; None if there is none, or a character whose width is not one column."""
    if not rows or not rows[0] or not all(_NARROW.fullmatch(cell) for row in rows for cell in row):
        return None
    return [max(map(len, column)) for column in zip(*rows, strict=True)]
