"""Columns of a file in any format, before their units are known."""

from __future__ import annotations

import codecs
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Protocol

import numpy as np
from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.errors import InputError, nearest
from commonrail.base.units import fits, is_everyday
from commonrail.physics.law import Domain
from commonrail.readers.location import LONGEST_NAME, Place
from commonrail.readers.toml import FileModel, fault

# Form of a data file that its bytes do not show: encoding and decimal sign of a text, sheet of a workbook.


class FileForm(NamedTuple):
    """Form of a file, as the caller states it.

    The encoding and the decimal sign, "." or ",", apply to a text, the sheet to a workbook. Defaults: UTF-8, a point
    unless it may separate thousands, the first sheet that is not empty.
    """

    encoding: str = ""
    decimal: str = ""
    sheet: str = ""


PLAIN = FileForm()

# Python encodings of host names and literals; files of measurements do not use them.
_NOT_OF_FILES = ("idna", "punycode", "raw-unicode-escape", "undefined", "unicode-escape", "unicode_escape")


def check_encoding(name: str, at: str) -> str:
    """Return the name of an encoding of texts.

    Raises `InputError` for an unknown name; `at`: place where the name was stated.
    """
    try:
        return _known_encoding(name)
    except PydanticCustomError as error:
        raise InputError(f"{at}: {error.message()}.", code="unknown-encoding", place=at) from error


def _known_encoding(name: str) -> str:
    try:
        codec = codecs.lookup(name)
    except (LookupError, ValueError):  # a null character
        raise fault(f'there is no encoding "{name}"; write utf-8, utf-16 or cp1252', code="unknown-encoding") from None
    if not getattr(codec, "_is_text_encoding", True) or codec.name in _NOT_OF_FILES:
        raise fault(f'"{name}" is no encoding of texts; write utf-8, utf-16 or cp1252', code="unknown-encoding")
    return name


class FormModel(FileModel):
    """Keys that state the form of the table's file."""

    encoding: Annotated[str, Field(max_length=40), AfterValidator(_known_encoding)] | None = None
    decimal: Literal[".", ","] | None = None
    sheet: str | None = None

    @property
    def form(self) -> FileForm:
        """The form that the keys state."""
        return FileForm(self.encoding or "", self.decimal or "", self.sheet or "")


MOST_SHOWN = 12  # names of a header


class Column(NamedTuple):
    """Column that is asked of a file."""

    name: str
    # SI unit of the values; of several units, the one of the column's dimension applies. Empty: the cells are texts
    unit: str | tuple[str, ...] = ""
    stated: str | None = ""  # unit for a file without units; None if the caller could state it and does not
    increasing: bool = False  # whether the values must increase from row to row, as a time does
    domain: Domain = Domain.ANY  # values outside are refused
    # whether every cell must hold a number; if not, an empty one is NaN, and without a domain also the word "nan"
    required: bool = True
    otherwise: str = ""  # unit if neither the file nor the caller states one; empty refuses the file
    stating: str = "the study"  # where a unit can be stated, e.g. an option; empty if only in the file

    @property
    def units(self) -> tuple[str, ...]:
        """Accepted SI units; empty for texts."""
        return (self.unit,) if isinstance(self.unit, str) and self.unit else tuple(self.unit)


@dataclass(frozen=True)
class Table:
    """Columns of a file."""

    path: Path
    columns: dict[str, Floats]  # numbers (rows,): in the units of the file from a `Sheet`, in SI from `read_columns`
    texts: dict[str, list[str]]  # columns without a unit
    written_units: dict[str, str]  # unit of each column as the file or whoever reads it states it, empty if nobody does
    rows: IndexArray  # (rows,): line in the file
    comments: tuple[str, ...] = ()  # without their sign
    row: str = "line"  # word for a row in messages
    units: dict[str, str] = field(default_factory=dict)  # SI units, where several kinds were allowed
    headings: dict[str, str] = field(default_factory=dict)  # the file's name of a column, if it differs

    def place(self, column: str, row: int) -> Place:
        """Place of a value, for a message."""
        return cell_place(self.path, int(self.rows[row]), self.headings.get(column, column), self.row)


class Sheet(Protocol):
    """File with named columns, in any format."""

    path: Path
    independent_columns: bool  # whether each column has its own times, and can be taken with them any number of times

    @property
    def names(self) -> Sequence[str]:
        """Names of the columns, without their units."""

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns in the units of the file; can be called only once, unless `independent_columns`."""


def find_unit(sheet: Sheet, name: str) -> str:
    """Unit of a column as the file states it; empty if it does not, or the format has no `unit`."""
    unit = getattr(sheet, "unit", None)
    return "" if unit is None else str(unit(name))


def cell_place(path: Path, row: int, column: str, word: str = "line") -> Place:
    """Place of a cell."""
    return Place(str(path), f'{word} {row}, column "{column}"')


LARGEST = 1e100  # number that is read from a file; the squares of larger numbers overflow


def finite(table: Table, columns: Sequence[Column], sentence: str) -> Table:
    """The table, refused with a sentence at the first number that is not finite or beyond `LARGEST`.

    NaN passes where no number is required.
    """
    for column in columns:
        if column.unit:
            values = table.columns[column.name]
            sound = np.abs(values) <= LARGEST
            wrong = np.flatnonzero(~sound if column.required else ~(sound | np.isnan(values)))
            if len(wrong):
                raise table.place(column.name, int(wrong[0])).error(sentence, code="not-finite")
    return table


_SUFFIX = re.compile(r"\s*(?:[/,]|\bin\b)\s*|\s+")  # between a name and a unit without brackets
_TIME = re.compile(r"(?:.*[^a-z])?(?:time|zeit|t)", re.I)


def name_and_unit(cell: str) -> tuple[str, str]:
    """Name and unit of a cell of a header; the unit may be empty.

    The unit is in square brackets, ``rate [mm3/ms]``. A common unit may also be in round brackets or after the name,
    ``rate (mm3/ms)``, ``ET us``, ``p / bar``, unless a number precedes it, as in "400 bar".
    """
    if cell.endswith("]") and "[" in cell:
        name, _, unit = cell[:-1].rpartition("[")
        return name.strip(), unit.strip()
    if len(cell) > LONGEST_NAME or is_everyday(cell):
        return cell, ""
    if cell.endswith(")"):
        for place in (i for i, sign in enumerate(cell) if sign == "("):
            name, unit = cell[:place].strip(), cell[place + 1 : -1].strip()
            if unit.upper() == "S" and _TIME.fullmatch(name):
                unit = "s"  # not siemens
            if is_everyday(unit) and unit != "1":
                return name, unit
        return cell, ""
    for match in _SUFFIX.finditer(cell):
        name, unit = cell[: match.start()], cell[match.end() :]
        is_sign = match[0].isspace() and len(unit) < 2  # "channel A"
        if name and not is_sign and not name[-1].isdigit() and name[-1] != "}" and unit != "1" and is_everyday(unit):
            return name, unit
    return cell, ""


def find_column(path: Path, names: Sequence[str], column: str, what: str = "") -> int:
    """Index of a column by its name, with or without the unit.

    `what`: purpose of the column, for messages. Raises `InputError` if the column is missing or occurs twice.
    """
    column = column if column in names else name_and_unit(column)[0]
    count = names.count(column)
    if count == 1:
        return names.index(column)
    if count > 1:
        raise InputError(
            f'{path}: the header has {count} columns "{column}"; rename one.',
            code="repeated",
            file=path,
            place=f'column "{column}"',
        )
    shown = ", ".join(f'"{name}"' for name in names[:MOST_SHOWN]) + (", …" if len(names) > MOST_SHOWN else "")
    raise InputError(
        f'{path}: there is no column "{column}"{what and f", {what}"}{nearest(column, names)}; the header has {shown}.',
        code="missing-column",
        file=path,
        place=f'column "{column}"',
    )


# Headings as people write them, in small letters without signs between words, by the names that the program knows.
HEADINGS: dict[str, tuple[str, ...]] = {
    "time": ("zeit", "t", "timestamp", "zeitstempel"),
    "rate": ("roi", "einspritzrate", "injectionrate", "rateofinjection", "einspritzverlauf"),
    "pressure": ("druck", "p", "raildruck", "prail", "railpressure", "systemdruck"),
    "rail_pressure": ("raildruck", "prail", "rail", "p", "druck", "pressure", "systemdruck", "railpressureactual"),
    "energising_time": (
        *("ansteuerdauer", "ansteuerzeit", "bestromungsdauer", "bestromungszeit", "et", "ti", "energizingtime"),
        *("energisingduration", "injectionduration", "pulsewidth", "ontime"),
    ),
    "quantity": ("menge", "einspritzmenge", "q", "injectedquantity", "injectionquantity", "foerdermenge", "hubmenge"),
    "command": ("ansteuerung", "ansteuersignal", "ttl", "trigger"),
    "start": ("beginn", "ansteuerbeginn", "startzeit", "soi", "soe"),
    "duration": ("dauer", "ansteuerdauer", "et", "energisingtime"),
    "test": ("pruefpunkt", "pruefschritt", "testpunkt", "testpoint", "teststep", "punkt"),
    "measure": ("messgroesse",),
    "second_energising_time": ("zweiteansteuerdauer",),
    "dwell": ("spritzabstand", "pause", "spritzpause"),
    "stroke_rate": ("hubfrequenz", "hubzahl"),
    "nominal": ("soll", "sollwert", "sollmenge", "nennwert", "nennmenge", "nominalquantity", "target"),
    "half_band": ("toleranz", "tolerance", "halbband"),
    "lower_limit": ("min", "minimum", "untergrenze", "unteregrenze", "unterergrenzwert"),
    "upper_limit": ("max", "maximum", "obergrenze", "oberegrenze", "oberergrenzwert"),
    "bench": ("ist", "istwert", "istmenge", "messwert", "gemessen", "measured", "actual"),
    "injector": ("injektor", "injectorid", "injektornummer", "seriennummer", "serialnumber"),
    "temperature": ("temperatur",),
    "density": ("dichte",),
    "viscosity": ("viskositaet",),
}
# Columns that are found by their unit if no heading matches.
BY_UNIT = ("time", "rate", "pressure", "rail_pressure", "energising_time", "quantity")
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})


BAND = "_band_"  # in the names of columns that hold an edge of a band next to the quantity


def is_heading(heading: str, name: str) -> bool:
    """Return whether a heading is usual for a column that the program knows by a name."""
    return _plain(heading) in (_plain(name), *HEADINGS.get(name, ()))


def _plain(heading: str) -> str:
    return re.sub(r"[\W_]", "", heading.lower().translate(_UMLAUTS))


def find_headings(sheet: Sheet, columns: Sequence[Column]) -> dict[str, str]:
    """Headings of the requested columns in a file, by column name; columns that the file lacks are omitted.

    An exact name takes precedence over a usual heading, and a usual heading over the only column with a suitable unit.
    """
    exact = {name: name for name in sheet.names}
    exact |= {f"{name} [{unit}]": name for name in sheet.names if (unit := find_unit(sheet, name))}
    headings = {column.name: exact[column.name] for column in columns if column.name in exact}
    columns = [
        column for column in columns if column.name in headings or not (sheet.independent_columns and column.increasing)
    ]
    for column in columns:
        usual = [name for name in sheet.names if name not in headings.values() and is_heading(name, column.name)]
        if column.name not in headings and column.name in HEADINGS and len(usual) == 1:
            headings[column.name] = usual[0]
    for column in columns:
        if column.name not in headings and column.name in BY_UNIT:
            free = [name for name in sheet.names if name not in headings.values() and BAND not in name]
            fitting = [name for name in free if any(fits(find_unit(sheet, name), kind) for kind in column.units)]
            if len(fitting) == 1:
                headings[column.name] = fitting[0]
    return {column.name: headings[column.name] for column in columns if column.name in headings}


# Channels of a record, each with its own times: shared by all formats of records.


TIME = "time"  # name of the times of any channel


class Channel(NamedTuple):
    """A channel: its group, unit, the name of its times, its arrays, its fault if it cannot be read, and a remark."""

    name: str
    group: str
    unit: str
    master: str
    time: Floats
    values: Floats
    fault: str
    remark: str = ""  # samples that are omitted, and the like


class ChannelSheet:
    """Channels as a `Sheet` with independent columns.

    A channel whose name occurs several times is named with its group.
    """

    independent_columns = True

    def __init__(self, path: Path, channels: Sequence[Channel]) -> None:
        self.path = path
        counts = Counter(channel.name for channel in channels)
        self._channels: dict[str, Channel] = {}
        for number, channel in enumerate(channels, start=1):
            full_name = channel.name if counts[channel.name] == 1 else f"{channel.group}/{channel.name}"
            self._channels[full_name if full_name not in self._channels else f"{full_name}, channel {number}"] = channel
        self.names = list(self._channels)

    def unit(self, name: str) -> str:
        """Unit of a channel, or empty."""
        return self._channels[name].unit

    def remark(self, name: str) -> str:
        """Remark on the content of a channel; may be empty."""
        return self._channels[name].remark

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of one channel and its times; see `Sheet.take`."""
        channels = [column for column in columns if not column.increasing]
        if len(channels) != 1:
            raise InputError(
                f"{self.path}: each channel of this record has its own times; name files one by one.",
                code="several-times",
                file=self.path,
            )
        name = self.names[find_column(self.path, self.names, channels[0].name)]
        channel = self._channels[name]
        for column in columns:
            if column.increasing and column.name not in (TIME, channel.master):
                raise InputError(
                    f'{self.path}: the times of "{name}" are called "{channel.master}", not "{column.name}"; write '
                    f'time = "{channel.master}" or "{TIME}".',
                    code="wrong-time",
                    file=self.path,
                )
        if channel.fault:
            raise Place(str(self.path), f'channel "{name}"').error(channel.fault, code="unusable-channel")
        numbers = {c.name: channel.time if c.increasing else channel.values for c in columns}
        written_units = {c.name: "s" if c.increasing else channel.unit for c in columns}
        table = Table(self.path, numbers, {}, written_units, np.arange(1, len(channel.time) + 1), row="sample")
        return finite(table, [column._replace(required=True) for column in columns], "the value is not a finite number")
