"""Joint fit of a family in a run folder, and its resumption: progress, result, report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from commonrail.cli.console import print_json, print_rows, print_table, say
from commonrail.cli.options import open_workers
from commonrail.cli.study_kind import RunOptions, StudyKind
from commonrail.cli.study_run import end_if_stopped, reported
from commonrail.errors import InputError
from commonrail.units import to_text

if TYPE_CHECKING:
    from commonrail.calibration.injector_type import InjectorType
    from commonrail.family.fit import FamilyFit
    from commonrail.store.run import Listener
    from commonrail.workers.workers import Workers

__all__ = ["STUDY", "FamilyOutcome", "print_family", "print_type", "run_family", "type_record"]


class FamilyOutcome(NamedTuple):
    """Run folder, its report and the joint fit."""

    folder: Path
    report: Path
    fit: FamilyFit


def run_family(
    source: Path,
    folder: Path,
    changes: Mapping[str, Any],
    models: Path | None,
    threads: int | None,
    workers: Workers | None,
) -> FamilyOutcome:
    """Fit the parts of a family file together in a new run folder, with progress on stderr.

    Parameters
    ----------
    source : Path
        Family file.
    folder : Path
        New or empty.
    changes : mapping
        Name of the type and seed, in place of those of the file.
    models : Path or None
        New folder for the injectors of the parts.
    threads : int or None
        None: all processors.
    workers : Workers or None
        Simulate in place of this process.

    Raises
    ------
    InputError, OutputError, StudyError
        As `commonrail.family.run.fit_into`.
    """
    from commonrail.family.run import fit_into
    from commonrail.family.study import load_family
    from commonrail.files.injector_file import dump_injector
    from commonrail.files.run_folder import create_run_folder, refuse_used

    if models is not None:
        refuse_used(models)
    family = replace(load_family(source), **changes)
    outcome = _told(
        family.title,
        folder,
        lambda listener: fit_into(folder, family, threads=threads, workers=workers, listener=listener),
    )
    if models is not None:
        place = create_run_folder(models)
        for part, own in outcome.fit.parts.items():
            dump_injector(own.injector, place / f"{part}.toml", header=f"{family.title}: {part}")
    return outcome


def _resume(folder: Path, options: RunOptions) -> None:
    from commonrail.family.run import TYPE, resume_family

    if options.generations:
        raise InputError(f"--generations: {folder} is the run of a family; state them in a new family file.")
    with open_workers(options.workers, options.cluster) as workers:

        def resumed(listener: Listener) -> FamilyFit:
            return resume_family(
                folder, as_begun=options.as_begun, threads=options.threads, workers=workers, listener=listener
            )

        outcome = _told(f"resuming {folder}", folder, resumed)
    print_family(outcome, options.json, folder / TYPE)


STUDY = StudyKind(_resume)


def _told(title: str, folder: Path, work: Callable[[Listener], FamilyFit]) -> FamilyOutcome:
    return FamilyOutcome(folder, *reported(title, folder, work))


def print_family(outcome: FamilyOutcome, json: bool, out: Path) -> None:
    """Print the figures of a joint fit; exit status 130 if it was stopped.

    Parameters
    ----------
    outcome : FamilyOutcome
    json : bool
        Print one record instead of tables.
    out : Path
        The type file.
    """
    from commonrail.family.result import TEXTS, parts_data
    from commonrail.files.type_file import names_injector
    from commonrail.report.tables import tables_of

    fit, folder = outcome.fit, outcome.folder
    if json:
        print_json(type_record(fit.injector_type, out) | _record_of(outcome))
    else:
        for part, data in parts_data(fit).items():
            click.echo(part)
            for table in tables_of(data, TEXTS):
                print_table(table)
        print_type(fit.injector_type)
        click.echo(f"report: {outcome.report}")
    if not names_injector(fit.injector_type):
        say(f"{out} names no injector of the catalogue; `commonrail adapt` needs one for it.")
    say(f"wrote {out}")
    end_if_stopped(fit.status, folder)


def _record_of(outcome: FamilyOutcome) -> dict[str, Any]:
    from commonrail.family.result import parts_data

    fit = outcome.fit
    data = parts_data(fit)
    return {
        "run": str(outcome.folder),
        "report": str(outcome.report),
        "status": fit.status,
        "cost": fit.cost,
        "injections": fit.simulations,
        "joint": dict(fit.joint),
        "fits": {name: {"best": dict(part.best), "data": data[name]} for name, part in fit.parts.items()},
    }


def type_record(found: InjectorType, out: Path) -> dict[str, Any]:
    """Record of a type for ``--json``.

    Parameters
    ----------
    found : InjectorType
    out : Path
        Its file.
    """
    parts = [{"name": p.name, "source": p.source, "injectors": p.injectors} for p in found.parts]
    values = [
        {"name": p.name, "value": p.value, "spread": p.spread, "lower": p.lower, "upper": p.upper, "source": p.source}
        for p in found.parameters
    ]
    head = {"schema": 1, "kind": "type", "type": str(out), "name": found.name, "synthetic": found.synthetic}
    fixed = [{"name": v.name, "value": v.value, "mark": v.mark, "source": v.source} for v in found.fixed]
    return {**head, "parts": parts, "parameters": values, "fixed": fixed}


def print_type(found: InjectorType) -> None:
    """Print the parameters of a type with their spreads."""
    from commonrail.injector.definition import parameter_quantities

    if found.synthetic:
        click.echo(f"SYNTHETIC: {found.synthetic}")
    units = {name: q.unit for name, q in parameter_quantities().items()}
    rows = [[p.name, to_text(p.value, units[p.name]), to_text(p.spread, units[p.name])] for p in found.parameters]
    rows += [[v.name, to_text(v.value, units[v.name]), "fixed"] for v in found.fixed]
    print_rows(["parameter", "value", "spread"], rows, found.title, texts=1)
