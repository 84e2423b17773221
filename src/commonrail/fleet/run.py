"""Run a fleet: hand every injector that is not done yet to a worker, and keep what comes back."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.calibration.interrupt import held_interrupts
from commonrail.calibration.result import software_record
from commonrail.calibration.run import scores_of
from commonrail.calibration.study import Study
from commonrail.engine.simulate import usable_threads
from commonrail.errors import CommonrailError, InputError, StudyError
from commonrail.files.run_folder import create_run_folder
from commonrail.files.study_file import load_study
from commonrail.fleet.fleet_file import Fleet
from commonrail.fleet.journal import FAILED, FINISHED, JOURNAL, Entry, Journal
from commonrail.fleet.member import folders_of, shared_files, write_study
from commonrail.fleet.pool import Limits, Outcome, Pool
from commonrail.fleet.results import write_results
from commonrail.fleet.summary import check_entries
from commonrail.fleet.supply import MISSING_FILE, fingerprint_of
from commonrail.fleet.task import Done, Refused

__all__ = ["INJECTORS", "FleetProgress", "FleetRun", "run_fleet"]

INJECTORS = "injectors"  # folder with a study for each
TRIED = 3  # injectors that are read before the workers start


class FleetProgress(NamedTuple):
    """How far a fleet has come.

    Injectors done, failed among them, in all, done since the start, seconds since then, and the one done last.
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
        What ``fleet.json`` holds.
    entries : tuple of Entry
        Injectors that are done, in the table's order.
    """

    folder: Path
    record: dict[str, Any]
    entries: tuple[Entry, ...]

    @property
    def interrupted(self) -> bool:
        """Whether the user stopped it."""
        return bool(self.record["status"] == "interrupted")


def run_fleet(
    fleet: Fleet,
    folder: Path,
    *,
    workers: int | None = None,
    retry: bool = False,
    progress: Callable[[FleetProgress], None] | None = None,
) -> FleetRun:
    """Calibrate the injectors of a fleet into a folder, or go on where an earlier run in that folder stopped.

    The result does not depend on the number of workers, on the order of the table, or on how often the run was stopped.
    In a script, call it below ``if __name__ == "__main__":``.

    Parameters
    ----------
    fleet : Fleet
    folder : Path
        New, empty, or left by an earlier run of the same fleet; injectors may have been added to its table.
    workers : int, optional
        Processes; all usable processors by default.
    retry : bool
        Try failed injectors again; without it only those whose data have changed.
    progress : function of FleetProgress, optional
        Called after every injector.

    Raises
    ------
    InputError
        If the folder holds something else or cannot be written.
    StudyError
        If another process is at work in the folder, what was begun there differs from this fleet, or not one of the
        first injectors can be read.
    OutputError
        If the disk is full; finished injectors are kept.
    """
    if not (folder / JOURNAL).is_file():
        create_run_folder(folder)
    with Journal(folder) as journal, held_interrupts() as wish:
        run = _Run(fleet, folder, journal, retry, progress)
        status = FINISHED
        try:
            run.calibrate(usable_threads() if workers is None else workers, wish.heed)
        except KeyboardInterrupt:
            status = "interrupted"
        entries = run.in_order()
        clock = {"seconds": run.seconds, "first": run.first, "calibrated_now": run.now, "workers": run.workers}
        return FleetRun(folder, write_results(folder, fleet, entries, status, clock), entries)


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
        self.fleet, self.folder, self.journal, self.progress = fleet, folder, journal, progress
        self.folders = folders_of(fleet.supply.names)
        self.inputs = {name: fleet.supply.fingerprints(name) for name in fleet.supply.names}
        self.entries = journal.entries()
        self._check_inputs()
        self.entries = {name: entry for name, entry in self.entries.items() if name in self.inputs}
        check_entries(fleet, self.entries, folder)
        self.pending = [name for name in fleet.supply.names if self._is_pending(name, retry)]
        self.entries = {name: entry for name, entry in self.entries.items() if name not in set(self.pending)}
        self.now = self.workers = 0
        self.first: float | None = None
        self.start = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Since the workers were started, or were about to be."""
        return time.perf_counter() - self.start

    def in_order(self) -> tuple[Entry, ...]:
        """Injectors that are done, in the table's order."""
        return tuple(self.entries[name] for name in self.fleet.supply.names if name in self.entries)

    def calibrate(self, workers: int, heed: Callable[[], None]) -> None:
        """Calibrate what is pending."""
        if not self.pending:
            return
        self._try_first()
        self.workers = min(workers, len(self.pending))
        limits = Limits(self.fleet.attempts, self.fleet.time_limit)
        self.start = time.perf_counter()
        with Pool(self.workers, limits) as pool:
            for outcome in pool.run(iter(self.pending), self._study, heed):
                self._keep(outcome)

    def _study(self, name: str) -> Path:
        return write_study(self.fleet, name, self.folder / INJECTORS / self.folders[name])

    def _keep(self, outcome: Outcome) -> None:
        answer = outcome.answer
        done = isinstance(answer, Done)
        reason = answer.reason if isinstance(answer, Refused) else ""
        entry = Entry(
            outcome.name,
            FINISHED if done else FAILED,
            reason,
            outcome.attempts,
            self.inputs[outcome.name],
            answer.record if isinstance(answer, Done) else {},
            answer.seconds if isinstance(answer, Done | Refused) else 0.0,
        )
        self.journal.write(entry)
        self.entries[outcome.name] = entry
        self.now += 1
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

    def _check_inputs(self) -> None:
        """Refuse to go on with another fleet than the one that was begun; injectors may have been added."""
        now, before = _common(self.fleet), self.journal.inputs()
        if not before:
            self.journal.write_inputs(now)
        elif now != before:
            changed = next(name for name in {**before, **now} if before.get(name) != now.get(name))
            raise StudyError(f"{self.folder} {_difference(changed, before, now)}; {_CURE}")
        for name, entry in self.entries.items():
            if name not in self.inputs and entry.status == FAILED:
                continue
            if name not in self.inputs:
                raise StudyError(
                    f'{self.folder} has injector "{name}", which {self.fleet.supply.path} has no more; {_CURE}'
                )
            own = self.inputs[name]
            if entry.status == FINISHED and own != entry.inputs:
                changed = next(s for s in {**entry.inputs, **own} if entry.inputs.get(s) != own.get(s))
                what = "is missing now" if own.get(changed) == MISSING_FILE else "has changed since"
                raise StudyError(
                    f'{self.folder} has injector "{name}" calibrated to other data: its file of "{changed}" {what}; '
                    f"{_CURE}"
                )

    def _try_first(self) -> None:
        """Read the first studies, so that a fault of all is told at once, and compile what the workers will load."""
        faults: list[CommonrailError] = []
        for name in self.pending[:TRIED]:
            try:
                _compile(load_study(self._study(name)))
                return
            except CommonrailError as error:
                faults.append(error)
        if not self.entries:
            raise type(faults[0])(f"Not one of the first {len(faults)} injectors can be read; the first: {faults[0]}")


_CURE = "bring it back as it was, or name another folder with --out."


def _compile(study: Study) -> None:
    scores_of(study, study.injector)


def _common(fleet: Fleet) -> dict[str, str]:
    """What decides over the result of every injector, by name: texts for what can be read, fingerprints for files."""
    template = fleet.template
    found = {"seed": str(fleet.seed), "leave_out": ", ".join(template.left_out)}
    found |= {f"version of {name}": version for name, version in software_record().items()}
    found[f"file {template.path.name}"] = fingerprint_of(template.text.encode())
    for name, path in shared_files(template).items():
        try:
            found[f"file {name}"] = fingerprint_of(path.read_bytes())
        except OSError as error:
            raise InputError(
                f"{path}: the file cannot be read ({error.strerror}); {template.path} names it."
            ) from error
    return found


def _difference(name: str, before: Mapping[str, str], now: Mapping[str, str]) -> str:
    if name.startswith("file "):
        return f"was begun with another {name.removeprefix('file ')}"
    return f'was begun with {name} "{before.get(name, "")}", and it is "{now.get(name, "")}" now'
