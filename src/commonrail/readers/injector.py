"""Injectors from TOML: shape of a file, the injector that its tables make, and the catalogue that ships."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

from pydantic import BeforeValidator, Field, PlainValidator, create_model

from commonrail.base.arguments import file_path, not_whole, read_source
from commonrail.base.choices import Actuation, Body, Boundary, Drive
from commonrail.base.errors import InputError
from commonrail.base.hooks import note
from commonrail.base.input import check_sum
from commonrail.base.registry import Catalogue
from commonrail.base.text import count_noun, join_words
from commonrail.base.units import to_text
from commonrail.physics.components.plunger_needle import cylinder_mass, cylinder_stiffness
from commonrail.physics.fuel import Fuel
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, Source, parameter_quantities
from commonrail.physics.law import Q
from commonrail.physics.variants import INSTALLED_LAWS, Variant, apply_words, model_of, reader_of, unread_parameters
from commonrail.readers.fuel import FuelModel, catalogue_fuel, parse_fuel
from commonrail.readers.location import Place, Reach, locate_errors
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
    parse_toml,
    read_model,
    read_toml,
)

if TYPE_CHECKING:
    from commonrail.physics.meters import Meter

CATALOGUE = Catalogue(
    "commonrail.physics",
    "catalogue/injectors",
    'There is no injector "{}" in the catalogue',
    group="injectors",
)

# Drawing of plunger and needle in an injector's file: seven cylinders, from which Eq. (8) gives stiffness and mass.

CYLINDERS = 7  # five of the plunger, two of the needle

_DRAWN = Source("F", "Eq. (8) from the drawing")
_Length = Annotated[Number, Stated(Q("m", "length"))]


_EXAMPLE = '{ diameter = "4.3 mm", length = "20 mm" }'


def _table(item: Any) -> Any:
    if not isinstance(item, dict):
        raise fault(f"write the cylinder as {_EXAMPLE}", code="wrong-type")
    return item


def _seven(items: Any) -> Any:
    if not isinstance(items, list) or len(items) != CYLINDERS:
        raise fault(
            f"give {CYLINDERS} cylinders {_EXAMPLE}, five of the plunger and two of the needle", code="wrong-number"
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
        values: Values = {}
        for i, cylinder in enumerate(self.cylinders, start=1):
            size = cylinder.diameter.value, cylinder.length.value
            values[f"k{i}"] = Given(cylinder_stiffness(modulus, *size), origin)
            values[f"m{i}"] = Given(cylinder_mass(density, *size), origin)
        return values


class DrawnTable(ParameterTable):
    """Table of plunger and needle: stated numbers take precedence over the drawing."""

    drawing: Drawing | None = None

    def values(self) -> Values:
        """Numbers of the drawing, replaced by stated ones."""
        return (self.drawing.values() if self.drawing else {}) | super().values()


_DEFAULT = Source("E", "default of commonrail")
_FUEL = ("name", "file", "definition")  # ways to state it


def list_components(*actuations: Actuation) -> list[str]:
    """Components of injectors, each a table of the file; by default for all actuations."""
    models = map(model_of, actuations or Actuation)
    return list(dict.fromkeys(component for model in models for component in get_type_hints(model.Parameters)))


def component_quantities(component: str, actuation: Actuation | None = None) -> dict[str, Q]:
    """Unit, meaning and domain of the parameters of a component, by the last part of their names."""
    quantities = parameter_quantities(actuation)
    return {path.partition(".")[2]: q for path, q in quantities.items() if path.startswith(f"{component}.")}


class _Definition(FuelModel):
    name: str = "fuel"


def _meter_tables(item: Any) -> Any:
    from commonrail.readers.meters import meter_tables  # imported late: most files have no meters

    return meter_tables(item)


MeterTables = Annotated[Any, PlainValidator(_meter_tables)]


class _FuelTable(Sourced):
    """Fuel in one of three forms, its temperature, and how volumes compress it."""

    compression: Literal["isothermal", "adiabatic"] | None = None
    name: str | None = None
    file: str | None = None
    definition: Annotated[Any, PlainValidator(_Definition.model_validate)] = None
    temperature: Annotated[Number, Stated(parameter_quantities(Actuation.SERVO)[FUEL_TEMPERATURE])] | None = None


class _Head(FileModel):
    """Keys of an injector's file besides its parts."""

    format: Literal["commonrail-injector/1"]
    base: str | None = None  # injector of the catalogue, or file: source of values that are not stated
    name: str | None = None
    title: str | None = None
    synthetic: str = ""
    allow_outside: bool = False
    fuel: _FuelTable = _FuelTable()
    actuation: Annotated[Actuation, choice(Actuation)] = Actuation.SERVO
    variant: Annotated[Body, choice(Body)] = Body.FLEXIBLE
    rail_boundary: Annotated[Boundary, choice(Boundary)] = Boundary.IDEAL
    drive_kind: Annotated[Drive, choice(Drive)] = Drive.REGULATED
    nozzle_law: str = ""  # law of an installed package; "": Eq. (9)
    a_hole_law: str = ""  # law of an installed package; "": law of the paper
    # of the bench that it was calibrated on: see `load_meters`
    meters: MeterTables = Field(default_factory=dict)


@cache
def _file_model(*actuations: Actuation) -> type[_Head]:
    """Model of an injector file for an actuation; by default with the components of all actuations."""
    tables: dict[str, Any] = {}
    for component in list_components(*actuations):
        kind = DrawnTable if component == "plunger_needle" else ParameterTable
        quantities = Quantities(component_quantities(component, *actuations))
        tables[component] = Annotated[kind, quantities], kind.model_construct()
    return create_model("_InjectorModel", __base__=_Head, **tables)


def _check_file(document: Mapping[str, Any], at: Place) -> Any:
    """Model of a parsed file; a file with a base has its components checked together with the base."""
    stated = document.get("actuation", Actuation.SERVO.value)
    actuations = [kind for kind in Actuation if kind.value == stated and "base" not in document]
    for actuation in actuations:
        _refuse_foreign(document, actuation, at)
    return read_model(_file_model(*actuations), document, at)


def _refuse_foreign(document: Mapping[str, Any], actuation: Actuation, at: Place) -> None:
    """Refuse a component that the actuation does not have."""
    parts = list_components(actuation)
    for key in document:
        if key not in parts and key not in _Head.model_fields and key in list_components():
            raise (at / key).error(
                f'an injector with actuation = "{actuation.value}" has no such part; its parts are {", ".join(parts)}',
                code="unknown-part",
            )


def build_injector(document: Mapping[str, Any], at: Place, stem: str, reach: Reach | None) -> Injector:
    """Injector of a parsed file.

    `stem`: name of an injector whose file gives none. `reach`: where the file of its fuel may lie. Raises `InputError`
    and `ConfigurationError` as `load_injector`.
    """
    model = _check_file(document, at)
    reach = reach or Reach(Path(at.file), model.allow_outside)
    base = None if model.base is None else _base(model.base, at, reach)
    variant = _variant(model, base, at)
    _refuse_foreign(document, variant.actuation, at)
    components = list_components(variant.actuation)
    values = {
        f"{component}.{name}": item
        for component in components
        for name, item in getattr(model, component).values().items()
    }
    _refuse_unread(model, variant, components, at)
    if model.fuel.temperature is not None:
        values[FUEL_TEMPERATURE] = model.fuel.temperature.with_source(model.fuel.origin())
    values = _fill_values(values, model, base, variant.actuation, at)
    _check_knots(values, document.get("nozzle", {}), at / "nozzle")
    for path, item in values.items():
        if words := not_whole(path, item.value):
            raise at.error(words, code="not-whole")
    usual = parameter_quantities(variant.actuation)
    for path in (path for path in _DISC_OF if path in values and path.partition(".")[2] in document.get("valve", {})):
        # no note on a default: written files contain all values
        if values[path].value != usual[path].default and (words := idle_words(path, lambda p: values[p].value)):
            note(f"{at / path}: {words}.")
    fuel = _fuel(model.fuel, base, values[FUEL_TEMPERATURE].value, at / "fuel", reach)
    name = stem if model.name is None else model.name
    with locate_errors(at):  # a drawing may lead to a stiffness without bounds
        return Injector(
            name,
            name if model.title is None else model.title,
            {path: values[path].value for path in parameter_quantities(variant.actuation)},
            fuel,
            variant,
            {path: item.source for path, item in values.items()},
            synthetic=model.synthetic or (base.synthetic if base else ""),
        )


def _base(name: str, at: Place, reach: Reach) -> Injector:
    """Base of a file: an injector of the catalogue, or a complete file."""
    key = at / "base"
    if name.endswith(".toml"):
        path = reach.path(Path(at.file).parent, name, key)
        check_sum(path)
        document, place = read_toml(path)[0], Place(str(path))
    else:
        place = Place(f"{name}.toml")
        with locate_errors(key):
            document = parse_toml(CATALOGUE.text(name), place.file)
        reach = Reach(Path(place.file), False)
    further = document.get("base")
    # an entry of the catalogue may rest on another one that states all values
    if further is not None and (name.endswith(".toml") or "base" in parse_toml(CATALOGUE.text(str(further)), name)):
        raise key.error(
            f'"{name}" has a base itself; name a file that states all values, such as calibrated.toml of a run',
            code="base-of-base",
        )
    return build_injector(document, place, Path(place.file).stem, reach)


def _fill_values(stated: Values, model: Any, base: Injector | None, actuation: Actuation, at: Place) -> Values:
    """All values by dotted name: as given, else of the base, else the default.

    Raises `InputError` with all that are missing.
    """
    quantities = parameter_quantities(actuation)
    if base is not None:
        of_base = {
            path: Given(value, Source("E", f"base {base.name}: {', '.join(base.sources[path])}"))
            for path, value in base.values.items()
        }
        return {path: stated.get(path) or of_base[path] for path in quantities}
    defaults = {path: Given(q.default, _DEFAULT) for path, q in quantities.items() if q.default is not None}
    values = {path: stated.get(path) or defaults.get(path) for path in quantities}
    missing = {path: q for path, q in quantities.items() if values[path] is None}
    has_fuel = any(getattr(model.fuel, key) is not None for key in _FUEL)
    if missing or not has_fuel:
        raise _incomplete(missing, has_fuel, actuation, at)
    return {path: item for path, item in values.items() if item is not None}


def _incomplete(missing: Mapping[str, Q], has_fuel: bool, actuation: Actuation, at: Place) -> InputError:
    """Error that lists all missing parameters of a file; its notes state the values of the shipped injectors."""
    documents = {n: parse_toml(CATALOGUE.text(n), n) for n in CATALOGUE.shipped()}
    shipped = [build_injector(d, Place(n), n, None) for n, d in documents.items() if "base" not in d]
    alike = [injector for injector in shipped if injector.variant.actuation is actuation]
    notes = {} if has_fuel else {"fuel.name": "of the catalogue, such as iso4113, or fuel.file"}
    for path, q in missing.items():
        values = (f"{i.name} {to_text(i.values[path], q.unit)} {i.sources[path].mark}" for i in alike)
        notes[path] = f"{q.meaning}: {', '.join(values)}"
    first = [f"{path} ({notes[path].partition(':')[0]})" for path in list(notes)[:2]]
    others = [count_noun(len(notes) - 2, "other")] if len(notes) > 2 else []
    names = " or ".join(f'"{injector.name}"' for injector in alike)
    error = at.error(
        f"there is no value for {join_words([*first, *others])}; add {'it' if len(notes) == 1 else 'all of them'}, or "
        f"take what is missing, marked E, from another injector with base = {names} at the top",
        code="missing-value",
    )
    for path, text in notes.items():
        error.add_note(f"  {path}, {text}")
    error.add_note("  (of the catalogue; M measured, F fitted or derived, E estimate)")
    return error


# Fields of a variant by their keys in a file.
VARIANT_KEYS = {
    "variant": "body",
    "rail_boundary": "boundary",
    "drive_kind": "drive",
    "actuation": "actuation",
    **{name: name for name in INSTALLED_LAWS},
}
_DECIDING = {
    "rail": "rail_boundary",
    "drive": "drive_kind",
    "plunger_needle": "variant",
}  # keys that select the values in use


def _refuse_unread(model: Any, variant: Variant, components: Collection[str], at: Place) -> None:
    """Refuse parameters that the default variant does not read: they would be ignored silently."""
    stated = model.model_fields_set
    if variant.actuation is Actuation.DIRECT and "variant" in stated and model.variant is Body.FLEXIBLE:
        raise (at / "variant").error("a direct-acting injector has a rigid body; remove this key", code="conflict")
    unread = unread_parameters(variant)
    for component, key in _DECIDING.items():
        if component in components and key not in stated:
            for name in getattr(model, component).values():
                if f"{component}.{name}" in unread:
                    reader = reader_of(f"{component}.{name}")
                    raise (at / component / name).error(
                        f"only {reader} reads this parameter, and the file does not state {key}; add it",
                        code="not-read",
                    )


def _variant(model: Any, base: Injector | None, at: Place) -> Variant:
    """Variant of a file; keys it does not state come from the base."""
    stated = {field: getattr(model, key) for key, field in VARIANT_KEYS.items() if key in model.model_fields_set}
    words = (base.variant if base else Variant())._asdict() | stated
    if base and words["actuation"] is not base.variant.actuation:
        raise (at / "base").error(
            f'{base.name} is a {base.variant.actuation.value} injector, and actuation is "{model.actuation.value}"; '
            "name a base of that kind",
            code="conflict",
        )
    laws = {key: words.pop(key) for key in INSTALLED_LAWS}
    with locate_errors(at):
        variant = Variant(**words)
    for key, name in laws.items():
        with locate_errors(at / key):
            variant = variant._replace(**{key: name})
    return variant


_DISC_OF = {"valve.stop_film": "valve.stop_disc", "valve.seat_film": "valve.seat_disc"}


def idle_words(name: str, value: Callable[[str], float]) -> str:
    """Clause that a film has no effect because the `value` of its disc is zero; empty for other parameters."""
    disc = _DISC_OF.get(name, "")
    return f"it has no effect while {disc} is 0" if disc and value(disc) == 0.0 else ""


def _check_knots(values: Values, stated: Mapping[str, Any], at: Place) -> None:
    """Check that the lifts of the c_d curve increase; a zero after the first knot means that the knot is absent.

    `values`: all values by dotted name; `stated`: nozzle keys of the file, one of which an error names.
    """
    names = [f"knot_{i}" for i in range(1, 9)]
    lifts = {name: values[f"nozzle.{name}"].value for name in names}
    knots = [name for name in names if lifts[name] > 0.0 or name == names[0]]
    for before, name in itertools.pairwise(knots):
        if not lifts[name] > lifts[before]:
            low, high = to_text(lifts[before], "m"), to_text(lifts[name], "m")
            raise (at / (name if name in stated else before)).error(
                f"the knots must rise, and {before} is at {low}, {name} at {high}; correct them, or set knots that are "
                "not wanted to zero",
                code="order",
            )


def _fuel(table: _FuelTable, base: Injector | None, temperature: float, at: Place, reach: Reach) -> Fuel:
    """Fuel of the file, or else of the base; checks that the fuel temperature [K] lies in its range."""
    is_of_base = base is not None and all(getattr(table, key) is None for key in _FUEL)
    fuel = base.fuel if base and is_of_base else _read_fuel(table, at, reach)
    low, high = fuel.temperature_range
    if not low - 1e-6 <= temperature <= high + 1e-6:  # rounding of a conversion from °C
        raise (at / "temperature").error(
            f"{temperature:g} K lies outside the range of {fuel.name}, {low:g} K to {high:g} K", code="out-of-range"
        )
    with locate_errors(at / "compression"):
        return replace(fuel, adiabatic=table.compression == "adiabatic") if table.compression else fuel


def _read_fuel(table: _FuelTable, at: Place, reach: Reach) -> Fuel:
    if [table.name, table.file, table.definition].count(None) != 2:
        raise at.error(
            'give either name = "iso4113" (a fuel of the catalogue) or file = "my-fuel.toml"', code="conflict"
        )
    if table.definition is not None:
        defined: _Definition = table.definition
        return defined.fuel(defined.name)
    if table.file is not None:
        path = reach.path(Path(at.file).parent, table.file, at / "file")
        return parse_fuel(read_toml(path)[0], path.stem, str(path))
    with locate_errors(at / "name"):
        return catalogue_fuel(table.name or "")


# Injectors from TOML: a file of the user, or the catalogue that ships with the package.
#
# One table per component, whose keys are the component's parameters. A value is a text with its unit, or an inline
# table that adds mark and source; what a file leaves out takes the default of the component.


def injector_catalogue() -> list[str]:
    """Names that `load_injector` knows: shipped injectors, then those of installed packages."""
    return CATALOGUE.names()


def in_catalogue(name: object) -> bool:
    """True for a name of `injector_catalogue`; installed packages are searched only where none of that name ships."""
    return name in CATALOGUE


def list_shipped_injectors() -> list[str]:
    """Names of the injectors that ship, sorted."""
    return CATALOGUE.shipped()


def load_injector(source: str | Path, reach: Reach | None = None) -> Injector:
    """Read an injector.

    Parameters
    ----------
    source : str or Path
        Path of a ``.toml`` file, or a name of `injector_catalogue`, with an optional variant as on the command line,
        "cri2-16@rigid,pwm".
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
        If the file cannot be read; if a key is unknown or missing; if a value has a wrong type or is outside its
        domain; or if it is a result that has been changed.
    ConfigurationError
        If `source` is neither a name nor a path.
    """
    source = read_source(source, "source of an injector")
    if isinstance(source, Path):
        check_sum(source)
        return build_injector(read_toml(source)[0], Place(str(source)), source.stem, reach)
    name, at, words = source.rpartition("@")
    if at and reach is None:
        injector = load_injector(name)
        with locate_errors(Place(source)):
            return replace(injector, variant=apply_words(injector.variant, words))
    if at:
        raise InputError(
            f'"{source}" names a variant, which is not taken here; state rail_boundary, drive_kind and variant in an '
            "injector file and name that.",
            code="variant-given",
        )
    file = f"{source}.toml"
    try:
        is_file = ((reach.file.parent if reach else Path()) / file).is_file()
    except (OSError, ValueError):  # a name that no file can have
        is_file = False
    text = CATALOGUE.text(source, f' (did you mean the file "{file}"?)' if is_file else "")
    return build_injector(parse_toml(text, file), Place(file), source, Reach(Path(file), False))


def load_meters(path: str | Path) -> tuple[Meter, ...]:
    """Read the meters that a calibration wrote with its injector to ``calibrated.toml``.

    Parameters
    ----------
    path : str or Path
        Injector file.

    Returns
    -------
    tuple of Meter
        Empty if the file has no meters.

    Raises
    ------
    InputError
        If the file cannot be read, or something in it is unknown or of the wrong kind.
    ConfigurationError
        If `path` is not a path, or a meter makes no sense.
    """
    from commonrail.readers.meters import MeterHead, meters_of_tables

    file = file_path(path, "path of an injector")
    at = Place(str(file))
    tables: Mapping[str, MeterHead] = _check_file(read_toml(file)[0], at).meters
    for name, table in tables.items():
        for key, amount in table.amounts():
            if amount.free:
                raise (at / "meters" / name / key).error(
                    "bounds belong in a study; give a value here", code="bounds-given"
                )
    return tuple(meters_of_tables(tables, at / "meters").values())
