"""commonrail family: type file of parts of one type, which were calibrated or are fitted together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from commonrail.cli.console import print_json, print_rows, print_table, say
from commonrail.cli.options import Json, Threads
from commonrail.cli.output import check_file
from commonrail.cli.progress import Bar, Stage
from commonrail.errors import InputError
from commonrail.units import parse, to_text

if TYPE_CHECKING:
    from commonrail.calibration.injector_type import InjectorType
    from commonrail.family.fit import FamilyFit

__all__ = ["family"]


def family(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE...",
            help="Family file whose parts are fitted together; or run folders of `calibrate`, one for each part; or "
            "the folder of a fleet.",
        ),
    ],
    *,
    out: Annotated[Path, typer.Option(metavar="TYPE.toml", help="Type file to be written.")],
    name: Annotated[str | None, typer.Option(help="Name of the type. [default: that of the file]")] = None,
    part_spread: Annotated[
        str | None,
        typer.Option(
            help="Assumed standard deviation between parts, e.g. 3%, for a type of one part. [default: the priors' of "
            "its study]"
        ),
    ] = None,
    models: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="New folder for the injector of each part of a family file."),
    ] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Write a type file from parts of one type.

    A study takes it as start and prior with the key `type`; `commonrail adapt` makes a part's model of it.

    \b
    Examples:
      commonrail family cases/family/family.toml --out cri2.toml --models parts
      commonrail family runs/part-1 runs/part-2 runs/part-3 --out cri2.toml
      commonrail family fleets/line-4 --out cri2.toml
      commonrail family runs/part-1 --part-spread 3% --out cri2.toml
    """
    from commonrail.family.from_results import FLEET
    from commonrail.files.type_file import dump_type

    check_file(out, "--out")
    share = None if part_spread is None else parse(part_spread, "1", "--part-spread")
    joint = [source for source in sources if source.suffix == ".toml"]
    if joint and len(sources) > 1:
        raise InputError(f"{joint[0]}: a family file is a source by itself; name it alone, or run folders only.")
    if not joint and models is not None:
        raise InputError("--models: only a family file makes injectors; omit it for runs and fleets.")
    if share is not None and (joint or any((source / FLEET).is_file() for source in sources)):
        raise InputError("--part-spread: only for run folders; omit it for a family file or a fleet.")
    fit = _fitted(joint[0], name, models, threads) if joint else None
    found = _from_results(sources, name or out.stem, share) if fit is None else fit.injector_type
    dump_type(found, out)
    if json:
        print_json(_record(found, out) | ({} if fit is None else _record_of(fit)))
    else:
        _print(found, fit)
    if found.injector is None:
        say(f"{out} names no injector of the catalogue; `commonrail adapt` needs one for it.")
    say(f"wrote {out}")


def _from_results(sources: Sequence[Path], name: str, share: float | None) -> InjectorType:
    from commonrail.family.from_results import FLEET, type_from_fleet, type_from_runs

    fleets = [source for source in sources if (source / FLEET).is_file()]
    if fleets and len(sources) > 1:
        raise InputError(f"{fleets[0]}: a fleet is a source by itself; name it alone, or run folders only.")
    return type_from_fleet(fleets[0], name) if fleets else type_from_runs(sources, name, part_spread=share)


def _fitted(source: Path, name: str | None, models: Path | None, threads: int | None) -> FamilyFit:
    """Joint fit of a family file, with its injectors written if they are wanted."""
    from commonrail.family.fit import fit_family
    from commonrail.family.study import load_family
    from commonrail.files.injector_file import dump_injector
    from commonrail.files.run_folder import create_run_folder, refuse_used

    if models is not None:
        refuse_used(models)
    family = load_family(source)
    family = family if name is None else replace(family, name=name)
    with Bar(family.title) as bar:
        fit = fit_family(
            family,
            threads=threads,
            progress=lambda p: bar.show(Stage(p.phase, p.generation, p.generations, f"best {p.best:.4g}")),
        )
    if models is not None:
        folder = create_run_folder(models)
        for part, own in fit.parts.items():
            dump_injector(own.injector, folder / f"{part}.toml", header=f"{family.title}: {part}")
    return fit


def _data(fit: FamilyFit) -> list[tuple[str, list[dict[str, Any]]]]:
    """Records of the data of each part."""
    from commonrail.calibration.result import data_records

    studies = fit.family.parts
    return [(name, data_records(studies[name].data, {"best": part.scores})) for name, part in fit.parts.items()]


def _record_of(fit: FamilyFit) -> dict[str, Any]:
    return {
        "cost": fit.cost,
        "injections": fit.simulations,
        "joint": dict(fit.joint),
        "fits": {part: {"best": dict(fit.parts[part].best), "data": data} for part, data in _data(fit)},
    }


def _record(found: InjectorType, out: Path) -> dict[str, Any]:
    parts = [{"name": p.name, "source": p.source, "injectors": p.injectors} for p in found.parts]
    values = [
        {"name": p.name, "value": p.value, "spread": p.spread, "lower": p.lower, "upper": p.upper, "source": p.source}
        for p in found.parameters
    ]
    head = {"schema": 1, "kind": "type", "type": str(out), "name": found.name, "synthetic": found.synthetic}
    return {**head, "parts": parts, "parameters": values}


def _print(found: InjectorType, fit: FamilyFit | None) -> None:
    from commonrail.injector.definition import parameter_quantities
    from commonrail.report.tables import tables_of

    if found.synthetic:
        typer.echo(f"SYNTHETIC: {found.synthetic}")
    for part, data in [] if fit is None else _data(fit):
        typer.echo(part)
        for table in tables_of(data):
            print_table(table)
    units = {name: q.unit for name, q in parameter_quantities().items()}
    rows = [[p.name, to_text(p.value, units[p.name]), to_text(p.spread, units[p.name])] for p in found.parameters]
    print_rows(["parameter", "value", "spread"], rows, found.title, texts=1)
