"""A calibration of an FMU that survives: kept step by step in its run folder, and resumed after whatever stopped it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from commonrail.base.arguments import file_path, instance, integer
from commonrail.base.csv_output import write_csv
from commonrail.base.output import write_set
from commonrail.calibration.search import Checkpoint
from commonrail.plugins.foreign_fmu.file import fmu_record
from commonrail.plugins.foreign_fmu.fit import FmuFit, calibrate_fmu
from commonrail.plugins.foreign_fmu.study import FmuStudy, load_fmu_study
from commonrail.runs.fingerprint import fingerprint_of
from commonrail.runs.fit import FitKind, Listener, Work
from commonrail.runs.folder import write_record
from commonrail.runs.journal import Journal

STUDY, RECORD, VALUES = "fmu-study.toml", "fmu-result.json", "values.csv"
SILENT = Listener()


def calibrate_fmu_into(
    folder: str | Path, study: FmuStudy, *, processes: int | None = None, listener: Listener = SILENT
) -> FmuFit:
    """Calibrate an FMU into a new run folder that keeps every step; `resume_fmu` resumes it wherever it was stopped.

    In the end it holds fmu-study.toml with all files that it reads, fmu-result.json, values.csv, SHA256SUMS and
    journal.sqlite. `processes` are all usable processors by default; the result does not depend on it. Other arguments
    and errors are those of `commonrail.runs.calibrate_into`.
    """
    path = file_path(folder, "folder")
    instance(study, FmuStudy, "study")
    return FMUS.begin(path, study, _work(listener, processes))


def resume_fmu(
    folder: str | Path,
    *,
    generations: int = 0,
    study: FmuStudy | None = None,
    as_begun: bool = False,
    processes: int | None = None,
    listener: Listener = SILENT,
) -> FmuFit:
    """Resume a calibration of an FMU; where no simulation met its time limit the result is that of one never stopped.

    `study` is given if it was made in Python and not read from a file; other arguments and errors are those of
    `calibrate_fmu_into` and `commonrail.resume`.
    """
    path, generations = file_path(folder, "folder"), integer(generations, "generations")
    return FMUS.resume(path, _work(listener, processes), study=study, generations=generations, as_begun=as_begun)


def _work(listener: Listener, processes: int | None) -> Work[FmuStudy, FmuFit]:
    def work(study: FmuStudy, journal: Journal, checkpoint: Checkpoint | None) -> FmuFit:
        fit = calibrate_fmu(
            study, processes=processes, progress=listener.progress, recorder=journal, checkpoint=checkpoint
        )
        journal.check_place()
        _write(journal.folder, fit)
        return fit

    return work


def _content(study: FmuStudy) -> str:
    """Fingerprint of a study: equal fingerprints mean identical searches, but for simulations that are given up."""
    rows, method = study.space.rows, study.method
    settings = study.seed, study.step, study.time_limit, study.loss, study.loss_scale
    return fingerprint_of(
        study.title,
        study.fmu.digest,
        study.space.parameters,
        (rows.matrix, rows.labels),
        study.data,
        replace(method, evolution=replace(method.evolution, generations=0)),
        *settings,
    )


def _write(folder: Path, fit: FmuFit) -> None:
    record = fmu_record(fit)
    synthetic = fit.study.synthetic
    notes = (f"Values of: {fit.study.title}", f"SYNTHETIC: {synthetic}" if synthetic else "not declared synthetic")
    header = ["data", "variable", "unit", "axis", "at", "measured", "start", "best"]
    with write_set(folder):
        write_record(folder / RECORD, record)
        write_csv(folder / VALUES, notes, header, _rows(record))


def _rows(record: dict[str, Any]) -> Iterator[list[str]]:
    for data in record["data"]:
        for output in data["outputs"]:
            head = [data["name"], output["variable"], output["unit"], output["axis"]]
            for row in zip(output["at"], output["measured"], output["start"], output["best"], strict=True):
                yield [*head, *("" if value is None else repr(value) for value in row)]


FMUS: FitKind[FmuStudy, FmuFit] = FitKind(
    file=STUDY,
    word="study",
    command="commonrail calibrate STUDY",
    again="commonrail.fmu.resume_fmu(folder, study=study)",
    load=load_fmu_study,
    content=_content,
    results=(RECORD, VALUES),
)
