"""A joint fit that survives: kept step by step in its run folder, and resumed after whatever stopped it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from commonrail.base.arguments import file_path, instance, integer, thread_count
from commonrail.base.output import write_set, writing
from commonrail.calibration.search import Checkpoint
from commonrail.data.records import LABELS, MEASURED
from commonrail.plugins.family.file import family_record
from commonrail.plugins.family.fit import FamilyFit, fit_family, objective_of_parts
from commonrail.plugins.family.injector_type import dump_type
from commonrail.plugins.family.study import Family, load_family
from commonrail.readers.injector_writer import dump_injector
from commonrail.runs.fingerprint import content_of, fingerprint_of
from commonrail.runs.fit import FitKind, Listener, Work, warn_of_targets
from commonrail.runs.folder import TRACES, rate_curves, write_record
from commonrail.runs.journal import Journal
from commonrail.runs.traces import Curve, write_traces
from commonrail.workers.workers import Workers

FAMILY, RECORD, TYPE, MODELS = "family.toml", "family.json", "type.toml", "models"
SILENT = Listener()


def fit_type(
    folder: str | Path,
    family: Family,
    *,
    threads: int | None = None,
    workers: Workers | None = None,
    listener: Listener = SILENT,
) -> FamilyFit:
    """Fit the parts of a family together, in a new run folder that keeps every step.

    In the end it holds family.toml with all files that it reads, type.toml, family.json, traces.csv, SHA256SUMS,
    journal.sqlite, and the injector of each part in the folder models. Arguments and errors are those of
    `commonrail.runs.calibrate_into`.
    """
    path = file_path(folder, "folder")
    instance(family, Family, "family")
    return FAMILIES.begin(path, family, _work(listener, threads, workers))


def resume_family(
    folder: str | Path,
    *,
    generations: int = 0,
    family: Family | None = None,
    as_begun: bool = False,
    threads: int | None = None,
    workers: Workers | None = None,
    listener: Listener = SILENT,
) -> FamilyFit:
    """Resume a joint fit that was stopped; the result is that of one never stopped, bit by bit.

    `family` is given if it was made in Python and not read from a file; other arguments and errors are those of
    `commonrail.resume`.
    """
    path, generations = file_path(folder, "folder"), integer(generations, "generations")
    work = _work(listener, threads, workers)
    return FAMILIES.resume(path, work, study=family, generations=generations, as_begun=as_begun)


def _work(listener: Listener, threads: int | None, workers: Workers | None) -> Work[Family, FamilyFit]:
    threads = thread_count(threads)

    def work(family: Family, journal: Journal, checkpoint: Checkpoint | None) -> FamilyFit:
        warn_of_targets(journal, family, checkpoint, lambda: objective_of_parts(family, threads), listener)
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
        return fit

    return work


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


def _write(folder: Path, fit: FamilyFit) -> None:
    """Write type.toml, family.json, traces.csv, their checksums, and the injectors of the parts."""
    models = folder / MODELS
    with writing(models):
        models.mkdir(exist_ok=True)
    with write_set(folder):
        for name, fitted_part in fit.parts.items():
            for number, injector in enumerate(fitted_part.members, 1):
                member = "" if number == 1 else f"-member-{number}"
                header = f"{fit.family.title}: {name}{member}"
                dump_injector(injector, models / f"{name}{member}.toml", header=header)
        dump_type(fit.injector_type, folder / TYPE)
        write_record(folder / RECORD, family_record(fit))
        write_traces(folder / TRACES, (f"Injection curves of: {fit.family.title}",), (MEASURED, *LABELS), _curves(fit))


def _curves(fit: FamilyFit) -> Iterator[Curve]:
    """Injection curves among the data of the parts."""
    for name, fitted_part in fit.parts.items():
        scores = {"start": fitted_part.start, "best": fitted_part.scores}
        for curve in rate_curves(fit.family.parts[name].data, scores):
            yield curve._replace(data=f"{name}: {curve.data}")


FAMILIES: FitKind[Family, FamilyFit] = FitKind(
    file=FAMILY,
    word="family",
    command="commonrail type FAMILY.toml",
    again="resume_family(folder, family=family)",
    load=load_family,
    content=_content,
    results=(RECORD, TYPE, f"{MODELS}/*"),
    options=("name", "seed"),
)
