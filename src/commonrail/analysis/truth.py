"""The declared truth of the virtual test bench: what is hidden from a fit, in numbers with mark and source."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from commonrail.analysis.bench_sensor import Sensor
from commonrail.arguments import chosen, instance, mapping, plain_text, settle
from commonrail.choices import Boundary
from commonrail.engine.reference import Resolution
from commonrail.injector.definition import Injector, Source, parameter_quantities
from commonrail.parts.furniture import Domain, Q
from commonrail.units import to_text

__all__ = ["MASSES", "QUANTITIES", "Friction", "Scatter", "Truth"]

MASSES = 9  # of plunger and needle, Eq. (10)

_BANDWIDTH = Q("Hz", "corner frequency of each of two low-passes", Domain.POSITIVE, math.inf)
_NOISE, _STEP, _SPREAD = "standard deviation of a sample", "step of the digital signal", "standard deviation"


def _none(unit: str, meaning: str) -> Q:
    """A quantity that is zero where it is not given."""
    return Q(unit, meaning, Domain.NON_NEGATIVE, 0.0)


# What a truth's tables hold besides values of the injector and friction: unit, meaning, and default, the ideal.
QUANTITIES: dict[str, dict[str, Q]] = {
    "rate_meter": {"bandwidth": _BANDWIDTH, "noise": _none("m3/s", _NOISE), "resolution": _none("m3/s", _STEP)},
    "rail_sensor": {"bandwidth": _BANDWIDTH, "noise": _none("Pa", _NOISE), "resolution": _none("Pa", _STEP)},
    "scatter": {
        "rail_pressure": _none("Pa", _SPREAD),
        "energising_time": _none("s", _SPREAD),
        "boost_voltage": _none("V", _SPREAD),
    },
}
FRICTION = {
    "coulomb": _none("N", "Coulomb friction on masses 1 to 9"),
    "viscous": _none("N s/m", "viscous friction on masses 1 to 9"),
}


@dataclass(frozen=True)
class Scatter:
    """Standard deviations from shot to shot: rail pressure [Pa], energising time [s], boost voltage [V]."""

    rail_pressure: float = 0.0
    energising_time: float = 0.0
    boost_voltage: float = 0.0


@dataclass(frozen=True)
class Friction:
    """Guide friction on masses 1…9: Coulomb [N] and viscous [N s/m]. Not in the paper's model."""

    coulomb: tuple[float, ...] = (0.0,) * MASSES
    viscous: tuple[float, ...] = (0.0,) * MASSES


_KINDS = {
    "friction": Friction,
    "resolution": Resolution,
    "rate_meter": Sensor,
    "rail_sensor": Sensor,
    "scatter": Scatter,
}


@dataclass(frozen=True)
class Truth:
    """The declared truth of the bench, richer than any model that is fitted to it.

    Attributes
    ----------
    name, title : str
        Identifier, and a line that says what it is.
    injector : str
        Name in the catalogue, or path, of the injector that it alters; a fit starts from that one.
    values : mapping of str to float
        Parameters that differ from that injector [SI].
    boundary : Boundary
        What feeds the true injector.
    friction : Friction
    resolution : Resolution
        Of the reference engine.
    rate_meter : Sensor
        Of the rate of injection [m³/s].
    rail_sensor : Sensor
        Of the pressure at the injector's inlet [Pa].
    scatter : Scatter
    sources : mapping of str to Source
        Origin of the numbers by dotted name, such as "plunger_needle.k1", "friction.coulomb", "rate_meter.noise".
    text : str
        The file it was read from.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind.
    """

    name: str
    title: str
    injector: str
    values: Mapping[str, float] = field(default_factory=dict)
    boundary: Boundary = Boundary.VOLUME
    friction: Friction = Friction()
    resolution: Resolution = Resolution(method="explicit")
    rate_meter: Sensor = field(default_factory=Sensor)
    rail_sensor: Sensor = field(default_factory=Sensor)
    scatter: Scatter = Scatter()
    sources: Mapping[str, Source] = field(default_factory=dict)
    text: str = ""

    def __post_init__(self) -> None:
        for what in ("name", "title", "injector", "text"):
            plain_text(getattr(self, what), f"{what} of a truth")
        mapping(self.values, "values of a truth", '{"valve.spring_preload": "75 N"}')
        mapping(self.sources, "sources of a truth", '{"rate_meter.noise": Source("E", "estimate")}')
        settle(self, boundary=chosen(self.boundary, Boundary, "boundary of a truth"))
        for what, kind in _KINDS.items():
            instance(getattr(self, what), kind, f"{what} of a truth")

    @property
    def synthetic(self) -> str:
        """Note shown with its data."""
        return f"All data are simulated by the virtual test bench (truth {self.name}), not measured."

    def hidden(self, injector: Injector) -> Injector:
        """The true injector behind the one that is fitted.

        Raises
        ------
        ConfigurationError
            If a value is unknown or outside its domain.
        """
        return replace(injector.with_values(self.values), variant=injector.variant._replace(boundary=self.boundary))

    def facts(self) -> list[tuple[str, str]]:
        """Every number with name, unit, mark and source, for reports."""
        return list(self._facts())

    def _facts(self) -> Iterator[tuple[str, str]]:
        feed = {Boundary.VOLUME: "a rail of finite volume behind a throttle", Boundary.IDEAL: "an ideal rail"}
        yield "injector", f"{self.injector}, fed from {feed[self.boundary]}"
        for path, value in self.values.items():
            yield path, to_text(value, parameter_quantities()[path].unit) + self._origin(path)
        for name, q in FRICTION.items():
            path, forces = f"friction.{name}", getattr(self.friction, name)
            listed = f"{', '.join(f'{force:g}' for force in forces)} {q.unit}" if any(forces) else "none"
            yield q.meaning, listed + self._origin(path)
        for table, quantities in QUANTITIES.items():
            for name, q in quantities.items():
                path, value = f"{table}.{name}", getattr(getattr(self, table), name)
                yield f"{_plain(table)}, {_plain(name)}: {q.meaning}", _amount(value, q) + self._origin(path)
        cells, step = self.resolution.cells, to_text(self.resolution.step, "s")
        yield "finite volumes", f"{cells[0]} in the feed pipe, {cells[1]} in the return line (numerical setting)"
        yield "time step", f"{step}, Runge–Kutta of order 4 (numerical setting)"

    def _origin(self, path: str) -> str:
        source = self.sources.get(path)
        return f" [{source.mark}] {source.text}" if source else ""


def _amount(value: float, q: Q) -> str:
    if math.isinf(value):
        return "unlimited"
    return to_text(value, q.unit) if value else "none"


def _plain(name: str) -> str:
    return name.replace("_", " ")
