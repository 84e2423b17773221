"""Files that are read: places in them for messages, folders that they may lie in, limits of their size."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from commonrail.base.arrays import IndexArray
from commonrail.base.errors import CommonrailError, InputError, nearest_key
from commonrail.base.hooks import note
from commonrail.base.input import read_plain, similar_names

_FORMAT = re.compile(r"[a-z][a-z0-9-]{0,40}/[0-9]{1,3}")


@dataclass(frozen=True)
class Place:
    """A key in a file; ``place / "key"`` goes into a table, ``place[0]`` into a list.

    Lists count from 1 in the text, as people do.
    """

    file: str
    key: str = ""

    def __str__(self) -> str:
        return f"{self.file}, {self.key}" if self.key else self.file

    def __truediv__(self, key: str) -> Place:
        return Place(self.file, f"{self.key}.{key}" if self.key else key)

    def __getitem__(self, index: int) -> Place:
        return Place(self.file, f"{self.key}[{index + 1}]")

    def error(self, sentence: str, code: str = "") -> InputError:
        """Error that opens with this place."""
        return InputError(f"{self}: {sentence}.", code=code, file=self.file, place=self.key)

    def check_format(self, document: Mapping[str, Any], expected: str) -> None:
        """Refuse a document whose key ``format`` is not `expected`, and say so if it is a file of another kind."""
        stated, kind = document.get("format"), _describe_file(expected)
        if stated == expected:
            return
        if isinstance(stated, str) and _FORMAT.fullmatch(stated) and (other := _describe_file(stated)) != kind:
            raise self.error(
                f'this is {other} (format = "{stated}"), and {kind} is expected; name that file instead',
                code="other-file",
            )
        what = "format is missing" if stated is None else f"format is {stated!r}"
        raise self.error(f'{what}; {kind} begins with format = "{expected}"', code="wrong-format")

    def refuse_unknown(self, table: Mapping[str, Any], keys: Collection[str]) -> None:
        """Refuse the first key of a table that is not in `keys`, and suggest the nearest one."""
        for key in table:
            if key not in keys:
                raise self.error(f'there is no key "{key}"{nearest_key(key, keys)}', code="unknown-key")


def _describe_file(format_: str) -> str:
    """Words for a file of a format, as "a study file" of "commonrail-study/1"."""
    name = format_.partition("/")[0].removeprefix("commonrail-")
    return f"{'an' if name[:1] in 'aeiou' else 'a'} {name} file"


@contextmanager
def locate_errors(place: Place) -> Iterator[None]:
    """Put the place before the message of any error of the project raised inside."""
    try:
        yield
    except CommonrailError as error:
        file, key = (error.file, error.place) if error.file else (place.file, place.key or error.place)
        placed = type(error)(f"{place}: {str(error).removesuffix('.')}.", code=error.code, file=file, place=key)
        for line in getattr(error, "__notes__", ()):
            placed.add_note(line)
        raise placed from error


# Folder that the names in a file must not lead out of: a study from anywhere must not read foreign files.

ALLOW = "allow_outside"


@dataclass
class Reach:
    """Folder to which the file names in `file` are restricted, unless it allows others.

    The user has named `file`. The files that it names lie in its folder or below, unless it allows files `outside`. The
    first outside file is `announced`, because `file` may come from someone else.
    """

    file: Path
    outside: bool
    announced: bool = False
    opened: tuple[Any, ...] = ()  # path, form and content of the file with columns that was read last

    def path(self, folder: Path, name: str, at: Place) -> Path:
        """Path of a file named in a file of `folder`.

        Raises `InputError` if it lies outside, be it by its name or because it is a link, and that is not allowed; or
        if it does not exist.
        """
        path = folder / name
        # links are resolved in both paths, so that the folder may itself be a link
        inside = Path(os.path.realpath(path)).is_relative_to(os.path.realpath(self.file.parent))
        if not (self.outside or inside):
            shown = name if len(name) <= 80 else f"{name[:77]}..."
            raise at.error(
                f'"{shown}" lies outside the folder of {self.file.name}; move it there, or write {ALLOW} = true at the '
                f"top of {self.file.name} if you know where it comes from",
                code="outside-folder",
            )
        if not (inside or self.announced):
            note(f"{self.file}: {ALLOW} = true, so files elsewhere are read, such as {path}.")
            self.announced = True
        if not os.path.lexists(path) and name.isprintable():  # an impossible name is reported when it is read
            raise at.error(f"{path}: there is no such file{similar_names(path)}", code="missing-file")
        return path


# Limits of tables, checked row by row before anything is built of them.

Groups = dict[tuple[str, ...], IndexArray]

MOST_ROWS = 10_000_000  # of a fleet: many injectors with a curve each
MOST_COLUMNS = 1000
LONGEST_NAME = 200  # of a column [characters]
MOST_CELLS = 2_000_000  # of a grid that is held in memory cell by cell
LARGEST_RECTANGLE = 20_000_000  # rows × widest row of a grid, which is padded to a matrix
MOST_VALUES = 20_000_000  # of all channels of a text file, or of one variable


def check_columns(where: str, columns: int, most: int = MOST_COLUMNS) -> None:
    """Refuse too many columns; `where` is the file, with the line if there is one."""
    if columns > most:
        raise InputError(
            f"{where}: there are {columns} columns, and at most {most} are read; keep only those that are needed.",
            code="too-many",
        )


class Shape:
    """Rows and cells of a grid, counted while it is read.

    Messages call a row by the `word`.
    """

    def __init__(self, path: Path, word: str = "line") -> None:
        self._path, self._word = path, word
        self._rows = self._cells = self._widest = 0

    def add(self, width: int, number: int) -> None:
        """Count row `number` with `width` cells; InputError if this row or the whole table has too many."""
        check_columns(f"{self._path}, {self._word} {number}", width)
        self._rows, self._cells, self._widest = self._rows + 1, self._cells + width, max(self._widest, width)
        if self._cells > MOST_CELLS or self._rows * self._widest > LARGEST_RECTANGLE:
            raise InputError(
                f"{self._path}: the table has more than the {MOST_CELLS} cells that are read, or more than "
                f"{LARGEST_RECTANGLE} if all rows were as long as the longest; keep only what is needed.",
                code="too-many",
                file=self._path,
            )


# Text from disk: one sentence for each reason why it is not text.

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def read_text(path: Path, largest: int) -> str:
    """Text of a UTF-8 file of at most `largest` bytes, line ends as ``"\\n"``.

    Raises `InputError` as `read_bytes`, or if it is not UTF-8 text.
    """
    return decode_line(path, read_bytes(path, largest), 1)


def read_bytes(path: Path, largest: int) -> bytes:
    """Bytes of a text file, without byte order mark and with line ends as ``"\\n"``.

    Raises `InputError` as `read_plain`, or if it is not text.
    """
    data = read_plain(path, largest)
    if data.startswith(_UTF16):
        raise InputError(f"{path}: this is UTF-16 text; save it as UTF-8.", code="wrong-encoding", file=path)
    if b"\0" in data:
        raise InputError(f"{path}: this is not a text file; save it as UTF-8 text.", code="not-text", file=path)
    return plain_lines(data)


def plain_lines(data: bytes) -> bytes:
    """Bytes of a text without byte order mark and with line ends as ``"\\n"``."""
    return data.removeprefix(_BYTE_ORDER_MARK).replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def decode_line(path: Path, data: bytes, first: int) -> str:
    """Text of UTF-8 lines; `first`: number of the first line. `InputError` for another encoding."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = first + data[: error.start].count(b"\n")
        byte = data[error.start]
        raise InputError(
            f"{path}, line {line}: byte 0x{byte:02x} is not UTF-8 text; save the file as UTF-8.",
            code="wrong-encoding",
            file=path,
            place=f"line {line}",
        ) from error
