"""Run a fleet: give every pending injector to a worker, and keep the results."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import file_path, flag, function, instance
from commonrail.base.errors import CommonrailError, StudyError
from commonrail.base.hooks import hold_interrupts, note
from commonrail.calibration.study import Study, objective_of
from commonrail.calibration.study_file import load_study
from commonrail.compiler.target import describe
from commonrail.engine.threads import usable_threads
from commonrail.plugins.fleet.file import write_results
from commonrail.plugins.fleet.journal import FAILED, FINISHED, JOURNAL, LOCK, Booking, Entry, Journal, load_entries
from commonrail.plugins.fleet.member import (
    Attempt,
    Calibrations,
    hash_shared_files,
    name_folders,
    record_failure,
    write_study,
)
from commonrail.plugins.fleet.study import Fleet
from commonrail.runs.fingerprint import TARGET, differing, other_bits
from commonrail.runs.folder import create_run_folder
from commonrail.workers.pool import Limits, check_count
from commonrail.workers.task import Lost, Outcome, Package, Task, pack
from commonrail.workers.workers import Workers

# Processors and versions that computed a fleet: mixed targets may change the table.

Warnings = list[dict[str, Any]]


def target_warnings(journal: Journal, entries: Sequence[Entry], study_of: Callable[[str], Study] | None) -> Warnings:
    """Warn, in the form of a fleet's record, that injectors were calibrated on different targets.

    The first finished injector is simulated again and compared bit for bit. `study_of`: returns the study of an
    injector; None if this process calibrates nothing.
    """
    finished = [entry for entry in entries if entry.status == FINISHED]
    if not finished:
        return []
    first = finished[0]
    again = (0.0, 0.0) if study_of is None else _again(first, study_of)
    text = other_bits(differing(journal.targets), f"the best values of {first.name}", *again)
    if not text:
        return []
    sentence = f"{text}: the table may differ from an uninterrupted fleet's; use a new folder to have a single target."
    return [{"code": TARGET, "injectors": len(finished), "first": first.name, "sentence": sentence}]


def _again(entry: Entry, study_of: Callable[[str], Study]) -> tuple[float, float]:
    """Objective of an injector's best values in the journal and on this machine; (0, 0) if it cannot be simulated."""
    with suppress(CommonrailError):
        study = study_of(entry.name)
        best = np.array([[entry.record["parameters"][name]["best"] for name in study.space.names]])
        return entry.record["J"]["best"], float(objective_of(study, 1).costs(best).costs[0])
    return 0.0, 0.0


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
    """A run of a fleet: its folder, the record in ``fleet.json``, and the injectors that are done, in table order."""

    folder: Path
    record: dict[str, Any]
    entries: tuple[Entry, ...]

    @property
    def interrupted(self) -> bool:
        """True if the user stopped the run."""
        return bool(self.record["status"] == "interrupted")


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
    existing = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    if not (folder / JOURNAL).is_file() and existing not in ({LOCK}, {LOCK, f"{LOCK}-journal"}):
        create_run_folder(folder)  # not if a killed fleet left its lock without a journal
    with Journal(folder) as journal, hold_interrupts() as stop:
        run = _Run(fleet, folder, journal, retry, progress)
        warnings = run.check_target()
        status, fault = FINISHED, None
        try:
            run.calibrate(usable_threads() if workers is None else workers, cluster, stop.check)
        except KeyboardInterrupt:
            status = "interrupted"
        except StudyError as error:  # workers do not start, or the cluster is lost
            if not run.begun:
                raise
            status, fault = FAILED, error
        journal.check_place()
        entries = run.in_order()
        clock = {"seconds": run.seconds, "first": run.first, "calibrated_now": run.now, "workers": run.workers}
        why = "" if fault is None else str(fault)
        record = write_results(folder, fleet, entries, status, clock, warnings=warnings, why=why)
        if fault is not None:
            raise fault
        return FleetRun(folder, record, entries)


class _Run:
    """A fleet at work."""

    def __init__(
        self,
        fleet: Fleet,
        folder: Path,
        journal: Journal,
        retry: bool,
        progress: Callable[[FleetProgress], None] | None,
    ) -> None:
        self.fleet, self.folder = fleet, folder
        self.journal, self.progress = journal, progress
        self.folders = name_folders(fleet.supply.names)
        self.inputs = {name: fleet.supply.fingerprints(name) for name in fleet.supply.names}
        shared = hash_shared_files(fleet.template)
        self.booking = Booking(fleet.supply, shared)
        self.entries = load_entries(fleet, self.inputs, journal, shared)
        self.pending = [name for name in fleet.supply.names if self._is_pending(name, retry)]
        for name in self.pending:
            self.entries.pop(name, None)
        self.now = self.workers = 0
        self.first: float | None = None
        self.begun = False
        self.start = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Time since the start of the workers."""
        return time.perf_counter() - self.start

    def in_order(self) -> tuple[Entry, ...]:
        """Injectors that are done, in the table's order."""
        return tuple(self.entries[name] for name in self.fleet.supply.names if name in self.entries)

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
        entry = Entry(name, status, attempt.reason, attempts, inputs, attempt.record, attempt.seconds)
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

    def check_target(self) -> list[dict[str, Any]]:
        """Note the target of this process if it will calibrate; warn if injectors have another target."""
        if self.pending:
            self.journal.note_target(describe().record)
        study_of = (lambda name: load_study(self._study(name))) if self.pending else None
        warnings = target_warnings(self.journal, self.in_order(), study_of)
        for warning in warnings:
            note(f"{self.folder}: {warning['sentence']}")
        return warnings

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
        return Attempt({}, reason, 0.0), task.losses
    return outcome.result, task.losses + 1
