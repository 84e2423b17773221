"""The journal of a run: one SQLite file that takes every step of a search as soon as it is done."""

from __future__ import annotations

import json
import math
import os
import platform
import socket
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.checkpoint import Checkpoint, Evolved, Found, Generation
from commonrail.calibration.result import software_record
from commonrail.errors import StudyError
from commonrail.files.atomic import PART, check_target
from commonrail.store.content import sha256
from commonrail.store.faults import UNTRUE, explained, trusted
from commonrail.store.lock import Lock
from commonrail.store.schema import check_schema, migrate

__all__ = ["JOURNAL", "LOCK", "Input", "Journal", "State", "read_about"]

Floats = NDArray[np.float64]

JOURNAL, LOCK = "journal.sqlite", "journal.lock"
PATIENCE = 30.0  # with others that have the journal open [s]


class State:
    """What became of a run."""

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


class Journal:
    """The journal of a run folder, held by this process; use it in a `with` block.

    Others may read it at any time. A transaction for each step: whatever happens to the process, every step that was
    told is kept whole. A power cut may take the last ones, which are then done again.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    StudyError
        If another process holds the folder, or what is there is no journal that this version reads.
    OutputError
        If it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / JOURNAL
        try:
            self._lock = Lock(folder / LOCK)
        except BlockingIOError:
            raise StudyError(f"{folder}: {_holder(self.path)}; wait for it, or end it first.") from None
        try:
            check_target(self.path)
            with explained(self.path), trusted(self.path):
                self._connection = sqlite3.connect(self.path, timeout=PATIENCE, isolation_level=None)
                migrate(self._connection, self.path)
                self._connection.execute("PRAGMA journal_mode=WAL")
                # without a wait for the disk at every step: after a power cut the last steps are done again
                self._connection.execute("PRAGMA synchronous=NORMAL")
                self._note_holder(f"process {os.getpid()} on {socket.gethostname()} is at work here since {_now()}")
        except BaseException:
            self._lock.close()
            raise
        _clear_parts(folder)

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the folder free; the journal is one file then, unless somebody is still reading it."""
        with suppress(sqlite3.Error):
            self._note_holder("")
            self._connection.execute("PRAGMA journal_mode=DELETE")
        self._connection.close()
        self._lock.close()

    def _note_holder(self, text: str) -> None:
        self._connection.execute("INSERT OR REPLACE INTO about VALUES ('holder', ?)", (text,))

    def _write(self, *statements: tuple[str, tuple[Any, ...]]) -> None:
        with explained(self.path):
            self._connection.execute("BEGIN")
            try:
                for text, values in statements:
                    self._connection.execute(text, values)
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise

    def _rows(self, text: str) -> list[tuple[Any, ...]]:
        with explained(self.path), trusted(self.path):
            return self._connection.execute(text).fetchall()

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
            return _count(int(self.about["generations"]))

    def describe(
        self, facts: Mapping[str, str], inputs: list[Input] | None = None, forget_refinements: bool = False
    ) -> None:
        """Write facts of the run, and in place of the former ones the files that the study reads; wait for the disk.

        To forget the refinements goes back to the end of the evolution.
        """
        statements: list[tuple[str, tuple[Any, ...]]] = [
            ("INSERT OR REPLACE INTO about VALUES (?, ?)", fact) for fact in facts.items()
        ]
        if inputs is not None:
            statements.append(("DELETE FROM input", ()))
            statements += [("INSERT INTO input VALUES (?, ?, ?, ?)", tuple(item)) for item in inputs]
        if forget_refinements:
            statements.append(("DELETE FROM refinement", ()))
        with explained(self.path):
            self._connection.execute("PRAGMA synchronous=FULL")
        self._write(*statements)
        with explained(self.path):
            self._connection.execute("PRAGMA synchronous=NORMAL")

    def start_session(self) -> None:
        """Note that this process is at work."""
        software = json.dumps(software_now())
        values = (_now(), os.getpid(), socket.gethostname(), software)
        self._write(
            ("INSERT INTO session (started, process, host, software) VALUES (?, ?, ?, ?)", values),
            ("INSERT OR REPLACE INTO about VALUES ('state', ?)", (State.RUNNING,)),
        )

    def end_session(self, state: str, reason: str) -> None:
        """Note that this process's work has ended, and how."""
        self._write(
            ("UPDATE session SET ended = ? WHERE number = (SELECT MAX(number) FROM session)", (_now(),)),
            ("INSERT OR REPLACE INTO about VALUES ('state', ?)", (state,)),
            ("INSERT OR REPLACE INTO about VALUES ('reason', ?)", (reason,)),
        )

    @property
    def software(self) -> dict[str, str]:
        """Versions and processor of the first session; empty if there was none."""
        rows = self._rows("SELECT software FROM session ORDER BY number LIMIT 1")
        with trusted(self.path):
            return {str(name): str(text) for name, text in json.loads(rows[0][0]).items()} if rows else {}

    def evolved(self, trials: Evolved, after: Checkpoint) -> None:
        """Keep one generation."""
        last, search = after.history[-1], dict(after.evolution)
        arrays = tuple(_bytes(search.pop(name)) for name in ("unit", "costs", "violations"))
        told = (_bytes(trials.x), _bytes(trials.costs), trials.statuses.astype("i1").tobytes())
        search = json.loads(json.dumps({"optimiser": search, "failures": dict(after.failures)}, default=_plain))
        search["sha256"] = _digest(arrays, search, after.history)
        row = (last.generation, last.best, last.mean, after.simulations, after.seconds)
        self._write(
            ("INSERT INTO generation VALUES (?, ?, ?, ?, ?, ?, ?, ?)", (*row, *told)),
            ("DELETE FROM population", ()),
            (
                "INSERT INTO population VALUES (?, ?, ?, ?, ?)",
                (last.generation, json.dumps(search), *arrays),
            ),
        )

    def refined(self, start: Floats, end: Found, after: Checkpoint) -> None:
        """Keep one refinement."""
        row = (after.refinements, _bytes(start), _bytes(end.x), end.cost, after.simulations, after.seconds)
        hops = json.loads(json.dumps(after.hops, default=_plain))
        hops["sha256"] = _digest((_bytes([end.cost]), row[2]), hops)
        self._write(("INSERT INTO refinement VALUES (?, ?, ?, ?, ?, ?, ?)", (*row, json.dumps(hops))))

    def checkpoint(self) -> Checkpoint | None:
        """Where to go on; None at the very beginning.

        Raises
        ------
        StudyError
            If the journal contradicts itself.
        """
        with trusted(self.path):
            return self._checkpoint()

    def _checkpoint(self) -> Checkpoint | None:
        population = self._rows("SELECT generation, search, members, costs, violations FROM population")
        if not population:
            return None
        number, text, *arrays = population[-1]
        search = dict(json.loads(text))
        digest = search.pop("sha256", None)  # journals of the first days had none
        generations = self._rows("SELECT number, best, mean, simulations, seconds FROM generation ORDER BY number")
        _check_numbers(generations, 0, number)
        history = tuple(Generation(row[0], _cost(row[1]), _cost(row[2])) for row in generations)
        evolution = dict(search["optimiser"])
        evolution |= dict(zip(("unit", "costs", "violations"), (_array(item) for item in arrays), strict=True))
        evolution["unit"] = evolution["unit"].reshape(-1, len(evolution["names"]))
        self._check_trials(evolution["unit"].shape)
        if digest is not None and digest != _digest(tuple(arrays), search, history):
            raise ValueError("a population is not the one that was written")
        failures = {str(name): _count(count) for name, count in search["failures"].items()}
        simulations, seconds = generations[-1][3:]
        return self._with_refinements(
            Checkpoint(evolution, history, _count(simulations), failures, seconds=_finite(seconds))
        )

    def _check_trials(self, shape: tuple[int, int]) -> None:
        members, dimension = shape
        lengths = "SELECT DISTINCT LENGTH(trials), LENGTH(costs), LENGTH(statuses) FROM generation"
        if self._rows(lengths) != [(8 * members * dimension, 8 * members, members)]:
            raise ValueError("a generation has not as many trials as the population has members")

    def _with_refinements(self, evolved: Checkpoint) -> Checkpoint:
        rows = self._rows("SELECT number, stop, cost, simulations, seconds, hops FROM refinement ORDER BY number")
        if not rows:
            return evolved
        _check_numbers(rows, 1, len(rows))
        ends = [Found(_array(row[1]).reshape(evolved.evolution["unit"].shape[1]), _cost(row[2])) for row in rows]
        best = min(ends, key=lambda end: end.cost)  # the first of equals, as in the search
        for row in rows:
            hops = dict(json.loads(row[5]))
            digest = hops.pop("sha256", None)
            if digest is not None and digest != _digest((_bytes([row[2]]), row[1]), hops):
                raise ValueError("a refinement is not the one that was written")
        simulations, seconds, _ = rows[-1][3:]
        return replace(
            evolved,
            simulations=_count(simulations),
            refinements=len(rows),
            refined=best if best.cost < evolved.history[-1].best else None,
            hops=hops,
            seconds=_finite(seconds),
        )


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
    with explained(path), trusted(path):
        connection = _read_only(path)
        try:
            check_schema(connection, path)
            facts: dict[str, Any] = dict(connection.execute("SELECT name, text FROM about").fetchall())
            counted = "SELECT COUNT(*), MIN(best), MAX(seconds) FROM generation"
            facts["generations done"], best, seconds = connection.execute(counted).fetchone()
            counted = "SELECT COUNT(*), MIN(cost), MAX(seconds) FROM refinement"
            facts["refinements"], cost, later = connection.execute(counted).fetchone()
            (facts["changed"],) = connection.execute("SELECT MAX(COALESCE(ended, started)) FROM session").fetchone()
        finally:
            connection.close()
        facts["best"] = min((float(x) for x in (best, cost) if x is not None), default=math.inf)
        facts["seconds"] = max((float(x) for x in (seconds, later) if x is not None), default=0.0)
    return facts


def _read_only(path: Path) -> sqlite3.Connection:
    address = f"{path.absolute().as_uri()}?mode=ro"
    try:
        return _connect(address)
    except sqlite3.OperationalError:  # a write-ahead log in a folder that cannot be written to
        return _connect(f"{address}&immutable=1")


def _connect(address: str) -> sqlite3.Connection:
    connection = sqlite3.connect(address, uri=True, timeout=5.0)
    try:
        connection.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def _check_numbers(rows: list[tuple[Any, ...]], first: int, last: int) -> None:
    if len(rows) != last - first + 1 or any(row[0] != first + i for i, row in enumerate(rows)):
        raise ValueError("steps are missing")


def _digest(arrays: tuple[bytes, ...], search: Mapping[str, Any], history: Sequence[Generation] = ()) -> str:
    """SHA-256 of what a search goes on from; SQLite does not notice a bit that has flipped on the disk."""
    past = _bytes([(step.generation, step.best, step.mean) for step in history])
    return sha256(b"".join((*arrays, past, json.dumps(search, sort_keys=True).encode())))


def _cost(value: Any) -> float:
    """A cost, which is infinite where nothing was simulated."""
    if not -math.inf < float(value):
        raise ValueError("a cost is no number")
    return float(value)


def _finite(value: Any) -> float:
    if not math.isfinite(value):
        raise ValueError("a time is no number")
    return float(value)


def _count(value: Any) -> int:
    if not isinstance(value, int) or value < 0:
        raise ValueError("a count is no number")
    return value


def _holder(path: Path) -> str:
    """Who is at work, as far as the journal tells."""
    with suppress(sqlite3.Error, *UNTRUE):
        connection = _read_only(path)
        try:
            row = connection.execute("SELECT text FROM about WHERE name = 'holder'").fetchone()
        finally:
            connection.close()
        if row and row[0]:
            return str(row[0])
    return "another process has just begun to work here"


def _clear_parts(folder: Path) -> None:
    """Remove what a process left of files that it was writing when it was killed."""
    with suppress(OSError):
        for path in folder.glob(f".*{PART}"):
            path.unlink()


def software_now() -> dict[str, str]:
    """What decides over the bits of a result: versions and processor."""
    return software_record() | {"processor": f"{platform.machine()} {_processor()}".strip()}


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _bytes(array: Any) -> bytes:
    return np.ascontiguousarray(array, "<f8").tobytes()


def _array(content: bytes) -> Floats:
    return np.frombuffer(content, "<f8").astype(float)


def _plain(value: Any) -> Any:
    """Arrays and NumPy's numbers for JSON."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be kept")
