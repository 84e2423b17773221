"""Text from disk: decoded, with its lines limited, and one sentence for each way in which it is no text."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

from commonrail.errors import InputError
from commonrail.reading.guarded_file import read_plain

__all__ = ["LONGEST_LINE", "read_bytes", "read_lines", "read_text"]

LONGEST_LINE = 100_000  # [bytes]; of a table with a thousand columns

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def read_text(path: Path, largest: int) -> str:
    """Text of a UTF-8 file of at most `largest` bytes, line ends as ``"\\n"``.

    Raises
    ------
    InputError
        As `read_bytes`, or if it is not UTF-8 text.
    """
    return _decoded(path, read_bytes(path, largest), 1)


def read_lines(path: Path, largest: int, encoding: str = "") -> Iterator[str]:
    """Lines of a text file of at most `largest` bytes, without their ends; decoded one by one, to save memory.

    Parameters
    ----------
    path : Path
    largest : int
    encoding : str
        UTF-8 if empty.

    Raises
    ------
    InputError
        As `read_bytes`, or if a line is too long or not text in that encoding.
    """
    data = _recoded(path, largest, encoding) if encoding else read_bytes(path, largest)
    for number, ended in enumerate(BytesIO(data), start=1):
        line = ended.removesuffix(b"\n")
        if len(line) > LONGEST_LINE:
            raise InputError(
                f"{path}, line {number}: the line has {len(line)} characters, more than the {LONGEST_LINE} that are "
                "read; keep only the columns that are needed."
            )
        yield _decoded(path, line, number)


def read_bytes(path: Path, largest: int) -> bytes:
    """Bytes of a text file, without byte order mark and with line ends as ``"\\n"``.

    Raises
    ------
    InputError
        As `read_plain`, or if it is not text.
    """
    data = read_plain(path, largest)
    if data.startswith(_UTF16):
        raise InputError(f'{path}: this is UTF-16 text; state encoding = "utf-16", or save it as UTF-8.')
    if b"\0" in data:
        raise InputError(f"{path}: this is not a text file; save it as UTF-8 text.")
    return data.removeprefix(_BYTE_ORDER_MARK).replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def _decoded(path: Path, data: bytes, first: int) -> str:
    """Text of lines of which the first has that number."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = first + data[: error.start].count(b"\n")
        byte = data[error.start]
        raise InputError(
            f"{path}, line {line}: byte 0x{byte:02x} is not UTF-8 text; save the file as UTF-8, or state its encoding."
        ) from error


def _recoded(path: Path, largest: int, encoding: str) -> bytes:
    """Text in another encoding as UTF-8, line ends as ``"\\n"``."""
    data = read_plain(path, largest)
    try:
        text = data.decode(encoding)
    except UnicodeError as error:
        raise InputError(f"{path}: this is no text in {encoding}; correct the encoding.") from error
    if "\0" in text:
        raise InputError(f"{path}: read in {encoding} this is no text; correct the encoding.")
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n").encode("utf-8", "replace")
