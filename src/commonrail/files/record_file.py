"""JSON records of run folders, read without trust in who wrote them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from commonrail.errors import InputError
from commonrail.files.atomic import write_text
from commonrail.files.sums import check_sum
from commonrail.reading.text_file import read_text

__all__ = ["LARGEST_RECORD", "read_record", "write_record"]

LARGEST_RECORD = 20_000_000  # [bytes]; its tables take up to 30 times as much


def read_record(path: Path, made_by: str) -> dict[str, Any]:
    """A record, which is one JSON object.

    Parameters
    ----------
    path : Path
    made_by : str
        Command that leaves such a file, for the message.

    Raises
    ------
    InputError
        If the file cannot be read, is no such object, or is not the one that was written.
    """
    if not path.exists():
        raise _broken(path, made_by, "there is no such file")
    check_sum(path)
    try:
        record = json.loads(read_text(path, LARGEST_RECORD))
    except (ValueError, RecursionError) as error:
        raise _broken(path, made_by, str(error)) from error
    if not isinstance(record, dict):
        raise _broken(path, made_by, "this is not one object in braces")
    return record


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Write a record whole or not at all; `OutputError` if it cannot be written."""
    write_text(path, json.dumps(record, indent=1, allow_nan=False) + "\n")


def _broken(path: Path, made_by: str, reason: str) -> InputError:
    return InputError(f"{path.parent}: not a run folder of {made_by} ({path.name}: {reason}); make it again.")
