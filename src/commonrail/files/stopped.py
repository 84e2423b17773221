"""Runs whose search was stopped before its end: who takes their values is told."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from commonrail.errors import InputError
from commonrail.files.record_file import read_record
from commonrail.notice import note

__all__ = ["note_stopped"]

_RESULT = "result.json"
_told: set[Path] = set()


def note_stopped(folder: Path, record: Mapping[str, Any] | None = None) -> None:
    """Note, once a process, that the values of a run are those of a search that was stopped.

    Parameters
    ----------
    folder : Path
        Run folder.
    record : mapping, optional
        Of its result; by default it is read. A folder that has none is not judged.
    """
    if record is None:
        with suppress(InputError):
            record = read_record(folder / _RESULT, "commonrail calibrate")
    where = folder.absolute()
    if record is None or record.get("status") != "interrupted" or where in _told:
        return
    _told.add(where)
    note(
        f"{folder}: the search was stopped before its end, and these are the best values up to then; "
        f"`commonrail resume {folder}` runs it to its end."
    )
