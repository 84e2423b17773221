"""The one way in which the program opens a file that others may have made: plain, of limited size, and fingerprinted.

A file may come from anywhere, so nothing about it is taken on trust. It is examined before and after it is opened, and
opening never waits: no device is touched and no pipe read. The hashed bytes are the parsed bytes.
`docs/howto/speed.md` lists the limits.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO
from zipfile import BadZipFile

from commonrail.base.errors import InputError, nearest
from commonrail.base.hooks import within

if TYPE_CHECKING:
    from numpy.typing import NDArray

LARGEST_FILE = 100_000_000  # [bytes]; only the reader of Parquet takes larger ones
UNREADABLE = "unreadable"  # in place of the SHA-256 of something that cannot be read as a file

_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFIFO: "a pipe"}

_noted: ContextVar[dict[Path, str] | None] = ContextVar("_noted", default=None)


@contextmanager
def noting_files() -> Iterator[dict[Path, str]]:
    """Absolute path and SHA-256 of every file that is read inside the block, in the order of reading."""
    noted: dict[Path, str] = {}
    with within(_noted, noted):
        yield noted


def sha256(content: bytes) -> str:
    """SHA-256 as text."""
    return hashlib.sha256(content).hexdigest()


def read_plain(path: Path, largest: int = LARGEST_FILE) -> bytes:
    """Bytes of a file of at most `largest` bytes, as they are in it.

    Raises `InputError` if there is no such file, it is not a plain file, it is larger, or it may not be read; or if it
    was read before inside the same `noting_files` and held other bytes then.
    """
    with _as_input_error(path), open_plain(path, largest) as stream:
        size = min(os.fstat(stream.fileno()).st_size, largest)
        data = stream.read(size + 1)  # as many bytes as are asked for are reserved before the first is read
        if len(data) > size:  # a file may grow, and system files report size 0
            data += stream.read(largest - size)
    if len(data) > largest:
        raise _too_large(path, f"more than {largest / 1e6:g} MB", largest)
    noted = _noted.get()
    if noted is not None:
        digest = sha256(data)
        if noted.setdefault(Path(os.path.abspath(path)), digest) != digest:
            raise InputError(f"{path}: the file was changed while it was read; start again.", code="changed", file=path)
    return data


@contextmanager
def open_plain(path: Path, largest: int = LARGEST_FILE) -> Iterator[BinaryIO]:
    """Stream of a plain file, which had at most `largest` bytes when it was opened.

    Raises `InputError` as `read_plain` does, except for a file that grows during reading.
    """
    with _as_input_error(path):
        check_plain(path, largest)
        # O_NONBLOCK: do not wait for the other end if a pipe has replaced the file in the meantime.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with open(handle, "rb") as stream:
        _refuse_unless_plain(path, os.fstat(handle), largest)
        yield stream


def check_plain(path: Path, largest: int | None = None) -> None:
    """Check that a path is a plain file without opening it: a device may act when opened, a pipe may wait.

    Raises `InputError` if it is a folder, device, pipe or socket, or a link to one, or larger than `largest` bytes.
    Raises `OSError` if there is nothing, or nothing that may be examined.
    """
    _refuse_unless_plain(path, path.stat(), largest)


def fingerprint(path: Path) -> str:
    """SHA-256 of a file; empty if missing or not permitted, `UNREADABLE` if not plain or too large."""
    try:
        return sha256(read_plain(path))
    except InputError as error:
        return UNREADABLE if error.__cause__ is None else ""


@contextmanager
def _as_input_error(path: Path) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(
            f"{path}: there is no such file{similar_names(path)}.", code="missing-file", file=path
        ) from error
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: the file cannot be read ({reason}).", code="unreadable", file=path) from error


def _refuse_unless_plain(path: Path, status: os.stat_result, largest: int | None) -> None:
    if not stat.S_ISREG(status.st_mode):
        kind = _KINDS.get(stat.S_IFMT(status.st_mode), "no plain file")
        study = path / "study.toml"
        meant = f' (did you mean "{study}"?)' if study.is_file() else ""
        raise InputError(f"{path}: this is {kind}, and a file is expected{meant}.", code="not-a-file", file=path)
    if largest is not None and status.st_size > largest:
        raise _too_large(path, f"{status.st_size / 1e6:.0f} MB", largest)


def _too_large(path: Path, size: str, largest: int) -> InputError:
    return InputError(
        f"{path}: the file has {size}, more than the {largest / 1e6:g} MB that are read; keep only what is needed.",
        code="too-large",
        file=path,
    )


def similar_names(path: Path) -> str:
    """Suggestion for a missing file, in parentheses, or empty."""
    try:
        below = sorted(path.parent.glob(f"*/{escape(path.name)}"))
        if below:
            return f' (did you mean "{below[0].relative_to(path.parent).as_posix()}"?)'
        return nearest(path.name, sorted(entry.name for entry in path.parent.iterdir()))
    except OSError:
        return ""


LARGEST_ARRAYS = 400_000_000  # [bytes]; five million draws of eight parameters


def read_arrays(path: Path, *needed: str) -> dict[str, NDArray[Any]]:
    """Arrays of a .npz file by their names.

    The sizes that the archive declares are looked at before anything is unpacked. Raises `InputError` if it is no such
    file, lacks an array that is `needed`, or is larger than `LARGEST_ARRAYS`.
    """
    import numpy as np

    try:
        with open_plain(path) as stream, np.load(stream, allow_pickle=False) as archive:
            size = sum(entry.file_size for entry in archive.zip.infolist())
            if size > LARGEST_ARRAYS:
                raise _too_large(path, f"{size / 1e6:.0f} MB when it is unpacked", LARGEST_ARRAYS)
            if missing := set(needed).difference(archive.files):
                raise InputError(
                    f"{path}: there is no array {min(missing)}; make the file again.", code="missing-array", file=path
                )
            return dict(archive)
    except (OSError, ValueError, EOFError, AttributeError, MemoryError, BadZipFile, zlib.error) as error:
        raise InputError(
            f"{path}: this is no file of arrays ({error}); make it again.", code="damaged", file=path
        ) from error


# Checksums of result files, in a file ``SHA256SUMS`` next to them that ``sha256sum -c SHA256SUMS`` reads too.

SUMS = "SHA256SUMS"
_LARGEST = 10_000_000  # [bytes]; a run lists its data files too
_LINE = re.compile("(?P<digest>[0-9a-f]{64})  (?P<name>.+?)\r?")


def check_sum(path: Path) -> None:
    """Refuse a changed file, as `check_sums`, if its folder has a checksum of it."""
    check_sums(path.parent, path.name)


def check_sums(folder: Path, *names: str) -> None:
    """Refuse a folder if a file has changed since its checksum was written.

    A missing file is left to its reader. `names`: files to check, by default all. Raises
    `InputError` for a changed file, or if the checksums cannot be read.
    """
    sums = folder / SUMS
    for name, written in read_sums(sums).items() if sums.is_file() else ():
        path = folder / name
        if (not names or name in names) and path.is_file() and digest(path) != written:
            raise InputError(
                f"{path}: this is not the file that was written: its SHA-256 is another than in {sums}; bring it back "
                "as it was, or make it again (`commonrail resume RUN` writes all results of a run), and if it was "
                "changed on purpose, copy it to another folder.",
                code="changed",
                file=path,
            )


def read_sums(sums: Path) -> dict[str, str]:
    """Digests in a file of checksums by the names of the files.

    Raises `InputError` if a line is not a digest, two spaces and a name.
    """
    digests = {}
    with within(_noted, None):  # checksums change with every result and are not inputs
        lines = os.fsdecode(read_plain(sums, _LARGEST)).removesuffix("\n")
    for i, line in enumerate(lines.split("\n") if lines else (), 1):
        parts = _LINE.fullmatch(line)
        if parts is None:
            raise InputError(
                f"{sums}, line {i}: expected the SHA-256 of a file, two spaces and its name; the checksums are "
                "damaged: take a copy of the run that is whole.",
                code="damaged",
                file=sums,
                place=f"line {i}",
            )
        digests[parts["name"]] = parts["digest"]
    return digests


def digest(path: Path) -> str:
    """SHA-256 of a file; `InputError` as `open_plain`, before a byte is read."""
    with open_plain(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()  # type: ignore[arg-type]
