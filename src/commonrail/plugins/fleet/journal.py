"""Journal of a fleet: one SQLite file that keeps every injector as soon as it is done."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

from commonrail.base.errors import StudyError
from commonrail.base.record import from_record, to_record
from commonrail.plugins.fleet.member import MemberRecord
from commonrail.plugins.fleet.study import MISSING_FILE, Fleet
from commonrail.runs.journal import RunJournal, now
from commonrail.runs.lock import check_trust
from commonrail.runs.tables import SESSIONS, Schema, put

JOURNAL, LOCK = "fleet.sqlite", "fleet.lock"
FINISHED, FAILED = "finished", "failed"

FLEET = Schema(
    f"""{SESSIONS}
CREATE TABLE injector (
    name TEXT PRIMARY KEY,
    status TEXT NOT NULL,       -- finished or failed
    reason TEXT NOT NULL,       -- of a failure
    attempts INTEGER NOT NULL,
    inputs TEXT NOT NULL,       -- JSON: fingerprint of each of its data files
    record TEXT NOT NULL,       -- JSON: see MemberRecord; null after a failure
    seconds REAL NOT NULL,      -- processor time
    session INTEGER NOT NULL,   -- that calibrated it
    ended TEXT NOT NULL,        -- UTC
    seal TEXT NOT NULL          -- in every table: see runs/tables.py
);""",
    "{path} holds other tables than the journal of a fleet by this version; name the fleet's own folder, or a new one.",
)


class Entry(NamedTuple):
    """Outcome of an injector.

    `status`: "finished" or "failed", with `reason`; `inputs`: fingerprint of each data file; `record`: result of
    `calibrate_study`, None after a failure; `seconds`: processor time; `session`: number of the session that calibrated
    it.
    """

    name: str
    status: str
    reason: str
    attempts: int
    inputs: Mapping[str, str]
    record: MemberRecord | None
    seconds: float
    session: int = 0

    @property
    def result(self) -> MemberRecord:
        """Record of a finished injector."""
        assert self.record is not None
        return self.record


class Journal(RunJournal):
    """Journal of a fleet; its content survives a killed process and a power cut."""

    NAME, LOCK, SCHEMA, DURABLE = JOURNAL, LOCK, FLEET, True

    def entries(self) -> dict[str, Entry]:
        """Injectors that are done, by name."""
        with check_trust(self.path):
            return {str(row[0]): _entry(row) for row in self._table("injector")}

    def write(self, entry: Entry) -> None:
        """Keep an injector, or replace it."""
        name, status, reason, attempts, inputs, record, *rest = entry
        texts = [json.dumps(to_record(item), sort_keys=True, allow_nan=False) for item in (inputs, record)]
        self._write(put("injector", name, status, reason, attempts, *texts, *rest, now()))

    def list_targets(self, sessions: Collection[int]) -> list[dict[str, str]]:
        """List the targets of sessions in their order."""
        return [target for number, target in enumerate(self.targets, start=1) if number in sessions]


def _entry(row: tuple[Any, ...]) -> Entry:
    name, status, reason, attempts, inputs, record, seconds, session, _ = row
    if status not in (FINISHED, FAILED) or not 0.0 <= seconds < math.inf or (record == "null") != (status == FAILED):
        raise ValueError("an injector's state")
    fingerprints = {str(source): str(text) for source, text in json.loads(inputs).items()}
    result = from_record(MemberRecord | None, json.loads(record))  # type: ignore[arg-type]
    return Entry(str(name), status, str(reason), int(attempts), fingerprints, result, float(seconds), int(session))


# Injectors calibrated by an earlier run: reused if fleet and data are the same and the journal is undamaged.

_CURE = "restore it, or use another folder."


def load_entries(
    fleet: Fleet, inputs: Mapping[str, Mapping[str, str]], journal: Journal, common: Mapping[str, str]
) -> dict[str, Entry]:
    """Load the injectors of a fleet that are done; an empty journal stores what they have in common.

    `inputs`: fingerprints of the data files of each injector; `common`: inputs common to all injectors, see
    `hash_common_inputs`. Raises `StudyError` if the folder has another fleet, or an injector was calibrated to other
    data. Injectors may have been added.
    """
    entries = journal.entries()
    if entries:
        with check_trust(journal.path):
            before: dict[str, str] = json.loads(journal.about["content"])
        _refuse_other_fleet(journal, before, common)
    # until an injector is calibrated, the template may be corrected
    journal.describe({"title": fleet.title, "content": json.dumps(common)})
    for name, entry in entries.items():
        if entry.status == FINISHED:
            _refuse_other_data(fleet, journal, entry, inputs.get(name))
    return {name: entry for name, entry in entries.items() if name in inputs}


def _refuse_other_fleet(journal: Journal, before: Mapping[str, str], common: Mapping[str, str]) -> None:
    changed = next((name for name in {**before, **common} if before.get(name) != common.get(name)), "")
    begun = f"{journal.folder} was begun with"
    if changed.startswith("file "):
        raise StudyError(f"{begun} another {changed.removeprefix('file ')}; {_CURE}")
    if changed:
        values = f'{changed} "{before.get(changed, "")}", and it is "{common.get(changed, "")}" now'
        raise StudyError(f"{begun} {values}; {_CURE}")


def _refuse_other_data(fleet: Fleet, journal: Journal, entry: Entry, inputs: Mapping[str, str] | None) -> None:
    place = f'{journal.folder} has injector "{entry.name}"'
    if inputs is None:
        raise StudyError(f"{place}, which is missing in {fleet.supply.path}; {_CURE}")
    for source in {**entry.inputs, **inputs}:
        if entry.inputs.get(source) != inputs.get(source):
            what = "is missing now" if inputs.get(source) == MISSING_FILE else "has changed since"
            raise StudyError(f'{place} calibrated to other data: its file of "{source}" {what}; {_CURE}')
