"""commonrail new: a commented injector, study and data file to start from, or a study of data files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from commonrail.base.errors import InputError
from commonrail.cli.console import print_json, print_pairs
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import Json, check_folder

if TYPE_CHECKING:
    from commonrail.calibration.study_file.from_data import Started


@verb
def new(
    folder: Annotated[Path, Argument(metavar="DIR", help="A new or empty folder.")],
    *,
    injector: Annotated[
        str | None, Option(metavar="MODEL", help="Injector of the study: a name of the catalogue, or a file.")
    ] = None,
    from_: Annotated[
        tuple[Path, ...],
        Option("--from", metavar="FILE", help="Data file for the study, see inspect; repeatable."),
    ] = (),
    cylinder_pressure: Annotated[str, Option(help="Cylinder pressure of the bench, e.g. 5MPa.")] = "",
    return_pressure: Annotated[str, Option(help="Pressure at the end of the return line, e.g. 0.5MPa.")] = "",
    json: Json = False,
) -> None:
    """Write a small study to start from.

    Its example curve is synthetic and marked so. With --from it is a study of your own files: maps, traces or
    records of shots, copied and described as they were understood.

    \b
    Examples:
      commonrail new my-injector
      commonrail new my-study --injector cri2-16 --from map.xlsx --from rates.mf4 --cylinder-pressure 0.5MPa
    """
    check_folder(folder)
    if from_ or injector is not None:
        if injector is None or not from_:
            raise InputError("Give --injector and one or more files with --from, or neither.")
        _of_files(folder, injector, from_, (cylinder_pressure, return_pressure), json)
        return
    if cylinder_pressure or return_pressure:
        raise InputError("--cylinder-pressure and --return-pressure belong to --from; omit them.")
    from commonrail.calibration.study_file.from_data import write_new

    written = write_new(folder)
    if json:
        print_json({"kind": "new", "files": [str(path) for path in written]})
        return
    for path in written:
        click.echo(str(path))
    click.echo(f"next: commonrail calibrate {folder / 'study.toml'}")


def _of_files(folder: Path, injector: str, sources: Sequence[Path], pressures: tuple[str, str], json: bool) -> None:
    from commonrail.base.units import parse
    from commonrail.calibration.study_file.from_data import BenchPressures, write_study_from

    for text, option in zip(pressures, ("--cylinder-pressure", "--return-pressure"), strict=True):
        if text:
            parse(text, "Pa", option)
    started = write_study_from(folder, injector, sources, BenchPressures(*pressures))
    if json:
        taken = {found.path.name: found.taken_for for found in started.surveys}
        files = [str(path) for path in started.files]
        assumed = {"assumed": list(started.assumed)}
        print_json({"kind": "new", "files": files, "taken for": taken, "open": list(started.open)} | assumed)
        return
    _print(started)


def _print(started: Started) -> None:
    for found in started.surveys:
        pairs = [("taken for", found.taken_for), *found.facts.items()]
        print_pairs([*pairs, ("read as", found.said)] if found.said else pairs, found.path.name)
    for path in started.files:
        click.echo(str(path))
    if started.open:
        click.echo(f"state in {started.study}: {', '.join(started.open)}")
    if started.assumed:
        click.echo(f"taken to be 0, the start of energising; check: {', '.join(started.assumed)}")
    click.echo(f"next: check {started.study}, then commonrail calibrate {started.study}")
