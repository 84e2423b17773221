"""commonrail fuel: fuel file from a table of measured properties."""

from __future__ import annotations

import json as text_of
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from commonrail.base.errors import InputError
from commonrail.base.output import write_text
from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import Json, check_file

if TYPE_CHECKING:
    from commonrail.plugins.fuel.run import FittedFuel

_VAPOUR = """
[vapour_pressure] # not in the table; only its smallness beside the return pressure matters
unit = "ln(Pa)"
mark = "E"
source = "taken from n-dodecane"
error = 1.0
ln_pressure = [6.598002, 2.179211, -0.3124296, 0.04114257, -0.005736842]
"""


@verb
def fuel(
    table: Annotated[
        Path,
        Argument(
            metavar="TABLE.csv",
            help="Columns pressure, temperature, density, viscosity (kinematic or dynamic) and, if there are, "
            "bulk_modulus (isothermal), sound_speed.",
        ),
    ],
    *,
    out: Annotated[Path, Option(metavar="FUEL.toml", help="Fuel file to be written.")],
    title: Annotated[str | None, Option(help="Title of the fuel. [default: the name of the file]")] = None,
    json: Json = False,
) -> None:
    """Fit a fuel to a table of its properties.

    The file states the largest deviation of each law from the table, whose pressures and temperatures are the fuel's
    range. An injector takes it by `file = "FUEL.toml"` in its table [fuel].

    \b
    Examples:
      commonrail fuel hvo.csv --out hvo.toml --title "HVO, batch 7"
    """
    from commonrail.plugins.fuel.run import fit_fuel
    from commonrail.readers.fuel import load_fuel

    check_file(out, "--out")
    if title is not None and not title.isprintable():
        raise InputError("--title: a title of printable characters on one line is expected.")
    found = fit_fuel(table)
    write_text(out, _document(found, title or out.stem, table.name))
    load_fuel(out)  # what is written is read
    if json:
        laws = {law.table: {"error": law.error, **law.polynomials} for law in found.laws}
        print_json({"schema": 1, "kind": "fuel", "fuel": str(out), "rows": found.rows, "laws": laws})
    else:
        rows = [[law.table, f"{100.0 * law.error:.2g} %"] for law in found.laws]
        print_rows(["law", "largest deviation"], rows, f"{found.rows} rows of {table}", texts=1)
    say(f"wrote {out}")


def _document(found: FittedFuel, title: str, source: str) -> str:
    """Text of a fuel file."""
    low, high = (value * 1e-6 for value in found.pressure)
    lines = [
        "# Written by commonrail fuel. Polynomials ascend in (T - 353.15 K)/(40 K); pressures in MPa.",
        f"title = {text_of.dumps(title)}",
        f"source = {text_of.dumps(f'fitted to {found.rows} rows of {source}')}",
        f"\n[range]\npressure_MPa = [{low!r}, {high!r}]\ntemperature_K = {list(found.temperature)}",
    ]
    for law in found.laws:
        lines.append(f"\n[{law.table}]")
        lines += ['kind = "integrated"'] if law.table == "density" else []
        lines += [f'unit = "{law.unit}"', 'mark = "F"', f"source = {text_of.dumps(f'fitted to {source}')}"]
        lines += [f"error = {law.error!r}", *(f"{name} = {values}" for name, values in law.polynomials.items())]
    return "\n".join(lines) + "\n" + _VAPOUR
