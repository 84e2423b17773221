"""The journal of a run: one SQLite file that takes every step of a search as soon as it is done."""

from __future__ import annotations

import json
import math
import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.calibration.checkpoint import Checkpoint, Generation, Stage, Step
from commonrail.compile_target import describe
from commonrail.errors import StudyError
from commonrail.files.atomic import PART
from commonrail.store.faults import trusted
from commonrail.store.journal_file import JournalFile, facts, now, opened_to_read
from commonrail.store.run_schema import RUN
from commonrail.store.seals import put, rows_of
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
    """The journal of a run folder, a `JournalFile`; it does not wait for the disk at every step of the search."""

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
        return {str(name): str(text) for name, text in self._table("about")}

    @property
    def inputs(self) -> list[Input]:
        """Files that the study reads.

        Raises
        ------
        StudyError
            If one would lie outside the run folder.
        """
        found = [Input(*map(str, row)) for row in self._table("input")]
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
        """Write facts of the run, and in place of the former ones the files that the study reads; wait for the disk.

        They are in the main file then, so that no damage to the log takes them.
        """
        statements = facts(about.items())
        if inputs is not None:
            statements.append(("DELETE FROM input", ()))
            statements += [put("input", *item) for item in inputs]
        self._write(*statements, durable=True)
        self._shorten_log()

    def start_session(self) -> None:
        """Note that this process is at work, and the target that it computes on."""
        row = (now(), None, os.getpid(), socket.gethostname(), json.dumps(describe().record))
        self._write(put("session", self._next("session"), *row), *facts([("state", State.RUNNING)]))

    def end_session(self, state: str, reason: str) -> None:
        """Note that this process's work has ended, and how."""
        number, started, _, *rest = self._table("session")[-1]
        ended = put("session", number, started, now(), *rest)
        self._write(ended, *facts([("state", state), ("reason", reason)]))

    @property
    def targets(self) -> list[dict[str, str]]:
        """Versions, and the processor that was compiled for, of each session."""
        with trusted(self.path):
            found = [json.loads(row[-1]) for row in self._table("session")]
            return [{str(name): str(text) for name, text in target.items()} for target in found]

    def step(self, step: Step, reached: Generation, after: Checkpoint) -> None:
        """Keep one step of an optimiser; what those after it have done is forgotten.

        Parameters
        ----------
        step, reached, after
            As `Recorder.step`.
        """
        stage, last = len(after.stages) - 1, after.stages[-1]
        packed = pack(last._asdict())
        told = (number_bytes(step.x), number_bytes(step.costs), step.statuses.astype("i1").tobytes())
        table, number = ("refinement", self._next("refinement")) if stage else ("generation", reached.generation)
        row = (number, reached.best, reached.mean, last.simulations, last.seconds, *told)
        self._write(
            ("DELETE FROM refinement WHERE ? = 0", (stage,)),
            ("DELETE FROM state WHERE stage >= ?", (stage,)),
            put(table, *row),
            put("state", stage, *packed, digest(*packed, after.history)),
        )

    def checkpoint(self) -> Checkpoint | None:
        """State to resume from; None at the very beginning.

        Raises
        ------
        StudyError
            If the journal is not what was written.
        """
        with trusted(self.path):
            history = tuple(Generation(*row[:3]) for row in self._table("generation"))
            stages: list[Stage] = []
            for number, text, arrays, written in self._table("state"):
                if number != len(stages) or written != digest(text, arrays, history):
                    raise ValueError("a state is not the one that was written")
                stages.append(Stage(**unpack(text, arrays)))
            if not stages and history:
                raise ValueError("the state after the last generation is missing")
            self._trials()
            return Checkpoint(tuple(stages), history) if stages else None

    def _trials(self) -> list[tuple[Floats, Floats]]:
        """Trials (n, d) [SI] and costs (n,) of each generation and refinement."""
        found, widths = [], set()
        for table in ("generation", "refinement"):
            for *_, trials, costs, statuses in self._table(table):
                if len(costs) != 8 * len(statuses):
                    raise ValueError("a generation has not as many costs as trials")
                told = np.frombuffer(costs, "<f8")
                found.append((np.frombuffer(trials, "<f8").reshape(len(told), -1), told))
                widths.add(found[-1][0].shape[1])
        if len(widths) > 1:
            raise ValueError("a generation has not as many costs as trials")
        return found

    def best_step(self) -> tuple[Floats, Floats]:
        """Trials (n, d) [SI] and costs (n,) of the step that found the lowest cost; empty before the first one."""
        with trusted(self.path):
            nothing = (np.empty((0, 0)), np.empty(0))
            return min(self._trials(), key=lambda step: step[1].min(initial=np.inf), default=nothing)


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
        about: dict[str, Any] = dict(rows_of(connection, "about"))
        sessions, generations, refinements = (
            rows_of(connection, table) for table in ("session", "generation", "refinement")
        )
        steps = generations + refinements
        return about | {
            "generations done": len(generations),
            "refinements": len(refinements),
            "best": min((float(row[1]) for row in steps), default=math.inf),
            "seconds": max((float(row[4]) for row in steps), default=0.0),
            "changed": max((ended or started for _, started, ended, *_ in sessions), default=None),
        }


def _clear_parts(folder: Path) -> None:
    """Remove what a process left of files that it was writing when it was killed."""
    with suppress(OSError):
        for path in folder.glob(f".*{PART}"):
            path.unlink()
