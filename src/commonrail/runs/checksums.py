"""Seals of a journal's rows: SQLite does not notice a bit that has flipped on the disk, a digest of the row does.

Each row of every table has its own SHA-256 in the last column. Rows that are gone leave a gap that SQLite's integrity
check sees; see `journal_file`.
"""

from __future__ import annotations

import hashlib
import sqlite3
import struct
from collections.abc import Sequence
from typing import Any

Statement = tuple[str, tuple[Any, ...]]


def seal(table: str, values: Sequence[Any]) -> str:
    """SHA-256 of a row: of its table, and of type and content of each value; `TypeError` for one of another kind."""
    digest = hashlib.sha256()
    for content in (table, *values):
        kind, piece = _bytes(content)
        digest.update(kind + struct.pack("<q", len(piece)) + piece)
    return digest.hexdigest()


def _bytes(value: Any) -> tuple[bytes, bytes]:
    if value is None:
        return b"0", b""
    if isinstance(value, str):
        return b"s", value.encode("utf-8", "surrogatepass")
    if isinstance(value, bytes | memoryview):
        return b"b", bytes(value)
    if isinstance(value, float) or (isinstance(value, int) and abs(value) < 2**53):
        return b"n", struct.pack("<d", value)  # a column of real numbers returns a whole one as a float
    if isinstance(value, int):
        return b"i", str(value).encode()
    raise TypeError(f"{type(value).__name__} cannot be kept in a journal")


def put(table: str, *values: Any) -> Statement:
    """Statement that writes a row with its seal; one with the same key is replaced."""
    places = ", ".join("?" * (len(values) + 1))
    return f"INSERT OR REPLACE INTO {table} VALUES ({places})", (*values, seal(table, values))


def rows_of(connection: sqlite3.Connection, table: str) -> list[tuple[Any, ...]]:
    """Rows of a table in the order of its keys or of writing, without their seals.

    `ValueError` if a row is not the one that was written.
    """
    found = []
    for *values, written in connection.execute(f"SELECT * FROM {table} ORDER BY rowid"):
        if written != seal(table, values):
            raise ValueError(f"a row of {table} is not the one that was written")
        found.append(tuple(values))
    return found
