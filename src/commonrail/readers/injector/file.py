"""Injectors to TOML, complete and exact: every value as the shortest decimal that is the same float."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from commonrail.base.arguments import file_path, instance, instances, known_names, mapping, plain_text, source_of
from commonrail.base.choices import Actuation
from commonrail.base.errors import InputError
from commonrail.base.output import check_sum, write_text
from commonrail.base.units import to_text
from commonrail.physics.fuel import Fuel, Law
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, Source
from commonrail.physics.law import Q
from commonrail.readers.fuel import load_fuel, shipped_fuels
from commonrail.readers.injector.model import CATALOGUE, injector_of, meters_of
from commonrail.readers.location import Place, Reach, read_text
from commonrail.readers.toml import (
    LARGEST_TOML,
    UNSTATED,
    inline_table,
    key_text,
    parse_toml,
    read_toml,
    table_lines,
    value_text,
)

if TYPE_CHECKING:
    from commonrail.physics.meters import Meter

FORMAT = "commonrail-injector/1"


def dump_injector(
    injector: Injector,
    path: str | Path,
    notes: Mapping[str, str] | None = None,
    header: str = "",
    meters: Sequence[Meter] = (),
) -> None:
    """Write a complete injector file, which `load_injector` reads back bit by bit.

    Parameters
    ----------
    injector : Injector
    path : str or Path
    notes : mapping of str to str, optional
        Sources of values that a calibration has fitted, by dotted name; they are marked F.
    header : str
        Comment at the top of the file.
    meters : sequence of Meter
        Those that the injector was calibrated with, to be kept beside it; `load_meters` reads them.

    Raises
    ------
    OutputError
        If the file cannot be written.
    ConfigurationError
        If an argument is of another kind, or a note belongs to no parameter.
    """
    instance(injector, Injector, "injector")
    path = file_path(path, "path of an injector")
    notes = mapping({} if notes is None else notes, "notes", '{"nozzle.holes": "measured again"}')
    known_names(list(notes), injector.quantities, "notes", "nozzle.holes")
    for note in notes.values():
        plain_text(note, "notes")
    from commonrail.physics.meters import Meter

    known = instances(meters, Meter, "meters")
    write_text(path, injector_text(injector, notes, plain_text(header, "header"), known))


def injector_text(injector: Injector, notes: Mapping[str, str], header: str, meters: Sequence[Meter] = ()) -> str:
    """The file's text."""
    lines = [f"# {line}" if line else "#" for line in header.splitlines()]
    lines += [f"{key} = {value_text(value)}" for key, value in _identity(injector).items()]
    sources = dict(injector.sources) | {name: Source("F", note) for name, note in notes.items()}
    fuel = FUEL_TEMPERATURE.partition(".")[0]
    tables: dict[str, list[str]] = {}
    for name, q in injector.quantities.items():
        table, key = name.split(".")
        entry = _entry(injector.values[name], q, sources.get(name, UNSTATED))
        tables.setdefault(table, ["", f"[{table}]"]).append(f"{key} = {entry}")
    tables[fuel] += _fuel_lines(injector.fuel, fuel)
    for own in tables.values():
        lines += own
    for meter in meters:  # of the bench, not of the injector
        lines += _meter_lines(meter)
    return "\n".join(lines) + "\n"


def _meter_lines(meter: Meter) -> Iterator[str]:
    from commonrail.physics.meters import QUANTITIES

    yield from table_lines(f"meters.{key_text(meter.name)}", {"law": meter.law.value, "order": meter.order})
    for key, value in meter.values.items():
        yield f"{key} = {_entry(value, QUANTITIES[key], meter.sources.get(key, UNSTATED))}"


def _identity(injector: Injector) -> dict[str, str]:
    variant = injector.variant
    identity = {
        "format": FORMAT,
        "name": injector.name,
        "title": injector.title,
        "variant": variant.body.value,
        "rail_boundary": variant.boundary.value,
        "drive_kind": variant.drive.value,
    }
    if variant.actuation is not Actuation.SERVO:
        identity["actuation"] = variant.actuation.value
    if variant.nozzle_law:
        identity["nozzle_law"] = variant.nozzle_law
    return identity | ({"synthetic": injector.synthetic} if injector.synthetic else {})


def _entry(value: float, q: Q, source: Source) -> str:
    """``{value = "0.000215 m", mark = "E", source = "…"} # 215 um: diameter of the Z-hole``."""
    # float(): a NumPy float writes its type into its repr.
    stated = float(value) if q.unit == "1" else f"{float(value)!r} {q.unit}"
    entry = inline_table({"value": stated, "mark": source.mark, "source": source.text})
    return f"{entry} # {to_text(value, q.unit)}: {q.meaning}"


def _fuel_lines(fuel: Fuel, table: str) -> Iterator[str]:
    """By name if this very fuel ships with the package, else law by law."""
    if fuel.name in shipped_fuels() and load_fuel(fuel.name) == fuel:
        yield f"name = {value_text(fuel.name)}"
    else:
        yield from table_lines(f"{table}.definition", _fuel_document(fuel))


def _fuel_document(fuel: Fuel) -> dict[str, Any]:
    """Table that `parse_fuel` reads, and the name."""
    eq2 = ("k1", "k2", "k3", "k4")
    density = eq2 if fuel.density_kind == "eq2" else ("at_zero_pressure",)
    low, high = (pressure / 1e6 for pressure in fuel.pressure_range)
    document = {
        "name": fuel.name,
        "title": fuel.title,
        "source": fuel.source,
        "range": {"pressure_MPa": [low, high], "temperature_K": list(fuel.temperature_range)},
        "density": {"kind": fuel.density_kind} | _law(fuel.density_law, "kg/m3", density),
        "kinematic_viscosity": _law(fuel.viscosity_law, "mm2/s", eq2[:3]),
        "vapour_pressure": _law(fuel.vapour_law, "ln(Pa)", ("ln_pressure",)),
    }
    optional = {"bulk_modulus": fuel.bulk_modulus_law, "isentropic_bulk_modulus": fuel.isentropic_law}
    return document | {key: _law(law, "MPa", eq2) for key, law in optional.items() if law is not None}


def _law(law: Law, unit: str, names: tuple[str, ...]) -> dict[str, Any]:
    origin = {"mark": law.origin.mark, "source": law.origin.source, "error": law.origin.error}
    return {"unit": unit} | origin | {n: list(k) for n, k in zip(names, law.coefficients, strict=True)}


# Injectors from TOML: a file of the user, or the catalogue that ships with the package.
#
# One table per component, whose keys are the component's parameters. A value is a text with its unit, or an inline
# table that adds mark and source; what a file leaves out takes the default of the component.


def injector_catalogue() -> list[str]:
    """Names that `load_injector` knows, those of installed packages behind those that ship."""
    return CATALOGUE.names()


def in_catalogue(name: object) -> bool:
    """True for a name of `injector_catalogue`; installed packages are searched only where none of that name ships."""
    return name in CATALOGUE


def shipped_injectors() -> list[str]:
    """Names of the injectors that ship, sorted."""
    return CATALOGUE.shipped()


def load_injector(source: str | Path, reach: Reach | None = None) -> Injector:
    """Read an injector.

    Parameters
    ----------
    source : str or Path
        Path of a ``.toml`` file, or a name of `injector_catalogue`.
    reach : Reach, optional
        Where the file of its fuel may lie; by default in the injector's folder or below, unless the injector's file
        says ``allow_outside = true``.

    Returns
    -------
    Injector
        Every value in SI, with mark and source.

    Raises
    ------
    InputError
        If the file cannot be read or something in it is unknown, missing, of the wrong kind or outside
        its domain, with file and key; or if it is a result that is not the one that was written.
    ConfigurationError
        If `source` is neither a name nor a path.
    """
    source = source_of(source, "source of an injector")
    if isinstance(source, Path):
        check_sum(source)
        return _read(read_text(source, LARGEST_TOML), str(source), source.stem, reach)
    if "@" in source:
        raise InputError(
            f'"{source}" names a variant, which is not taken here; state rail_boundary, drive_kind and variant in an '
            "injector file and name that."
        )
    file = f"{source}.toml"
    return _read(CATALOGUE.text(source, _similar(file, reach)), file, source, Reach(Path(file), False))


def _read(text: str, file: str, stem: str, reach: Reach | None) -> Injector:
    return injector_of(parse_toml(text, file), Place(file), stem, reach)


def load_meters(path: str | Path) -> tuple[Meter, ...]:
    """Read the meters that a calibration has left beside its injector, in ``calibrated.toml``.

    Parameters
    ----------
    path : str or Path
        Injector file.

    Returns
    -------
    tuple of Meter
        Empty if there are none.

    Raises
    ------
    InputError
        If the file cannot be read, or something in it is unknown or of the wrong kind.
    ConfigurationError
        If `path` is no path, or a meter makes no sense.
    """
    file = file_path(path, "path of an injector")
    return meters_of(read_toml(file)[0], Place(str(file)))


def _similar(file: str, reach: Reach | None) -> str:
    """Suggestion of a file of that name, if there is one."""
    try:
        there = ((reach.file.parent if reach else Path()) / file).is_file()
    except (OSError, ValueError):  # a name that no file can have
        there = False
    return f' (did you mean the file "{file}"?)' if there else ""
