"""commonrail family: type file of the parts of one type that were calibrated."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.options import Json
from commonrail.cli.output import check_file
from commonrail.errors import InputError
from commonrail.units import parse, to_text

if TYPE_CHECKING:
    from commonrail.calibration.injector_type import InjectorType

__all__ = ["family"]


def family(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE...", help="Run folders of `calibrate`, one for each part, or the folder of a fleet."
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
    json: Json = False,
) -> None:
    """Write a type file: values and spreads of what the parts of one type share.

    A study takes it as start and prior with the key `type`; `commonrail adapt` makes a part's model of it.

    \b
    Examples:
      commonrail family runs/part-1 runs/part-2 runs/part-3 --out cri2.toml
      commonrail family fleets/line-4 --out cri2.toml
      commonrail family runs/part-1 --part-spread 3% --out cri2.toml
    """
    from commonrail.family.from_results import FLEET, type_from_fleet, type_from_runs
    from commonrail.files.type_file import dump_type

    check_file(out, "--out")
    fleets = [source for source in sources if (source / FLEET).is_file()]
    own = name or out.stem
    share = None if part_spread is None else parse(part_spread, "1", "--part-spread")
    if fleets and len(sources) > 1:
        raise InputError(f"{fleets[0]}: a fleet is a source by itself; name it alone, or run folders only.")
    found = type_from_fleet(fleets[0], own) if fleets else type_from_runs(sources, own, part_spread=share)
    dump_type(found, out)
    if json:
        print_json(_record(found, out))
    else:
        _print(found)
    if found.injector is None:
        say(f"{out} names no injector of the catalogue; `commonrail adapt` needs one for it.")
    say(f"wrote {out}")


def _record(found: InjectorType, out: Path) -> dict[str, Any]:
    parts = [{"name": p.name, "source": p.source, "injectors": p.injectors} for p in found.parts]
    values = [
        {"name": p.name, "value": p.value, "spread": p.spread, "lower": p.lower, "upper": p.upper, "source": p.source}
        for p in found.parameters
    ]
    head = {"schema": 1, "kind": "type", "type": str(out), "name": found.name, "synthetic": found.synthetic}
    return {**head, "parts": parts, "parameters": values}


def _print(found: InjectorType) -> None:
    from commonrail.injector.definition import parameter_quantities

    if found.synthetic:
        typer.echo(f"SYNTHETIC: {found.synthetic}")
    units = {name: q.unit for name, q in parameter_quantities().items()}
    rows = [[p.name, to_text(p.value, units[p.name]), to_text(p.spread, units[p.name])] for p in found.parameters]
    print_rows(["parameter", "value", "spread"], rows, found.title, texts=1)
