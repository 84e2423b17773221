"""commonrail compare: models side by side on any data, without fitting."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from commonrail.base.errors import SimulationError
from commonrail.cli.console import SIMULATING, print_json, print_synthetic, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import Json, Settings, Threads, read_models

if TYPE_CHECKING:
    from commonrail.calibration.plausibility import Finding
    from commonrail.cli.model_name import NamedModel
    from commonrail.plugins.compare.run import Comparison


@table_verb
def compare(
    models: Annotated[
        tuple[str, ...],
        Argument(
            metavar="MODEL",
            help="One to eight models: injector file, catalogue name, or run folder of calibrate. A prefix LABEL= "
            "names a model; a suffix @rigid, @regulated,volume … changes its variant.",
        ),
    ],
    *,
    data: Annotated[tuple[Path, ...], Option(metavar="STUDY.toml", help="Study file whose data are used; repeatable.")],
    out: Annotated[
        Path | None, Option(metavar="DIR", help="New folder for report.html, comparison.json and traces.csv.")
    ] = None,
    set_: Settings = (),
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Compare models on the data of studies, without fitting.

    Each model is simulated at every point of the data. A simulation that fails gives no number; the last
    table lists the reason. Implausible results give warnings. Without --out nothing is written.

    \b
    Examples:
      commonrail compare runs/paper-1 --data cases/paper/study.toml
      commonrail compare virtual-lino-2016 rigid=virtual-lino-2016@rigid --data cases/paper/study.toml
      commonrail compare runs/a runs/b --data cases/cri2-16/study.toml --out runs/a-or-b
    """
    from commonrail.plugins.compare.file import write_comparison
    from commonrail.report.page import write_report
    from commonrail.runs.folder import new_folder

    with new_folder(out) if out else nullcontext() as place:
        comparison, record = _compare(read_models(models, set_), data, threads)
        if place is not None:
            write_comparison(place, comparison, record)
            write_report(place)
    if json:
        print_json(record)
        return
    _print(record)
    if out is not None:
        click.echo(f"report: {out / 'report.html'}")


def _compare(
    models: Sequence[NamedModel], files: Sequence[Path], threads: int | None
) -> tuple[Comparison, dict[str, Any]]:
    from commonrail.calibration.study_file import load_study
    from commonrail.plugins.compare.file import comparison_record
    from commonrail.plugins.compare.run import compare as compare_models

    studies = [load_study(file) for file in files]
    say(SIMULATING)
    meters = {model.label: model.meters for model in models}
    comparison = compare_models(
        {model.label: model.injector for model in models}, studies, threads=threads, meters=meters
    )
    if not comparison.simulated:
        first = next(f for of_model in comparison.failures.values() for failures in of_model for f in failures)
        raise SimulationError(f"No model could be simulated at any point of the data. {first.sentence}")
    texts = {model.label: model.text for model in models}
    record = comparison_record(comparison, texts, [str(file) for file in files])
    return comparison, record | {"warnings": _warnings(comparison, models)}


def _warnings(comparison: Comparison, models: Sequence[NamedModel]) -> list[dict[str, str]]:
    """Print warnings of implausible errors, shifts and gains to stderr, each once; return their records."""
    from commonrail.base.record import to_record
    from commonrail.calibration.plausibility import of_model

    findings: dict[Finding, None] = {}
    for model in models:
        scores = iter(comparison.scores[model.label])
        for study in comparison.studies:
            study_scores = [next(scores) for _ in study.data]
            for finding in of_model(study, model.injector, study_scores, fitted=model.run is not None):
                findings[finding] = None
    for finding in findings:
        say(f"warning: {finding.sentence}")
    return list(to_record(tuple(findings)))


def _print(record: dict[str, Any]) -> None:
    from commonrail.base.record import from_record
    from commonrail.plugins.compare.file import ComparisonRecord
    from commonrail.plugins.compare.page import comparison_lines, comparison_tables

    comparison = from_record(ComparisonRecord, record)
    print_synthetic(comparison.synthetic)
    print_text(comparison_lines(comparison), comparison_tables(comparison))
