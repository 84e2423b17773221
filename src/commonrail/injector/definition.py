"""An injector as the user holds it: values by name, fuel, variant, and where each number comes from."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, get_type_hints

from commonrail.errors import ConfigurationError, nearest
from commonrail.fuel.fuel import Fuel
from commonrail.injector.layout import field_paths
from commonrail.injector.model import Parameters
from commonrail.injector.variants import Variant
from commonrail.parts.furniture import Domain, Q, describe

FUEL_TEMPERATURE = "fuel.temperature"


class Source(NamedTuple):
    """Where a number comes from: mark M, C, F or E (measured, ECU calibration, fitted, estimate) and text."""

    mark: str
    text: str


@functools.cache
def parameter_quantities() -> dict[str, Q]:
    """Dotted name → unit, meaning and domain of every parameter, in the order of `Parameters`."""
    rooms: dict[str, Any] = get_type_hints(Parameters)
    named = {f"{room}.{name}": q for room, kind in rooms.items() for name, q in describe(kind).items()}
    named[FUEL_TEMPERATURE] = Q("K", "temperature of the fuel", Domain.POSITIVE)
    return named


@functools.cache
def parameter_paths() -> tuple[str, ...]:
    """Dotted names of the parameters in the order of a flat vector."""
    return tuple(field_paths(Parameters))


@dataclass(frozen=True)
class Injector:
    """An injector.

    Attributes
    ----------
    name, title : str
        Identifier, and a line that says what it is.
    values : mapping of str to float
        SI value of every parameter by dotted name (`parameter_quantities`), "fuel.temperature" included.
    fuel : Fuel
    variant : Variant
        Body, boundary at the rail and kind of drive.
    sources : mapping of str to Source
        Origin of values by dotted name.
    synthetic : str
        What about it is not measured, empty if nothing.
    """

    name: str
    title: str
    values: Mapping[str, float]
    fuel: Fuel
    variant: Variant = Variant()
    sources: Mapping[str, Source] = field(default_factory=dict)
    synthetic: str = ""

    def __post_init__(self) -> None:
        known = parameter_quantities()
        for path, value in self.values.items():
            _check(self.name, path, value, known)
        missing = [path for path in known if path not in self.values]
        if missing:
            raise ConfigurationError(f"{self.name}: no value for {missing[0]}; give one in the injector's file.")

    @property
    def parameters(self) -> Parameters:
        """Values as the NamedTuple that the physics reads."""
        flat = iter([self.values[path] for path in parameter_paths()])
        rooms = get_type_hints(Parameters)
        return Parameters(**{room: _take(kind, flat) for room, kind in rooms.items()})

    def with_values(self, values: Mapping[str, float]) -> Injector:
        """The same injector with some values changed.

        Raises
        ------
        ConfigurationError
            If a name is unknown or a value outside its domain.
        """
        return replace(self, values={**self.values, **values})


def _take(kind: Any, flat: Iterator[float]) -> Any:
    return kind._make([next(flat) for _ in kind._fields])


def _check(name: str, path: str, value: float, known: Mapping[str, Q]) -> None:
    if path not in known:
        raise ConfigurationError(f"{name}: there is no parameter {path}{nearest(path, known)}.")
    quantity = known[path]
    if not (abs(value) < float("inf") and quantity.domain.admits(value)):
        raise ConfigurationError(
            f"{name}: {path} ({quantity.meaning}) must be {quantity.domain.value}, not "
            f"{value:g} {quantity.unit.removesuffix('1')}".rstrip()
            + "."
        )
