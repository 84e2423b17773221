"""commonrail adapt: model of one part from a type of injector and a few reference quantities."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from commonrail.cli.console import print_json, print_pairs, print_rows, say
from commonrail.cli.options import Json, Threads
from commonrail.cli.output import check_file
from commonrail.units import to_text

if TYPE_CHECKING:
    from commonrail.family.adapt import Adapted

__all__ = ["adapt"]


def adapt(
    injector_type: Annotated[Path, typer.Argument(metavar="TYPE.toml", help="Type file, as `family` writes it.")],
    *,
    points: Annotated[
        Path,
        typer.Option(
            "--from",
            metavar="POINTS.csv",
            help="Reference quantities of the part: columns rail_pressure, energising_time and quantity.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="MODEL.toml", help="Injector file to be written.")],
    injector: Annotated[
        str | None,
        typer.Option(help="Injector of the part: its nozzle and measured values. [default: the type's]"),
    ] = None,
    cylinder_pressure: Annotated[str, typer.Option(help="Cylinder pressure of the points, e.g. 5MPa.")] = "5MPa",
    return_pressure: Annotated[
        str, typer.Option(help="Pressure at the end of the return line of the points, e.g. 0.5MPa.")
    ] = "0.5MPa",
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Make a part's model from its type and few quantities.

    Up to three quantities determine the flow factor; from four on the type's parameters are fitted
    too, held by their spreads.

    \b
    Example:
      commonrail adapt types/cri2.toml --from points.csv --injector part.toml --out model.toml
    """
    from commonrail.family.adapt import adapt as run
    from commonrail.files.injector_file import dump_injector

    check_file(out, "--out")
    adapted = run(
        injector_type,
        points,
        injector=injector,
        cylinder_pressure=cylinder_pressure,
        return_pressure=return_pressure,
        threads=threads,
    )
    header = (
        f"Made by commonrail adapt from {injector_type.name} and {points.name}; flow factor {adapted.flow_factor:.5g}."
    )
    dump_injector(adapted.injector, out, header=header)
    if json:
        print_json(_record(adapted, out))
    else:
        if adapted.injector.synthetic:
            typer.echo(f"SYNTHETIC: {adapted.injector.synthetic}")
        free = len(adapted.calibration.best)
        pairs = [("flow factor", f"{adapted.flow_factor:.4f}"), ("parameters fitted", f"{free}")]
        print_pairs(pairs, adapted.calibration.study.title)
        print_rows(["rail pressure", "energising time", "measured", "type", "adapted"], _rows(adapted), texts=0)
    say(f"wrote {out}")


def _rows(adapted: Adapted) -> list[list[str]]:
    columns = zip(adapted.points.points, adapted.points.quantity, adapted.before, adapted.after, strict=True)
    return [
        [to_text(point.initial_pressures()[0], "Pa"), to_text(point.pulses[0].duration, "s")]
        + [f"{value * 1e9:.3f} mm3" for value in values]
        for point, *values in columns
    ]


def _record(adapted: Adapted, out: Path) -> dict[str, Any]:
    return {
        "schema": 1,
        "kind": "adaptation",
        "model": str(out),
        "synthetic": adapted.injector.synthetic,
        "flow_factor": adapted.flow_factor,
        "parameters": adapted.calibration.best,
        "measured": adapted.points.quantity.tolist(),
        "type": adapted.before.tolist(),
        "adapted": adapted.after.tolist(),
    }
