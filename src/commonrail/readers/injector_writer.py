"""Injectors to TOML, complete and exact: every value as the shortest decimal that is the same float."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from commonrail.base.arguments import file_path, instance, instances, known_names, mapping, plain_text
from commonrail.base.output import write_text
from commonrail.base.units import to_text
from commonrail.physics.fuel import Fuel
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, Source
from commonrail.physics.law import Q
from commonrail.physics.variants import INSTALLED_LAWS, Variant
from commonrail.readers.fuel import fuel_document, list_shipped_fuels, load_fuel
from commonrail.readers.injector import VARIANT_KEYS
from commonrail.readers.toml import UNSTATED, inline_table, key_text, table_lines, value_text

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
        Meters that the injector was calibrated with, written to the same file; `load_meters` reads them.

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

    bench_meters = instances(meters, Meter, "meters")
    write_text(path, injector_text(injector, notes, plain_text(header, "header"), bench_meters))


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
    for table_entry in tables.values():
        lines += table_entry
    for meter in meters:  # of the bench, not of the injector
        lines += _meter_lines(meter)
    return "\n".join(lines) + "\n"


def _meter_lines(meter: Meter) -> Iterator[str]:
    from commonrail.physics.meters import QUANTITIES

    yield from table_lines(f"meters.{key_text(meter.name)}", {"law": meter.law.value, "order": meter.order})
    for key, value in meter.values.items():
        yield f"{key} = {_entry(value, QUANTITIES[key], meter.sources.get(key, UNSTATED))}"


def _identity(injector: Injector) -> dict[str, str]:
    identity = {"format": FORMAT, "name": injector.name, "title": injector.title}
    for key, field in VARIANT_KEYS.items():
        value = getattr(injector.variant, field)
        if key not in ("actuation", *INSTALLED_LAWS) or value != getattr(Variant(), field):
            identity[key] = value if isinstance(value, str) else value.value
    return identity | ({"synthetic": injector.synthetic} if injector.synthetic else {})


def _entry(value: float, q: Q, source: Source) -> str:
    """``{value = "0.000215 m", mark = "E", source = "…"} # 215 um: diameter of the Z-hole``."""
    # float(): a NumPy float writes its type into its repr.
    stated = float(value) if q.unit == "1" else f"{float(value)!r} {q.unit}"
    entry = inline_table({"value": stated, "mark": source.mark, "source": source.text})
    return f"{entry} # {to_text(value, q.unit)}: {q.meaning}"


def _fuel_lines(fuel: Fuel, table: str) -> Iterator[str]:
    """By name if this very fuel ships with the package, else law by law."""
    if fuel.adiabatic:
        yield 'compression = "adiabatic"'
    if fuel.name in list_shipped_fuels() and load_fuel(fuel.name) == replace(fuel, adiabatic=False):
        yield f"name = {value_text(fuel.name)}"
    else:
        yield from table_lines(f"{table}.definition", fuel_document(fuel))
