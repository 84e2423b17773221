"""Shape of an injector's file: its tables, and the injector that they make."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

from pydantic import BeforeValidator, Field, PlainValidator, create_model

from commonrail.base.arguments import not_whole
from commonrail.base.choices import Actuation, Body, Boundary, Drive
from commonrail.base.units import to_text
from commonrail.physics.components.plunger_needle import cylinder_mass, cylinder_stiffness
from commonrail.physics.fuel import Fuel
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, Source, parameter_quantities
from commonrail.physics.law import Q
from commonrail.physics.variants import Variant, model_of, reader_of, unread_parameters
from commonrail.readers.fuel import FuelModel, load_fuel, parse_fuel
from commonrail.readers.location import Place, Reach, located
from commonrail.readers.toml import (
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
    read_model,
    read_toml,
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
    from commonrail.readers.injector.meters import meter_tables  # of which most files have none

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
    from commonrail.readers.injector.meters import MeterHead, meters_of_tables

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
