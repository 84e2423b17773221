"""commonrail fuel: fuel file from a table of measured properties, or of a pure fluid of CoolProp."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from commonrail.base.errors import InputError
from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import Json, check_file, read_axis, refuse_unused


@table_verb
def fuel(
    table: Annotated[
        Path | None,
        Argument(
            metavar="[TABLE.csv]",
            help="Columns pressure, temperature, density, viscosity (kinematic or dynamic) and, if there are, "
            "bulk_modulus (isothermal), sound_speed.",
        ),
    ] = None,
    *,
    coolprop: Annotated[
        str | None, Option(metavar="NAME", help="Pure fluid of CoolProp in place of a table, e.g. Methanol.")
    ] = None,
    pressure: Annotated[
        str | None, Option(metavar="LOW:HIGH", help="Range of the fluid, all of it liquid, e.g. 0.5:200MPa.")
    ] = None,
    temperature: Annotated[str | None, Option(metavar="LOW:HIGH", help="Range of the fluid, e.g. 20:80degC.")] = None,
    out: Annotated[Path, Option(metavar="FUEL.toml", help="Fuel file to be written.")],
    title: Annotated[str | None, Option(help="Title of the fuel. [default: the name of the file]")] = None,
    json: Json = False,
) -> None:
    """Fit a fuel to a table of its properties, or to CoolProp.

    The file states the largest deviation of each law, and the range of pressures and temperatures. Of a fluid of
    CoolProp at most 0.1 % in density, 0.5 % in sound speed and 3 % in viscosity are accepted. An injector takes the
    file by `file = "FUEL.toml"` in its table [fuel].

    \b
    Examples:
      commonrail fuel hvo.csv --out hvo.toml --title "HVO, batch 7"
      commonrail fuel --coolprop Methanol --pressure 0.5:200MPa --temperature 20:80degC --out methanol.toml
    """
    from commonrail.plugins.fuel.write import fuel as write_fuel

    if out.exists():
        raise InputError(f"--out: {out} already exists; name another file, or remove it first.")
    check_file(out, "--out")
    if title is not None and not title.isprintable():
        raise InputError("--title: a title of printable characters on one line is expected.")
    if (table is None) == (coolprop is None):
        raise InputError("Name either a table of properties or a fluid by --coolprop NAME.")
    refuse_unused({name: (coolprop is not None, "--coolprop NAME") for name in ("pressure", "temperature")})
    ranges = {}
    if coolprop is not None:
        ranges["pressure"] = _range(pressure, "Pa", "--pressure")
        ranges["temperature"] = _range(temperature, "K", "--temperature")
    _, fit, simulated = write_fuel(out, table, coolprop=coolprop or "", title=title or "", **ranges)
    if json:
        laws = {law.table: {"error": law.error, **law.polynomials} for law in fit.laws}
        record = {"schema": 1, "kind": "fuel", "fuel": str(out), "rows": fit.rows, "laws": laws}
        print_json(record | ({"simulated": simulated} if simulated else {}))
    else:
        rows = [[law.table, f"{100.0 * law.error:.2g} %"] for law in fit.laws]
        rows += [
            [f"{name.replace('_', ' ')} as simulated", f"{100.0 * deviation:.2g} %"]
            for name, deviation in simulated.items()
        ]
        print_rows(
            ["law", "largest deviation"],
            rows,
            f"{fit.rows} {'rows' if table else 'points'} of {table or coolprop}",
            texts=1,
        )
    say(f"wrote {out}")


def _range(text: str | None, unit: str, option: str) -> tuple[float, float]:
    """Lowest and highest value of an option LOW:HIGH."""
    parts = [] if text is None else text.split(":")
    if len(parts) != 2:
        example = {"Pa": "0.5:200MPa", "K": "20:80degC"}[unit]
        raise InputError(f"{option}: a range LOW:HIGH with a unit is needed with --coolprop, such as {example}.")
    low, high = read_axis(",".join(parts), unit, option, increasing=True).tolist()
    return low, high
