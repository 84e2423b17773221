"""A calibration of an FMU that survives: kept step by step in its run folder, and resumed after whatever stopped it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from commonrail.arguments import file_path, instance
from commonrail.calibration.checkpoint import Checkpoint
from commonrail.errors import StudyError
from commonrail.files.atomic import write_csv
from commonrail.files.record_file import FMU_RECORD, read_record, write_record
from commonrail.files.sums import summed
from commonrail.foreign.fit import FmuFit, calibrate_fmu
from commonrail.foreign.result import fmu_record
from commonrail.foreign.study import FmuStudy
from commonrail.foreign.study_file import load_fmu_study
from commonrail.store.beginning import Copied, begun, ending
from commonrail.store.changes import check_files
from commonrail.store.content import fingerprint_of
from commonrail.store.copies import copy_apart, places_apart
from commonrail.store.journal import JOURNAL, Journal
from commonrail.store.run import Listener
from commonrail.workers.interrupt import held_interrupts

__all__ = ["RECORD", "STUDY", "VALUES", "calibrate_fmu_into", "is_fmu_run", "read_fmu_run", "resume_fmu"]

STUDY, RECORD, VALUES = "fmu-study.toml", FMU_RECORD, "values.csv"
SILENT = Listener()


def is_fmu_run(folder: Path) -> bool:
    """Return whether a folder is that of a calibration of an FMU."""
    return (folder / JOURNAL).is_file() and (folder / STUDY).is_file()


def calibrate_fmu_into(
    folder: str | Path, study: FmuStudy, *, processes: int | None = None, listener: Listener = SILENT
) -> FmuFit:
    """Calibrate an FMU into a new run folder that keeps every step; `resume_fmu` resumes it wherever it was stopped.

    Parameters
    ----------
    folder : str or Path
        New or empty. In the end it holds fmu-study.toml with all files that it reads, fmu-result.json, values.csv,
        SHA256SUMS and journal.sqlite.
    study : FmuStudy
        Read from a file.
    processes : int, optional
        All usable processors by default; the result does not depend on it.
    listener : Listener, optional

    Raises
    ------
    InputError
        If the folder is not empty.
    OutputError
        If it cannot be written; what was done before is kept.
    StudyError
        If the study was made in Python, or cannot be run; what was done before is kept.
    """
    path = file_path(folder, "folder")
    instance(study, FmuStudy, "study")
    if not study.files:
        raise StudyError(f"{study.title}: a study that was made in Python has no run folder; use calibrate_fmu.")
    with _begun(path, study) as (journal, own):
        return _run(journal, own, None, listener, processes)


def resume_fmu(
    folder: str | Path, *, as_begun: bool = False, processes: int | None = None, listener: Listener = SILENT
) -> FmuFit:
    """Resume a calibration of an FMU; where no simulation met its time limit the result is that of one never stopped.

    Parameters
    ----------
    folder : str or Path
        Run folder; it may have been moved or copied.
    as_begun : bool
        Use the copies in the run folder although the files that they were made from have changed.
    processes, listener
        As in `calibrate_fmu_into`; they may differ from those of the beginning.

    Raises
    ------
    StudyError
        If there is no journal, another process is at work in the folder, or the study or its data have changed.
    OutputError
        If the folder cannot be written; what was done before is kept.
    """
    path = file_path(folder, "folder")
    if not is_fmu_run(path):
        raise StudyError(f"{path}: this is no run of an FMU; `commonrail calibrate STUDY` begins one.")
    with Journal(path) as journal:
        check_files(journal, as_begun)
        study = replace(load_fmu_study(path / STUDY), seed=int(journal.about.get("seed", "1")))
        if _content(study) != journal.about.get("content"):
            raise StudyError(
                f"{path}: the study reads differently from when the run was begun, although its files are the same; "
                "resume it with the version of commonrail that began it, or begin a new run."
            )
        return _run(journal, study, journal.checkpoint(), listener, processes)


@contextmanager
def _begun(folder: Path, study: FmuStudy) -> Iterator[tuple[Journal, FmuStudy]]:
    """A new run's journal and its study, read from the copies in the folder."""

    def copied() -> Copied[FmuStudy]:
        inputs = copy_apart(study.files, folder, STUDY)
        own = replace(load_fmu_study(folder / STUDY), seed=study.seed)
        facts = {
            "title": study.title,
            "given": study.text,
            "study": own.text,
            "seed": str(study.seed),
            "content": _content(own),
            "generations": str(study.method.evolution.generations),
        }
        return Copied(own, facts, inputs)

    copies = [place.as_posix() for place in places_apart(study.files, STUDY).values()]
    with begun(folder, copies, copied) as found:
        yield found


def _content(study: FmuStudy) -> str:
    """Fingerprint of a study: equal fingerprints mean identical searches, but for simulations that are given up."""
    rows = study.space.rows
    decisive: tuple[Any, ...] = (study.seed, study.method, study.step, study.time_limit, study.loss, study.loss_scale)
    return fingerprint_of(
        study.title, study.fmu.digest, study.space.parameters, (rows.matrix, rows.labels), study.data, *decisive
    )


def _run(
    journal: Journal, study: FmuStudy, checkpoint: Checkpoint | None, listener: Listener, processes: int | None
) -> FmuFit:
    journal.start_session()
    with held_interrupts(), ending(journal):  # once the search has ended, its result is written whatever keys are hit
        fit = calibrate_fmu(
            study, processes=processes, progress=listener.progress, recorder=journal, checkpoint=checkpoint
        )
        journal.check_place()
        _write(journal.folder, fit)
        journal.end_session(fit.status, fit.reason)
    return fit


def read_fmu_run(folder: str | Path) -> dict[str, Any]:
    """fmu-result.json of a run folder.

    Raises
    ------
    InputError
        If the folder is not that of a calibration of an FMU, or the file is broken or not the one that was written.
    """
    return read_record(file_path(folder, "folder") / RECORD, "commonrail calibrate")


def _write(folder: Path, fit: FmuFit) -> None:
    record = fmu_record(fit)
    synthetic = fit.study.synthetic
    notes = (f"Values of: {fit.study.title}", f"SYNTHETIC: {synthetic}" if synthetic else "not declared synthetic")
    header = ["data", "variable", "unit", "axis", "at", "measured", "start", "best"]
    with summed(folder, RECORD, VALUES):
        write_record(folder / RECORD, record)
        write_csv(folder / VALUES, notes, header, _rows(record))


def _rows(record: dict[str, Any]) -> Iterator[list[str]]:
    for data in record["data"]:
        for output in data["outputs"]:
            head = [data["name"], output["variable"], output["unit"], output["axis"]]
            for row in zip(output["at"], output["measured"], output["start"], output["best"], strict=True):
                yield [*head, *("" if value is None else repr(value) for value in row)]
