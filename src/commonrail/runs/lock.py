"""One process at a time in a folder: locks of the operating system, which end with the process however that ends.

A lock file can be removed, and its folder renamed, while a process is at work. So the folder itself is locked too,
where the system can do that, and its handle is kept: it tells whether the folder's name still leads to it.
"""

from __future__ import annotations

import errno
import os
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType

from commonrail.base.errors import CommonrailError, OutputError, StudyError
from commonrail.base.output import check_target

# Errors of SQLite as sentences.

# Primary result codes that mean that the disk, not the file's content, is at fault.
_DISK = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CANTOPEN)

# What reading numbers of the wrong kind or length raises.
UNTRUE = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)


@contextmanager
def check_trust(path: Path) -> Iterator[None]:
    """Raise `StudyError` if the content of a journal was changed."""
    try:
        yield
    except UNTRUE as error:
        raise StudyError(f"{path}: the journal is damaged ({type(error).__name__}); use an intact copy.") from error


@contextmanager
def explain_errors(path: Path) -> Iterator[None]:
    """Turn an error of SQLite on a file into a sentence.

    `OutputError` if the disk is full, or the file cannot be written or made; `StudyError` if it is not what it should
    be.
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
    return StudyError(f"{path}: this cannot be read as a journal ({error}); use an intact copy.")


def refuse_rollback(path: Path) -> None:
    """Raise `StudyError` for a rollback journal. Runs leave none, and SQLite would delete the file that it names."""
    rollback = path.with_name(f"{path.name}-journal")
    with suppress(FileNotFoundError):
        if not rollback.lstat().st_size:  # the lock of earlier versions
            return
        raise StudyError(
            f"{rollback}: this file does not belong to a run, and SQLite could delete other files because of it; "
            "remove it, or take a copy of the folder without it."
        )


fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # Windows, where a folder in use cannot be renamed
    fcntl = None

TRIES, PAUSE = 10, 0.05  # attempts to lock a folder, and pause between them [s]; a reader holds it briefly


class Lock:
    """Lock that this process holds until it is closed; uses SQLite's locking, which works on every system.

    The file stays empty. `BlockingIOError` if somebody else holds it, `OutputError` if it cannot be made, or is a link
    or a device; `StudyError` if it is not empty, or has a rollback journal next to it.
    """

    def __init__(self, path: Path) -> None:
        check_target(path)
        refuse_rollback(path)
        if path.exists() and path.stat().st_size:
            raise StudyError(f"{path}: a lock is an empty file, and this one is not; remove it.")
        if path.exists() and not os.access(path, os.W_OK):  # SQLite would open the file read-only and not lock it
            raise OutputError(f"{path} cannot be written (no permission); copy the folder and go on from the copy.")
        self._path, self._handle, self._by_handle = path, *_hold(path.parent, TRIES)
        try:
            self._lock_file(path)
        except BaseException:
            self._release()
            raise

    def _lock_file(self, path: Path) -> None:
        with explain_errors(path):
            self._connection = sqlite3.connect(path, isolation_level=None, timeout=0.5)  # who only looks is quick
            try:
                self._connection.execute("PRAGMA journal_mode=MEMORY")  # no further file next to it
                self._connection.execute("BEGIN EXCLUSIVE")
            except sqlite3.OperationalError as error:
                self._connection.close()
                if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY:
                    raise
                _refuse_without_locks(path)
                raise BlockingIOError(str(path)) from None

    @property
    def is_in_place(self) -> bool:
        """Return whether the folder's name still leads to the folder that is locked, and nobody else can lock it."""
        if self._handle is None:
            return True
        try:
            here = os.path.samestat(os.fstat(self._handle), self._path.parent.stat())
        except OSError:
            return False
        return here and (self._by_handle or self._path.is_file())

    def check_place(self) -> None:
        """Refuse (`StudyError`) to write into what has taken the folder's place since it was locked."""
        if not self.is_in_place:
            raise StudyError(
                f"{self._path.parent}: the folder was renamed, moved or replaced, or its lock removed, while this "
                "process was at work in it; nothing more is written here. Resume it where it is now: what was done is "
                "in it."
            )

    def close(self) -> None:
        """Release it."""
        self._connection.close()
        self._release()

    def _release(self) -> None:
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def _refuse_without_locks(path: Path) -> None:
    """Refuse (`OutputError`) a file system without locks, which SQLite reports as a file that somebody else holds."""
    if fcntl is None:
        return
    with path.open("rb+") as file:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno == errno.ENOLCK:
                raise OutputError(
                    f"{path}: the file system gives no locks ({error.strerror}), as a network drive without them; put "
                    "the run on a local disk."
                ) from None


def is_folder_held(folder: Path) -> bool:
    """Return whether a process holds a folder by its handle."""
    try:
        handle, _ = _hold(folder, tries=1)
    except BlockingIOError:
        return True
    if handle is not None:
        os.close(handle)
    return False


def _hold(folder: Path, tries: int) -> tuple[int | None, bool]:
    """Handle of a folder, None where a system has no such thing, and whether the folder is locked by it.

    `BlockingIOError` if another process holds the folder, even for reading, at each of `tries` attempts.
    """
    if fcntl is None:
        return None, False
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        return None, False
    for left in reversed(range(tries)):
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return handle, True
        except BlockingIOError:
            if not left:
                os.close(handle)
                raise
            time.sleep(PAUSE)
        except OSError:  # a file system without such locks
            break
    return handle, False
