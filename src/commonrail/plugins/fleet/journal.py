"""Journal of a fleet: one SQLite file that keeps every injector as soon as it is done."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from commonrail.base.errors import StudyError
from commonrail.base.input import fingerprint, sha256
from commonrail.compiler.target import package_versions
from commonrail.plugins.fleet.member import Attempt, list_shared_files
from commonrail.plugins.fleet.study import MISSING_FILE, Fleet, Supply
from commonrail.runs.journal import JournalFile, facts, now
from commonrail.runs.lock import check_trust
from commonrail.runs.tables import Schema, put

# Fingerprints of the files that a worker read for an injector's result.

Inputs = Mapping[str, str]


class Booking:
    """Checks that the workers of a fleet read unchanged files.

    `shared`: SHA-256 of the files common to all injectors, at the start of the fleet.
    """

    def __init__(self, supply: Supply, shared: Mapping[Path, str]) -> None:
        self.supply = supply
        self._seen = dict(shared)
        self._written: dict[str, Mapping[Path, str]] = {}

    def hand_out(self, name: str, study: Path) -> Path:
        """Note the files written for an injector in the folder of `study`; return `study`."""
        folder = study.absolute().parent
        self._written[name] = {path: fingerprint(path) for path in folder.iterdir() if path.is_file()}
        return study

    def book(self, name: str, attempt: Attempt, before: Inputs) -> tuple[Attempt, Inputs]:
        """Return the attempt and the fingerprints of its data; `before`: fingerprints at the start of the fleet.

        Data changed during the fleet get the fingerprint of the version that was read. If another file has changed,
        the attempt has failed without fingerprints, and the next run repeats it.
        """
        written = self._written.pop(name, {})
        if not attempt.files:
            return attempt, before
        inputs = self.supply.fingerprints_read(name, attempt.files)
        data = set(inputs.values())
        for path, digest in attempt.files.items():
            if path in written or digest not in data:
                expected = written.get(path) or self._seen.setdefault(path, digest)
                if expected != digest:
                    reason = f"{path}: the file has changed during the fleet; run the fleet again."
                    return Attempt({}, reason, attempt.seconds), {}
        return attempt, inputs


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
    seal TEXT NOT NULL          -- in every table: see runs/tables.py
);""",
    "{path} is not the journal of a fleet: it holds other tables; name the fleet's own folder.",
)


@dataclass(frozen=True)
class Entry:
    """Outcome of an injector.

    `status`: "finished" or "failed", with `reason`; `inputs`: fingerprint of each data file; `record`: returned by
    `calibrate_study`, empty after a failure; `seconds`: processor time.
    """

    name: str
    status: str
    reason: str
    attempts: int
    inputs: Mapping[str, str]
    record: Mapping[str, Any]
    seconds: float


class Journal(JournalFile):
    """Journal of a fleet; its content survives a killed process and a power cut."""

    NAME, LOCK, SCHEMA, DURABLE = JOURNAL, LOCK, FLEET, True

    def inputs(self) -> dict[str, str]:
        """Fingerprints of the inputs common to all injectors, by name; empty for a new journal."""
        with check_trust(self.path):
            return {str(name): str(fingerprint) for name, fingerprint in self._table("input")}

    def write_inputs(self, inputs: Mapping[str, str]) -> None:
        """Keep the fingerprints of a new fleet."""
        statements = [put("input", *item) for item in inputs.items()]
        self._write(("DELETE FROM input", ()), *statements)

    @property
    def targets(self) -> list[dict[str, str]]:
        """Versions and target processors of the calibrating processes, the latest last."""
        with check_trust(self.path):
            targets = json.loads(dict(self._table("about")).get("targets", "[]"))
            return [{str(name): str(text) for name, text in target.items()} for target in targets]

    def note_target(self, target: Mapping[str, str]) -> None:
        """Append the target of this process unless it is the latest already."""
        if self.targets[-1:] != [target]:
            self._write(*facts([("targets", json.dumps([*self.targets, target]))]))

    def entries(self) -> dict[str, Entry]:
        """Injectors that are done, by name."""
        with check_trust(self.path):
            return {str(row[0]): _entry(row) for row in self._table("injector")}

    def write(self, entry: Entry) -> None:
        """Keep an injector, or replace it."""
        texts = [json.dumps(content, sort_keys=True, allow_nan=False) for content in (entry.inputs, entry.record)]
        self._write(
            put("injector", entry.name, entry.status, entry.reason, entry.attempts, *texts, entry.seconds, now())
        )


def _entry(row: tuple[Any, ...]) -> Entry:
    name, status, reason, attempts, inputs, record, seconds, _ = row
    if status not in (FINISHED, FAILED) or not 0.0 <= seconds < math.inf:
        raise ValueError("an injector's state")
    fingerprints = {str(source): str(text) for source, text in json.loads(inputs).items()}
    return Entry(str(name), status, str(reason), int(attempts), fingerprints, dict(json.loads(record)), float(seconds))


# Injectors calibrated by an earlier run: reused if fleet and data are the same and the journal is undamaged.

_CURE = "restore it, or use another folder."


def load_entries(
    fleet: Fleet, inputs: Mapping[str, Mapping[str, str]], journal: Journal, shared: Mapping[Path, str]
) -> dict[str, Entry]:
    """Load the injectors of a fleet that are done; an empty journal stores the fingerprints of the fleet.

    `inputs`: fingerprints of the data files of each injector. Raises `StudyError` if the folder has another fleet, or
    an injector was calibrated to other data. Injectors may have been added.
    """
    folder, entries = journal.path.parent, journal.entries()
    now, before = _common(fleet, shared), journal.inputs()
    if entries and not before:
        raise StudyError(f"{journal.path}: the journal is damaged: the fingerprints of the fleet are missing; {_CURE}")
    changed = next((name for name in {**before, **now} if before.get(name) != now.get(name)), "")
    if entries and changed.startswith("file "):
        raise StudyError(f"{folder} was begun with another {changed.removeprefix('file ')}; {_CURE}")
    if entries and changed:
        raise StudyError(
            f'{folder} was begun with {changed} "{before.get(changed, "")}", and it is "{now.get(changed, "")}" now; '
            f"{_CURE}"
        )
    journal.write_inputs(now)  # until an injector is calibrated, the template may be corrected
    for name, entry in entries.items():
        if entry.status == FAILED:
            continue
        if name not in inputs:
            raise StudyError(f'{folder} has injector "{name}", which is missing in {fleet.supply.path}; {_CURE}')
        current_inputs = inputs[name]
        if current_inputs != entry.inputs:
            changed = next(
                s for s in {**entry.inputs, **current_inputs} if entry.inputs.get(s) != current_inputs.get(s)
            )
            what = "is missing now" if current_inputs.get(changed) == MISSING_FILE else "has changed since"
            raise StudyError(
                f'{folder} has injector "{name}" calibrated to other data: its file of "{changed}" {what}; {_CURE}'
            )
    return {name: entry for name, entry in entries.items() if name in inputs}


def _common(fleet: Fleet, shared: Mapping[Path, str]) -> dict[str, str]:
    """Inputs common to all injectors, by name: readable texts, or fingerprints of files."""
    template = fleet.template
    fingerprints = {"seed": str(fleet.seed), "leave_out": ", ".join(template.left_out)}
    fingerprints |= {f"version of {name}": version for name, version in package_versions().items()}
    fingerprints[f"file {template.path.name}"] = sha256(template.text.encode())
    names = {Path(os.path.abspath(path)): name for name, path in list_shared_files(template).items()}
    return fingerprints | {f"file {names.get(path, path.name)}": digest for path, digest in shared.items()}
