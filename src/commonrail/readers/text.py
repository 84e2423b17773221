"""Lines and cells of a text: encoding, separator and decimal sign are detected unless they are stated.

A file may have comment lines (``#``) and empty ones anywhere. Rows are read one by one: a large file is never
in memory as cells.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from io import BytesIO
from itertools import islice
from pathlib import Path

from commonrail.base.errors import InputError
from commonrail.base.input import read_plain
from commonrail.readers.location import decode_line

LONGEST_LINE = 100_000  # [bytes]; of a table with a thousand columns
LONGEST_NUMBER = 100  # [characters]
SAMPLE = 1000  # lines that tell the separator

Cell = str | float
NumberedRows = Iterator[tuple[int, Sequence[Cell]]]  # line of the file on which a row begins, and its cells

_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_POINT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.A)
_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?", re.A)
_QUOTED = re.compile(r'"[^"]*"')
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+", re.A)
_EMPTY = frozenset(("nan", "inf", "+inf", "-inf"))


def read_encoded(path: Path, largest: int, encoding: str = "") -> tuple[bytes, str]:
    r"""Text as UTF-8 with line ends ``"\n"``, and the name of its encoding.

    Raises `InputError` as `read_plain` does, or if the file is not a text in this encoding. Without a stated encoding,
    UTF-8, UTF-16 and cp1252 are tried.
    """
    data = read_plain(path, largest)
    for name in [encoding] if encoding else _likely(data):
        try:
            text = data.decode(name)
        except UnicodeError:
            continue
        except LookupError as error:
            raise InputError(
                f'{path}: there is no encoding "{name}"; write utf-8, utf-16 or cp1252.',
                code="unknown-encoding",
                file=path,
            ) from error
        if "\0" not in text:
            text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
            return text.encode("utf-8", "replace"), name
    tried = f"in {encoding}; correct the encoding" if encoding else "that can be read; export the table as CSV"
    raise InputError(f"{path}: this is no text {tried}.", code="wrong-encoding", file=path)


def _likely(data: bytes) -> list[str]:
    """Encodings that a text may have, by its first bytes."""
    mark = next((name for start, name in _MARKS.items() if data.startswith(start)), None)
    zeros = (data[1:200:2].count(0), data[0:200:2].count(0))
    if mark is None and max(zeros) > 20:
        mark = "utf-16-le" if zeros[0] > zeros[1] else "utf-16-be"
    return [mark] if mark else ["utf-8", "cp1252"]


def number_lines(path: Path, data: bytes) -> Iterator[tuple[int, str]]:
    """Lines of UTF-8 text with their numbers, without their ends; decoded one by one, to save memory.

    Raises `InputError` if a line is too long, or is not UTF-8 text.
    """
    for number, ended in enumerate(BytesIO(data), start=1):
        line = ended.removesuffix(b"\n")
        if len(line) > LONGEST_LINE:
            raise InputError(
                f"{path}, line {number}: the line has {len(line)} characters, more than the {LONGEST_LINE} that are "
                "read; keep only the columns that are needed.",
                code="line-too-long",
                file=path,
                place=f"line {number}",
            )
        # spreadsheets and word processors write spaces that do not break
        yield number, decode_line(path, line, number).replace("\u00a0", " ").replace("\u202f", " ")


def find_separator(lines: Iterable[str]) -> str:
    """Sign that is in more than half of the lines that have one outside quotes: semicolon, tab, else comma."""
    bare = [_QUOTED.sub("", line) for line in islice(lines, SAMPLE)]
    separated = [line for line in bare if any(sign in line for sign in ";\t,")]
    for sign in (";", "\t"):
        if 2 * sum(sign in line for line in separated) > len(separated):
            return sign
    return ","


def split_lines(path: Path, lines: Iterator[tuple[int, str]], separator: str, *, plain: bool = False) -> NumberedRows:
    """Cells of each row and the line on which it begins; `plain` keeps the spaces about them."""
    taken: list[int] = []  # lines of the current row: a quoted cell may span several

    def texts() -> Iterator[str]:
        for number, text in lines:
            taken.append(number)
            yield text + "\n"

    reader = csv.reader(texts(), delimiter=separator, strict=True, skipinitialspace=not plain)
    while True:
        taken.clear()
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise InputError(
                f"{path}, line {taken[0]}: the row cannot be read ({error}).",
                code="bad-row",
                file=path,
                place=f"line {taken[0]}",
            ) from error
        yield taken[0], row if plain else [cell.strip() for cell in row]


def find_decimal_comma(path: Path, rows: NumberedRows, decimal: str, separator: str = "") -> bool:
    """Return whether the decimal sign is a comma: as stated, else as found in the numbers.

    If commas separate the cells, the decimal sign is a point unless stated. Raises `InputError` if numbers with points
    and with commas are mixed, if commas separate the cells and no number has the stated decimal comma, or if points may
    separate thousands. Such points are followed by three digits, as in 1.200, and other numbers are integers such as
    35. If no number is an integer, or a number such as 0.35 occurs, the point is the decimal sign.
    """
    if decimal == "." or (separator == "," and not decimal):
        return False
    has_comma, integer, pointed, grouped = False, "", "", (0, "")
    for line, row in rows:
        for cell in row:
            if not isinstance(cell, str):
                continue
            if "," in cell:
                has_comma = has_comma or has_decimal_comma(cell)
            elif "." not in cell:
                integer = integer or (cell if cell.isdecimal() else "")
            elif _GROUPED.fullmatch(cell):
                grouped = grouped if grouped[1] else (line, cell)
            elif not pointed and _POINT.fullmatch(cell):
                pointed = cell
    among = pointed or grouped[1]
    if (decimal or has_comma) and among:
        kind = "a decimal comma is stated" if decimal else "some numbers have a decimal comma"
        raise InputError(
            f'{path}: {kind}, and "{among}" has a point; write all numbers with the same decimal sign, and '
            "thousands without a sign.",
            code="mixed-decimals",
            file=path,
        )
    if decimal and separator == "," and not has_comma:
        raise InputError(
            f"{path}: a decimal comma is stated, but commas separate the columns and no number has one in quotes; "
            "state a decimal point, or separate the columns by semicolons.",
            code="no-decimal-comma",
            file=path,
        )
    if not has_comma and not decimal and grouped[1] and not pointed and integer:
        raise InputError(
            f'{path}, line {grouped[0]}: "{grouped[1]}" may be {grouped[1].replace(".", "")}, because three digits '
            f'follow each point of the file and others, as "{integer}", have none; write thousands without a point, or '
            "state that the decimal sign is a point.",
            code="open-decimal",
            file=path,
            place=f"line {grouped[0]}",
        )
    return has_comma or bool(decimal)


def has_decimal_comma(cell: str) -> bool:
    """Return whether a cell is a number with a decimal comma."""
    return bool(_COMMA.fullmatch(cell))


def read_number(cell: Cell, comma: bool) -> Cell:
    """Number of a cell, or the cell itself if it is a text; `comma` reads decimal commas too."""
    if not isinstance(cell, str) or not cell or len(cell) > LONGEST_NUMBER:
        return cell
    if comma and _COMMA.fullmatch(cell):
        cell = cell.replace(",", ".")
    elif not _POINT.fullmatch(cell):
        return cell
    value = float(cell)
    return value if abs(value) < float("inf") else cell


def is_number(cell: Cell) -> bool:
    """Return whether a cell holds a number with either decimal sign, or a word for a missing one."""
    return not isinstance(cell, str) or not isinstance(read_number(cell, True), str) or cell.lower() in _EMPTY
