"""commonrail compare: models side by side on any data, without fitting."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from commonrail.base.errors import InputError, SimulationError
from commonrail.base.output import writing
from commonrail.cli.console import SIMULATING, print_json, print_table, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import Json, StudyFile, Threads

if TYPE_CHECKING:
    from commonrail.calibration.compare import Comparison


@verb
def compare(
    models: Annotated[
        tuple[str, ...],
        Argument(
            metavar="MODEL",
            help="One to eight models: an injector file, a name of the catalogue, or a run folder of calibrate. LABEL= "
            "in front names a model; @rigid, @regulated,volume … behind it changes its variant.",
        ),
    ],
    *,
    data: Annotated[tuple[Path, ...], Option(metavar="STUDY.toml", help="Study file whose data are used; repeatable.")],
    out: Annotated[
        Path | None, Option(metavar="DIR", help="New folder for report.html, comparison.json and traces.csv.")
    ] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Compare models on the data of studies, without fitting.

    Each model is simulated at every point of the data. A simulation that fails gives no number; the last
    table lists its reason. Without --out nothing is written.

    \b
    Examples:
      commonrail compare virtual-lino-2016 rigid=virtual-lino-2016@rigid --data cases/paper/study.toml
      commonrail compare runs/a runs/b --data cases/cri2-16/study.toml --out runs/a-or-b
    """
    if out is None:
        record = _compared(models, data, threads)[1]
    else:
        record = _into(out, lambda: _compared(models, data, threads))
    if json:
        print_json(record)
        return
    _print(record)
    if out is not None:
        click.echo(f"report: {out / 'report.html'}")


def _compared(models: Sequence[str], files: Sequence[Path], threads: int | None) -> tuple[Comparison, dict[str, Any]]:
    from commonrail.calibration.compare import compare as run
    from commonrail.calibration.compare import comparison_record
    from commonrail.calibration.study_file.file import load_study
    from commonrail.runs.model_name import read_model_names

    named = read_model_names(models)
    studies = [load_study(file) for file in files]
    say(SIMULATING)
    meters = {model.label: model.meters for model in named}
    comparison = run({model.label: model.injector for model in named}, studies, threads=threads, meters=meters)
    if not comparison.simulated:
        first = next(f for found in comparison.failures.values() for points in found for f in points)
        raise SimulationError(f"No model could be simulated on any of the data. {first.sentence}")
    texts = {model.label: model.text for model in named}
    return comparison, comparison_record(comparison, texts, [str(file) for file in files])


def _into(folder: Path, run: Callable[[], tuple[Comparison, dict[str, Any]]]) -> dict[str, Any]:
    """Run a comparison into a new folder, which is taken away again if nothing comes of it."""
    from commonrail.report.page import write_report
    from commonrail.runs.comparison import write_comparison
    from commonrail.runs.folder import new_run_folder

    with new_run_folder(folder):
        comparison, record = run()
        with writing(folder):
            write_comparison(folder, comparison, record)
    write_report(folder)
    return record


def _print(record: dict[str, Any]) -> None:
    from commonrail.report.compare import comparison_lines, comparison_tables

    if record["synthetic"]:
        click.echo(f"SYNTHETIC: {record['synthetic']}")
    for line in comparison_lines(record):
        click.echo(line)
    click.echo("")
    for table in comparison_tables(record):
        print_table(table)


# commonrail validate: errors of an injector on the data of a study, without fitting.


@verb
def validate(
    study: StudyFile,
    *,
    injector: Annotated[str | None, Option(help="Injector file, or a name of the catalogue.")] = None,
    run: Annotated[Path | None, Option(metavar="RUN", help="Run folder whose calibrated.toml is used.")] = None,
    json: Json = False,
) -> None:
    """Compute the errors of an injector on a study's data.

    \b
    Examples:
      commonrail validate cases/paper/study.toml --run runs/paper-1
      commonrail validate cases/cri2-16/study.toml --injector cri2-16
    """
    from commonrail.calibration.compare import check_drive
    from commonrail.calibration.plausibility.check import of_model
    from commonrail.calibration.result import data_records, warning_records
    from commonrail.calibration.scoring import score_all
    from commonrail.calibration.study_file.file import load_study
    from commonrail.data.metering import meter_records, meters_of, with_meters
    from commonrail.readers.injector.file import injector_catalogue, load_injector, load_meters
    from commonrail.report.fit.record import meter_lines
    from commonrail.report.fit.tables import tables_of

    source = _source(injector, run)
    chosen = load_injector(source)
    meters = () if source in injector_catalogue() else load_meters(source)
    loaded = load_study(study)
    loaded = replace(loaded, data=with_meters(loaded.data, meters))
    check_drive(chosen, loaded, chosen.name)
    say(SIMULATING)
    scores = score_all(loaded, chosen)
    data = data_records(loaded.data, {"best": scores})
    warnings = of_model(loaded, chosen, scores, fitted=run is not None)
    for finding in warnings:
        say(f"warning: {finding.sentence}")
    labels = {"best": "calibrated" if run else chosen.name}
    if json:
        named = {"name": chosen.name, "title": chosen.title, "variant": chosen.variant.label}
        record = {"schema": 1, "kind": "validation", "title": loaded.title, "injector": named}
        print_json(
            record
            | {"labels": labels, "data": data, "warnings": warning_records(warnings)}
            | meter_records(meters_of(loaded.data))
        )
        return
    click.echo(f"{chosen.title} on the data of: {loaded.title}")
    for line in meter_lines(meter_records(meters_of(loaded.data))):
        click.echo(line)
    if loaded.synthetic:
        click.echo(f"SYNTHETIC: {loaded.synthetic}")
    for table in tables_of(data, labels):
        print_table(table)


def _source(injector: str | None, run: Path | None) -> str | Path:
    if injector is not None and run is None:
        return injector
    if run is None or injector is not None:
        raise InputError("Give either --injector FILE or --run RUN.")
    path = run / "calibrated.toml"
    if not path.is_file():
        raise InputError(f"{run}: no calibrated.toml there; name a folder of commonrail calibrate.")
    return path
