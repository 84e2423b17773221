"""Changes of a run's files since it was begun."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from commonrail.errors import InputError, StudyError
from commonrail.files.atomic import write_text
from commonrail.files.run_folder import STUDY
from commonrail.reading.guarded_file import fingerprint
from commonrail.reading.text_file import read_text
from commonrail.reading.toml_file import LARGEST_TOML
from commonrail.store.journal import Input, Journal

__all__ = ["check_files"]

MOST = 3  # keys that a sentence names


def check_files(journal: Journal, as_begun: bool) -> None:
    """Refuse to go on with other files than those of the beginning.

    Parameters
    ----------
    journal : Journal
    as_begun : bool
        Leave out the files that were copied; the copies alone count.

    Raises
    ------
    StudyError
        If a file has changed; the sentence says which, and of the study which keys.
    """
    about, inputs = journal.about, journal.inputs
    _finish_writing(journal.folder, about, inputs)
    for i, item in enumerate(inputs):
        path = journal.folder / item.name
        if (now := fingerprint(path)) != item.copy:
            what = _what(about.get("study", ""), path) if i == 0 else ""
            raise StudyError(
                f"{path} {'is missing' if not now else f'has been changed since the run was begun{what}'}; bring it "
                "back as it was, or begin a new run."
            )
    for i, item in enumerate(inputs if not as_begun else []):
        path = Path(item.origin)
        if (now := fingerprint(path)) and now != item.original:
            what = _what(about.get("given", ""), path) if i == 0 else ""
            raise StudyError(
                f"{path} has been changed since the run in {journal.folder} was begun{what}; begin a new run for it, "
                f"or go on with the copy as it was: `commonrail resume {journal.folder} --as-begun`."
            )


def _finish_writing(folder: Path, about: Mapping[str, str], inputs: list[Input]) -> None:
    """Write the study with more generations, if a crash came between the journal's note of it and the file."""
    if inputs and about.get("before") and fingerprint(folder / STUDY) == about["before"]:
        write_text(folder / STUDY, about.get("study", ""))


def _what(before: str, path: Path) -> str:
    """Keys of a study file that have changed, in parentheses."""
    try:
        old, new = (dict(_leaves(tomllib.loads(text))) for text in (before, read_text(path, LARGEST_TOML)))
    except (InputError, ValueError, RecursionError):
        return ""
    keys = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    if not keys:
        return " (comments or spaces)"
    shown = [f"{key}: {_text(old.get(key))} -> {_text(new.get(key))}" for key in keys[:MOST]]
    return f" ({'; '.join(shown)}{'; ...' if len(keys) > MOST else ''})"


def _leaves(value: Any, key: str = "") -> list[tuple[str, Any]]:
    """Values of nested tables by dotted key."""
    if isinstance(value, dict):
        return [leaf for name, item in value.items() for leaf in _leaves(item, f"{key}.{name}" if key else name)]
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return [leaf for i, item in enumerate(value) for leaf in _leaves(item, f"{key}[{i + 1}]")]
    return [(key, value)]


def _text(value: Any) -> str:
    text = "absent" if value is None else f"{value!r}".replace("'", '"')
    return text if len(text) <= 40 else text[:37] + "..."
