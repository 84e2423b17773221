"""Channels of a LabVIEW measurement file (.lvm), a text whose header gives start and spacing of the samples.

Source: National Instruments, "Specification for the LabVIEW Measurement File (.lvm)". Samples are evenly spaced by that
specification: times are X0 + n Delta_X; the columns of x, which have six digits, are not read.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from commonrail.base.errors import InputError
from commonrail.base.input import LARGEST_FILE
from commonrail.base.units import convert, fits, read_decimal
from commonrail.readers.columns import PLAIN, Channel, ChannelSheet, FileForm
from commonrail.readers.location import MOST_VALUES, Place, check_columns
from commonrail.readers.text import number_lines, read_encoded

_MAGIC, _END, _COMMENT = "LabVIEW Measurement", "***End_of_Header***", "Comment"
_SEPARATORS = {"tab": "\t", "comma": ",", "": "\t"}
_DECIMALS = ("", ".", ",")
_FINEST = 1e-3  # largest rounding of times, as a share of a step; it has no effect on a fit
_X_TITLE = "X_Value"
_TAGS = [
    "Separator",
    "Decimal_Separator",
    "Channels",
    "Samples",
    "X_Dimension",
    "X_Unit_Label",
    "Y_Unit_Label",
    "X0",
    "Delta_X",
]

Rows = Iterator[tuple[int, list[str]]]


class LvmFile(ChannelSheet):
    """LabVIEW measurement file of one segment, a `Sheet` with independent columns.

    `form`: encoding; the header states the decimal sign. Raises `InputError` if it cannot be read, has several
    segments, or its header lacks what says where the samples are.
    """

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        data, encoding = read_encoded(path, LARGEST_FILE, form.encoding)
        self.said = f"encoding {encoding}"
        lines = number_lines(path, data)
        _, first = next(lines, (0, ""))
        if not first.startswith(_MAGIC):
            raise InputError(f'{path}: this is no LabVIEW measurement file; its first line must be "{_MAGIC}".')
        head = _header(path, ((n, text.split("\t" if "\t" in text else ",")) for n, text in lines))
        separator = _SEPARATORS.get(_first(head, "Separator").lower())
        decimal = _first(head, "Decimal_Separator")
        if separator == "," and not decimal and "Decimal_Separator" in head:
            decimal = ","  # the decimal comma was read as a separator
        if separator is None or decimal not in _DECIMALS or separator == decimal:
            raise InputError(f"{path}: separator or decimal sign of the header is none that LabVIEW writes.")
        rows = ((n, text.split(separator)) for n, text in lines)
        segment = _header(path, rows)
        super().__init__(path, _channels(path, rows, segment, decimal or "."))


def _header(path: Path, rows: Rows) -> dict[str, list[str]]:
    """Used tags of a header with their cells, up to the end of the header."""
    cells_of_tags: dict[str, list[str]] = {}
    for _, (tag, *cells) in rows:
        if tag == _END:
            return cells_of_tags
        if tag in _TAGS:
            cells_of_tags[tag] = [cell.strip() for cell in cells]
    raise InputError(f'{path}: the file ends before the header does, which ends with "{_END}" twice.')


def _first(head: dict[str, list[str]], tag: str) -> str:
    return (head.get(tag) or [""])[0]


def _channels(path: Path, rows: Rows, segment: dict[str, list[str]], decimal: str) -> list[Channel]:
    """Channels below the header of a segment."""
    _, titles = next(rows, (0, []))
    # an x column precedes each channel, or one x column, which may be blank, precedes all channels
    places = [i for i, title in enumerate(titles) if i and title.strip() not in (_X_TITLE, _COMMENT, "")]
    if not places or _first(segment, "Channels") != str(len(places)):
        raise InputError(
            f"{path}: the header has {_first(segment, 'Channels') or 'no number of'} channels, and {len(places)} have "
            "a name above their numbers."
        )
    check_columns(str(path), len(places))
    columns = _numbers(path, rows, places, decimal)
    channels = []
    for place, column in zip(places, columns, strict=True):
        # values of a header stand above the column of their channel
        name, at = titles[place].strip(), Place(str(path), f'channel "{titles[place].strip()}"')
        tags = {tag: cells[place - 1] if place <= len(cells) else "" for tag, cells in segment.items()}
        if tags.get("X_Dimension", "Time") not in ("Time", ""):
            raise at.error(f"its x axis is {tags['X_Dimension']}, and time is expected")
        if tags.get("Samples") != str(len(column)):
            raise at.error(
                f"the header announces {tags.get('Samples') or 'no number of'} samples, and {len(column)} follow; "
                "write one segment, whole, into a file"
            )
        start, step = _raster(tags, decimal, at)
        unit = tags.get("Y_Unit_Label", "")
        times = np.asarray(start + step * np.arange(len(column)), np.float64)
        channels.append(Channel(name, "", unit, _X_TITLE, times, np.array(column, np.float64), ""))
    return channels


def _raster(tags: dict[str, str], decimal: str, at: Place) -> tuple[float, float]:
    """First time and spacing of a channel [s]."""
    unit = tags.get("X_Unit_Label", "")
    if unit and not fits(unit, "s"):
        raise at.error(f'X_Unit_Label is "{unit}", and a unit of time is expected')
    start, step = (convert(_number(tags.get(tag, ""), decimal), unit or "s", "s") for tag in ("X0", "Delta_X"))
    if not step > 0.0 or not np.isfinite(start):
        raise at.error(
            f'the header has no X0 and Delta_X with the decimal sign "{decimal}", which say where the samples are'
        )
    if np.spacing(abs(start)) > _FINEST * step:
        raise at.error(
            f"X0 = {start:g} s is a date, so steps of {step:g} s are rounded; write the time from the begin of the "
            "record, such as 0"
        )
    return start, step


def _numbers(path: Path, rows: Rows, places: Sequence[int], decimal: str) -> list[array[float]]:
    """Samples of each channel; a shorter one has blank cells below its last."""
    columns = [array("d") for _ in places]
    targets = list(zip(places, columns, strict=True))
    count = 0
    for line, row in rows:
        if row[0] == "Channels":
            raise InputError(f"{path}, line {line}: a second segment begins here; write each into a file of its own.")
        count += len(row)
        if count > MOST_VALUES:
            raise InputError(f"{path}: the file has more than the {MOST_VALUES} cells that are read; cut the record.")
        for place, column in targets:
            if place >= len(row):
                break  # the rest of the row is blank
            if cell := row[place].strip():
                column.append(_number(cell, decimal))
    return columns


def _number(cell: str, decimal: str) -> float:
    """Number of a cell; NaN for anything else."""
    try:
        return read_decimal(cell.replace(decimal, "."))
    except ValueError:
        return np.nan
