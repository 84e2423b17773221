"""Write a fuel file from a table of properties, or from a pure fluid of CoolProp."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from commonrail.base.arguments import Quantity, array, file_path
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.output import write_text
from commonrail.plugins.fuel.file import document
from commonrail.plugins.fuel.run import FittedFuel, fit_fuel
from commonrail.readers.fuel import load_fuel


class WrittenFuel(NamedTuple):
    """Written fuel: file, laws, and (for CoolProp) largest deviations of the simulation's polynomials."""

    path: Path
    fitted: FittedFuel
    simulated: dict[str, float]


def fuel(
    out: str | Path,
    table: str | Path | None = None,
    *,
    coolprop: str = "",
    pressure: Sequence[Quantity] = (),
    temperature: Sequence[Quantity] = (),
    title: str = "",
) -> WrittenFuel:
    """Fit a fuel to a table of its properties, or to a pure fluid of CoolProp, and write its file.

    Parameters
    ----------
    out : str or path
        Fuel file, which must not exist.
    table : str or path, optional
        Columns pressure, temperature, density, viscosity; optional bulk_modulus and sound_speed.
    coolprop : str
        Fluid instead of a table, such as ``"Methanol"``.
    pressure, temperature : (float or str, float or str)
        Range of the liquid [Pa], [K].
    title : str
        Default: name of the file.

    Returns
    -------
    WrittenFuel

    Raises
    ------
    InputError
        If the file exists, the table cannot be used, or CoolProp cannot compute the fluid well enough.
    ConfigurationError
        Unless either a table or a fluid with its ranges is given.
    """
    path = file_path(out, "fuel file")
    if path.exists():
        raise InputError(f"{path}: the file already exists; name another one, or remove it first.")
    if (table is None) == (not coolprop):
        raise ConfigurationError("Name either a table of properties or a fluid of CoolProp.")
    if table is not None:
        source_path = file_path(table, "table")
        fitted, simulated = fit_fuel(source_path), dict[str, float]()
        source = f"fitted to {fitted.rows} rows of {source_path.name}"
    else:
        from commonrail.plugins.fuel.coolprop import fit_pure_fuel

        if not len(pressure) == len(temperature) == 2:
            raise ConfigurationError("A fluid of CoolProp needs its lowest and highest pressure and temperature.")
        ranges = array(pressure, "Pa", "pressure", 1).tolist(), array(temperature, "K", "temperature", 1).tolist()
        fitted, simulated, source = fit_pure_fuel(coolprop, *ranges)
    write_text(path, document(fitted, title or path.stem, source))
    load_fuel(path)  # checks that it can be read
    return WrittenFuel(path, fitted, simulated)
