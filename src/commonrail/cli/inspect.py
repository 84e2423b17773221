"""commonrail inspect: content of a file, and what it is taken for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from commonrail.cli.console import print_json, print_pairs, say
from commonrail.cli.options import Json
from commonrail.cli.output import check_file
from commonrail.errors import InputError

if TYPE_CHECKING:
    from commonrail.reading.grid import Grid
    from commonrail.reading.map_table import FoundMap

__all__ = ["inspect"]

MOST_SHOWN = 12  # cells of a header


def inspect(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="CSV or text table, Excel workbook, or DCM file.")],
    *,
    sheet: Annotated[str | None, typer.Option(help="Sheet of a workbook. [default: the first with cells]")] = None,
    encoding: Annotated[
        str | None, typer.Option(help="Encoding of a text, e.g. cp1252 or utf-16. [default: detected]")
    ] = None,
    pressure_unit: Annotated[str, typer.Option(help="Unit of the rail pressures, if the file has none.")] = "",
    time_unit: Annotated[str, typer.Option(help="Unit of the energising times, if the file has none.")] = "",
    quantity_unit: Annotated[str, typer.Option(help="Unit of the quantities, if the file has none.")] = "",
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Table for a study: a row for each point, with units.")
    ] = None,
    json: Json = False,
) -> None:
    """List what a data file holds and what it is taken for.

    A quantity map may be a table with a row for each point, or a matrix of rail pressures and energising times,
    either way round. Encoding, separators, decimal sign and axes are detected and reported.

    \b
    Examples:
      commonrail inspect bench.xlsx --out data/quantity.csv
      commonrail inspect map.csv --encoding cp1252 --quantity-unit mm3
    """
    from commonrail.reading.grid import read_grid
    from commonrail.reading.map_table import GivenUnits, find_map

    check_file(out, "--out")
    if file.suffix.lower() == ".dcm":
        _show(_dcm(file), json)
        return
    grid = read_grid(file, encoding, sheet)
    try:
        found = find_map(grid, GivenUnits(pressure_unit, time_unit, quantity_unit))
    except InputError as error:
        if out is not None or pressure_unit or time_unit or quantity_unit:
            raise
        _show(_table_facts(grid, str(error)), json)
        return
    if out is not None:
        _write(out, found, file)
    _show(_facts(file, found) | ({"files": [str(out)]} if out is not None else {}), json)
    if out is not None and not json:
        say(f"wrote {out}")


def _facts(file: Path, found: FoundMap) -> dict[str, Any]:
    axes = {"rail pressure": found.rail_pressure, "energising time": found.energising_time, "quantity": found.quantity}
    ranges = {
        name: f"{values.min():g} to {values.max():g} {found.units[name]}"
        + (f", {len(set(values.tolist()))} values" if name != "quantity" else f", {len(values)} points")
        for name, values in axes.items()
    }
    return {"file": str(file), "taken for": f"a quantity map: {found.form}", **ranges, "read as": "; ".join(found.said)}


def _table_facts(grid: Grid, reason: str) -> dict[str, Any]:
    """Facts of a table in which no map is found."""
    heads = [str(cell) for cell in grid.rows[0]]
    shown = ", ".join(heads[:MOST_SHOWN]) + (f" and {len(heads) - MOST_SHOWN} more" if len(heads) > MOST_SHOWN else "")
    return {
        "file": str(grid.path),
        "taken for": "a table, no quantity map",
        "reason": reason.removeprefix(f"{grid.path}: "),
        "rows": str(len(grid.rows)),
        "first row": shown,
        "read as": "; ".join(grid.said),
    }


def _dcm(file: Path) -> dict[str, Any]:
    from commonrail.files.dcm import read_dcm

    maps = read_dcm(file)
    if not maps:
        raise InputError(f"{file}: there is no map in this DCM file; single values and curves are passed over.")
    facts: dict[str, Any] = {"file": str(file), "taken for": "calibration data, DCM 2"}
    for m in maps:
        (ny, nx), axes = m.values.shape, f"{m.x.unit or 'no unit'} × {m.y.unit or 'no unit'}"
        facts[m.label] = f"{nx} × {ny} over {axes}, values in {m.unit or 'no unit'}"
    return facts


def _write(path: Path, found: FoundMap, source: Path) -> None:
    """Write the map as a study reads it."""
    from commonrail.files.atomic import write_csv

    names = ("rail_pressure", "energising_time", "quantity")
    units = (found.units[name] for name in ("rail pressure", "energising time", "quantity"))
    header = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    rows = zip(found.rail_pressure.tolist(), found.energising_time.tolist(), found.quantity.tolist(), strict=True)
    write_csv(path, [f"from {source.name}: {found.form}"], header, ([f"{v:.12g}" for v in row] for row in rows))


def _show(facts: dict[str, Any], json: bool) -> None:
    if json:
        print_json({"kind": "inspection", **facts})
        return
    print_pairs(
        [(name, str(text)) for name, text in facts.items() if name not in ("file", "files")], str(facts["file"])
    )
