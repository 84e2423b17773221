"""Tables of a run's journal. Arrays are the bytes of little-endian numbers: 64-bit floats, statuses 8-bit integers."""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.reading.guarded_file import sha256
from commonrail.store.schema import Schema, Version
from commonrail.store.seals import add_seals
from commonrail.store.states import digest, number_bytes, pack

__all__ = ["RUN"]

_FIRST = """
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
);"""

_STEPS = """
    number INTEGER PRIMARY KEY,      -- from 1
    best REAL NOT NULL,              -- columns as in generation
    mean REAL NOT NULL,
    simulations INTEGER NOT NULL,
    seconds REAL NOT NULL,
    trials BLOB NOT NULL,
    costs BLOB NOT NULL,
    statuses BLOB NOT NULL
"""
_STATE = """
    stage INTEGER PRIMARY KEY,       -- 0: the first optimiser, of which generation has the steps; then: refinement
    search TEXT NOT NULL,            -- JSON: calibration/checkpoint.py, Stage after its latest step, but for the arrays
    arrays BLOB NOT NULL,
    sha256 TEXT NOT NULL             -- of both, and of numbers and objectives of all generations
"""


def _keep_states(journal: sqlite3.Connection) -> None:
    """A state for each optimiser, in place of tables with columns for what each of them keeps."""
    stages = _stages(journal)
    history = journal.execute("SELECT number, best, mean FROM generation ORDER BY number").fetchall()
    ends = _ends(journal)
    for table in ("population", "refinement"):
        journal.execute(f"DROP TABLE {table}")
    journal.execute(f"CREATE TABLE refinement ({_STEPS})")
    journal.execute(f"CREATE TABLE state ({_STATE})")
    for number, stage in enumerate(stages):
        packed = pack(stage)
        journal.execute("INSERT INTO state VALUES (?, ?, ?, ?)", (number, *packed, digest(*packed, history)))
    costs = [history[-1][1] if history else math.inf]
    for end in ends:
        costs.append(end.cost)
        status = np.array([0 if math.isfinite(end.cost) else -1], "i1")
        row = (end.number, min(costs), history[-1][2], end.simulations, end.seconds)
        told = (end.stop, number_bytes([end.cost]), status.tobytes())
        journal.execute("INSERT INTO refinement VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row + told)


class _End(NamedTuple):
    number: int
    stop: bytes
    cost: float
    simulations: int
    seconds: float
    hops: str


def _ends(journal: sqlite3.Connection) -> list[_End]:
    """Refinements of a journal of schema 1."""
    rows = journal.execute(f"SELECT {', '.join(_End._fields)} FROM refinement ORDER BY number")
    return [_End(*row)._replace(cost=float(row[2])) for row in rows]


def _stages(journal: sqlite3.Connection) -> list[dict[str, Any]]:
    """Stages of a journal of schema 1, checked as that was."""
    found = journal.execute("SELECT generation, search, members, costs, violations FROM population").fetchall()
    if not found:
        return []
    number, text, *arrays = found[-1]
    search = json.loads(text)
    columns = "number, best, mean, simulations, seconds"
    generations = journal.execute(f"SELECT {columns} FROM generation ORDER BY number").fetchall()
    _check_numbers(generations, 0, number)
    _check_digest(search, (*arrays, number_bytes([row[:3] for row in generations])))
    evolution = search["optimiser"] | dict(zip(("unit", "costs", "violations"), map(_array, arrays), strict=True))
    evolution["unit"] = evolution["unit"].reshape(-1, len(evolution["names"]))
    evolution |= {"method": "differential evolution", "steps": evolution.pop("generation")}
    failures = {str(name): _count(count) for name, count in search["failures"].items()}
    stages = [_stage(evolution, failures, *generations[-1][3:])]
    ends = _ends(journal)
    if ends:
        refinement = _refinement(evolution, ends, generations[-1][1])
        stages.append(_stage(refinement, failures, ends[-1].simulations, ends[-1].seconds))
    return stages


def _refinement(evolution: Mapping[str, Any], ends: list[_End], before: float) -> dict[str, Any]:
    """State of refinements by where they ended, given the objective before them."""
    _check_numbers(ends, 1, len(ends))
    for end in ends:
        hops = json.loads(end.hops)
        _check_digest(hops, (number_bytes([end.cost]), end.stop))
    best = min(ends, key=lambda end: end.cost)  # the first of equals, as in the search
    x = _array(best.stop).reshape(len(evolution["names"]))
    improved = best.cost < before
    return {
        "method": "least-squares refinement",
        **{key: evolution[key] for key in ("names", "lower", "upper")},
        "steps": len(ends),
        "counts": {},
        "best": x if improved else None,
        "cost": best.cost if improved else None,
        "rng": hops,
    }


def _stage(state: dict[str, Any], failures: dict[str, int], simulations: Any, seconds: Any) -> dict[str, Any]:
    if not math.isfinite(seconds):
        raise ValueError("a time is no number")
    return {"state": state, "simulations": _count(simulations), "failures": failures, "seconds": float(seconds)}


def _check_digest(search: dict[str, Any], arrays: Iterable[bytes]) -> None:
    """Take the digest out of what a search went on from, and compare it; journals of the first days had none."""
    written = search.pop("sha256", None)
    if written is not None and written != sha256(b"".join((*arrays, json.dumps(search, sort_keys=True).encode()))):
        raise ValueError("a state is not the one that was written")


def _check_numbers(rows: Sequence[tuple[Any, ...]], first: int, last: int) -> None:
    if [row[0] for row in rows] != list(range(first, last + 1)):
        raise ValueError("steps are missing")


def _count(value: Any) -> int:
    if not isinstance(value, int) or value < 0:
        raise ValueError("a count is no number")
    return value


def _array(content: bytes) -> Floats:
    return np.frombuffer(content, "<f8").astype(float)


_TABLES = frozenset({"about", "input", "session", "generation", "refinement", "state"})

RUN = Schema(
    (
        Version(frozenset({"about", "input", "session", "generation", "population", "refinement"}), _FIRST),
        Version(_TABLES, _keep_states),
        Version(_TABLES, lambda journal: add_seals(journal, _TABLES)),
    ),
    "{path} has schema {found} and this version reads {known} and older ones; use the version of commonrail that wrote "
    "it, or a newer one.",
    "{path} is not the journal of a run: it holds other tables; name the run's own folder.",
)
