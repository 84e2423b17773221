"""A joint fit that survives: kept step by step in its run folder, and resumed after whatever stopped it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from commonrail.arguments import file_path, instance, thread_count
from commonrail.calibration.checkpoint import Checkpoint
from commonrail.errors import StudyError
from commonrail.family.fit import FamilyFit, fit_family, objective_of_parts
from commonrail.family.result import family_record
from commonrail.family.study import Family, load_family
from commonrail.files.atomic import writing
from commonrail.files.injector_file import dump_injector
from commonrail.files.record_file import FAMILY_RECORD, read_record, write_record
from commonrail.files.run_folder import TRACES, rate_curves
from commonrail.files.sums import summed
from commonrail.files.traces_file import Curve, Traces, read_traces, write_traces
from commonrail.files.type_file import dump_type
from commonrail.kinds.records import LABELS, MEASURED
from commonrail.store.beginning import Copied, begun, ending, refuse_wrong
from commonrail.store.changes import check_files
from commonrail.store.content import content_of, fingerprint_of
from commonrail.store.copies import copy_apart, places_apart
from commonrail.store.journal import JOURNAL, Journal
from commonrail.store.run import Listener
from commonrail.store.targets import other_targets
from commonrail.workers.interrupt import held_interrupts
from commonrail.workers.workers import Workers

__all__ = ["FAMILY", "MODELS", "RECORD", "TYPE", "fit_into", "is_family_run", "read_family_run", "resume_family"]

FAMILY, RECORD, TYPE, MODELS = "family.toml", FAMILY_RECORD, "type.toml", "models"
SILENT = Listener()


def is_family_run(folder: Path) -> bool:
    """Return whether a folder is that of a joint fit."""
    return (folder / JOURNAL).is_file() and (folder / FAMILY).is_file()


def fit_into(
    folder: str | Path,
    family: Family,
    *,
    threads: int | None = None,
    workers: Workers | None = None,
    listener: Listener = SILENT,
) -> FamilyFit:
    """Fit the parts of a family together, in a new run folder that keeps every step.

    Parameters
    ----------
    folder : str or Path
        New or empty. In the end it holds family.toml with all files that it reads, type.toml, family.json, SHA256SUMS,
        journal.sqlite, and the injector of each part in the folder models.
    family : Family
        Read from a file.
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    workers : Workers, optional
        Processes or a cluster that simulate in place of threads; the result is the same.
    listener : Listener, optional

    Raises
    ------
    ConfigurationError
        If an argument is of another kind.
    InputError
        If the folder is not empty.
    OutputError
        If it cannot be written; what was done before is kept.
    StudyError
        If the family was made in Python, or cannot be fitted; what was done before is kept.
    """
    path = file_path(folder, "folder")
    instance(family, Family, "family")
    if not family.files:
        raise StudyError(f"{family.title}: a family that was made in Python has no run folder; use fit_family.")
    with _begun(path, family) as (journal, own):
        return _run(journal, own, None, listener, thread_count(threads), workers)


def resume_family(
    folder: str | Path,
    *,
    as_begun: bool = False,
    threads: int | None = None,
    workers: Workers | None = None,
    listener: Listener = SILENT,
) -> FamilyFit:
    """Resume a joint fit that was stopped; the result is that of one never stopped, bit by bit.

    Parameters
    ----------
    folder : str or Path
        Run folder; it may have been moved or copied.
    as_begun : bool
        Use the copies in the run folder although the files that they were made from have changed.
    threads, workers, listener
        As in `fit_into`; they may differ from those of the beginning.

    Raises
    ------
    StudyError
        If there is no journal, another process is at work in the folder, or the family or its data have changed.
    OutputError
        If the folder cannot be written; what was done before is kept.
    """
    path = file_path(folder, "folder")
    if not is_family_run(path):
        raise StudyError(f"{path}: this is no run folder of a family; `commonrail family FAMILY.toml` begins one.")
    with Journal(path) as journal:
        refuse_wrong(journal, path)
        check_files(journal, as_begun)
        family = load_family(path / FAMILY)
        about = journal.about
        family = replace(family, name=about.get("name", family.name), seed=int(about.get("seed", family.seed)))
        if _content(family) != about.get("content"):
            raise StudyError(
                f"{path}: the family reads differently from when the run was begun, although its files are the same; "
                "resume it with the version of commonrail that began it, or begin a new run."
            )
        return _run(journal, family, journal.checkpoint(), listener, thread_count(threads), workers)


@contextmanager
def _begun(folder: Path, family: Family) -> Iterator[tuple[Journal, Family]]:
    """A new run's journal and its family, read from the copies in the folder."""

    def copied() -> Copied[Family]:
        inputs = copy_apart(family.files, folder, FAMILY)
        own = replace(load_family(folder / FAMILY), name=family.name, seed=family.seed)
        facts = {
            "title": family.title,
            "name": family.name,
            "seed": str(family.seed),
            "given": family.text,
            "study": own.text,
            "content": _content(own),
            "generations": str(family.method.evolution.generations),
        }
        return Copied(own, facts, inputs)

    copies = [place.as_posix() for place in places_apart(family.files, FAMILY).values()]
    with begun(folder, copies, copied) as found:
        yield found


def _content(family: Family) -> str:
    """Fingerprint of a family: equal fingerprints mean identical searches but for their length."""
    evolution = replace(family.method.evolution, generations=0)
    return fingerprint_of(
        family.name,
        family.title,
        family.seed,
        replace(family.method, evolution=evolution),
        family.space.parameters,
        tuple(parameter.prior for parameter in family.space.parameters),
        tuple((name, relation.share, relation.spread) for name, relation in family.shared.items()),
        tuple((name, content_of(study)) for name, study in family.parts.items()),
    )


def _run(
    journal: Journal,
    family: Family,
    checkpoint: Checkpoint | None,
    listener: Listener,
    threads: int | None,
    workers: Workers | None,
) -> FamilyFit:
    if checkpoint is not None:
        for finding in other_targets(journal, family, objective_of_parts(family, threads)):
            listener.note(f"warning: {finding.sentence}")
    journal.start_session()
    with held_interrupts(), ending(journal):  # once the search has ended, its result is written whatever keys are hit
        fit = fit_family(
            family,
            threads=threads,
            progress=listener.progress,
            workers=workers,
            recorder=journal,
            checkpoint=checkpoint,
        )
        journal.check_place()
        _write(journal.folder, fit)
        journal.end_session(fit.status, fit.reason)
    return fit


def read_family_run(folder: str | Path) -> tuple[dict[str, Any], Traces]:
    """family.json, and per injection curve of a part the arrays time_s [s] and rates [m³/s] by label.

    Raises
    ------
    InputError
        If the folder is not that of a joint fit, or a file of it is broken or not the one that was written.
    """
    path = file_path(folder, "folder")
    return read_record(path / RECORD, "commonrail family"), read_traces(path / TRACES)


def _write(folder: Path, fit: FamilyFit) -> None:
    """Write type.toml, family.json, traces.csv, their checksums, and the injectors of the parts."""
    models = folder / MODELS
    with writing(models):
        models.mkdir(exist_ok=True)
    with summed(folder, TYPE, RECORD, TRACES):
        for name, part in fit.parts.items():
            for number, injector in enumerate(part.members, 1):
                member = "" if number == 1 else f"-member-{number}"
                header = f"{fit.family.title}: {name}{member}"
                dump_injector(injector, models / f"{name}{member}.toml", header=header)
        dump_type(fit.injector_type, folder / TYPE)
        write_record(folder / RECORD, family_record(fit))
        write_traces(folder / TRACES, (f"Injection curves of: {fit.family.title}",), (MEASURED, *LABELS), _curves(fit))


def _curves(fit: FamilyFit) -> Iterator[Curve]:
    """Injection curves among the data of the parts."""
    for name, part in fit.parts.items():
        scores = {"start": part.start, "best": part.scores}
        for curve in rate_curves(fit.family.parts[name].data, scores):
            yield curve._replace(data=f"{name}: {curve.data}")
