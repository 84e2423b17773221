"""Run a fleet: give every pending injector to a worker, and keep the results."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import file_path, flag, function, instance
from commonrail.base.errors import CommonrailError, InputError, StudyError
from commonrail.base.hooks import hold_interrupts, note
from commonrail.base.input import fingerprint
from commonrail.base.output import writing
from commonrail.calibration.study import objective_of
from commonrail.calibration.study_file import load_study
from commonrail.engine.threads import usable_threads
from commonrail.plugins.fleet.file import FleetRecord, FleetWarning, RunClock, summarise_fleet, write_results
from commonrail.plugins.fleet.journal import FAILED, FINISHED, Entry, Journal, load_entries
from commonrail.plugins.fleet.member import (
    Attempt,
    Calibrations,
    hash_common_inputs,
    hash_shared_files,
    name_folders,
    record_failure,
    write_study,
)
from commonrail.plugins.fleet.study import Fleet, Supply
from commonrail.runs.fingerprint import TARGET, differing, other_bits
from commonrail.runs.fit import check_free, run_session
from commonrail.runs.journal import State, opened_to_read
from commonrail.runs.tables import read_rows
from commonrail.workers.pool import Limits, check_count
from commonrail.workers.task import Lost, Outcome, Package, Task, pack
from commonrail.workers.workers import Workers

Inputs = Mapping[str, str]  # fingerprints of the files that a worker read for an injector's result


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
                    return Attempt(None, reason, attempt.seconds), {}
        return attempt, inputs


INJECTORS = "injectors"  # folder with a study for each
TRIED = 3  # injectors read before the workers start


class FleetProgress(NamedTuple):
    """Progress of a fleet.

    `done`, `failed`, `total`: numbers of injectors; `now`: done since the start, in `seconds`; `last`: done last.
    """

    done: int
    failed: int
    total: int
    now: int
    seconds: float
    last: Entry


@dataclass(frozen=True)
class FleetRun:
    """A run of a fleet.

    Attributes
    ----------
    folder : Path
    record : dict
        Content of ``fleet.json``.
    result : FleetRecord
        The record as an object.
    entries : tuple of Entry
        Injectors that are done, in the order of the table.
    """

    folder: Path
    record: dict[str, Any]
    result: FleetRecord
    entries: tuple[Entry, ...]
    reason = ""  # a run that ends for another reason than the user's raises an error

    @property
    def status(self) -> str:
        """ "finished" or "interrupted"."""
        return self.result.status

    @property
    def interrupted(self) -> bool:
        """True if the user stopped the run."""
        return self.status == State.INTERRUPTED


def fleet(
    fleet: Fleet,
    folder: Path,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    retry: bool = False,
    progress: Callable[[FleetProgress], None] | None = None,
) -> FleetRun:
    """Calibrate the injectors of a fleet into a folder, or resume an earlier run in that folder.

    The result does not depend on the number of workers, on the order of the table, or on stops. Injectors may be added
    to the table between runs. In a script, call this function below ``if __name__ == "__main__":``.

    Parameters
    ----------
    fleet : Fleet
    folder : path
        New folder, or folder of an earlier run.
    workers : int, optional
        Number of processes, or workers of a "local" cluster; all usable processors by default.
    cluster : str, optional
        Address of the scheduler of a Dask cluster, "tcp://host:port", or "local" for a cluster on this machine.
    retry : bool
        Repeat all failed injectors, not only those with changed data.
    progress : function of FleetProgress, optional
        Called after every injector.

    Raises
    ------
    ConfigurationError
        If an argument has the wrong type, or there are too many workers; nothing is written.
    InputError
        If the folder has other content; nothing is written.
    StudyError
        If another process works in the folder, the folder has another fleet, or none of the first injectors can be
        read. Also if workers do not start or a cluster is lost; the tables are written then.
    OutputError
        If the disk is full; finished injectors are kept.
    """
    instance(fleet, Fleet, "fleet")
    folder = file_path(folder, "folder")
    if workers is not None:
        check_count(workers)
    flag(retry, "retry")
    function(progress, "progress")
    _refuse_used(folder)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with Journal(folder) as journal, hold_interrupts() as stop:
        run = _Run(fleet, journal, retry, progress)
        count = usable_threads() if workers is None else workers
        return run_session(journal, lambda: run.run(count, cluster, stop.check))


def _refuse_used(folder: Path) -> None:
    """Refuse a folder with other content, unless its journal is that of a fleet that has begun."""
    path = folder / Journal.NAME
    if not path.is_file():
        check_free(folder, journal=Journal)
        return
    with opened_to_read(path, Journal.SCHEMA) as connection:
        has_begun = "content" in dict(read_rows(connection, "about"))
    if not has_begun:
        try:
            check_free(folder, journal=Journal)
        except InputError as error:
            raise InputError(
                f"{path}: this journal is empty, but the folder has other files; bring the journal back, or name "
                "another folder, nothing was overwritten."
            ) from error


class _Run:
    """A fleet at work."""

    def __init__(
        self, fleet: Fleet, journal: Journal, retry: bool, progress: Callable[[FleetProgress], None] | None
    ) -> None:
        self.fleet, self.folder = fleet, journal.folder
        self.journal, self.progress = journal, progress
        self.folders = name_folders(fleet.supply.names)
        self.inputs = {name: fleet.supply.fingerprints(name) for name in fleet.supply.names}
        shared = hash_shared_files(fleet.template)
        self.booking = Booking(fleet.supply, shared)
        self.entries = load_entries(fleet, self.inputs, journal, hash_common_inputs(fleet, shared))
        self.pending = [name for name in fleet.supply.names if self._is_pending(name, retry)]
        for name in self.pending:
            self.entries.pop(name, None)
        self.now = self.workers = 0
        self.first: float | None = None
        self.begun = False
        self.start = time.perf_counter()

    def run(self, count: int, cluster: str | None, check_stop: Callable[[], None]) -> FleetRun:
        """Calibrate the pending injectors, and write the results of all that are done."""
        warnings = self._compare_targets()
        status, fault = State.FINISHED, None
        try:
            self.calibrate(count, cluster, check_stop)
        except KeyboardInterrupt:
            status = State.INTERRUPTED
        except StudyError as error:  # workers do not start, or the cluster is lost
            if not self.begun:
                raise
            status, fault = State.FAILED, error
        self.journal.check_place()
        entries = tuple(self.entries[name] for name in self.fleet.supply.names if name in self.entries)
        clock = RunClock(self.seconds, self.first, self.now, self.workers)
        result = summarise_fleet(self.fleet, entries, status, clock, warnings)
        record = write_results(self.folder, self.fleet, entries, result, "" if fault is None else str(fault))
        if fault is not None:
            raise fault
        return FleetRun(self.folder, record, result, entries)

    @property
    def seconds(self) -> float:
        """Time since the start of the workers."""
        return time.perf_counter() - self.start

    def calibrate(self, count: int, cluster: str | None, check_stop: Callable[[], None]) -> None:
        """Calibrate the pending injectors."""
        if not self.pending:
            return
        package = self._package()
        count, limits = min(count, len(self.pending)), Limits(failures=self.fleet.attempts)
        self.start, self.begun = time.perf_counter(), True
        opened = Workers.processes(count, limits) if cluster is None else Workers.cluster(cluster, count, limits)
        with opened as workers:
            self.workers = workers.backend.count
            tasks = self._tasks(self.pending, package, workers.backend.shares_files)
            for task, outcome in workers.run(tasks, check_stop=check_stop):
                self._keep(str(task.name), *_attempt(task, outcome))

    def _tasks(self, names: Sequence[str], package: Package, shared: bool) -> Iterator[Task]:
        """Yield the task of each injector; studies are loaded here if workers cannot read the files."""
        for name in names:
            path = self._study(name)
            try:
                study_source = path if shared else load_study(path)
            except CommonrailError as error:
                self._keep(name, record_failure(error), 1)
            else:
                yield Task(name, package, study_source, self.fleet.time_limit)

    def _study(self, name: str) -> Path:
        self.journal.check_place()
        return self.booking.hand_out(name, write_study(self.fleet, name, self.folder / INJECTORS / self.folders[name]))

    def _keep(self, name: str, attempt: Attempt, attempts: int) -> None:
        attempt, inputs = self.booking.book(name, attempt, self.inputs[name])
        status = FAILED if attempt.reason else FINISHED
        session = self.journal.session
        entry = Entry(name, status, attempt.reason, attempts, inputs, attempt.record, attempt.seconds, session)
        self.journal.write(entry)
        self.now += name not in self.entries
        self.entries[name] = entry
        self.first = self.seconds if self.first is None else self.first
        self._tell(entry)

    def _tell(self, last: Entry) -> None:
        if self.progress is None:
            return
        failed = sum(entry.status == FAILED for entry in self.entries.values())
        total = len(self.fleet.supply.names)
        with suppress(OSError, ValueError):  # a terminal that went away must not end the work
            self.progress(FleetProgress(len(self.entries), failed, total, self.now, self.seconds, last))

    def _is_pending(self, name: str, retry: bool) -> bool:
        entry = self.entries.get(name)
        if entry is None:
            return True
        return entry.status == FAILED and (retry or entry.inputs != self.inputs[name])

    def _compare_targets(self) -> list[FleetWarning]:
        """Warn if injectors were calibrated on several targets, which may change the table.

        The first finished injector is simulated again and compared bit for bit, if this process will calibrate.
        """
        finished = [self.entries[name] for name in self.fleet.supply.names if self._is_finished(name)]
        if not finished:
            return []
        sessions, recomputed = {entry.session for entry in finished}, (0.0, 0.0)
        if self.pending:
            sessions.add(self.journal.session)
            recomputed = self._recompute(finished[0])
        first = finished[0].name
        text = other_bits(differing(self.journal.list_targets(sessions)), f"the best values of {first}", *recomputed)
        if not text:
            return []
        sentence = (
            f"{text}: the table may differ from an uninterrupted fleet's; use a new folder to have a single target."
        )
        note(f"{self.folder}: {sentence}")
        return [FleetWarning(TARGET, len(finished), first, sentence)]

    def _is_finished(self, name: str) -> bool:
        return name in self.entries and self.entries[name].status == FINISHED

    def _recompute(self, entry: Entry) -> tuple[float, float]:
        """Objective of an injector's best values in the journal and here; (0, 0) if it cannot be simulated."""
        with suppress(CommonrailError):
            study = load_study(self._study(entry.name))
            best = np.array([[entry.result.parameters[name].best for name in study.space.names]])
            return entry.result.best_cost, float(objective_of(study, 1).costs(best).costs[0])
        return 0.0, 0.0

    def _package(self) -> Package:
        """Load the first studies to report a common fault at once, and compile the kernels for the workers."""
        faults: list[CommonrailError] = []
        for name in self.pending[:TRIED]:
            try:
                return pack(Calibrations(load_study(self._study(name))))
            except CommonrailError as error:
                faults.append(error)
        if not self.entries:
            raise type(faults[0])(f"None of the first {len(faults)} injectors can be read; the first: {faults[0]}")
        return pack(Calibrations(None))


def _attempt(task: Task, outcome: Outcome) -> tuple[Attempt, int]:
    """Return the attempt for the journal, and the number of attempts."""
    if isinstance(outcome, Lost):
        reason = f"Each of {task.losses} attempts was lost; the last time the worker {outcome.reason}."
        return Attempt(None, reason, 0.0), task.losses
    return outcome.result, task.losses + 1
