"""Simulations by which the fast engine is checked: points, variants and parameter sets, fixed in advance.

Each group has one set of limits. A main injection is checked by rate, volume, opening and closing; a short injection or
a random injector by volume alone. If the needle hardly leaves its seat or falls back on it, its opening and closing
depend on bounces: half a step may move them by a microsecond although the volume stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from commonrail.base.arguments import COUNTS
from commonrail.base.arrays import Floats
from commonrail.base.choices import Actuation, Body, Boundary, Drive
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.status import Status
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.plugins.paper.bench import PAPER_OPTIMUM

PRESSURES = (40e6, 80e6, 120e6, 160e6, 180e6)  # [Pa]
TWO = (80e6, 160e6)
SHORT_AT = (60e6, 100e6, 160e6)  # of short injections [Pa]
ENERGISING = 700e-6  # [s], as in the paper
HORIZON = 1.9e-3  # by then the needle has closed at all pressures [s]
SHORT_TIMES = (150e-6, 180e-6, 200.5e-6, 250e-6, 320e-6)  # energising times [s]
DWELLS = (50e-6, 300e-6)  # from the end of a pilot to the start of the main injection [s]
LONG_DWELLS = (600e-6, 900e-6, 1200e-6)  # waves of the return line return to the valve meanwhile [s]
PILOT, MAIN = 250e-6, 500e-6  # energising times of pilot and main injection [s]
DIRECT_AT = (20e6,)  # for direct-acting injectors, which have lower rail pressures [Pa]
DIRECT_PILOT, DIRECT_MAIN = 400e-6, 600e-6  # direct-acting injectors open later [s]
SEED = 20160401
CANDIDATES, BOX = 50, 0.6  # random stiffnesses within ± 60 % at 160 MPa
INJECTORS, AROUND = 20, 0.3  # random injectors within ± 30 %
DRAWS = 1000  # from which the random injectors are taken
# Not varied: they have no effect without a shaped nozzle and a free-wheel diode.
IDLE = ("nozzle.knot_", "drive.diode_voltage")
RANDOM_AT, RANDOM_HORIZON = 100e6, 3.3e-3  # of the random injectors [Pa], [s]
SOME = 1e-9  # least injected volume of a random injector [m³]
AWAY = 5.0  # distance of hot and cold fuel from the ends of its range [K]


class RateLimits(NamedTuple):
    """Limits of a main injection: L1 of the rate and volume [%], opening and closing [us]."""

    rate: float = 0.1
    volume: float = 0.05
    opening: float = 0.5
    closing: float = 0.5

    def times(self, factor: float) -> RateLimits:
        """Multiply all limits by a factor."""
        return RateLimits(*(factor * limit for limit in self))


class VolumeLimit(NamedTuple):
    """Limit of the volume error: the larger of a share [1] and a quantity [m³]. `share` [1] of members must meet it."""

    relative: float
    absolute: float
    share: float = 1.0

    def of(self, volume: float) -> float:
        """The limit for an injected volume [m³]."""
        return max(self.relative * volume, self.absolute)

    @property
    def text(self) -> str:
        """Limit in words."""
        larger = f"the larger of {100.0 * self.relative:g} % and {1e9 * self.absolute:g} mm³"
        return larger if self.share == 1.0 else f"{larger}, kept by {100.0 * self.share:g} %"


# For a step of 1 us. A rigid mass hits its seat at full speed; no chain softens the impact.
MAINS, RIGID = RateLimits(), RateLimits().times(2.0)
PAIR, ANY = (VolumeLimit(0.003, 1e-11),), (VolumeLimit(0.005, 1e-11),)
# In a short injection, the needle may return to its seat and open again. A change of a hole by 1 % then changes the
# volume by tens of percent, and the error of the step grows alike. 90 % of the members must meet the first limit, all
# must meet the second.
SHORT = (VolumeLimit(0.003, 1e-11, 0.9), VolumeLimit(0.01, 3e-11))


class Task(NamedTuple):
    """One comparison of the engines.

    `group`: name of the checks, whose members have equal limits; `single`: group of the same run in single precision,
    or empty; `method`: integration method of the reference.
    """

    group: str
    injector: Injector
    point: OperatingPoint
    limits: RateLimits | tuple[VolumeLimit, ...] = MAINS
    single: str = ""
    method: Literal["lsoda", "explicit"] = "explicit"


def comparisons(injector: Injector, quick: bool = False, catalogue: Sequence[Injector] = ()) -> list[Task]:
    """All comparisons for a flexible injector with an ideal rail and PWM drive.

    `quick`: fewer, without hot and cold fuel, several injections and random injectors. Injectors of the catalogue are
    compared with two injections separated by a long dwell.
    """
    tasks = (
        _stiffnesses(injector, quick) + _variants(injector) + _random_stiffnesses(injector, 4 if quick else CANDIDATES)
    )
    if quick:
        return tasks + _traces(injector, TWO[1:]) + _short(injector, SHORT_TIMES[1:2], SHORT_AT[1:2])
    tasks += _traces(injector, TWO) + _fuels(injector)
    tasks += _short(injector, SHORT_TIMES, SHORT_AT) + _pilots(injector) + _random_injectors(injector)
    return tasks + [task for each in catalogue for task in _long_dwells(each)]


def _stiffnesses(injector: Injector, quick: bool) -> list[Task]:
    """Stiffnesses with LSODA, the second reference method; single precision uses the same reference run."""
    sets: dict[str, dict[str, float]] = {"injector as given": {}, "paper's optimal stiffness": PAPER_OPTIMUM}
    pressures, at = (TWO, "80 and 160 MPa") if quick else (PRESSURES, "40 to 180 MPa")
    return [
        Task(
            f"{name}, {at}",
            injector.with_values(values),
            _main(pressure),
            single="" if values else f"f32, {at}",
            method="explicit" if values and quick else "lsoda",
        )
        for name, values in sets.items()
        for pressure in pressures
    ]


def _variants(injector: Injector) -> list[Task]:
    rigid = injector.variant._replace(body=Body.RIGID)
    volume = injector.variant._replace(boundary=Boundary.VOLUME, drive=Drive.REGULATED)
    return [
        Task("rigid body, 160 MPa", replace(injector, variant=rigid), _main(160e6), RIGID),
        Task("rail volume, 160 MPa", replace(injector, variant=volume), _main(160e6)),
    ]


def _random_stiffnesses(injector: Injector, count: int) -> list[Task]:
    factors = np.random.default_rng(SEED).uniform(1.0 - BOX, 1.0 + BOX, (count, len(PAPER_OPTIMUM)))
    group = f"{count} random stiffnesses within ± {100 * BOX:.0f} %, 160 MPa"
    return [Task(group, _scale_values(injector, list(PAPER_OPTIMUM), row), _main(160e6)) for row in factors]


def _traces(injector: Injector, pressures: tuple[float, ...]) -> list[Task]:
    by_current = _driven(injector, Drive.CURRENT)
    tasks = []
    for pressure in pressures:
        tasks += [
            Task("rail trace that drops by 10 MPa", injector, _main(drop(pressure))),
            Task("inlet trace with ripples of 1 and 3 kHz", injector, _main(ripple(pressure))),
            Task("current trace", by_current, _main(pressure, profile(1e-3))),
            Task("current trace longer than the horizon", by_current, _main(pressure, profile(5e-3))),
        ]
    return tasks


def _fuels(injector: Injector) -> list[Task]:
    low, high = injector.fuel.temperature_range
    return [
        Task(f"fuel at {temperature:.0f} K", injector.with_values({FUEL_TEMPERATURE: temperature}), _main(pressure))
        for temperature in (low + AWAY, high - AWAY)
        for pressure in TWO
    ]


def _short(injector: Injector, times: tuple[float, ...], pressures: tuple[float, ...]) -> list[Task]:
    times_text = f"{times[0] * 1e6:g} us" if len(times) == 1 else f"{times[0] * 1e6:g} to {times[-1] * 1e6:g} us"
    return [
        Task(f"energising time {times_text}", driven, OperatingPoint(pressure, time), SHORT)
        for time in times
        for driven in (_driven(injector, Drive.PWM), _driven(injector, Drive.REGULATED))
        for pressure in pressures
    ]


def _pilots(injector: Injector) -> list[Task]:
    return [
        Task(f"pilot and main injection, dwell {dwell * 1e6:g} us", injector, _pair(pressure, dwell), PAIR)
        for dwell in DWELLS
        for pressure in SHORT_AT
    ]


def _long_dwells(injector: Injector) -> list[Task]:
    """Long dwells for any actuation; a drive by a trace is replaced by a regulated one."""
    direct = injector.variant.actuation is Actuation.DIRECT
    pressures, times = (DIRECT_AT, (DIRECT_PILOT, DIRECT_MAIN)) if direct else (TWO, (PILOT, MAIN))
    driven = _driven(injector, Drive.REGULATED) if injector.variant.drive.is_trace else injector
    group = f"{injector.name}, pilot and main injection, dwells of 600 to 1200 us"
    return [
        Task(group, driven, _pair(pressure, dwell, *times), PAIR, method="lsoda" if direct else "explicit")
        for dwell in LONG_DWELLS
        for pressure in pressures
    ]


def _random_injectors(injector: Injector) -> list[Task]:
    """Random injectors: the first draws that lie in their domains, are closed at rest, and inject."""
    names = [name for name, value in injector.values.items() if value != 0.0 and not name.startswith(IDLE)]
    low, high = np.log((1.0 - AROUND, 1.0 + AROUND))
    factors = np.exp(np.random.default_rng(SEED).uniform(low, high, (DRAWS, len(names))))
    factors[:, np.isin(names, COUNTS)] = 1.0  # the number of holes is an integer
    nominal = np.array([injector.values[name] for name in names])
    point = OperatingPoint(RANDOM_AT, ENERGISING, horizon=RANDOM_HORIZON)
    batch = simulate_batch(injector, [point], names, factors * nominal)
    refused = np.isin(batch.status[:, 0], (Status.OUTSIDE_DOMAIN, Status.NOT_CLOSED_AT_START))
    drawn = factors[~refused & ~(batch.injected_volume[:, 0] < SOME)][:INJECTORS]  # draws with other failures are kept
    group = f"{len(drawn)} random injectors, every parameter but counts within ± {100 * AROUND:.0f} %"
    return [Task(group, _scale_values(injector, names, row), point, ANY) for row in drawn]


def drop(pressure: float) -> Trace:
    """Rail pressure that falls by 10 MPa during injection."""
    return Trace.of([0.0, 200e-6, 1200e-6, 2500e-6], pressure - np.array([0.0, 0.0, 10e6, 9e6]))


def ripple(pressure: float) -> Trace:
    """Pressure at the inlet with waves of 3 MPa at 1 kHz and 2 MPa at 3 kHz, a sample every 10 us."""
    time = 10e-6 * np.arange(251)
    phase = 2e3 * np.pi * time
    return Trace.of(time, pressure + 3e6 * np.sin(phase) + 2e6 * np.sin(3.0 * phase))


def profile(length: float) -> Trace:
    """Current of 20 A, then 12 A, with ripples of the output stage; zero from 740 us to the end of the trace [s]."""
    time = 5e-6 * np.arange(round(length / 5e-6) + 1)
    knots = [0.0, 80e-6, 350e-6, 400e-6, ENERGISING, 740e-6]
    current = np.interp(time, knots, [0.0, 20.0, 20.0, 12.0, 12.0, 0.0])
    swings = (time > knots[1]) & (time < knots[4])
    return Trace.of(time, current + 0.8 * swings * np.sin(2.0 * np.pi * 25e3 * time))


def _main(rail_pressure: float | Trace, drive: Trace | None = None) -> OperatingPoint:
    return OperatingPoint(rail_pressure, ENERGISING, drive=drive, horizon=HORIZON)


def _pair(rail_pressure: float, dwell: float, pilot: float = PILOT, main: float = MAIN) -> OperatingPoint:
    return OperatingPoint(rail_pressure, (Energising(0.0, pilot), Energising(pilot + dwell, main)))


def _driven(injector: Injector, drive: Drive) -> Injector:
    return replace(injector, variant=injector.variant._replace(drive=drive))


def _scale_values(injector: Injector, names: list[str], factors: Floats) -> Injector:
    scaled = {n: injector.values[n] * float(x) for n, x in zip(names, factors, strict=True)}
    return replace(injector, values={**injector.values, **scaled})  # also values that the variant does not read
