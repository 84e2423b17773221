"""Type of injector: what its parts share, learnt from calibrated parts and given to the next one as start and prior."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import NamedTuple

from commonrail.base.arguments import instances, plain_text, settle
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.calibration.parameter import Mark, Prior
from commonrail.physics.injector import Injector, Source, parameter_quantities

ROUNDING = 1e-9  # relative, by which a spread may lie below its part


@dataclass(frozen=True)
class TypeParameter:
    """A parameter of a type.

    Parameters
    ----------
    name : str
        Part and field, such as ``valve.mass``.
    value : float
        Expected value of a part of the type, SI.
    spread : float
        Standard deviation of the next part's value about it, SI, greater than zero.
    lower, upper : float
        Bounds within which the parts were fitted, SI; they enclose the value.
    mark : {"M", "C", "F", "E"}
        Mark of value and spread: F where parts were fitted.
    source : str
        Source of both.
    between : float or None
        Part of the spread that is scatter between parts, SI; the rest is the error of the value. None where the two are
        not told apart.

    Raises
    ------
    ConfigurationError
        If the parameter is unknown, a number is not finite, the spread is not greater than zero, or the value lies
        outside the bounds.
    """

    name: str
    value: float
    spread: float
    lower: float
    upper: float
    mark: Mark = "F"
    source: str = "no source stated"
    between: float | None = None

    def __post_init__(self) -> None:
        known = parameter_quantities()
        if self.name not in known:
            raise ConfigurationError(f"A type has no parameter {self.name}{nearest(self.name, known)}.")
        numbers = (self.value, self.spread, self.lower, self.upper)
        if not all(map(isfinite, numbers)) or not self.spread > 0.0:
            raise ConfigurationError(f"{self.name}: a type needs finite numbers and a spread greater than zero.")
        if self.between is not None and not 0.0 <= self.between <= self.spread * (1.0 + ROUNDING):
            raise ConfigurationError(
                f"{self.name}: the scatter between parts must lie between zero and the spread, {self.spread:g}, "
                f"not {self.between:g}."
            )
        if not self.lower <= self.value <= self.upper or self.lower == self.upper:
            raise ConfigurationError(
                f"{self.name}: the value {self.value:g} must lie within its bounds, {self.lower:g} to {self.upper:g}."
            )

    @property
    def prior(self) -> Prior:
        """Prior of the next part's value."""
        return Prior(self.value, self.spread, self.source)


@dataclass(frozen=True)
class FixedValue:
    """A value that the studies of a type's parts fixed, in place of their injectors'.

    Parameters
    ----------
    name : str
        Part and field, such as ``valve.lift``.
    value : float
        SI.
    mark : {"M", "C", "F", "E"}
        Mark of the value for the parts that the type was learnt from.
    source : str

    Raises
    ------
    ConfigurationError
        If the parameter is unknown, or the value lies outside its domain.
    """

    name: str
    value: float
    mark: Mark = "E"
    source: str = "no source stated"

    def __post_init__(self) -> None:
        known = parameter_quantities()
        if self.name not in known:
            raise ConfigurationError(f"A type has no parameter {self.name}{nearest(self.name, known)}.")
        if not (isfinite(self.value) and known[self.name].domain.admits(self.value)):
            raise ConfigurationError(f"{self.name}: a fixed value must be {known[self.name].domain.value}.")

    def of_type(self, name: str) -> Source:
        """Source of the value on another part: what was measured on the type's parts is derived there.

        Parameters
        ----------
        name : str
            Of the type.
        """
        return Source("F" if self.mark == "M" else self.mark, f'type "{name}": {self.source}')


class TypePart(NamedTuple):
    """A part that a type was learnt from, or a fleet of them.

    Attributes
    ----------
    name : str
    source : str
        Source of its data.
    files : mapping of str to str
        SHA-256 of its files by name: study, data, results.
    injectors : int
        Number of injectors: 1, or that of a fleet.
    """

    name: str
    source: str = "no source stated"
    files: Mapping[str, str] = {}
    injectors: int = 1


@dataclass(frozen=True)
class InjectorType:
    """Values and spreads of the parameters of a type of injector, and the parts that they were learnt from.

    Parameters
    ----------
    name, title : str
    parameters : sequence of TypeParameter
        At least one, each name once.
    parts : sequence of TypePart
    injector : Injector or None
        Injector whose other values the parts had; None if it is not known.
    synthetic : str
        What about the parts is not measured; empty if nothing.
    fixed : sequence of FixedValue
        Values that the parts had in place of their injectors', and with which the parameters were fitted.

    Raises
    ------
    ConfigurationError
        If there is no parameter, or one is given twice.
    """

    name: str
    title: str
    parameters: tuple[TypeParameter, ...]
    parts: tuple[TypePart, ...] = ()
    injector: Injector | None = None
    synthetic: str = field(default="", kw_only=True)
    fixed: tuple[FixedValue, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        for what in ("name", "title", "synthetic"):
            plain_text(getattr(self, what), f"{what} of a type")
        settle(self, parameters=instances(self.parameters, TypeParameter, "parameters of a type"))
        settle(self, parts=instances(self.parts, TypePart, "parts of a type"))
        settle(self, fixed=instances(self.fixed, FixedValue, "fixed values of a type"))
        if not self.parameters:
            raise ConfigurationError(f"{self.name}: a type needs at least one parameter.")
        names = [p.name for p in self.parameters] + [value.name for value in self.fixed]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise ConfigurationError(f"{self.name}: {name} is given a second time; keep one of both.")

    @property
    def by_name(self) -> dict[str, TypeParameter]:
        """Parameters by name."""
        return {parameter.name: parameter for parameter in self.parameters}

    def given_to(self, injector: Injector, keep: Collection[str] = ()) -> tuple[TypeParameter, ...]:
        """Parameters whose values an injector takes from the type: all but those that were measured on it.

        Parameters
        ----------
        injector : Injector
            Its values with the mark M are its own.
        keep : collection of str
            More names of values that are its own.
        """
        own = self._measured(injector).union(keep)
        return tuple(p for p in self.parameters if p.name not in own)

    def fixed_for(self, injector: Injector, keep: Collection[str] = ()) -> tuple[FixedValue, ...]:
        """Fixed values that an injector takes from the type: all but those that were measured on it.

        Parameters
        ----------
        injector : Injector
            Its values with the mark M are its own.
        keep : collection of str
            More names of values that are its own.
        """
        own = self._measured(injector).union(keep)
        return tuple(value for value in self.fixed if value.name not in own)

    def _measured(self, injector: Injector) -> set[str]:
        """Names of values that were measured on an injector, and not on the one that the type's parts started from."""
        base = self.injector

        def of_base(name: str) -> bool:
            return (
                base is not None
                and base.values.get(name) == injector.values[name]
                and base.sources.get(name) == injector.sources[name]
            )

        return {name for name, source in injector.sources.items() if source.mark == "M" and not of_base(name)}

    def applied(self, injector: Injector, keep: Collection[str] = ()) -> Injector:
        """The injector with the values of the type, as `given_to` says.

        Parameters
        ----------
        injector : Injector
        keep : collection of str
            Names of values that are its own.
        """
        given, fixed = self.given_to(injector, keep), self.fixed_for(injector, keep)
        sources = {p.name: Source(p.mark, p.source) for p in given} | {v.name: v.of_type(self.name) for v in fixed}
        changed = injector.with_values({p.name: p.value for p in given} | {v.name: v.value for v in fixed})
        # the type's text starts with that of its injector
        texts = (injector.synthetic, self.synthetic.removeprefix(injector.synthetic).strip())
        synthetic = " ".join(text for text in texts if text)
        return replace(changed, sources={**injector.sources, **sources}, synthetic=synthetic)
