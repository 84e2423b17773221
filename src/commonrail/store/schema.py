"""The journal's tables, and how a journal of an older version becomes one of this version."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from commonrail.errors import StudyError

__all__ = ["SCHEMA", "check_schema", "migrate"]

# Entry i brings a journal of schema i to schema i + 1; an entry is never changed once it was released. Arrays are the
# bytes of little-endian numbers: 64-bit floats, statuses 8-bit integers.
MIGRATIONS = (
    """
    CREATE TABLE about (
        name TEXT PRIMARY KEY,       -- created, title, study (as given, TOML), content, state, reason, holder
        text TEXT NOT NULL
    );
    CREATE TABLE input (
        name TEXT PRIMARY KEY,       -- of the copy, relative to the run folder
        origin TEXT NOT NULL,        -- path of the file that was copied
        original TEXT NOT NULL,      -- SHA-256 of that file
        copy TEXT NOT NULL           -- SHA-256 of the copy, whose paths may be others
    );
    CREATE TABLE session (
        number INTEGER PRIMARY KEY,
        started TEXT NOT NULL,       -- UTC
        ended TEXT,                  -- NULL: still at work, or killed
        process INTEGER NOT NULL,
        host TEXT NOT NULL,
        software TEXT NOT NULL       -- JSON: versions, processor
    );
    CREATE TABLE generation (
        number INTEGER PRIMARY KEY,  -- 0 is the initial population
        best REAL NOT NULL,          -- objective so far
        mean REAL NOT NULL,          -- of the finite ones of the population
        simulations INTEGER NOT NULL, -- injections so far
        seconds REAL NOT NULL,       -- so far
        trials BLOB NOT NULL,        -- (members, parameters), SI
        costs BLOB NOT NULL,         -- (members,)
        statuses BLOB NOT NULL       -- (members,), see engine/status.py; -1: not simulated
    );
    CREATE TABLE population (        -- one row: the members after the last generation
        generation INTEGER PRIMARY KEY,
        search TEXT NOT NULL,        -- JSON: the optimiser's state but for the arrays, failures by status
        members BLOB NOT NULL,       -- (members, parameters), unit coordinates
        costs BLOB NOT NULL,
        violations BLOB NOT NULL
    );
    CREATE TABLE refinement (
        number INTEGER PRIMARY KEY,  -- from 1
        start BLOB NOT NULL,         -- (parameters,), SI
        stop BLOB NOT NULL,
        cost REAL NOT NULL,
        simulations INTEGER NOT NULL,
        seconds REAL NOT NULL,
        hops TEXT NOT NULL           -- JSON: state of the generator of starts
    );
    """,
)
SCHEMA = len(MIGRATIONS)
_TABLES = {"about", "input", "session", "generation", "population", "refinement"}


def migrate(connection: sqlite3.Connection, path: Path) -> None:
    """Bring a journal, or an empty file, to this version's schema.

    Raises
    ------
    StudyError
        If a newer version wrote it.
    """
    for number in range(check_schema(connection, path), SCHEMA):
        connection.executescript(f"BEGIN; {MIGRATIONS[number]} PRAGMA user_version = {number + 1}; COMMIT;")


def check_schema(connection: sqlite3.Connection, path: Path) -> int:
    """Schema of a journal; 0 of an empty file.

    Raises
    ------
    StudyError
        If this version does not know it.
    """
    found = int(connection.execute("PRAGMA user_version").fetchone()[0])
    if not 0 <= found <= SCHEMA:
        raise StudyError(
            f"{path} has schema {found} and this version reads {SCHEMA} and older ones; use the version of commonrail "
            "that wrote it, or a newer one."
        )
    expected = set() if found == 0 else _TABLES
    tables = {
        name: kind for name, kind in connection.execute("SELECT name, type FROM sqlite_master WHERE sql NOT NULL")
    }
    if set(tables) != expected or set(tables.values()) > {"table"}:
        raise StudyError(f"{path} is not the journal of a run: it holds other tables; name the run's own folder.")
    return found
