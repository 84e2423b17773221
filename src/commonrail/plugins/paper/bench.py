"""Declared truth of the virtual test bench: numbers that a fit does not know, with mark and source."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, NamedTuple

import numpy as np

from commonrail.base.arguments import Cure, enum_member, instance, integer, mapping, number, plain_text, settle
from commonrail.base.arrays import Floats
from commonrail.base.choices import Boundary
from commonrail.base.errors import SimulationError
from commonrail.base.text import quantity
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.solution import Solution
from commonrail.engine.time_step import check_step
from commonrail.physics.injector import Injector, Source, parameter_quantities
from commonrail.physics.law import Domain, Q
from commonrail.physics.meters import LowPass, Meter, first_order

# Measuring chain: limited bandwidth, noise and resolution of a signal.

PASSES = 2  # low-passes in a row


@dataclass(frozen=True)
class Sensor:
    """A measuring chain: two equal first-order low-passes in a row, then Gaussian noise, then rounding.

    `bandwidth` is the corner frequency of each low-pass [Hz], infinite for none. `noise` is the standard deviation of a
    sample, independent from sample to sample, and `resolution` the step of the digital signal, zero for none; both in
    the signal's unit.
    """

    bandwidth: float = math.inf
    noise: float = 0.0
    resolution: float = 0.0

    def shown(self, signal: Floats, interval: float, rng: np.random.Generator, rest: float = 0.0) -> Floats:
        """Signal (n,) as displayed, of means or values at an interval [s]; before, they were `rest`."""
        for _ in range(PASSES):
            signal = first_order(signal, 2.0 * math.pi * self.bandwidth * interval, rest)
        noisy = signal + self.noise * rng.standard_normal(len(signal))
        return np.asarray(np.round(noisy / self.resolution) * self.resolution) if self.resolution > 0.0 else noisy

    def as_meter(self, name: str) -> Meter:
        """The low-passes as a meter of a fit; noise and resolution are no part of it."""
        return Meter(name, {} if math.isinf(self.bandwidth) else {"cutoff": self.bandwidth}, LowPass.CASCADE, PASSES)


MASSES = 9  # of plunger and needle, Eq. (10)

_BANDWIDTH = Q("Hz", "corner frequency of each of two low-passes", Domain.POSITIVE, math.inf)
_NOISE, _STEP, _SPREAD = "standard deviation of a sample", "step of the digital signal", "standard deviation"


def _none(unit: str, meaning: str) -> Q:
    """A quantity that is zero where it is not given."""
    return Q(unit, meaning, Domain.NON_NEGATIVE, 0.0)


# Quantities of a truth besides the injector and friction: unit, meaning, and default, which is ideal.
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
        Identifier, and a line on the effect.
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

    cure: ClassVar[Cure] = Cure("read it with commonrail.lab.load_truth({})", "virtual-lino-2016")

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
        settle(
            self,
            values=mapping(self.values, "values of a truth", '{"valve.spring_preload": "75 N"}'),
            sources=mapping(self.sources, "sources of a truth", '{"rate_meter.noise": Source("E", "estimate")}'),
            boundary=enum_member(self.boundary, Boundary, "boundary of a truth"),
        )
        for what, kind in _KINDS.items():
            instance(getattr(self, what), kind, f"{what} of a truth")

    @property
    def synthetic(self) -> str:
        """Note shown with its data."""
        return f"All data are simulated by the virtual test bench (truth {self.name}), not measured."

    def make_true_injector(self, injector: Injector) -> Injector:
        """The true injector behind the one that is fitted.

        Raises
        ------
        ConfigurationError
            If a value is unknown or outside its domain.
        """
        variant = injector.variant._replace(boundary=self.boundary)
        return replace(injector, variant=variant, values={**injector.values, **self.values})

    def facts(self) -> list[tuple[str, str]]:
        """Every number with name, unit, mark and source, for reports."""
        return list(self._facts())

    def _facts(self) -> Iterator[tuple[str, str]]:
        feed = {Boundary.VOLUME: "a rail of finite volume behind a throttle", Boundary.IDEAL: "an ideal rail"}
        yield "injector", f"{self.injector}, fed from {feed[self.boundary]}"
        for path, value in self.values.items():
            yield path, quantity(value, parameter_quantities()[path].unit) + self._origin(path)
        for name, q in FRICTION.items():
            path, forces = f"friction.{name}", getattr(self.friction, name)
            listed = f"{', '.join(f'{force:g}' for force in forces)} {q.unit}" if any(forces) else "none"
            yield q.meaning, listed + self._origin(path)
        for table, quantities in QUANTITIES.items():
            for name, q in quantities.items():
                path, value = f"{table}.{name}", getattr(getattr(self, table), name)
                amount = "unlimited" if math.isinf(value) else quantity(value, q.unit) if value else "none"
                yield f"{table}, {name}: ".replace("_", " ") + q.meaning, amount + self._origin(path)
        cells, step = self.resolution.cells, quantity(self.resolution.step, "s")
        yield "finite volumes", f"{cells[0]} in the feed pipe, {cells[1]} in the return line (numerical setting)"
        yield "time step", f"{step}, Runge–Kutta of order 4 (numerical setting)"

    def _origin(self, path: str) -> str:
        source = self.sources.get(path)
        return f" [{source.mark}] {source.text}" if source else ""


# Virtual test bench: injection curves of a declared, hidden truth, in place of data that were never published.
#
# The truth is richer than any model that is fitted to it (`truth`), and it runs on the reference engine, so a fit
# never meets its own discretisation. A curve is one shot: rail pressure, energising time and boost voltage deviate
# from what was asked for, and rate and inlet pressure are seen through sensors. The fit sees the two sensors' signals
# and the energising time that was asked for. Everything the bench gives is synthetic.

# Table 1 of the paper, "optimal" [N/m]
PAPER_OPTIMUM = {
    "plunger_needle.k1": 3.03e8,
    "plunger_needle.k2": 8.26e7,
    "plunger_needle.k3": 8.35e7,
    "plunger_needle.k4": 1.41e8,
    "plunger_needle.k5": 1.05e8,
    "plunger_needle.k6": 3.50e8,
    "plunger_needle.k7": 6.44e7,
}

# Sec. 5
RAIL_PRESSURES = {"160 MPa": 160e6, "120 MPa": 120e6, "80 MPa": 80e6}  # [Pa]
ENERGISING_TIME = 700e-6  # [s]
SAMPLES, INTERVAL = 520, 3e-6  # Sec. 5: 520 samples; their spacing [s] is ours


@dataclass(frozen=True)
class Bench:
    """Hidden truth that is measured, injector by its drawing, which is fitted, and time step of the fit.

    Attributes
    ----------
    truth : Truth
    injector : Injector
    time_step : float
        [s].

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, or the time step does not lie between 1 ns and 100 us.
    """

    cure: ClassVar[Cure] = Cure("write commonrail.lab.Bench(truth, injector, time_step)")

    truth: Truth
    injector: Injector
    time_step: float

    def __post_init__(self) -> None:
        instance(self.truth, Truth, "truth of the bench")
        instance(self.injector, Injector, "injector of the bench")
        settle(self, time_step=check_step(self.time_step))


class Curve(NamedTuple):
    """One injection curve of the bench, at the rail pressure asked for [Pa]; arrays have 520 samples.

    `rate`: means over samples that end at `time` [s], as shown by the rate meter [m³/s]; `rail`: pressure at the
    injector's inlet at `trace_time` [s], as shown by the sensor [Pa].
    """

    rail_pressure: float
    time: Floats
    rate: Floats
    trace_time: Floats
    rail: Floats


def bench_curve(truth: Truth, injector: Injector, rail_pressure: float, energising_time: float, seed: int) -> Curve:
    """Rate and inlet pressure of one shot on the virtual test bench, as its sensors show them.

    The same arguments give the same curve, whatever else is drawn and on however many threads.

    Parameters
    ----------
    truth : Truth
    injector : Injector
        Which the truth alters, and from which a fit starts.
    rail_pressure : float
        Asked for [Pa]; with `seed`, the key of the random numbers.
    energising_time : float
        Asked for [s].
    seed : int
        Of scatter and noise.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, the truth does not fit the injector, or a deviation leaves no sensible
        operating point.
    SimulationError
        If the truth cannot be simulated.
    """
    instance(truth, Truth, "truth")
    instance(injector, Injector, "injector")
    rail_pressure = number(rail_pressure, "Pa", "rail pressure")
    energising_time = number(energising_time, "s", "energising time")
    seed = integer(seed, "seed")
    streams = np.random.SeedSequence((seed, round(rail_pressure))).spawn(3)
    operation, rate_meter, rail_sensor = map(np.random.default_rng, streams)
    shot = _shoot(truth, injector, rail_pressure, energising_time, operation)
    inlet = shot.channels["inlet_pressure"]
    rate = truth.rate_meter.shown(shot.rate, INTERVAL, rate_meter)
    rail = truth.rail_sensor.shown(inlet, INTERVAL, rail_sensor, float(inlet[0]))
    return Curve(rail_pressure, shot.time[1:], rate, shot.time[1:], rail[1:])


def _shoot(
    truth: Truth, injector: Injector, rail_pressure: float, energising_time: float, rng: np.random.Generator
) -> Solution:
    """The injection as it is, with its own deviations."""
    scatter, (rail, duration, boost) = truth.scatter, rng.standard_normal(3)
    hidden = truth.make_true_injector(injector)
    boosted = hidden.values["drive.boost_voltage"] + scatter.boost_voltage * boost
    point = OperatingPoint(
        rail_pressure + scatter.rail_pressure * rail,
        energising_time + scatter.energising_time * duration,
        horizon=SAMPLES * INTERVAL,
    )
    friction = np.column_stack((truth.friction.coulomb, truth.friction.viscous))
    hidden = replace(hidden, values={**hidden.values, "drive.boost_voltage": boosted})
    shot = simulate_reference(hidden, point, INTERVAL, truth.resolution, friction)
    if shot.status.failed:
        raise SimulationError(f"{truth.name} at {quantity(rail_pressure, 'Pa')}: {shot.sentence}")
    return shot
