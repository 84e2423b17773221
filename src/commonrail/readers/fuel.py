"""Fuels from TOML: the catalogue that ships with the package, and files of the same form.

Every table of such a file must state its unit, mark, source and error.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, GetCoreSchemaHandler, PlainValidator, model_validator
from pydantic_core import CoreSchema, core_schema

from commonrail.base.arguments import file_path, plain_text
from commonrail.base.registry import Catalogue
from commonrail.physics.fuel import Fuel, Law, Origin, Polynomial
from commonrail.readers.location import Place
from commonrail.readers.toml import MARKS, FileModel, OneOf, fault, parse_toml, read_mark, read_model, read_toml

_CATALOGUE = Catalogue("commonrail.physics", "catalogue/fuels", 'There is no fuel "{}"', "", "fuels")


def fuel_catalogue() -> list[str]:
    """Names that `load_fuel` knows: shipped fuels, then those of installed packages."""
    return _CATALOGUE.names()


def list_shipped_fuels() -> list[str]:
    """Names of the fuels that ship, sorted."""
    return _CATALOGUE.shipped()


def load_fuel(source: str | Path) -> Fuel:
    """Return a fuel of the catalogue or of a file.

    Parameters
    ----------
    source : str or path
        One of `fuel_catalogue()`, such as ``"iso4113"``, or a file, which is a path or ends with ``.toml``.

    Raises
    ------
    InputError
        If there is no such fuel; the message proposes the nearest name. If the file cannot be read.
    ConfigurationError
        If `source` is neither a text nor a path.
    """
    if isinstance(source, PathLike) or (isinstance(source, str) and source.endswith(".toml")):
        path = file_path(source, "file of a fuel")
        return parse_fuel(read_toml(path)[0], path.stem, str(path))
    return catalogue_fuel(source)


def catalogue_fuel(name: str) -> Fuel:
    """Fuel of the catalogue; raises the errors of `load_fuel`."""
    return _load_cached(plain_text(name, "name of a fuel"))


@functools.cache
def _load_cached(name: str) -> Fuel:
    file = f"catalogue/{name}.toml"
    return parse_fuel(parse_toml(_CATALOGUE.text(name), file), name, file)


def parse_fuel(document: Mapping[str, Any], name: str, where: str) -> Fuel:
    """Return the fuel that a parsed TOML document describes.

    Raises `InputError` if something is missing, of the wrong type, in another unit, or contradicts the rest.
    """
    return read_model(FuelModel, document, Place(where)).fuel(name)


def _polynomial(item: Any) -> Polynomial:
    numbers = item if isinstance(item, list) else []
    sound = (isinstance(n, int | float) and not isinstance(n, bool) and math.isfinite(n) for n in numbers)
    if not numbers or not all(sound):
        raise fault("this must be a list of numbers, ascending in temperature", code="wrong-type")
    return tuple(map(float, numbers))


def _range(item: Any) -> tuple[float, float]:
    ends = _polynomial(item)
    if len(ends) != 2 or not 0.0 <= ends[0] < ends[1]:
        raise fault("this must be [lower, upper] with 0 <= lower < upper", code="wrong-range")
    return ends[0], ends[1]


_Range = Annotated[tuple[float, float], PlainValidator(_range)]


@dataclass(frozen=True)
class _Polynomials:
    """Schema of a law: its coefficients `names` are polynomials in (T - 353.15 K)/(40 K), in `unit`.

    `logarithm`: alternative unit, with which the polynomials give the natural logarithm. The schema is written out: a
    Pydantic model of each law takes long to build.
    """

    unit: str
    names: Sequence[str] = ("k1", "k2", "k3", "k4")
    logarithm: str = ""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        keys = {
            "mark": core_schema.no_info_plain_validator_function(read_mark),
            "source": core_schema.str_schema(strict=True),
            "error": core_schema.float_schema(strict=True, ge=0.0, allow_inf_nan=False),
            "unit": core_schema.no_info_plain_validator_function(self._unit),
            **dict.fromkeys(self.names, core_schema.no_info_plain_validator_function(_polynomial)),
        }
        table = core_schema.typed_dict_schema({name: core_schema.typed_dict_field(of) for name, of in keys.items()})
        return core_schema.no_info_after_validator_function(self._law, table)

    def _unit(self, item: Any) -> str:
        if item == self.unit or (self.logarithm and item == self.logarithm):
            return str(item)
        raise fault(f'unit is "{item}", convert the coefficients to "{self.unit}"', code="wrong-unit")

    def _law(self, table: Mapping[str, Any]) -> Law:
        origin = Origin(table["mark"], table["source"], table["error"])
        return Law(tuple(table[name] for name in self.names), origin, table["unit"] == self.logarithm)

    def table(self, law: Law) -> dict[str, Any]:
        """Table of a law."""
        origin = {"mark": law.origin.mark, "source": law.origin.source, "error": law.origin.error}
        numbers = {name: list(k) for name, k in zip(self.names, law.coefficients, strict=True)}
        return {"unit": self.logarithm if law.logarithmic else self.unit} | origin | numbers


_DENSITIES = {"eq2": _Polynomials("kg/m3"), "integrated": _Polynomials("kg/m3", ("at_zero_pressure",))}
_VISCOSITY = _Polynomials("mm2/s", ("k1", "k2", "k3"), "ln(mm2/s)")
_VAPOUR, _MODULUS = _Polynomials("ln(Pa)", ("ln_pressure",)), _Polynomials("MPa")
_HEAT = _Polynomials("J/(kg K)", ("isobaric",))


class _Ranges(FileModel):
    model_config = ConfigDict(extra="ignore")

    pressure_MPa: _Range
    temperature_K: _Range


class FuelModel(FileModel):
    """Whole file, or the table ``fuel.definition`` of an injector; unknown keys are ignored."""

    model_config = ConfigDict(extra="ignore")

    title: str
    source: str
    range: _Ranges
    density_law: Annotated[Law, OneOf("kind", {k: Annotated[Law, form] for k, form in _DENSITIES.items()})] = Field(
        alias="density"
    )
    viscosity_law: Annotated[Law, _VISCOSITY] = Field(alias="kinematic_viscosity")
    vapour_law: Annotated[Law, _VAPOUR] = Field(alias="vapour_pressure")
    bulk_modulus_law: Annotated[Law, _MODULUS] | None = Field(None, alias="bulk_modulus")
    isentropic_law: Annotated[Law, _MODULUS] | None = Field(None, alias="isentropic_bulk_modulus")
    heat_capacity_law: Annotated[Law, _HEAT] | None = Field(None, alias="heat_capacity")

    @model_validator(mode="before")
    @classmethod
    def _check_moduli(cls, data: Any) -> Any:
        density = data.get("density") if isinstance(data, dict) else None
        kind = density.get("kind") if isinstance(density, dict) else None
        if kind in ("eq2", "integrated") and (kind == "integrated") != ("bulk_modulus" in data):
            raise fault(
                'write a table [bulk_modulus] if, and only if, [density] has kind = "integrated", because an explicit '
                "density law already fixes the modulus",
                code="conflict",
            )
        if kind == "eq2" and "isentropic_bulk_modulus" not in data:
            raise fault(
                'write a table [isentropic_bulk_modulus], because [density] has kind = "eq2"', code="missing-key"
            )
        return data

    def fuel(self, name: str) -> Fuel:
        """The fuel under a name."""
        laws: dict[str, Any] = {key: getattr(self, key) for key in _LAWS}
        simulated = (law for key, law in laws.items() if law is not None and key != "heat_capacity_law")
        low, high = self.range.pressure_MPa
        return Fuel(
            name=name,
            title=self.title,
            pressure_range=(low * 1e6, high * 1e6),
            temperature_range=self.range.temperature_K,
            mark=max((law.origin.mark for law in simulated), key=MARKS.index),
            source=self.source,
            **laws,
        )


_LAWS = {key: str(field.alias) for key, field in FuelModel.model_fields.items() if field.alias}


def fuel_document(fuel: Fuel) -> dict[str, Any]:
    """Table that `parse_fuel` reads, and the name."""
    forms = {"viscosity_law": _VISCOSITY, "vapour_law": _VAPOUR, "heat_capacity_law": _HEAT}
    forms["density_law"] = _DENSITIES[fuel.density_kind]
    laws = {key: law for key in _LAWS if (law := getattr(fuel, key)) is not None}
    tables = {_LAWS[key]: forms.get(key, _MODULUS).table(law) for key, law in laws.items()}
    low, high = (pressure / 1e6 for pressure in fuel.pressure_range)
    head = {"name": fuel.name, "title": fuel.title, "source": fuel.source}
    ranges = {"pressure_MPa": [low, high], "temperature_K": list(fuel.temperature_range)}
    return head | {"range": ranges} | tables | {"density": {"kind": fuel.density_kind} | tables["density"]}
