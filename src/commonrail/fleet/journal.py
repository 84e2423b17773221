"""The journal of a fleet: one SQLite file that keeps every injector as soon as it is done."""

from __future__ import annotations

import json
import math
import os
import socket
import sqlite3
from collections.abc import Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from commonrail.errors import StudyError
from commonrail.files.atomic import check_target
from commonrail.store.faults import explained, trusted
from commonrail.store.lock import Lock

__all__ = ["FAILED", "FINISHED", "JOURNAL", "Entry", "Journal"]

JOURNAL, LOCK = "fleet.sqlite", "fleet.lock"
SCHEMA = 1
FINISHED, FAILED = "finished", "failed"

_TABLES = """
CREATE TABLE about (name TEXT PRIMARY KEY, text TEXT NOT NULL);
CREATE TABLE input (name TEXT PRIMARY KEY, fingerprint TEXT NOT NULL);
CREATE TABLE injector (
    name TEXT PRIMARY KEY,
    status TEXT NOT NULL,       -- finished or failed
    reason TEXT NOT NULL,       -- of a failure
    attempts INTEGER NOT NULL,
    inputs TEXT NOT NULL,       -- JSON: fingerprint of each of its data files
    record TEXT NOT NULL,       -- JSON: see task.calibrate_file
    seconds REAL NOT NULL,      -- processor time
    ended TEXT NOT NULL         -- UTC
);
"""


@dataclass(frozen=True)
class Entry:
    """What became of an injector.

    Attributes
    ----------
    name, status, reason : str
        `status` is "finished" or "failed".
    attempts : int
    inputs : mapping of str to str
        Fingerprint of each of its data files.
    record : mapping
        What `task.calibrate_file` returned; empty if it failed.
    seconds : float
        Processor time [s].
    """

    name: str
    status: str
    reason: str
    attempts: int
    inputs: Mapping[str, str]
    record: Mapping[str, Any]
    seconds: float


class Journal:
    """The journal in a folder, held by this process until it is closed; use it in a `with` block.

    Readable by others at any time. A transaction for each injector: what was written survives a killed process, and a
    power cut too.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    StudyError
        If another process holds it, or it is no journal that this version reads.
    OutputError
        If it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / JOURNAL
        try:
            self._lock = Lock(folder / LOCK)
        except BlockingIOError:
            raise StudyError(
                f"{folder}: another fleet is at work here ({self._holder()}); wait for it, or end it."
            ) from None
        try:
            check_target(self.path)
            with explained(self.path), trusted(self.path):
                self._connection = sqlite3.connect(self.path, timeout=30.0)
                self._connection.execute("PRAGMA journal_mode=WAL")
                self._connection.execute("PRAGMA synchronous=FULL")
                self._open()
                self._note("holder", f"process {os.getpid()} on {socket.gethostname()} since {_now()}")
        except BaseException:
            self._lock.close()
            raise

    def _holder(self) -> str:
        with suppress(sqlite3.Error), closing(sqlite3.connect(self.path)) as connection:
            row = connection.execute("SELECT text FROM about WHERE name = 'holder'").fetchone()
            return str(row[0]) if row else "it has just begun"
        return "it has just begun"

    def _open(self) -> None:
        (version,) = self._connection.execute("PRAGMA user_version").fetchone()
        if version == 0:
            self._connection.executescript(f"BEGIN; {_TABLES} PRAGMA user_version = {SCHEMA}; COMMIT;")
        elif version > SCHEMA:
            raise StudyError(
                f"{self.path}: the journal has schema {version} and this version reads {SCHEMA}; go on with the "
                "version of commonrail that began it."
            )

    def _note(self, name: str, text: str) -> None:
        with self._connection:
            self._connection.execute("INSERT OR REPLACE INTO about VALUES (?, ?)", (name, text))

    def inputs(self) -> dict[str, str]:
        """Fingerprints of what is common to all injectors, by name; empty for a new journal."""
        with explained(self.path), trusted(self.path):
            return dict(self._connection.execute("SELECT name, fingerprint FROM input"))

    def write_inputs(self, inputs: Mapping[str, str]) -> None:
        """Keep the fingerprints of a new fleet."""
        with explained(self.path), self._connection:
            self._connection.execute("DELETE FROM input")
            self._connection.executemany("INSERT INTO input VALUES (?, ?)", inputs.items())

    def entries(self) -> dict[str, Entry]:
        """All injectors that are done, by name."""
        columns = "name, status, reason, attempts, inputs, record, seconds"
        with explained(self.path), trusted(self.path):
            rows = self._connection.execute(f"SELECT {columns} FROM injector").fetchall()
            return {str(row[0]): _entry(row) for row in rows}

    def write(self, entry: Entry) -> None:
        """Keep an injector; one that is there is replaced."""
        texts = [json.dumps(part, sort_keys=True, allow_nan=False) for part in (entry.inputs, entry.record)]
        values = (entry.name, entry.status, entry.reason, entry.attempts, *texts, entry.seconds, _now())
        with explained(self.path), self._connection:
            self._connection.execute("INSERT OR REPLACE INTO injector VALUES (?, ?, ?, ?, ?, ?, ?, ?)", values)

    def close(self) -> None:
        """Give the folder free."""
        self._connection.close()
        self._lock.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _entry(row: tuple[Any, ...]) -> Entry:
    name, status, reason, attempts, inputs, record, seconds = row
    if status not in (FINISHED, FAILED) or not 0.0 <= seconds < math.inf:
        raise ValueError("an injector's state")
    fingerprints = {str(source): str(text) for source, text in json.loads(inputs).items()}
    return Entry(str(name), status, str(reason), int(attempts), fingerprints, dict(json.loads(record)), float(seconds))


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
