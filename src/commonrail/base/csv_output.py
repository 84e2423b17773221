"""CSV tables in which a spreadsheet takes no text for a formula."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from commonrail.base.output import line_text, replacing

# Cells that a spreadsheet would compute are neutralised when tables are written, and restored when tables are read.
#
# A text that looks like a formula gets an apostrophe in front, which makes it a text for every spreadsheet. All other
# texts stay unchanged, and `restore(neutralise(text)) == text`.

MARK = "'"

# First sign of a formula, also in full width, after spaces and quotes that a spreadsheet may drop.
_FORMULA = re.compile(r"[\s'\"]*[=+\-@＝＋－＠]")
_NUMBER = re.compile(r"[\s'\"]*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
_SEPARATORS = re.compile(r"([,;\t])")


def neutralise(text: str) -> str:
    """Text of a cell that no spreadsheet computes; numbers stay unchanged."""
    return MARK + text if _is_computed(text) else text


def restore(cell: str) -> str:
    """Text that `neutralise` has turned into this cell."""
    return cell[1:] if cell.startswith(MARK) and _is_computed(cell[1:]) else cell


def comment_line(text: str) -> str:
    """Comment line of a text, neutralised after each separator, where a spreadsheet begins a new cell."""
    return f"# {_behind_separators(line_text(text), neutralise)}"


def restore_note(line: str) -> str:
    """Text of a line of `comment_line` whose comment sign has been removed."""
    return _behind_separators(line, restore)


def _behind_separators(line: str, change: Callable[[str], str]) -> str:
    first, *others = _SEPARATORS.split(line)
    return first + "".join(piece if i % 2 == 0 else change(piece) for i, piece in enumerate(others))


def _is_computed(text: str) -> bool:
    if text[:1].isalnum():  # most cells: digits and letters begin no formula
        return False
    return bool(_FORMULA.match(text)) and not _NUMBER.fullmatch(text)


def write_csv(path: Path, notes: Iterable[str], header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Write a complete table or nothing; raises `OutputError` as `replacing` does.

    A text that a spreadsheet would compute is neutralised; `CsvFile` with `plain` restores it.

    `notes`: comment lines above the header. `header`: names of the columns with their units.
    """
    with replacing(path) as stream:
        stream.writelines(f"{comment_line(note)}\n" for note in notes)
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(map(_cell, header))
        writer.writerows(map(_cell, row) for row in rows)


def _cell(text: str) -> str:
    return neutralise(line_text(text))
