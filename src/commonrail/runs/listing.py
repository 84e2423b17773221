"""Runs below a folder."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from commonrail.base.arguments import file_path
from commonrail.base.errors import CommonrailError, InputError
from commonrail.runs.journal import JOURNAL, LOCK, State, read_about
from commonrail.runs.lock import is_folder_held

STOPPED, DAMAGED = "stopped", "damaged"


@dataclass(frozen=True)
class Run:
    """State of a run, from its journal.

    Attributes
    ----------
    folder : Path
    state : str
        "running", "finished", "interrupted" (Ctrl-C), "failed", "stopped" (killed), "damaged".
    title, reason : str
        `reason` of a failure or of damage.
    generation, generations : int
        Done and wanted, the initial population included.
    refinements : int
        Done.
    best : float
        Objective; inf if unknown.
    age : float
        Since the last session ended or, if it has not, began [s].
    seconds : float
        Time of the search [s].
    """

    folder: Path
    state: str
    title: str = ""
    reason: str = ""
    generation: int = 0
    generations: int = 0
    refinements: int = 0
    best: float = float("inf")
    age: float = float("nan")
    seconds: float = 0.0


def list_runs(folder: str | Path) -> list[Run]:
    """Runs in a folder and below, by path; symbolic links are not followed.

    Raises
    ------
    InputError
        If the folder does not exist.
    ConfigurationError
        If it is not a path.
    """
    top = file_path(folder, "folder")
    if not top.is_dir():
        raise InputError(f"{top}: there is no such folder; name one that holds run folders.")
    return [_run(path) for path in sorted(_run_folders(top))]


def _run_folders(top: Path) -> Iterator[Path]:
    for parent, folders, files in os.walk(top):
        if JOURNAL in files:
            folders.clear()  # a run holds no runs
            yield Path(parent)


def _run(folder: Path) -> Run:
    try:
        about = read_about(folder)
        is_running = _is_held(folder / LOCK)
        if not is_running and about.get("state") == State.RUNNING:
            about = read_about(folder)  # the run may have ended since the first read
        state = about.get("state", STOPPED)
        changed = about["changed"]
        return Run(
            folder,
            state if is_running == (state == State.RUNNING) else (State.RUNNING if is_running else STOPPED),
            about.get("title", ""),
            "" if is_running else about.get("reason", ""),
            about["generations done"],
            1 + int(about.get("generations", -1)),
            about["refinements"],
            about["best"],
            (datetime.now(UTC) - datetime.fromisoformat(changed)).total_seconds() if changed else float("nan"),
            about["seconds"],
        )
    except (CommonrailError, sqlite3.Error, ValueError, TypeError) as error:
        return Run(folder, DAMAGED, reason=str(error))


def _is_held(lock: Path) -> bool:
    """Return whether a process holds a folder, without locking it."""
    if not lock.is_file():
        return is_folder_held(lock.parent)
    with closing(sqlite3.connect(f"{lock.absolute().as_uri()}?mode=ro", uri=True, timeout=0.0)) as connection:
        try:
            connection.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()
        except sqlite3.OperationalError as error:
            return error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY
    return False
