"""The journal of a fleet: one SQLite file that keeps every injector as soon as it is done."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from commonrail.store.faults import trusted
from commonrail.store.journal_file import JournalFile, facts, now
from commonrail.store.schema import Schema
from commonrail.store.seals import put

__all__ = ["FAILED", "FINISHED", "JOURNAL", "Entry", "Journal"]

JOURNAL, LOCK = "fleet.sqlite", "fleet.lock"
FINISHED, FAILED = "finished", "failed"

FLEET = Schema(
    """
CREATE TABLE about (name TEXT PRIMARY KEY, text TEXT NOT NULL, seal TEXT NOT NULL);
CREATE TABLE input (name TEXT PRIMARY KEY, fingerprint TEXT NOT NULL, seal TEXT NOT NULL);
CREATE TABLE injector (
    name TEXT PRIMARY KEY,
    status TEXT NOT NULL,       -- finished or failed
    reason TEXT NOT NULL,       -- of a failure
    attempts INTEGER NOT NULL,
    inputs TEXT NOT NULL,       -- JSON: fingerprint of each of its data files
    record TEXT NOT NULL,       -- JSON: see task.calibrate_file
    seconds REAL NOT NULL,      -- processor time
    ended TEXT NOT NULL,        -- UTC
    seal TEXT NOT NULL          -- in every table: see store/seals.py
);""",
    "{path} is not the journal of a fleet: it holds other tables; name the fleet's own folder.",
)


@dataclass(frozen=True)
class Entry:
    """Outcome of an injector.

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


class Journal(JournalFile):
    """The journal of a fleet, a `JournalFile`: what was written survives a killed process, and a power cut too."""

    NAME, LOCK, SCHEMA = JOURNAL, LOCK, FLEET
    HOLDER = "{here} since {since}"
    HELD = "{folder}: another fleet is at work here ({holder}); wait for it, or end it."
    NEW = "it has just begun"
    DURABLE = True

    def inputs(self) -> dict[str, str]:
        """Fingerprints of what is common to all injectors, by name; empty for a new journal."""
        with trusted(self.path):
            return {str(name): str(fingerprint) for name, fingerprint in self._table("input")}

    def write_inputs(self, inputs: Mapping[str, str]) -> None:
        """Keep the fingerprints of a new fleet."""
        kept = [put("input", *item) for item in inputs.items()]
        self._write(("DELETE FROM input", ()), *kept)

    @property
    def targets(self) -> list[dict[str, str]]:
        """Versions, and the processor that was compiled for, of the processes that have calibrated; the latest last."""
        with trusted(self.path):
            found = json.loads(dict(self._table("about")).get("targets", "[]"))
            return [{str(name): str(text) for name, text in target.items()} for target in found]

    def note_target(self, target: Mapping[str, str]) -> None:
        """Keep the target of this process as the latest, if it is not that already."""
        if self.targets[-1:] != [target]:
            self._write(*facts([("targets", json.dumps([*self.targets, target]))]))

    def entries(self) -> dict[str, Entry]:
        """All injectors that are done, by name."""
        with trusted(self.path):
            return {str(row[0]): _entry(row) for row in self._table("injector")}

    def write(self, entry: Entry) -> None:
        """Keep an injector; one that is there is replaced."""
        texts = [json.dumps(part, sort_keys=True, allow_nan=False) for part in (entry.inputs, entry.record)]
        self._write(
            put("injector", entry.name, entry.status, entry.reason, entry.attempts, *texts, entry.seconds, now())
        )


def _entry(row: tuple[Any, ...]) -> Entry:
    name, status, reason, attempts, inputs, record, seconds, _ = row
    if status not in (FINISHED, FAILED) or not 0.0 <= seconds < math.inf:
        raise ValueError("an injector's state")
    fingerprints = {str(source): str(text) for source, text in json.loads(inputs).items()}
    return Entry(str(name), status, str(reason), int(attempts), fingerprints, dict(json.loads(record)), float(seconds))
