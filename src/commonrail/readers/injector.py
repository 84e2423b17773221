"""Injector files: their tables, the injectors that they make, and injectors written as files."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

from pydantic import BeforeValidator, Field, PlainValidator, create_model

from commonrail.base.arguments import (
    file_path,
    instance,
    instances,
    known_names,
    mapping,
    not_whole,
    plain_text,
    source_of,
)
from commonrail.base.choices import Actuation, Body, Boundary, Drive
from commonrail.base.output import check_sum, write_text
from commonrail.base.registry import Catalogue
from commonrail.base.units import to_text
from commonrail.physics.components.plunger_needle import cylinder_mass, cylinder_stiffness
from commonrail.physics.fuel import Fuel, Law
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, Source, parameter_quantities
from commonrail.physics.law import Q
from commonrail.physics.variants import Variant, model_of, reader_of, unread_parameters
from commonrail.readers.fuel import FuelModel, load_fuel, parse_fuel, shipped_fuels
from commonrail.readers.location import Place, Reach, located, read_text
from commonrail.readers.toml import (
    LARGEST_TOML,
    UNSTATED,
    FileModel,
    Given,
    Number,
    ParameterTable,
    Quantities,
    Sourced,
    Stated,
    Values,
    choice,
    fault,
    inline_table,
    key_text,
    parse_toml,
    read_model,
    read_toml,
    table_lines,
    value_text,
)

if TYPE_CHECKING:
    from commonrail.physics.meters import Meter

# Drawing of plunger and needle in an injector's file: seven cylinders, from which Eq. (8) gives stiffness and mass.

CYLINDERS = 7  # five of the plunger, two of the needle

_DRAWN = Source("F", "Eq. (8) from the drawing")
_Length = Annotated[Number, Stated(Q("m", "length"))]


def _table(item: Any) -> Any:
    if not isinstance(item, dict):
        raise fault('write the cylinder as { diameter = "4.3 mm", length = "20 mm" }')
    return item


def _seven(items: Any) -> Any:
    if not isinstance(items, list) or len(items) != CYLINDERS:
        raise fault(
            f'give {CYLINDERS} cylinders {{ diameter = "4.3 mm", length = "20 mm" }}, five of the plunger and two of '
            "the needle"
        )
    return items


class _Cylinder(FileModel):
    diameter: _Length
    length: _Length


class Drawing(Sourced):
    """Sizes of the cylinders and their material."""

    elastic_modulus: Annotated[Number, Stated(Q("Pa", "elastic modulus"))]
    density: Annotated[Number, Stated(Q("kg/m3", "density"))]
    cylinders: Annotated[list[Annotated[_Cylinder, BeforeValidator(_table)]], BeforeValidator(_seven)]

    def values(self) -> Values:
        """k1…k7 and m1…m7, Eq. (8)."""
        origin, modulus, density = self.origin(_DRAWN), self.elastic_modulus.value, self.density.value
        found: Values = {}
        for i, cylinder in enumerate(self.cylinders, start=1):
            size = cylinder.diameter.value, cylinder.length.value
            found[f"k{i}"] = Given(cylinder_stiffness(modulus, *size), origin)
            found[f"m{i}"] = Given(cylinder_mass(density, *size), origin)
        return found


class DrawnTable(ParameterTable):
    """Table of plunger and needle: a number of its own goes before that of the drawing."""

    drawing: Drawing | None = None

    def values(self) -> Values:
        """Numbers of the drawing, and those that are given."""
        return (self.drawing.values() if self.drawing else {}) | super().values()


_DEFAULT = Source("E", "default of commonrail")


def components_of(*actuations: Actuation) -> list[str]:
    """Components of injectors, each a table of the file; by default those of all."""
    models = map(model_of, actuations or Actuation)
    return list(dict.fromkeys(component for model in models for component in get_type_hints(model.Parameters)))


def component_quantities(component: str, actuation: Actuation | None = None) -> dict[str, Q]:
    """Unit, meaning and domain of the parameters of a component, by the last part of their names."""
    known = parameter_quantities(actuation)
    return {path.partition(".")[2]: q for path, q in known.items() if path.startswith(f"{component}.")}


class _Definition(FuelModel):
    name: str = "fuel"


def _meter_tables(item: Any) -> Any:
    from commonrail.readers.meters import meter_tables  # of which most files have none

    return meter_tables(item)


MeterTables = Annotated[Any, PlainValidator(_meter_tables)]


class _FuelTable(Sourced):
    """Fuel in one of three forms, and its temperature."""

    name: str | None = None
    file: str | None = None
    definition: Annotated[Any, PlainValidator(_Definition.model_validate)] = None
    temperature: Annotated[Number, Stated(parameter_quantities(Actuation.SERVO)[FUEL_TEMPERATURE])]


class _Head(FileModel):
    """Keys of an injector's file besides its parts."""

    format: Literal["commonrail-injector/1"]
    name: str | None = None
    title: str | None = None
    synthetic: str = ""
    allow_outside: bool = False
    fuel: _FuelTable
    actuation: Annotated[Actuation, choice(Actuation)] = Actuation.SERVO
    variant: Annotated[Body, choice(Body)] = Body.FLEXIBLE
    rail_boundary: Annotated[Boundary, choice(Boundary)] = Boundary.IDEAL
    drive_kind: Annotated[Drive, choice(Drive)] = Drive.REGULATED
    nozzle_law: str = ""  # of an installed package; "" is Eq. (9)
    # of the bench that it was calibrated on: see `load_meters`
    meters: MeterTables = Field(default_factory=dict)


@cache
def _model_of(actuation: Actuation) -> type[_Head]:
    """Whole file of an injector of an actuation."""
    tables: dict[str, Any] = {}
    for component in components_of(actuation):
        kind = DrawnTable if component == "plunger_needle" else ParameterTable
        known = Quantities(component_quantities(component, actuation))
        tables[component] = Annotated[kind, known], kind.model_construct()
    return create_model("_InjectorModel", __base__=_Head, **tables)


def _checked(document: Mapping[str, Any], at: Place) -> Any:
    """Model of a parsed file; a part of injectors that are actuated otherwise is refused."""
    stated = document.get("actuation")
    actuation = next((kind for kind in Actuation if kind.value == stated), Actuation.SERVO)
    parts = components_of(actuation)
    for key in document:
        if key not in parts and key not in _Head.model_fields and key in components_of():
            raise (at / key).error(
                f'an injector with actuation = "{actuation.value}" has no such part; its parts are {", ".join(parts)}'
            )
    return read_model(_model_of(actuation), document, at)


def meters_of(document: Mapping[str, Any], at: Place) -> tuple[Meter, ...]:
    """Meters of a parsed file.

    Raises `InputError` and `ConfigurationError` as `load_meters`.
    """
    from commonrail.readers.meters import MeterHead, meters_of_tables

    tables: Mapping[str, MeterHead] = _checked(document, at).meters
    for name, table in tables.items():
        for key, amount in table.amounts():
            if amount.free:
                raise (at / "meters" / name / key).error("bounds belong in a study; give a value here")
    return tuple(meters_of_tables(tables, at / "meters").values())


def injector_of(document: Mapping[str, Any], at: Place, stem: str, reach: Reach | None) -> Injector:
    """Injector of a parsed file.

    `stem`: name of an injector whose file gives none. `reach`: where the file of its fuel may lie. Raises `InputError`
    and `ConfigurationError` as `load_injector`.
    """
    model = _checked(document, at)
    given: dict[str, Given] = {}
    for component in (components := components_of(model.actuation)):
        quantities = component_quantities(component, model.actuation)
        given |= _values_of(component, getattr(model, component).values(), quantities, at / component)
    _refuse_unread(model, components, at)
    _check_knots(given, document.get("nozzle", {}), at / "nozzle")
    for path, item in given.items():
        if words := not_whole(path, item.value):
            raise at.error(words)
    given[FUEL_TEMPERATURE] = model.fuel.temperature.given(model.fuel.origin())
    fuel = _fuel(model.fuel, at / "fuel", reach or Reach(Path(at.file), model.allow_outside))
    name = stem if model.name is None else model.name
    with located(at):  # a drawing may lead to a stiffness without bounds
        return Injector(
            name,
            name if model.title is None else model.title,
            {path: given[path].value for path in parameter_quantities(model.actuation)},
            fuel,
            _variant(model, at),
            {path: item.source for path, item in given.items()},
            synthetic=model.synthetic,
        )


_DECIDING = {"rail": "rail_boundary", "drive": "drive_kind", "plunger_needle": "variant"}  # keys that say what is read


def _refuse_unread(model: Any, components: Collection[str], at: Place) -> None:
    """Refuse what the variant does not read if the file does not state that variant: it would be ignored in silence."""
    stated = model.model_fields_set
    if model.actuation is Actuation.DIRECT and "variant" in stated and model.variant is Body.FLEXIBLE:
        raise (at / "variant").error("a direct-acting injector has a rigid body; remove this key")
    unread = unread_parameters(_variant(model, at))
    for component, key in _DECIDING.items():
        if component in components and key not in stated:
            for name in getattr(model, component).values():
                if f"{component}.{name}" in unread:
                    reader = reader_of(f"{component}.{name}")
                    raise (at / component / name).error(
                        f"this is read with {reader} only, and the file does not state {key}; add it"
                    )


def _variant(model: Any, at: Place) -> Variant:
    variant = Variant(model.variant, model.rail_boundary, model.drive_kind, actuation=model.actuation)
    with located(at / "nozzle_law"):
        return Variant(*variant[:-1], nozzle_law=model.nozzle_law)


def _values_of(component: str, values: Values, quantities: Mapping[str, Q], at: Place) -> Values:
    """Values of a component by dotted name: as given, else the default."""
    missing = [name for name, q in quantities.items() if name not in values and q.default is None]
    if missing:
        first, *others = missing
        more = f", nor for {', '.join(others)}" if others else ""
        raise at.error(f"there is no value for {first}, the {quantities[first].meaning}{more}; add it")
    defaults = {name: Given(q.default, _DEFAULT) for name, q in quantities.items() if q.default is not None}
    return {f"{component}.{name}": values.get(name) or defaults[name] for name in quantities}


def _check_knots(given: Values, stated: Mapping[str, Any], at: Place) -> None:
    """Refuse knots of the shape of c_d over lift that do not rise; one of zero behind the first is none.

    All values are `given` by dotted name; an error names the key of one that the file has `stated` for the nozzle.
    """
    names = [f"knot_{i}" for i in range(1, 9)]
    lifts = {name: given[f"nozzle.{name}"].value for name in names}
    known = [name for name in names if lifts[name] > 0.0 or name == names[0]]
    for before, name in itertools.pairwise(known):
        if not lifts[name] > lifts[before]:
            low, high = to_text(lifts[before], "m"), to_text(lifts[name], "m")
            raise (at / (name if name in stated else before)).error(
                f"the knots must rise, and {before} is at {low}, {name} at {high}; correct them, or set knots that are "
                "not wanted to zero"
            )


def _fuel(table: _FuelTable, at: Place, reach: Reach) -> Fuel:
    fuel = _read_fuel(table, at, reach)
    temperature, (low, high) = table.temperature.value, fuel.temperature_range
    if not low - 1e-6 <= temperature <= high + 1e-6:  # rounding of a conversion from °C
        raise (at / "temperature").error(
            f"{temperature:g} K lies outside the range of {fuel.name}, {low:g} K to {high:g} K"
        )
    return fuel


def _read_fuel(table: _FuelTable, at: Place, reach: Reach) -> Fuel:
    if [table.name, table.file, table.definition].count(None) != 2:
        raise at.error('give either name = "iso4113" (a fuel of the catalogue) or file = "my-fuel.toml"')
    if table.definition is not None:
        defined: _Definition = table.definition
        return defined.fuel(defined.name)
    if table.file is not None:
        path = reach.path(Path(at.file).parent, table.file, at / "file")
        return parse_fuel(read_toml(path)[0], path.stem, str(path))
    with located(at / "name"):
        return load_fuel(table.name or "")


# Injectors from TOML: a file of the user, or the catalogue that ships with the package.
#
# One table per component, whose keys are the component's parameters. A value is a text with its unit, or an inline
# table that adds mark and source; what a file leaves out takes the default of the component.

_CATALOGUE = Catalogue(
    "commonrail.physics",
    "catalogue/injectors",
    'There is no injector "{}" in the catalogue',
    group="injectors",
)


def injector_catalogue() -> list[str]:
    """Names that `load_injector` knows, those of installed packages behind those that ship."""
    return _CATALOGUE.names()


def in_catalogue(name: object) -> bool:
    """True for a name of `injector_catalogue`; installed packages are searched only where none of that name ships."""
    return name in _CATALOGUE


def shipped_injectors() -> list[str]:
    """Names of the injectors that ship, sorted."""
    return _CATALOGUE.shipped()


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
    file = f"{source}.toml"
    return _read(_CATALOGUE.text(source, _similar(file, reach)), file, source, Reach(Path(file), False))


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


# Injectors to TOML, complete and exact: every value as the shortest decimal that is the same float.

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
