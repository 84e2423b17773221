"""Injectors to TOML, complete and exact: every value as the shortest decimal that is the same float."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import InlineTable

from commonrail.arguments import file_path, instance, instances, known_names, mapping, plain_text
from commonrail.choices import Actuation
from commonrail.files.atomic import write_text
from commonrail.files.fuel_file import fuel_catalogue, load_fuel
from commonrail.fuel.fuel import Fuel, Law
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector, Source
from commonrail.observation.meter import Meter
from commonrail.observation.quantities import QUANTITIES
from commonrail.parts.furniture import Q
from commonrail.units import to_text

__all__ = ["FORMAT", "dump_injector"]

FORMAT = "commonrail-injector/1"
_UNSTATED = Source("E", "no source stated")


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
    known = instances(meters, Meter, "meters")
    write_text(path, injector_text(injector, notes, plain_text(header, "header"), known))


def injector_text(injector: Injector, notes: Mapping[str, str], header: str, meters: Sequence[Meter] = ()) -> str:
    """The file's text."""
    document = tomlkit.document()
    for line in header.splitlines():
        document.add(tomlkit.comment(line))
    for key, value in _identity(injector).items():
        document.add(key, tomlkit.item(value))
    sources = dict(injector.sources) | {name: Source("F", note) for name, note in notes.items()}
    tables: dict[str, Any] = {}
    for name, q in injector.quantities.items():
        room, key = name.split(".")
        if room not in tables:
            tables[room] = tomlkit.table()
            document.add(room, tables[room])
        source = sources.get(name, _UNSTATED)
        tables[room].add(key, _entry(injector.values[name], q, source))
    _add_fuel(tables[FUEL_TEMPERATURE.split(".")[0]], injector.fuel)
    _add_meters(document, meters)
    return tomlkit.dumps(document)


def _add_meters(document: tomlkit.TOMLDocument, meters: Sequence[Meter]) -> None:
    """Tables of the meters, which belong to the bench and not to the injector; none if there are no meters."""
    tables = tomlkit.table(is_super_table=True)
    for meter in meters:
        table = tomlkit.table()
        table.update({"law": meter.law.value, "order": meter.order})
        for key, value in meter.values.items():
            table.add(key, _entry(value, QUANTITIES[key], meter.sources.get(key, _UNSTATED)))
        tables.add(meter.name, table)
    if meters:
        document.add("meters", tables)


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
    return identity | ({"synthetic": injector.synthetic} if injector.synthetic else {})


def _entry(value: float, q: Q, source: Source) -> InlineTable:
    """``{ value = "0.000215 m", mark = "E", source = "…" } # 215 um, diameter of the Z-hole``."""
    entry = tomlkit.inline_table()
    # float(): a NumPy float writes its type into its repr.
    entry.update({"value": float(value) if q.unit == "1" else f"{float(value)!r} {q.unit}"})
    entry.update({"mark": source.mark, "source": source.text})
    entry.comment(f"{to_text(value, q.unit)}: {q.meaning}")
    return entry


def _add_fuel(table: Any, fuel: Fuel) -> None:
    """By name if the catalogue has this very fuel, else law by law."""
    if fuel.name in fuel_catalogue() and load_fuel(fuel.name) == fuel:
        table.add("name", fuel.name)
    else:
        table.add("definition", tomlkit.item(_fuel_document(fuel)))


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
