"""Text from disk, with one sentence for each way in which a file cannot be read.

A file may come from anywhere, so nothing about it is taken on trust: what it is, how large it is, how long its lines
are. `docs/howto/limits.md` lists the limits.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from glob import escape
from io import BytesIO
from pathlib import Path

from commonrail.errors import InputError, nearest

__all__ = ["LONGEST_LINE", "noting_files", "read_bytes", "read_lines", "read_plain", "read_text"]

LONGEST_LINE = 100_000  # [bytes]; of a table with a thousand columns

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFIFO: "a pipe"}


_noted: ContextVar[dict[Path, str] | None] = ContextVar("_noted", default=None)


@contextmanager
def noting_files() -> Iterator[dict[Path, str]]:
    """Absolute path and SHA-256 of every file that is read inside the block, in the order of reading."""
    noted: dict[Path, str] = {}
    token = _noted.set(noted)
    try:
        yield noted
    finally:
        _noted.reset(token)


def read_text(path: Path, largest: int) -> str:
    """Text of a UTF-8 file of at most `largest` bytes, line ends as ``"\\n"``.

    Raises
    ------
    InputError
        As `read_bytes`, or if it is not UTF-8 text.
    """
    return _decoded(path, read_bytes(path, largest), 1)


def read_lines(path: Path, largest: int) -> Iterator[str]:
    """Lines of a UTF-8 file of at most `largest` bytes, without their ends; decoded one by one, to save memory.

    Raises
    ------
    InputError
        As `read_bytes`, or if a line is too long or not UTF-8 text.
    """
    for number, ended in enumerate(BytesIO(read_bytes(path, largest)), start=1):
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
    if b"\0" in data:
        raise InputError(f"{path}: this is not a text file; save it as UTF-8 text.")
    return data.removeprefix(_BYTE_ORDER_MARK).replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def read_plain(path: Path, largest: int) -> bytes:
    """Bytes of a file of at most `largest` bytes, as they stand in it.

    Raises
    ------
    InputError
        If there is no such file, it is not a plain file, it is larger, or it may not be read.
    """
    try:
        data = _plain(path, largest)
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file{_similar(path)}.") from error
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: the file cannot be read ({reason}).") from error
    noted = _noted.get()
    if noted is not None:
        noted[Path(os.path.abspath(path))] = hashlib.sha256(data).hexdigest()
    return data


def _plain(path: Path, largest: int) -> bytes:
    """Bytes of a plain file; looked at before it is opened, because to open a device may do something."""
    _refuse_unless_plain(path, path.stat(), largest)
    # Neither waits for the other end of a pipe, should one have taken the file's place meanwhile.
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with open(handle, "rb") as stream:
        _refuse_unless_plain(path, os.fstat(handle), largest)
        data = stream.read(largest + 1)  # a file may grow, and those of the system say that they are empty
    if len(data) > largest:
        raise _too_large(path, f"more than {largest / 1e6:g} MB", largest)
    return data


def _refuse_unless_plain(path: Path, found: os.stat_result, largest: int) -> None:
    if not stat.S_ISREG(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "no plain file")
        raise InputError(f"{path}: this is {kind}, and a file is expected.")
    if found.st_size > largest:
        raise _too_large(path, f"{found.st_size / 1e6:.0f} MB", largest)


def _too_large(path: Path, size: str, largest: int) -> InputError:
    return InputError(
        f"{path}: the file has {size}, more than the {largest / 1e6:g} MB that are read; keep only what is needed."
    )


def _decoded(path: Path, data: bytes, first: int) -> str:
    """Text of lines of which the first has that number."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = first + data[: error.start].count(b"\n")
        byte = data[error.start]
        raise InputError(
            f"{path}, line {line}: byte 0x{byte:02x} is not UTF-8 text; save the file as UTF-8."
        ) from error


def _similar(path: Path) -> str:
    try:
        below = sorted(path.parent.glob(f"*/{escape(path.name)}"))
        if below:
            return f' (did you mean "{below[0].relative_to(path.parent).as_posix()}"?)'
        return nearest(path.name, sorted(entry.name for entry in path.parent.iterdir()))
    except OSError:
        return ""
