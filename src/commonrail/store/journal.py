"""The journal of a run: one SQLite file that takes every step of a search as soon as it is done."""

from __future__ import annotations

import json
import math
import os
import platform
import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.calibration.checkpoint import Checkpoint, Generation, Stage, Step
from commonrail.calibration.result import software_record
from commonrail.errors import StudyError
from commonrail.files.atomic import PART
from commonrail.store.faults import trusted
from commonrail.store.journal_file import JournalFile, facts, now, opened_to_read
from commonrail.store.run_schema import RUN
from commonrail.store.states import digest, number_bytes, pack, unpack

__all__ = ["JOURNAL", "LOCK", "Input", "Journal", "State", "read_about"]

JOURNAL, LOCK = "journal.sqlite", "journal.lock"


class State:
    """State of a run."""

    RUNNING = "running"
    FINISHED = "finished"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


class Input(NamedTuple):
    """A file that a study reads: name of its copy in the run folder, where it came from, and SHA-256 of both."""

    name: str
    origin: str
    original: str
    copy: str


class Journal(JournalFile):
    """The journal of a run folder; it does not wait for the disk at every step of the search.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    StudyError, OutputError
        As `JournalFile`.
    """

    NAME, LOCK, SCHEMA = JOURNAL, LOCK, RUN
    HOLDER = "{here} is at work here since {since}"
    HELD = "{folder}: {holder}; wait for it, or end it first."
    NEW = "another process has just begun to work here"
    DURABLE = False

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        _clear_parts(folder)

    @property
    def about(self) -> dict[str, str]:
        """Facts of the run by name."""
        return {str(name): str(text) for name, text in self._rows("SELECT name, text FROM about")}

    @property
    def inputs(self) -> list[Input]:
        """Files that the study reads.

        Raises
        ------
        StudyError
            If one would lie outside the run folder.
        """
        rows = self._rows("SELECT name, origin, original, copy FROM input ORDER BY rowid")
        found = [Input(*map(str, row)) for row in rows]
        for item in found:
            if Path(item.name).is_absolute() or ".." in Path(item.name).parts:
                raise StudyError(f"{self.path}: the path {item.name} leaves the run folder; take a copy that is whole.")
        return found

    @property
    def generations(self) -> int:
        """Generations wanted after the initial population."""
        with trusted(self.path):
            wanted = int(self.about["generations"])
            if wanted < 0:
                raise ValueError("a count is no number")
            return wanted

    def describe(self, about: Mapping[str, str], inputs: list[Input] | None = None) -> None:
        """Write facts of the run, and in place of the former ones the files that the study reads; wait for the disk."""
        statements = facts(about.items())
        if inputs is not None:
            statements.append(("DELETE FROM input", ()))
            statements += [("INSERT INTO input VALUES (?, ?, ?, ?)", tuple(item)) for item in inputs]
        self._write(*statements, durable=True)

    def start_session(self) -> None:
        """Note that this process is at work."""
        software = json.dumps(software_now())
        values = (now(), os.getpid(), socket.gethostname(), software)
        self._write(
            ("INSERT INTO session (started, process, host, software) VALUES (?, ?, ?, ?)", values),
            ("INSERT OR REPLACE INTO about VALUES ('state', ?)", (State.RUNNING,)),
        )

    def end_session(self, state: str, reason: str) -> None:
        """Note that this process's work has ended, and how."""
        self._write(
            ("UPDATE session SET ended = ? WHERE number = (SELECT MAX(number) FROM session)", (now(),)),
            ("INSERT OR REPLACE INTO about VALUES ('state', ?)", (state,)),
            ("INSERT OR REPLACE INTO about VALUES ('reason', ?)", (reason,)),
        )

    @property
    def software(self) -> dict[str, str]:
        """Versions and processor of the first session; empty if there was none."""
        rows = self._rows("SELECT software FROM session ORDER BY number LIMIT 1")
        with trusted(self.path):
            return {str(name): str(text) for name, text in json.loads(rows[0][0]).items()} if rows else {}

    def step(self, step: Step, reached: Generation, after: Checkpoint) -> None:
        """Keep one step of an optimiser; what those after it have done is forgotten.

        Parameters
        ----------
        step : Step
        reached : Generation
            Objective after it.
        after : Checkpoint
            Its last stage is the optimiser's.
        """
        stage, last = len(after.stages) - 1, after.stages[-1]
        packed = pack(last._asdict())
        told = (number_bytes(step.x), number_bytes(step.costs), step.statuses.astype("i1").tobytes())
        table, number = ("refinement", None) if stage else ("generation", reached.generation)
        row = (number, reached.best, reached.mean, last.simulations, last.seconds, *told)
        self._write(
            ("DELETE FROM refinement WHERE ? = 0", (stage,)),
            ("DELETE FROM state WHERE stage >= ?", (stage,)),
            (f"INSERT INTO {table} VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row),
            ("INSERT INTO state VALUES (?, ?, ?, ?)", (stage, *packed, digest(*packed, after.history))),
        )

    def checkpoint(self) -> Checkpoint | None:
        """State to resume from; None at the very beginning.

        Raises
        ------
        StudyError
            If the journal is not what was written.
        """
        with trusted(self.path):
            history = tuple(
                Generation(*row) for row in self._rows("SELECT number, best, mean FROM generation ORDER BY 1")
            )
            stages = []
            for text, arrays, written in self._rows("SELECT search, arrays, sha256 FROM state ORDER BY stage"):
                if written != digest(text, arrays, history):
                    raise ValueError("a state is not the one that was written")
                stages.append(Stage(**unpack(text, arrays)))
            if not stages:
                return None
            self._check_trials()
            return Checkpoint(tuple(stages), history)

    def _check_trials(self) -> None:
        """Refuse generations that have not as many costs and statuses as trials."""
        found = "COUNT(DISTINCT 1.0 * LENGTH(trials) / LENGTH(costs)), MAX(LENGTH(costs) != 8 * LENGTH(statuses))"
        if self._rows(f"SELECT {found} FROM generation") != [(1, 0)]:
            raise ValueError("a generation has not as many costs as trials")


def read_about(folder: Path) -> dict[str, Any]:
    """Facts of the run in a folder, without holding it.

    Those of the table about, and "generations done", "refinements", "best", "seconds", "changed" (UTC).

    Raises
    ------
    StudyError
        If there is no journal, or it cannot be read.
    """
    path = folder / JOURNAL
    if not path.is_file():
        raise StudyError(f"{path}: there is no journal, or it is no plain file; name the folder of a run.")
    with opened_to_read(path, RUN) as connection:
        about: dict[str, Any] = dict(connection.execute("SELECT name, text FROM about").fetchall())
        counted = "SELECT COUNT(*), MIN(best), MAX(seconds) FROM"
        done, best, seconds = connection.execute(f"{counted} generation").fetchone()
        refinements, cost, later = connection.execute(f"{counted} refinement").fetchone()
        (changed,) = connection.execute("SELECT MAX(COALESCE(ended, started)) FROM session").fetchone()
        return about | {
            "generations done": done,
            "refinements": refinements,
            "best": min((float(x) for x in (best, cost) if x is not None), default=math.inf),
            "seconds": max((float(x) for x in (seconds, later) if x is not None), default=0.0),
            "changed": changed,
        }


def _clear_parts(folder: Path) -> None:
    """Remove what a process left of files that it was writing when it was killed."""
    with suppress(OSError):
        for path in folder.glob(f".*{PART}"):
            path.unlink()


def software_now() -> dict[str, str]:
    """Versions and processor, which determine the bits of a result."""
    return software_record() | {"processor": f"{platform.machine()} {_processor()}".strip()}


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()
