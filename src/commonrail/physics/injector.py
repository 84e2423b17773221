"""An injector as the user holds it: values by name, fuel, variant, and where each number comes from."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple, get_type_hints

from commonrail.base.arguments import Quantity, instance, mapping, not_whole, number, plain_text, settle
from commonrail.base.choices import Actuation, Laws
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.physics.fuel import Fuel
from commonrail.physics.law import Domain, Q, describe, field_paths
from commonrail.physics.variants import EXTENDING, Variant, model_of, reader_of, unread_parameters

FUEL_TEMPERATURE = "fuel.temperature"


class Source(NamedTuple):
    """Source of a number: mark M, C, F or E (measured, ECU calibration, fitted, estimate) and text."""

    mark: str
    text: str


@functools.cache
def parameter_quantities(actuation: Actuation | None = None) -> dict[str, Q]:
    """Dotted name → unit, meaning and domain of every parameter, in the order of the components.

    Parameters
    ----------
    actuation : Actuation, optional
        Of the injector; by default all parameters, first those of the servo injector.
    """
    kinds = tuple(Actuation) if actuation is None else (actuation,)
    components: dict[str, Any] = {}
    for kind in kinds:
        components = {**components, **get_type_hints(model_of(kind).Parameters)}
    quantities = {
        f"{component}.{name}": q for component, kind in components.items() for name, q in describe(kind).items()
    }
    quantities[FUEL_TEMPERATURE] = Q("K", "temperature of the fuel", Domain.POSITIVE)
    return quantities


@functools.cache
def parameter_paths(actuation: Actuation = Actuation.SERVO) -> tuple[str, ...]:
    """Dotted names of the parameters of an actuation in the order of a flat vector."""
    return tuple(field_paths(model_of(actuation).Parameters))


@dataclass(frozen=True, repr=False)
class Injector(Shown):
    """An injector.

    Attributes
    ----------
    name, title : str
        Identifier, and a line that says what it is.
    values : mapping of str to float
        SI value of every parameter by dotted name (`quantities`), "fuel.temperature" included.
    fuel : Fuel
    variant : Variant
        Body, boundary at the rail and kind of drive.
    sources : mapping of str to Source
        Origin of values by dotted name.
    synthetic : str
        Reason why it is synthetic; empty for measured data.

    Raises
    ------
    ConfigurationError
        If a parameter is unknown, missing or outside its domain, or an argument is of another kind. Values may be
        given as texts with their units, ``"75 N"``.
    """

    presenter = "commonrail.report.notebook:INJECTOR"

    name: str
    title: str
    values: Mapping[str, float]
    fuel: Fuel
    variant: Variant = Variant()
    sources: Mapping[str, Source] = field(default_factory=dict)
    synthetic: str = field(default="", kw_only=True)

    if TYPE_CHECKING:  # accepted types are wider than stored ones

        def __init__(
            self,
            name: str,
            title: str,
            values: Mapping[str, Quantity],
            fuel: Fuel,
            variant: Variant = Variant(),
            sources: Mapping[str, Source] = {},
            *,
            synthetic: str = "",
        ) -> None: ...

    def __post_init__(self) -> None:
        instance(self.variant, Variant, "variant")
        quantities = self.quantities
        for what in ("name", "title", "synthetic"):
            plain_text(getattr(self, what), f"{what} of an injector")
        values = {
            path: _read_value(self.name, path, value, quantities) for path, value in _read_values(self.values).items()
        }
        sources = mapping(self.sources, "sources", '{"nozzle.holes": Source("M", "drawing")}')
        settle(self, values=values, sources=sources)
        instance(self.fuel, Fuel, "fuel")
        missing = [path for path in quantities if path not in self.values]
        if missing:
            raise ConfigurationError(f"{self.name}: no value for {missing[0]}; give one in the injector's file.")

    @property
    def quantities(self) -> Mapping[str, Q]:
        """`parameter_quantities` of its actuation."""
        return parameter_quantities(self.variant.actuation)

    @functools.cached_property
    def parameters(self) -> Any:
        """Values as the NamedTuple that the physics reads."""
        kind, components = _components(self.variant.actuation)
        flat = iter([self.values[path] for path in parameter_paths(self.variant.actuation)])
        return kind(**{component: _take(component_kind, flat) for component, component_kind in components.items()})

    def wired(self, names: Iterable[str] = ()) -> Variant:
        """Variant that computes this injector: with the extended laws if a value or a varying name needs them.

        Parameters
        ----------
        names : iterable of str
            Dotted names of the parameters that vary.
        """
        needed = set(EXTENDING).intersection(names) or any(self.values.get(name, 0.0) != 0.0 for name in EXTENDING)
        return self.variant._replace(laws=Laws.EXTENDED) if needed else self.variant

    def with_values(self, values: Mapping[str, Quantity]) -> Injector:
        """The same injector with some values changed.

        Parameters
        ----------
        values : mapping of str to float or str
            SI numbers, or texts with their units such as ``"75 N"``, by dotted name.

        Raises
        ------
        ConfigurationError
            If a name is unknown, its parameter is not read by the variant, or a value is of another kind or outside
            its domain.
        """
        changed = replace(self, values={**self.values, **_read_values(values)})
        self.check_read(values)
        return changed

    def check_read(self, names: Iterable[str]) -> None:
        """Refuse parameters that the variant does not read: their values would change nothing.

        Parameters
        ----------
        names : iterable of str
            Dotted names.

        Raises
        ------
        ConfigurationError
            For the first such name, with the variants that read it.
        """
        for name in names:
            if name in unread_parameters(self.variant):
                raise ConfigurationError(
                    f"{self.name} with {self.variant.label} does not read {name}; take a model with {reader_of(name)}, "
                    "or omit it."
                )


@functools.cache
def _components(actuation: Actuation) -> tuple[Any, Mapping[str, Any]]:
    """Class of the parameters and of its components; cached because looking up type hints is slow."""
    kind = model_of(actuation).Parameters
    return kind, get_type_hints(kind)


def _take(kind: Any, flat: Iterator[float]) -> Any:
    return kind._make([next(flat) for _ in kind._fields])


def _read_values(values: object) -> Mapping[str, Any]:
    return mapping(values, "values of parameters", '{"valve.spring_preload": "75 N"}')


def _read_value(name: str, path: str, value: object, quantities: Mapping[str, Q]) -> float:
    if path not in quantities:
        raise ConfigurationError(
            f"{name}: there is no parameter {path}{nearest(path, quantities)}; "
            "commonrail.models.parameter_quantities() lists them."
        )
    quantity = quantities[path]
    number_si = value if isinstance(value, float) else number(value, quantity.unit, f"{name}, {path}")
    if not (abs(number_si) < float("inf") and quantity.domain.admits(number_si)):
        raise ConfigurationError(
            f"{name}: {path} ({quantity.meaning}) must be {quantity.domain.value}, not "
            f"{number_si:g} {quantity.unit.removesuffix('1')}".rstrip()
            + "."
        )
    if words := not_whole(path, number_si):
        raise ConfigurationError(f"{name}: {words}.")
    return float(number_si)
