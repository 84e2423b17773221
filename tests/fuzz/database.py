"""SQLite files with faults: flipped and lost bytes, and cells that hold what nobody has written there."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing, suppress
from random import Random

import numpy as np

from tests.fuzz.mutation import BYTES, JSON, TEXTS

__all__ = ["spoilt_database"]

CELLS: tuple[object, ...] = (
    None,
    0,
    -1,
    1,
    10**15,
    -(2**63),
    1e308,
    -1e308,
    float("inf"),
    0.5,
    "",
    "nan",
    "1e999",
    b"",
)
NUMBERS = (0.0, -1.0, 1e308, -1e308, np.nan, np.inf, -np.inf, 5e-324, 1e-9, 2.0)
STATEMENTS = (
    "DELETE FROM {table}",
    "DELETE FROM {table} WHERE rowid = (SELECT MAX(rowid) FROM {table})",
    "DELETE FROM {table} WHERE rowid = (SELECT MIN(rowid) FROM {table})",
    "DROP TABLE {table}",
    "ALTER TABLE {table} RENAME TO other",
    "ALTER TABLE {table} ADD COLUMN more",
    "PRAGMA user_version = 0",
    "PRAGMA user_version = 99",
    "PRAGMA user_version = -1",
    "CREATE TRIGGER t AFTER INSERT ON {table} BEGIN DELETE FROM {table}; END",
)


def spoilt_database(random: Random, data: bytes) -> bytes:
    """The content of an SQLite file with some faults in it."""
    if random.random() < 0.4:
        return random.choice(BYTES)(random, data)
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
        connection.deserialize(data[:18] + b"\x01\x01" + data[20:])  # in memory there is no write-ahead log
        tables = [name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        for _ in range(random.choice((1, 1, 1, 2, 3))):
            table = random.choice(tables)
            with suppress(sqlite3.Error, OverflowError):  # a table that is gone, or a value that SQLite refuses
                if random.random() < 0.15:
                    connection.execute(random.choice(STATEMENTS).format(table=table))
                else:
                    _change_cell(random, connection, table)
        return connection.serialize()


def _change_cell(random: Random, connection: sqlite3.Connection, table: str) -> None:
    columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
    rows = connection.execute(f"SELECT rowid FROM {table}").fetchall()
    if not rows:
        return
    column, (row,) = random.choice(columns), random.choice(rows)
    (value,) = connection.execute(f"SELECT {column} FROM {table} WHERE rowid = ?", (row,)).fetchone()
    connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (_other(random, value), row))


def _other(random: Random, value: object) -> object:
    """Something in place of a cell's value: of another kind, or nearly the same."""
    if random.random() < 0.25:
        return random.choice((*CELLS, *TEXTS))
    if isinstance(value, bytes):
        return _other_numbers(random, value)
    if isinstance(value, str):
        return _other_text(random, value)
    return random.choice((float(value or 0) * random.choice(NUMBERS), random.choice(CELLS)))


def _other_numbers(random: Random, value: bytes) -> bytes:
    if random.random() < 0.5 or len(value) % 8:
        return random.choice(BYTES)(random, value)
    numbers = np.frombuffer(value, "<f8").copy()
    some = [random.randrange(len(numbers)) for _ in range(random.choice((1, 3, len(numbers))))] if len(numbers) else []
    for i in some:
        numbers[i] = random.choice(NUMBERS)
    return numbers.tobytes()


def _other_text(random: Random, value: str) -> str:
    try:
        json.loads(value)
    except ValueError:
        return random.choice(BYTES)(random, value.encode()).decode("utf-8", "replace")
    return random.choice(JSON)(random, value)
