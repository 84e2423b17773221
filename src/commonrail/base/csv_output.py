"""Tables written as CSV, in which no text is a formula for a spreadsheet."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from commonrail.base.output import line_text, replacing

# Texts in tables that a spreadsheet would compute: neutralised where tables are written, restored where they are read.
#
# A text that would be taken for a formula gets an apostrophe in front, which makes it a text for every spreadsheet.
# The same text comes back: `restore(neutralise(text)) == text`, and texts that nobody would compute stay as they
# are.

MARK = "'"

# Signs with which a formula begins, in full width too, behind spaces and quotes that a spreadsheet may drop.
_FORMULA = re.compile(r"[\s'\"]*[=+\-@＝＋－＠]")
_NUMBER = re.compile(r"[\s'\"]*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
_SEPARATORS = re.compile(r"([,;\t])")


def neutralise(text: str) -> str:
    """Cell of a table, which no spreadsheet computes; numbers stay numbers."""
    return MARK + text if _is_computed(text) else text


def restore(cell: str) -> str:
    """Text of a cell that `neutralise` gave."""
    return cell[1:] if cell.startswith(MARK) and _is_computed(cell[1:]) else cell


def comment_line(text: str) -> str:
    """Comment line of a text; a spreadsheet divides it into cells at each separator."""
    return f"# {_behind_separators(line_text(text), neutralise)}"


def restore_note(line: str) -> str:
    """Text of a line that `comment_line` gave, without its sign."""
    return _behind_separators(line, restore)


def _behind_separators(line: str, change: Callable[[str], str]) -> str:
    first, *others = _SEPARATORS.split(line)
    return first + "".join(piece if i % 2 == 0 else change(piece) for i, piece in enumerate(others))


def _is_computed(text: str) -> bool:
    if text[:1].isalnum():  # most cells: digits and letters begin no formula
        return False
    return bool(_FORMULA.match(text)) and not _NUMBER.fullmatch(text)


def write_csv(path: Path, notes: Iterable[str], header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Write a table, whole or not at all; `OutputError` as `replacing`.

    This is where tables are written: a text that a spreadsheet would compute is neutralised, and `CsvFile` with `plain`
    reads it back as it was.

    `notes`: comment lines above the header. `header`: names of the columns with their units.
    """
    with replacing(path) as stream:
        stream.writelines(f"{comment_line(note)}\n" for note in notes)
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(map(_cell, header))
        writer.writerows(map(_cell, row) for row in rows)


def _cell(text: str) -> str:
    return neutralise(line_text(text))
