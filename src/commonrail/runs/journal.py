"""The journal of a run: one SQLite file that takes every step of a search as soon as it is done."""

from __future__ import annotations

import json
import math
import os
import socket
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError, StudyError
from commonrail.base.input import check_plain
from commonrail.base.output import PART, check_target
from commonrail.calibration.search import Checkpoint, Generation, Stage, Step
from commonrail.compiler.target import describe
from commonrail.runs.lock import UNTRUE, Lock, check_trust, explain_errors, refuse_rollback
from commonrail.runs.tables import RUN, Schema, Statement, digest, number_bytes, pack, put, read_rows, unpack

# An SQLite file in a folder that one process holds and others read: what all journals have in common.

PATIENCE = 30.0  # with others that have the journal open [s]
LONGEST_LOG = 4_000_000  # written to the log before the main file takes it [bytes]

# Values of the fact "log": in the main file, that a log with more data belongs to it; in the log, that it is present.
NEEDED, THERE = "needed", "there"

# Mode before and after the log is in use. A rollback journal in a file, the default, could remain after a crash, and
# could not be distinguished from a planted file. Meanwhile only the head of the file is written, in one piece.
_NO_ROLLBACK_FILE = "PRAGMA journal_mode=MEMORY"


class JournalFile:
    """A journal in a folder, held by this process; use it in a `with` block.

    Others may read it at any time. Each step is one transaction: every reported step is kept completely, even if the
    process is killed. Each kind of journal adds its tables, one of which is ``about`` (name, text). Every row is
    sealed, and all seals are checked before anything is written.

    `StudyError` if another process holds the folder, or if the file is not a journal of this version, is damaged, or
    has lost its log; `OutputError` if it cannot be written.
    """

    NAME: ClassVar[str]
    LOCK: ClassVar[str]
    SCHEMA: ClassVar[Schema]
    # Whether each step waits for the disk; if not, a power cut takes the last ones, which are then done again.
    DURABLE: ClassVar[bool]

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / self.NAME
        self._lock = _lock(folder / self.LOCK, self.path)
        try:
            check_target(self.path)
            refuse_rollback(self.path)
            with explain_errors(self.path), check_trust(self.path):
                self._open()
        except BaseException:
            self._lock.close()
            raise

    def _open(self) -> None:
        with_log = _has_log(self.path)
        self._connection = sqlite3.connect(self.path, timeout=PATIENCE, isolation_level=None)
        try:
            has_tables = _check(self._connection, self.path, self.SCHEMA, with_log)
            if self._connection.execute("PRAGMA journal_mode").fetchone() != ("wal",):
                self._connection.execute(_NO_ROLLBACK_FILE)
                self._connection.execute("PRAGMA journal_mode=WAL")
            if not has_tables:
                self.SCHEMA.create(self._connection)
            self._connection.execute("PRAGMA wal_autocheckpoint=0")
            self._connection.execute(_synchronous(self.DURABLE))
            self._note(holder=f"process {os.getpid()} on {socket.gethostname()} is at work here since {now()}")
            self._shorten_log()
        except BaseException:
            self._connection.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_in_place(self) -> bool:
        """Return whether the folder's name still leads to the folder that was opened."""
        return self._lock.is_in_place

    def check_place(self) -> None:
        """Refuse (`StudyError`) to write into what has taken the folder's place since it was opened."""
        self._lock.check_place()

    def close(self) -> None:
        """Release the lock; SQLite merges the log unless a reader is open."""
        if self.is_in_place:  # SQLite would remove a log by its name, which may by now be another journal's
            with suppress(sqlite3.Error):
                self._note(holder="", log="")
                self._connection.execute(_NO_ROLLBACK_FILE)
        self._connection.close()
        self._lock.close()

    def _note(self, **pairs: str) -> None:
        for statement in facts(pairs.items()):
            self._connection.execute(*statement)

    def _shorten_log(self) -> None:
        """Move the log into the main file, which notes that a log belongs to it; a reader may delay this."""
        with explain_errors(self.path):
            self._note(log=NEEDED)
            self._connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
            self._note(log=THERE)
            self._logged = 0

    def _write(self, *statements: Statement, durable: bool = False) -> None:
        """Execute statements as one transaction; a `durable` one waits for the disk in any case."""
        self.check_place()
        with explain_errors(self.path):
            self._connection.execute(_synchronous(durable or self.DURABLE))
            self._connection.execute("BEGIN")
            try:
                for text, values in statements:
                    self._connection.execute(text, values)
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise
            self._logged += sum(len(v) for _, values in statements for v in values if isinstance(v, str | bytes))
            if self._logged > LONGEST_LOG:
                self._shorten_log()

    def _table(self, name: str) -> list[tuple[Any, ...]]:
        """Rows of a table without their seals, by key or in the order of writing; `StudyError` if one was changed."""
        with explain_errors(self.path), check_trust(self.path):
            return list(read_rows(self._connection, name))

    def _next(self, table: str) -> int:
        """Number of the next row of a table that counts from 1."""
        with explain_errors(self.path), check_trust(self.path):
            (last,) = self._connection.execute(f"SELECT COALESCE(MAX(number), 0) FROM {table}").fetchone()
            return int(last) + 1


def _lock(path: Path, journal: Path) -> Lock:
    """Lock of a folder; `StudyError` with the process that holds it according to its journal."""
    try:
        return Lock(path)
    except BlockingIOError:
        holder = _holder(journal) or "another process has just begun to work here"
        raise StudyError(f"{path.parent}: {holder}; wait for it, or end it first.") from None


def _synchronous(durable: bool) -> str:
    return f"PRAGMA synchronous={'FULL' if durable else 'NORMAL'}"  # whether a transaction waits for the disk


def facts(pairs: Iterable[tuple[str, str]]) -> list[Statement]:
    """Statements that write facts into the table ``about``."""
    return [put("about", *pair) for pair in pairs]


@contextmanager
def opened_to_read(path: Path, schema: Schema) -> Iterator[sqlite3.Connection]:
    """Connection for reading a journal without holding it; for an empty file, to empty tables in memory.

    `StudyError` if the file is not a journal of this version, is damaged, or has lost its log.
    """
    refuse_rollback(path)
    with_log = _has_log(path)
    with explain_errors(path), check_trust(path), closing(_read_only(path)) as connection:
        if _check(connection, path, schema, with_log or _has_log(path)):
            yield connection
            return
        with closing(sqlite3.connect(":memory:")) as empty:
            schema.create(empty)
            yield empty


def _check(connection: sqlite3.Connection, path: Path, schema: Schema, with_log: bool) -> bool:
    """True if a file holds a journal of which every row is the one that was written; False if it is empty.

    `with_log`: it has a write-ahead log.
    """
    # check the tables first: SQLite would evaluate conditions of foreign tables in its own check, at any cost
    if not schema.check(connection, path):
        return False
    (fault,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
    if fault != "ok":
        raise ValueError(fault)
    log = ""
    for table in schema.tables:
        for row in read_rows(connection, table):
            log = str(row[1]) if (table, row[0]) == ("about", "log") else log
    if log == NEEDED and not with_log:
        raise StudyError(
            f"{path}: its log {path.name}-wal is missing, and the last steps with it; bring it back beside the "
            "journal, or take a copy of both."
        )
    return True


def _has_log(path: Path) -> bool:
    """Return whether a journal has a write-ahead log that is not empty."""
    with suppress(OSError):
        return path.with_name(f"{path.name}-wal").stat().st_size > 0
    return False


def _read_only(path: Path) -> sqlite3.Connection:
    if path.exists():
        check_plain(path)  # SQLite would wait for the other end of a pipe
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


def _holder(path: Path) -> str:
    """Process at work according to the journal."""
    with suppress(sqlite3.Error, InputError, *UNTRUE), closing(_read_only(path)) as connection:
        row = connection.execute("SELECT text FROM about WHERE name = 'holder'").fetchone()
        return str(row[0]) if row else ""
    return ""


def now() -> str:
    """The time [UTC] as journals write it."""
    return datetime.now(UTC).isoformat(timespec="seconds")


JOURNAL, LOCK = "journal.sqlite", "journal.lock"
ESTIMATED = "estimated"  # fact of a run: objective of the most likely values, if they are the calibrated ones
STARTS = "starts"  # fact of a run: number of starts of the search for the most likely values, if stated


@contextmanager
def held_run(folder: Path) -> Iterator[Lock]:
    """Lock of a run folder, for writing without its journal; `StudyError` if another process holds it."""
    with closing(_lock(folder / LOCK, folder / JOURNAL)) as lock:
        yield lock


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


class RunJournal(JournalFile):
    """The journal of a run of any kind: facts, and the sessions of the processes that worked on it.

    `session`: number of this process's session, 0 before it is started.
    """

    session = 0

    @property
    def about(self) -> dict[str, str]:
        """Facts of the run by name."""
        return {str(name): str(text) for name, text in self._table("about")}

    @property
    def has_begun(self) -> bool:
        """True if the journal has the fingerprint of the run's settings."""
        return "content" in self.about

    def describe(self, about: Mapping[str, str], *more: Statement) -> None:
        """Write facts of the run, with more statements in the same transaction, and wait for the disk.

        They are then in the main file, safe from damage to the log.
        """
        self._write(*facts(about.items()), *more, durable=True)
        self._shorten_log()

    def start_session(self) -> None:
        """Note that this process is at work, and the target that it computes on."""
        self.session = self._next("session")
        row = (now(), None, os.getpid(), socket.gethostname(), json.dumps(describe().record))
        self._write(put("session", self.session, *row), *facts([("state", State.RUNNING)]))

    def end_session(self, state: str, reason: str) -> None:
        """Note that this process's work has ended, and how."""
        number, started, _, *rest = self._table("session")[-1]
        ended = put("session", number, started, now(), *rest)
        self._write(ended, *facts([("state", state), ("reason", reason)]))

    @property
    def targets(self) -> list[dict[str, str]]:
        """Versions and target processor of each session."""
        with check_trust(self.path):
            targets = [json.loads(row[-1]) for row in self._table("session")]
            return [{str(name): str(text) for name, text in target.items()} for target in targets]


class Journal(RunJournal):
    """The journal of a search in a run folder; it does not wait for the disk at every step."""

    NAME, LOCK, SCHEMA, DURABLE = JOURNAL, LOCK, RUN, False

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        with suppress(OSError):  # what a process left of files that it was writing when it was killed
            for path in folder.rglob(f".*{PART}"):
                path.unlink()

    @property
    def inputs(self) -> list[Input]:
        """Files that the settings were read from; `StudyError` if one would lie outside the run folder."""
        files = [Input(*map(str, row)) for row in self._table("input")]
        for item in files:
            if Path(item.name).is_absolute() or ".." in Path(item.name).parts:
                raise StudyError(f"{self.path}: the path {item.name} leaves the run folder; use an intact copy.")
        return files

    @property
    def generations(self) -> int:
        """Generations wanted after the initial population."""
        with check_trust(self.path):
            count = int(self.about["generations"])
            if count < 0:
                raise ValueError("a count is no number")
            return count

    def describe_files(self, about: Mapping[str, str], inputs: list[Input]) -> None:
        """Write facts of the run, and replace the files that the study reads; see `describe`."""
        self.describe(about, ("DELETE FROM input", ()), *(put("input", *item) for item in inputs))

    def step(self, step: Step, reached: Generation, after: Checkpoint) -> None:
        """Keep one step of an optimiser, as a `Recorder`; steps of later optimisers are deleted."""
        stage, last = len(after.stages) - 1, after.stages[-1]
        packed = pack(last._asdict())
        arrays = (number_bytes(step.x), number_bytes(step.costs), step.statuses.astype("i1").tobytes())
        table, number = ("refinement", self._next("refinement")) if stage else ("generation", reached.generation)
        row = (number, reached.best, reached.mean, last.simulations, last.seconds, *arrays)
        self._write(
            ("DELETE FROM refinement WHERE ? = 0", (stage,)),
            ("DELETE FROM state WHERE stage >= ?", (stage,)),
            put(table, *row),
            put("state", stage, *packed, digest(*packed, after.history)),
        )

    def checkpoint(self) -> Checkpoint | None:
        """State to resume from; None at the very beginning. `StudyError` if it was changed."""
        with check_trust(self.path):
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
        steps, widths = [], set()
        for table in ("generation", "refinement"):
            for *_, trials, costs, statuses in self._table(table):
                if len(costs) != 8 * len(statuses):
                    raise ValueError("a generation has not as many costs as trials")
                cost_array = np.frombuffer(costs, "<f8")
                steps.append((np.frombuffer(trials, "<f8").reshape(len(cost_array), -1), cost_array))
                widths.add(steps[-1][0].shape[1])
        if len(widths) > 1:
            raise ValueError("a generation has not as many costs as trials")
        return steps

    def best_step(self) -> tuple[Floats, Floats]:
        """Trials (n, d) [SI] and costs (n,) of the step that found the lowest cost; empty before the first one."""
        with check_trust(self.path):
            nothing = (np.empty((0, 0)), np.empty(0))
            return min(self._trials(), key=lambda step: step[1].min(initial=np.inf), default=nothing)


def best_course(folder: Path) -> Floats:
    """Best candidate so far after each generation of the run in a folder, (generations, d) [SI].

    `StudyError` if the journal cannot be read.
    """
    path = folder / JOURNAL
    best: list[Floats] = []
    lowest = math.inf
    with opened_to_read(path, RUN) as connection:
        for _, _, _, _, _, trials, costs, _ in read_rows(connection, "generation"):
            values = np.nan_to_num(np.frombuffer(costs, "<f8"), nan=np.inf)
            at = int(np.argmin(values))
            if values[at] < lowest or not best:
                lowest = float(values[at])
                candidate = np.frombuffer(trials, "<f8").reshape(len(values), -1)[at]
            best.append(candidate)
    return np.array(best)


def read_inputs(folder: Path) -> list[Input]:
    """Files that the settings of the run in a folder were read from, without holding it; errors as `read_about`."""
    with opened_to_read(folder / JOURNAL, RUN) as connection:
        return [Input(*map(str, row)) for row in read_rows(connection, "input")]


def read_about(folder: Path) -> dict[str, Any]:
    """Facts of the run in a folder, without holding it; `StudyError` if the journal is missing or cannot be read.

    Those of the table about, and "generations done", "refinements", "best", "seconds", "changed" (UTC).
    """
    path = folder / JOURNAL
    if not path.is_file():
        raise StudyError(f"{path}: there is no journal, or it is no plain file; name the folder of a run.")
    with opened_to_read(path, RUN) as connection:
        about: dict[str, Any] = dict(read_rows(connection, "about"))
        generations, refinements = (
            [row[:5] for row in read_rows(connection, table)] for table in ("generation", "refinement")
        )
        steps = generations + refinements
        return about | {
            "generations done": len(generations),
            "refinements": len(refinements),
            "best": float(about.get(ESTIMATED) or min((row[1] for row in steps), default=math.inf)),
            "seconds": max((float(row[4]) for row in steps), default=0.0),
            "changed": max((row[2] or row[1] for row in read_rows(connection, "session")), default=None),
        }
