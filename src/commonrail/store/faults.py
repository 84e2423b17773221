"""Errors of SQLite as sentences."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from commonrail.errors import CommonrailError, OutputError, StudyError

__all__ = ["UNTRUE", "explained", "trusted"]

# Primary result codes that mean that the disk, not the file's content, is at fault.
_DISK = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CANTOPEN)

# What reading numbers of the wrong kind or length raises.
UNTRUE = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)


@contextmanager
def trusted(path: Path) -> Iterator[None]:
    """Say so if what a journal holds is not what was written.

    Raises
    ------
    StudyError
        In place of any error that comes of a damaged file.
    """
    try:
        yield
    except UNTRUE as error:
        raise StudyError(
            f"{path}: the journal is damaged ({type(error).__name__}); take a copy of it that is whole."
        ) from error


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn an error of SQLite on a file into a sentence.

    Raises
    ------
    OutputError
        If the disk is full, or the file cannot be written or made.
    StudyError
        If the file is not what it should be.
    """
    try:
        yield
    except sqlite3.Error as error:
        raise _sentence(path, error) from error


def _sentence(path: Path, error: sqlite3.Error) -> CommonrailError:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return StudyError(f"{path}: another program has it open; close it there, then go on.")
    if code in _DISK:
        return OutputError(
            f"{path} cannot be written ({error}); what was done before is kept: make room or copy the folder to "
            "another place, then go on from it."
        )
    return StudyError(f"{path}: this cannot be read as a journal ({error}); take a copy of it that is whole.")
