"""Tables of a journal: how a new one gets them, and whether a file has them."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from commonrail.errors import StudyError

VERSION = 1  # of the tables of all journals, which SQLite keeps in the file as user_version


@dataclass(frozen=True)
class Schema:
    """Tables of one kind of journal.

    Attributes
    ----------
    text : str
        SQL that makes them; the last column of each is the row's seal.
    foreign : str
        Sentence for a file with other tables: {path}.
    """

    text: str
    foreign: str

    @cached_property
    def tables(self) -> dict[str, str]:
        """SQL of each table by name, without comments and spaces."""
        with closing(sqlite3.connect(":memory:")) as connection:
            connection.executescript(self.text)
            return _tables(connection)

    def create(self, connection: sqlite3.Connection) -> None:
        """Make the tables in an empty file."""
        connection.executescript(f"BEGIN; {self.text} PRAGMA user_version = {VERSION}; COMMIT;")

    def check(self, connection: sqlite3.Connection, path: Path) -> bool:
        """Whether a file holds the tables; False if it is empty.

        Raises
        ------
        StudyError
            If another version of commonrail wrote it, or it is another kind of file.
        """
        (version,) = connection.execute("PRAGMA user_version").fetchone()
        if version not in (0, VERSION):
            raise StudyError(f"{path} was left by another version of commonrail; calibrate again.")
        if (tables := _tables(connection)) != (self.tables if version else {}):
            raise StudyError(self.foreign.format(path=path))
        return bool(tables)


def _tables(connection: sqlite3.Connection) -> dict[str, str]:
    found = connection.execute("SELECT name, sql FROM sqlite_master WHERE sql NOT NULL")
    return {str(name): re.sub(r"--.*|\s+", "", str(text)) for name, text in found}
