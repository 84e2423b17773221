"""One process at a time in a folder: a lock of the operating system, which ends with the process however that ends."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from commonrail.files.atomic import check_target
from commonrail.store.faults import explained

__all__ = ["Lock"]


class Lock:
    """A lock that this process holds until it is closed.

    SQLite's own locking serves, since it works on every system; the file stays empty.

    Parameters
    ----------
    path : Path

    Raises
    ------
    BlockingIOError
        If somebody else holds it.
    OutputError
        If the file cannot be made, or is a link or a device.
    """

    def __init__(self, path: Path) -> None:
        check_target(path)
        with explained(path):
            self._connection = sqlite3.connect(path, isolation_level=None, timeout=0.5)  # who only looks is quick
            try:
                self._connection.execute("BEGIN EXCLUSIVE")
            except sqlite3.OperationalError as error:
                self._connection.close()
                if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY:
                    raise
                raise BlockingIOError(str(path)) from None

    def close(self) -> None:
        """Give it free."""
        self._connection.close()
