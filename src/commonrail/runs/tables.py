"""Tables of a journal, seals of rows, and states of optimisers as JSON with the bytes of their arrays."""

from __future__ import annotations

import hashlib
import json
import math
import re
import sqlite3
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.base.errors import StudyError
from commonrail.base.input import sha256

# Tables of a journal: creation and check.

VERSION = 1  # of the tables; SQLite stores it in the file as user_version


@dataclass(frozen=True)
class Schema:
    """Tables of one kind of journal: their SQL, and the message for a file with other tables ({path}).

    The last column of each table is the row's seal.
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
        """True if a file holds the tables; False if it is empty.

        `StudyError` if another version of commonrail wrote it, or it is another kind of file.
        """
        (version,) = connection.execute("PRAGMA user_version").fetchone()
        if version not in (0, VERSION):
            raise StudyError(f"{path} was left by another version of commonrail; calibrate again.")
        if (tables := _tables(connection)) != (self.tables if version else {}):
            raise StudyError(self.foreign.format(path=path))
        return bool(tables)


def _tables(connection: sqlite3.Connection) -> dict[str, str]:
    rows = connection.execute("SELECT name, sql FROM sqlite_master WHERE sql NOT NULL")
    return {str(name): re.sub(r"--.*|\s+", "", str(text)) for name, text in rows}


# Tables of a run's journal. Arrays are the bytes of little-endian numbers: 64-bit floats, statuses 8-bit integers.

_STEPS = """
    number INTEGER PRIMARY KEY,
    best REAL NOT NULL,           -- objective so far
    mean REAL NOT NULL,           -- of the finite ones of the population
    simulations INTEGER NOT NULL, -- injections so far
    seconds REAL NOT NULL,        -- so far
    trials BLOB NOT NULL,         -- (members, parameters), SI
    costs BLOB NOT NULL,          -- (members,)
    statuses BLOB NOT NULL,       -- (members,), see engine/status.py; -1: not simulated
    seal TEXT NOT NULL            -- in every table: see `seal` below
"""
# Tables that the journals of all kinds of run have.
SESSIONS = """
CREATE TABLE about (
    name TEXT PRIMARY KEY,        -- created, title, study (as given, TOML), content, state, reason, holder
    text TEXT NOT NULL,
    seal TEXT NOT NULL
);
CREATE TABLE session (
    number INTEGER PRIMARY KEY,
    started TEXT NOT NULL,        -- UTC
    ended TEXT,                   -- NULL: still at work, or killed
    process INTEGER NOT NULL,
    host TEXT NOT NULL,
    software TEXT NOT NULL,       -- JSON: versions, processor
    seal TEXT NOT NULL
);"""
RUN = Schema(
    f"""{SESSIONS}
CREATE TABLE input (
    name TEXT PRIMARY KEY,        -- of the copy, relative to the run folder
    origin TEXT NOT NULL,         -- path of the file that was copied
    original TEXT NOT NULL,       -- SHA-256 of that file
    copy TEXT NOT NULL,           -- SHA-256 of the copy, whose paths may be others
    seal TEXT NOT NULL
);
CREATE TABLE generation ({_STEPS});  -- of the first optimiser; 0 is the initial population
CREATE TABLE refinement ({_STEPS});  -- from 1
CREATE TABLE state (
    stage INTEGER PRIMARY KEY,    -- 0: the first optimiser; then: refinement
    search TEXT NOT NULL,         -- JSON: calibration/search.py, Stage after its latest step, but for the arrays
    arrays BLOB NOT NULL,
    sha256 TEXT NOT NULL,         -- of both, and of numbers and objectives of all generations
    seal TEXT NOT NULL
);""",
    "{path} is not the journal of a run: it holds other tables; name the run's own folder.",
)


_ARRAY = "array"  # key of an array in the JSON: its type and shape


def pack(state: Mapping[str, Any]) -> tuple[str, bytes]:
    """JSON of a mapping, and its arrays as bytes of little-endian numbers, in their order in the mapping.

    `TypeError` if it holds anything but texts, numbers, arrays, None, and mappings and lists of these.
    """
    arrays: list[bytes] = []

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
            little = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
            arrays.append(little.tobytes())
            return {_ARRAY: [little.dtype.str, list(value.shape)]}
        if isinstance(value, np.generic):
            return value.item()
        raise TypeError(f"{type(value).__name__} cannot be kept")

    return json.dumps(dict(state), default=plain), b"".join(arrays)


def unpack(text: str, content: bytes) -> dict[str, Any]:
    """A state from what `pack` made of it; `ValueError`, `TypeError` or `KeyError` if it is not whole."""
    left = memoryview(content)

    def restore_array(table: dict[str, Any]) -> Any:
        nonlocal left
        if set(table) != {_ARRAY}:
            return table
        kind, shape = table[_ARRAY]
        dtype = np.dtype(kind)
        size = math.prod(shape) * dtype.itemsize
        array: NDArray[Any] = np.frombuffer(left[:size], dtype).reshape(shape)
        left = left[size:]
        return array.astype(dtype.newbyteorder("="))

    state = json.loads(text, object_hook=restore_array)
    if not isinstance(state, dict) or len(left):
        raise ValueError("a state is not whole")
    return state


def digest(text: str, arrays: bytes, history: Sequence[tuple[int, float, float]]) -> str:
    """SHA-256 of the data to resume a search: a state from `pack`; number, best and mean of each generation.

    It detects flipped bits on the disk, which SQLite does not.
    """
    return sha256(b"".join((text.encode(), arrays, number_bytes(history))))


def number_bytes(numbers: Any) -> bytes:
    """Numbers as journals keep them: 64 bits, little-endian."""
    return np.ascontiguousarray(numbers, "<f8").tobytes()


# Seals of rows: SQLite does not notice a bit that has flipped on the disk, a digest of the row does. Each row of every
# table has its own SHA-256 in the last column. Rows that are gone leave a gap that SQLite's integrity check sees.

Statement = tuple[str, tuple[Any, ...]]


def seal(table: str, values: Sequence[Any]) -> str:
    """SHA-256 of a row: its table, and type and content of each value; `TypeError` for an unsupported type."""
    row_hash = hashlib.sha256()
    for content in (table, *values):
        kind, piece = _bytes(content)
        row_hash.update(kind + struct.pack("<q", len(piece)) + piece)
    return row_hash.hexdigest()


def _bytes(value: Any) -> tuple[bytes, bytes]:
    if value is None:
        return b"0", b""
    if isinstance(value, str):
        return b"s", value.encode("utf-8", "surrogatepass")
    if isinstance(value, bytes | memoryview):
        return b"b", bytes(value)
    if isinstance(value, float) or (isinstance(value, int) and abs(value) < 2**53):
        return b"n", struct.pack("<d", value)  # a REAL column returns an integer as a float
    if isinstance(value, int):
        return b"i", str(value).encode()
    raise TypeError(f"{type(value).__name__} cannot be kept in a journal")


def put(table: str, *values: Any) -> Statement:
    """Statement that writes a row with its seal; one with the same key is replaced."""
    places = ", ".join("?" * (len(values) + 1))
    return f"INSERT OR REPLACE INTO {table} VALUES ({places})", (*values, seal(table, values))


def read_rows(connection: sqlite3.Connection, table: str) -> Iterator[tuple[Any, ...]]:
    """Rows of a table in the order of its keys or of writing, without their seals.

    `ValueError` if a row is not the one that was written.
    """
    for *values, written in connection.execute(f"SELECT * FROM {table} ORDER BY rowid"):
        if written != seal(table, values):
            raise ValueError(f"a row of {table} is not the one that was written")
        yield tuple(values)
