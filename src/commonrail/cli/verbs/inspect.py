"""commonrail inspect: content of a file, and what it is taken for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from commonrail.base.errors import InputError
from commonrail.cli.console import print_json, print_pairs, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import DecimalSign, Encoding, Json, SheetName, check_file, read_form

if TYPE_CHECKING:
    from commonrail.readers.quantity_matrix import FoundMap


@table_verb
def inspect(
    file: Annotated[Path, Argument(metavar="FILE", help="CSV, Excel, MDF, TDMS, LabVIEW, MAT, Parquet, DCM file ...")],
    *,
    sheet: SheetName = None,
    encoding: Encoding = None,
    decimal: DecimalSign = None,
    pressure_unit: Annotated[str, Option(help="Unit of the rail pressures, if the file has none.")] = "",
    time_unit: Annotated[str, Option(help="Unit of the energising times, if the file has none.")] = "",
    quantity_unit: Annotated[str, Option(help="Unit of the quantities, if the file has none.")] = "",
    out: Annotated[
        Path | None, Option(metavar="FILE.csv", help="Table for a study: a row for each point, with units.")
    ] = None,
    json: Json = False,
) -> None:
    """List what a data file holds and what it is taken for.

    Channels with their units and ranges, a quantity map in rows or as a matrix, traces beside each other, or a
    record of repeated shots. Encoding, separators, decimal sign and axes are detected and reported.

    \b
    Examples:
      commonrail inspect rates.mf4
      commonrail inspect bench.xlsx --out data/quantity.csv
      commonrail inspect map.csv --encoding cp1252 --quantity-unit mm3
    """
    from commonrail.readers.overview import inspect as survey
    from commonrail.readers.quantity_matrix import GivenUnits

    check_file(out, "--out")
    form = read_form(encoding, decimal, sheet, [file])
    stated_units = GivenUnits(pressure_unit, time_unit, quantity_unit)
    overview = survey(file, form, stated_units)
    if not overview.taken_for:  # by an inspector of an installed package
        _show({"file": str(file), **overview.facts}, json)
        return
    if overview.quantity_map is None and (out is not None or any(stated_units.by_kind().values())):
        reason = overview.facts.get("reason", f"it is taken for {overview.taken_for}.")
        raise InputError(f"{file}: {reason}")
    if out is not None and overview.quantity_map is not None:
        _write(out, overview.quantity_map, file)
    facts = {"file": str(file), "taken for": overview.taken_for, **overview.facts}
    facts |= {"read as": overview.said} if overview.said else {}
    facts |= {"marked as": overview.synthetic} if overview.synthetic else {}
    _show(facts | ({"files": [str(out)]} if out is not None else {}), json)
    if out is not None and not json:
        say(f"wrote {out}")


def _write(path: Path, quantity_map: FoundMap, source: Path) -> None:
    """Write the map as a study reads it."""
    from commonrail.base.csv_output import write_csv

    names = ("rail_pressure", "energising_time", "quantity")
    units = (quantity_map.units[name] for name in ("rail pressure", "energising time", "quantity"))
    header = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    rows = zip(
        quantity_map.rail_pressure.tolist(),
        quantity_map.energising_time.tolist(),
        quantity_map.quantity.tolist(),
        strict=True,
    )
    write_csv(path, [f"from {source.name}: {quantity_map.form}"], header, ([f"{v:.12g}" for v in row] for row in rows))


def _show(facts: dict[str, Any], json: bool) -> None:
    if json:
        print_json({"kind": "inspection", **facts})
        return
    print_pairs(
        [(name, str(text)) for name, text in facts.items() if name not in ("file", "files")], str(facts["file"])
    )
