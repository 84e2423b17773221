"""Maps as DCM 2.0, the text format of calibration data of control units.

Each map is a KENNFELD: its x axis once (ST/X), then for each value of the y axis (ST/Y) a row of values (WERT). Lines
hold six numbers, decimal points, no thousands separators. The format is ASCII; other characters are transcribed.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np

from commonrail.base.errors import InputError
from commonrail.base.input import read_plain
from commonrail.base.output import replacing, write_text
from commonrail.base.units import read_decimal
from commonrail.plugins.maps.table import Axis, MapTable
from commonrail.readers.location import read_bytes

NUMBERS = 6  # per line
LARGEST = 20_000_000  # [bytes]
MOST_VALUES = 1_000_000
MOST_DECIMALS = 15  # of a written value: the precision of a double near 1
MOST_COMMENTS = 1000  # kept
MOST_MAPS = 10_000  # in a file; chosen: a control unit has several thousand
_FORMAT = "KONSERVIERUNG_FORMAT"
# Lines of maps that are not tables of numbers over numbers.
_FOREIGN = dict.fromkeys(("ST_TX/X", "ST_TX/Y"), "its support points are texts") | {
    "TEXT": "its values are texts",
    "VAR": "it is a variant-coded parameter",
}
_SIGNS = str.maketrans({"µ": "u", "³": "3", "²": "2", "×": "x", "°": "deg", "−": "-", '"': "'"})


def write_dcm(path: Path, tables: Sequence[MapTable]) -> None:
    """Write maps without empty cells into one file, atomically."""
    write_text(path, "\n".join(_lines(tables)) + "\n")


def write_into_dcm(path: Path, source: Path, label: str, table: MapTable) -> None:
    """Write a copy of a DCM file with new values in one of its maps and notes at its head.

    All other characters stay. `label` names the map in `source`; the values of `table` are in the same order, and its
    label replaces the old one. `InputError` if a cell has no number.
    """
    table.require_numbers("A DCM file")
    values = iter(table.values.ravel().tolist())
    inside = done = False
    text, encoding = _decode(read_plain(source, LARGEST).removeprefix(b"\xef\xbb\xbf"))  # both preserve each byte
    if re.search(r"\r(?!\n)", text):  # other programs treat CR as a line end
        raise InputError(f"{source}: a line ends with CR alone; lines must end with LF or CR LF.")
    lines = text.split("\n")
    for i, line in enumerate(lines):
        words = line.split()
        if not done and words[1:2] == [label] and re.fullmatch(r"(FEST|GRUPPEN)?KENNFELD", words[0]):
            inside = done = True
            lines[i] = re.sub(r"(KENNFELD\s+)\S+", rf"\g<1>{table.label}", line, count=1)
        elif inside and words[:1] == ["WERT"]:
            head, word, rest = line.partition("WERT")
            numbers = re.sub(r"\S+", lambda _: f"{next(values) + 0.0:.{table.decimals}f}", rest)
            lines[i] = head + word + numbers
        inside &= words[:1] != ["END"]
    if next(values, None) is not None:
        raise InputError(f"{source}: lines of the map {label} were not found; they must end with LF or CR LF.")
    notes = "".join(f"* {_plain(note)}\n" for note in ("written by commonrail", *table.notes))
    with replacing(path, "wb") as stream:
        stream.write((notes + "\n".join(lines)).encode(encoding))


def _decode(data: bytes) -> tuple[str, str]:
    """Text of a DCM file and its encoding: UTF-8 if it is valid, else Latin-1."""
    try:
        return data.decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        return data.decode("latin-1"), "latin-1"


def _lines(tables: Sequence[MapTable]) -> Iterator[str]:
    yield f"* {_plain('written by commonrail')}"
    for note in dict.fromkeys(note for table in tables for note in table.notes):
        yield f"* {_plain(note)}"
    yield ""
    yield f"{_FORMAT} 2.0"
    for table in tables:
        yield ""
        yield from _map(table)


def _map(table: MapTable) -> Iterator[str]:
    yield f"KENNFELD {table.label} {len(table.x.values)} {len(table.y.values)}"
    texts = {"LANGNAME": table.title, "EINHEIT_X": table.x.unit, "EINHEIT_Y": table.y.unit, "EINHEIT_W": table.unit}
    yield from (f'   {word} "{_plain(text)}"' for word, text in texts.items())
    yield from _numbers("ST/X", table.x.values.tolist())
    for place, row in zip(table.y.values.tolist(), table.values.tolist(), strict=True):
        yield f"   ST/Y   {number_text(place)}"
        yield from _numbers("WERT", row)
    yield "END"


def _numbers(word: str, values: Sequence[float]) -> Iterator[str]:
    for first in range(0, len(values), NUMBERS):
        yield f"   {word}   " + "   ".join(map(number_text, values[first : first + NUMBERS]))


def number_text(value: float) -> str:
    """Format a number with a decimal point and without an exponent; it reads back to the same double."""
    return np.format_float_positional(value + 0.0, trim="0")


def _plain(text: str) -> str:
    """Text in ASCII on one line, without quotation marks."""
    decomposed = unicodedata.normalize("NFKD", " ".join(text.split()).translate(_SIGNS))
    return decomposed.encode("ascii", "ignore").decode("ascii")


def read_dcm(path: Path, foreign: dict[str, str] | None = None, comments: list[str] | None = None) -> list[MapTable]:
    """Read KENNFELD, FESTKENNFELD and GRUPPENKENNFELD of a DCM 2.0 file; single values and curves are skipped.

    Maps that are not tables of numbers over increasing numbers, or share a label, are skipped too; `foreign` receives
    the reasons by label, `comments` the comment lines. Files that are not UTF-8 are read as Latin-1.

    `InputError` if it is not DCM, or a map in it is damaged; the message names the line.
    """
    text, _ = _decode(read_bytes(path, LARGEST))
    lines = [(n, line) for n, raw in enumerate(text.split("\n"), start=1) if (line := raw.strip())]
    if comments is not None:
        comments += [line[1:].strip() for _, line in lines if line[0] == "*"][:MOST_COMMENTS]
    foreign = {} if foreign is None else foreign
    content = ((n, line) for n, line in lines if line[0] not in "*!.")
    first = next(content, (1, ""))
    if not re.fullmatch(rf"{_FORMAT}\s+2\.\d", first[1]):
        cure = "; export it as DCM 2.0" if first[1].startswith(_FORMAT) else ""
        raise InputError(
            f'{path}, line {first[0]}: a DCM file begins with {_FORMAT} 2.0, and this one with "{first[1][:40]}"{cure}.'
        )
    tables: dict[str, MapTable] = {}
    for number, line in content:
        words = line.split()
        if re.fullmatch(r"(FEST|GRUPPEN)?KENNFELD", words[0]):
            if len(tables) + len(foreign) == MOST_MAPS:
                raise InputError(f"{path}, line {number}: there are more than the {MOST_MAPS} maps that are read.")
            table = _read_map(path, number, words, content)
            if isinstance(table, str):
                foreign[words[1]] = f"{table}, line {number}"
            elif tables.setdefault(table.label, table) is not table:
                foreign[table.label] = f"its label is repeated, line {number}"
    return [table for label, table in tables.items() if label not in foreign]


def _read_map(path: Path, start: int, words: Sequence[str], content: Iterable[tuple[int, str]]) -> MapTable | str:
    """Read a map up to its END; return the reason if it is not a table of numbers over numbers."""
    if len(words) != 4 or not all(word.isascii() and word.isdecimal() for word in words[2:]):
        raise InputError(f"{path}, line {start}: expected {words[0]} NAME NX NY.")
    if max(map(len, words[2:])) > len(str(MOST_VALUES)):  # Python refuses to read thousands of digits
        digits = max(map(len, words[2:]))
        raise InputError(f"{path}, line {start}: a size has {digits} digits, and 1 to {MOST_VALUES} values are read.")
    nx, ny = int(words[2]), int(words[3])
    if not 0 < nx * ny <= MOST_VALUES:
        raise InputError(f"{path}, line {start}: the map has {nx} × {ny} values, and 1 to {MOST_VALUES} are read.")
    texts: dict[str, str] = {}
    decimals = 0
    counts = {"ST/X": nx, "ST/Y": ny, "WERT": nx * ny}
    numbers: dict[str, list[float]] = {word: [] for word in counts}
    foreign = ""
    for number, line in content:
        word, rest = [*line.split(None, 1), ""][:2]  # at any white space, no-break spaces too
        if word == "END":
            if foreign:
                return foreign
            for key, count in counts.items():
                if len(numbers[key]) != count:
                    raise InputError(
                        f"{path}, line {start}: the map {words[1]} has {len(numbers[key])} numbers in its {key} lines, "
                        f"and {count} are expected for {nx} × {ny}."
                    )
            if any(np.any(np.diff(numbers[key]) <= 0.0) for key in ("ST/X", "ST/Y")):
                return "its support points do not increase"
            return _table(words[1], (ny, nx), texts, numbers, decimals)
        if word in _FOREIGN:
            foreign = _FOREIGN[word]
        elif word in numbers:
            numbers[word] += _floats(path, number, rest)
            if word == "WERT":
                places = (-int(Decimal(text).as_tuple().exponent) for text in rest.split())
                decimals = min(max([decimals, *places]), MOST_DECIMALS)
            if len(numbers[word]) > counts[word]:  # limits the memory for a file of such lines
                raise InputError(
                    f"{path}, line {number}: the {word} lines of the map {words[1]} hold more than the {counts[word]} "
                    f"numbers that are expected for {nx} × {ny}."
                )
        else:
            texts[word] = rest.strip().strip('"')
    raise InputError(f"{path}, line {start}: the map {words[1]} has no END; the file is cut.")


def _floats(path: Path, number: int, text: str) -> list[float]:
    try:
        values = [read_decimal(word) for word in text.split()]
    except ValueError as error:
        raise InputError(f'{path}, line {number}: "{text.strip()[:40]}" are not numbers.') from error
    if not all(map(math.isfinite, values)):
        raise InputError(f"{path}, line {number}: a number is not finite.")
    return values


def _table(
    label: str, shape: tuple[int, int], texts: Mapping[str, str], numbers: Mapping[str, list[float]], decimals: int
) -> MapTable:
    x, y = (Axis(axis, texts.get(f"EINHEIT_{axis}", ""), np.array(numbers[f"ST/{axis}"])) for axis in "XY")
    values, states = np.array(numbers["WERT"]).reshape(shape), (("",) * shape[1],) * shape[0]
    name, unit = texts.get("LANGNAME", ""), texts.get("EINHEIT_W", "")
    return MapTable(label, name, "value", unit, x, y, values, states, decimals=decimals)
