"""Tables of a journal: which there are in each schema, and how those of an older one become those of the next."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from commonrail.errors import StudyError

__all__ = ["Schema", "Version"]


class Version(NamedTuple):
    """A schema of a journal.

    Attributes
    ----------
    tables : frozenset of str
    make : str or callable
        SQL, or a function of the connection, that brings a journal of the schema before to this one; it is never
        changed once it was released.
    """

    tables: frozenset[str]
    make: str | Callable[[sqlite3.Connection], None]


@dataclass(frozen=True)
class Schema:
    """The schemas of one kind of journal.

    Attributes
    ----------
    versions : tuple of Version
        The first one is made from an empty file.
    newer : str
        Sentence for a journal of a later version: {path}, {found}, {known}.
    foreign : str
        Sentence for a file with other tables: {path}.
    """

    versions: tuple[Version, ...]
    newer: str
    foreign: str

    @property
    def version(self) -> int:
        """Number of this version's schema."""
        return len(self.versions)

    def migrate(self, connection: sqlite3.Connection, path: Path) -> None:
        """Bring a journal, or an empty file, to this version's schema.

        Raises
        ------
        StudyError
            If a newer version wrote it, or it is none.
        """
        self._bring(connection, self.check(connection, path), self.version)

    def _bring(self, connection: sqlite3.Connection, found: int, wanted: int) -> None:
        for number in range(found, wanted):
            make = self.versions[number].make
            done = f"PRAGMA user_version = {number + 1}"
            if isinstance(make, str):
                connection.executescript(f"BEGIN; {make} {done}; COMMIT;")
                continue
            connection.execute("BEGIN IMMEDIATE")
            try:
                make(connection)
                connection.execute(done)
                connection.execute("COMMIT")
            except BaseException:
                if connection.in_transaction:
                    connection.execute("ROLLBACK")
                raise

    def check(self, connection: sqlite3.Connection, path: Path) -> int:
        """Schema of a journal; 0 of an empty file.

        Raises
        ------
        StudyError
            If this version does not know it.
        """
        found = int(connection.execute("PRAGMA user_version").fetchone()[0])
        if not 0 <= found <= self.version:
            raise StudyError(self.newer.format(path=path, found=found, known=self.version))
        expected = self.versions[found - 1].tables if found else frozenset()
        kinds = dict(connection.execute("SELECT name, type FROM sqlite_master WHERE sql NOT NULL"))
        if set(kinds) != expected or set(kinds.values()) > {"table"} or _columns(connection) != self._own(found):
            raise StudyError(self.foreign.format(path=path))
        return found

    def _own(self, version: int) -> list[tuple[str, str]]:
        """Tables of a version's new journal."""
        with closing(sqlite3.connect(":memory:", isolation_level=None)) as fresh:
            self._bring(fresh, 0, version)
            return _columns(fresh)


def _columns(connection: sqlite3.Connection) -> list[tuple[str, str]]:
    """Name of each table and the text that made it, without comments and spaces."""
    found = connection.execute("SELECT name, sql FROM sqlite_master WHERE sql NOT NULL ORDER BY name").fetchall()
    return [(str(name), re.sub(r"--.*|\s+", "", str(text))) for name, text in found]
