"""Tables of a run's journal. Arrays are the bytes of little-endian numbers: 64-bit floats, statuses 8-bit integers."""

from __future__ import annotations

from commonrail.store.schema import Schema

_STEPS = """
    number INTEGER PRIMARY KEY,
    best REAL NOT NULL,           -- objective so far
    mean REAL NOT NULL,           -- of the finite ones of the population
    simulations INTEGER NOT NULL, -- injections so far
    seconds REAL NOT NULL,        -- so far
    trials BLOB NOT NULL,         -- (members, parameters), SI
    costs BLOB NOT NULL,          -- (members,)
    statuses BLOB NOT NULL,       -- (members,), see engine/status.py; -1: not simulated
    seal TEXT NOT NULL            -- in every table: see seals.py
"""
RUN = Schema(
    f"""
CREATE TABLE about (
    name TEXT PRIMARY KEY,        -- created, title, study (as given, TOML), content, state, reason, holder
    text TEXT NOT NULL,
    seal TEXT NOT NULL
);
CREATE TABLE input (
    name TEXT PRIMARY KEY,        -- of the copy, relative to the run folder
    origin TEXT NOT NULL,         -- path of the file that was copied
    original TEXT NOT NULL,       -- SHA-256 of that file
    copy TEXT NOT NULL,           -- SHA-256 of the copy, whose paths may be others
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
);
CREATE TABLE generation ({_STEPS});  -- of the first optimiser; 0 is the initial population
CREATE TABLE refinement ({_STEPS});  -- from 1
CREATE TABLE state (
    stage INTEGER PRIMARY KEY,    -- 0: the first optimiser; then: refinement
    search TEXT NOT NULL,         -- JSON: calibration/checkpoint.py, Stage after its latest step, but for the arrays
    arrays BLOB NOT NULL,
    sha256 TEXT NOT NULL,         -- of both, and of numbers and objectives of all generations
    seal TEXT NOT NULL
);""",
    "{path} is not the journal of a run: it holds other tables; name the run's own folder.",
)
