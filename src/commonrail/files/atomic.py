"""Output that is there whole or not at all: written beside its place, then moved there."""

from __future__ import annotations

import csv
import os
import secrets
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Literal

from commonrail.errors import OutputError
from commonrail.reading.formulas import neutralised, neutralised_note

__all__ = ["PART", "check_target", "replacing", "write_csv", "write_text", "writing"]

PART = ".part"  # end of the name of a file that is being written


@contextmanager
def writing(path: Path, option: str = "") -> Iterator[None]:
    """Turn an operating system's error while writing into a sentence.

    Parameters
    ----------
    path : Path
    option : str
        Option of the command line that named it.

    Raises
    ------
    OutputError
        If the disk is full, there is no permission, or for any other reason.
    """
    try:
        yield
    except OSError as error:
        place = f"{option}: {path}" if option else f"{path}"
        reason = error.strerror or type(error).__name__
        raise OutputError(f"{place} cannot be written ({reason}); make room there or name another place.") from error


@contextmanager
def replacing(path: Path, mode: Literal["w", "wb"] = "w") -> Iterator[IO[Any]]:
    """Stream to a file that takes the place of `path` at the end of the block, unless the block ends in an error.

    A crash or a full disk leaves what was at `path` before; a power cut leaves that or the new file, never a part.

    Raises
    ------
    OutputError
        If it cannot be written, or `path` is a symbolic link, a device or a folder.
    """
    with writing(path):
        check_target(path)
        part = path.with_name(f".{path.name}.{secrets.token_hex(6)}{PART}")
        text: dict[str, Any] = {} if mode == "wb" else {"encoding": "utf-8", "newline": ""}
        try:
            with open(part, mode, opener=_create, **text) as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(part, path)
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise
        _settle(path.parent)


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all.

    Raises
    ------
    OutputError
        As `replacing`.
    """
    with replacing(path) as stream:
        stream.write(text)


def write_csv(path: Path, notes: Iterable[str], header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Write a table, whole or not at all; `OutputError` as `replacing`.

    This is where tables are written: a text that a spreadsheet would compute is neutralised, and `CsvFile` with `plain`
    reads it back as it was.

    Parameters
    ----------
    path : Path
    notes : iterable of str
        Comment lines above the header.
    header : sequence of str
        Names of the columns with their units.
    rows : iterable of sequences of str
    """
    with replacing(path) as stream:
        stream.writelines(f"# {neutralised_note(note)}\n" for note in notes)
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(map(neutralised, header))
        writer.writerows(map(neutralised, row) for row in rows)


def check_target(path: Path) -> None:
    """Refuse a place where no file should be put.

    Raises
    ------
    OutputError
        If it is a symbolic link, a device or a folder.
    """
    # a link in a folder that others can write to may point at anything
    if path.is_symlink():
        raise OutputError(f"{path}: this is a symbolic link, which is not followed; remove it or name another place.")
    if path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "no plain file"
        raise OutputError(f"{path}: this is {kind}; name a file.")


def _create(path: str, flags: int) -> int:
    """Open a file that is not there yet: what somebody has put in its place is not followed."""
    return os.open(path, flags | os.O_EXCL, 0o666)


def _settle(folder: Path) -> None:
    """See that the move is on disk too, where the system can tell."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
