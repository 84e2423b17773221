"""commonrail validate: errors of an injector on the data of a study, without fitting."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import click

from commonrail.base.errors import InputError
from commonrail.cli.console import SIMULATING, print_json, print_lines, print_table, say
from commonrail.cli.grammar import Option, verb
from commonrail.cli.options import Json, StudyFile


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
    from commonrail.calibration.plausibility import of_model
    from commonrail.calibration.result import data_records, warning_records
    from commonrail.calibration.scoring import check_drive, score_all
    from commonrail.calibration.study_file.file import load_study
    from commonrail.data.metering import meter_records, meters_of, with_meters
    from commonrail.readers.injector.file import in_catalogue, load_injector, load_meters
    from commonrail.report.fit.record import meter_lines
    from commonrail.report.fit.tables import tables_of

    source = _source(injector, run)
    chosen = load_injector(source)
    meters = () if in_catalogue(source) else load_meters(source)
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
    print_lines(meter_lines(meter_records(meters_of(loaded.data))))
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
