"""Simulations that the fast engine is judged by: points, wirings and parameter sets, chosen beforehand.

A group of them is judged by one set of limits: a main injection by rate, volume and the needle's instants, a short
injection or a random injector by volume alone. The instants of a needle that hardly leaves its seat, or that falls back
on it, hang on its bounces, so that half a step may move them by a microsecond where the volume stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import Literal, NamedTuple, cast

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.choices import Actuation, Body, Boundary, Drive, Precision
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.plugins.paper.bench import PAPER_OPTIMUM
from commonrail.plugins.verification import closed_forms
from commonrail.plugins.verification.closed_forms import Check, check
from commonrail.plugins.verification.external import Run, against_outside, objective_and_scores

PRESSURES = (40e6, 80e6, 120e6, 160e6, 180e6)  # [Pa]
TWO = (80e6, 160e6)
SHORT_AT = (60e6, 100e6, 160e6)  # of short injections [Pa]
ENERGISING = 700e-6  # [s], as in the paper
HORIZON = 1.9e-3  # the needle has closed by then at all of them [s]
SHORT_TIMES = (150e-6, 180e-6, 200.5e-6, 250e-6, 320e-6)  # energising times [s]
DWELLS = (50e-6, 300e-6)  # from the end of a pilot to the start of the main injection [s]
LONG_DWELLS = (600e-6, 900e-6, 1200e-6)  # in which the return line's waves come back to the valve [s]
PILOT, MAIN = 250e-6, 500e-6  # their energising times [s]
DIRECT_AT = (20e6,)  # of a direct-acting injector, which is made for lower rail pressures [Pa]
DIRECT_PILOT, DIRECT_MAIN = 400e-6, 600e-6  # it opens later [s]
CANDIDATES, BOX, SEED = 50, 0.6, 20160401  # random stiffnesses within ± 60 % at 160 MPa
INJECTORS, AROUND, DRAWS = 20, 0.3, 1000  # random injectors, every parameter within ± 30 %, out of so many draws
# Not varied: without a shape of the nozzle and without a free-wheel diode they change nothing.
IDLE = ("nozzle.knot_", "drive.diode_voltage")
RANDOM_AT, RANDOM_HORIZON = 100e6, 3.3e-3  # of the random injectors [Pa], [s]
SOME = 1e-9  # the least that one of them injects [m³]
AWAY = 5.0  # of hot and cold fuel from the ends of its range [K]


class Course(NamedTuple):
    """Limits of a main injection: L1 of the rate and volume [%], opening and closing [us]."""

    rate: float = 0.1
    volume: float = 0.05
    opening: float = 0.5
    closing: float = 0.5

    def times(self, factor: float) -> Course:
        """All limits by a factor."""
        return Course(*(factor * limit for limit in self))


class Volume(NamedTuple):
    """Limit of the volume alone: the larger of a share [1] and a quantity [m³], and how many must keep it [1]."""

    relative: float
    absolute: float
    share: float = 1.0

    def of(self, volume: float) -> float:
        """The limit for an injected volume [m³]."""
        return max(self.relative * volume, self.absolute)

    @property
    def text(self) -> str:
        """As a person writes it."""
        larger = f"the larger of {100.0 * self.relative:g} % and {1e9 * self.absolute:g} mm3"
        return larger if self.share == 1.0 else f"{larger}, kept by {100.0 * self.share:g} %"


# Of a step of 1 us. One rigid mass meets its seat at full speed, no chain softens the blow.
MAINS, RIGID = Course(), Course().times(2.0)
PAIR, ANY = (Volume(0.003, 1e-11),), (Volume(0.005, 1e-11),)
# The needle of a short injection may fall back on its seat and open again: its volume then moves by tens of per cent
# per 1 % of a hole, and the step's error with it. Most keep the first limit, all the second.
SHORT = (Volume(0.003, 1e-11, 0.9), Volume(0.01, 3e-11))


class Task(NamedTuple):
    """One comparison of the engines.

    Checks are named by the group, whose members have the same limits; `single` is the group of the same run in single
    precision, empty if there is none; `method` is that of the reference.
    """

    group: str
    injector: Injector
    point: OperatingPoint
    limits: Course | tuple[Volume, ...] = MAINS
    single: str = ""
    method: str = "explicit"


def comparisons(injector: Injector, quick: bool = False, catalogue: Sequence[Injector] = ()) -> list[Task]:
    """All comparisons of an injector that is flexible, fed by an ideal rail and driven by PWM.

    Quick ones are fewer, without hot and cold fuel, several injections and random injectors. Those of the catalogue are
    compared with two injections, a long dwell between them.
    """
    tasks = (
        _stiffnesses(injector, quick) + _wirings(injector) + _random_stiffnesses(injector, 4 if quick else CANDIDATES)
    )
    if quick:
        return tasks + _traces(injector, TWO[1:]) + _short(injector, SHORT_TIMES[1:2], SHORT_AT[1:2])
    tasks += _traces(injector, TWO) + _fuels(injector)
    tasks += _short(injector, SHORT_TIMES, SHORT_AT) + _pilots(injector) + _random_injectors(injector)
    return tasks + [task for each in catalogue for task in _long_dwells(each)]


def _stiffnesses(injector: Injector, quick: bool) -> list[Task]:
    """By LSODA, so that both methods of the reference are seen; single precision shares the run of double."""
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


def _wirings(injector: Injector) -> list[Task]:
    rigid = injector.variant._replace(body=Body.RIGID)
    volume = injector.variant._replace(boundary=Boundary.VOLUME, drive=Drive.REGULATED)
    return [
        Task("rigid body, 160 MPa", replace(injector, variant=rigid), _main(160e6), RIGID),
        Task("rail volume, 160 MPa", replace(injector, variant=volume), _main(160e6)),
    ]


def _random_stiffnesses(injector: Injector, count: int) -> list[Task]:
    factors = np.random.default_rng(SEED).uniform(1.0 - BOX, 1.0 + BOX, (count, len(PAPER_OPTIMUM)))
    group = f"{count} random stiffnesses within ± {100 * BOX:.0f} %, 160 MPa"
    return [Task(group, _scaled(injector, list(PAPER_OPTIMUM), row), _main(160e6)) for row in factors]


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
    whole = f"{times[0] * 1e6:g} us" if len(times) == 1 else f"{times[0] * 1e6:g} to {times[-1] * 1e6:g} us"
    return [
        Task(f"energising time {whole}", wired, OperatingPoint(pressure, time), SHORT)
        for time in times
        for wired in (_driven(injector, Drive.PWM), _driven(injector, Drive.REGULATED))
        for pressure in pressures
    ]


def _pilots(injector: Injector) -> list[Task]:
    return [
        Task(f"pilot and main injection, dwell {dwell * 1e6:g} us", injector, _pair(pressure, dwell), PAIR)
        for dwell in DWELLS
        for pressure in SHORT_AT
    ]


def _long_dwells(injector: Injector) -> list[Task]:
    """Of any actuation, the current of one that is driven by a trace regulated instead."""
    direct = injector.variant.actuation is Actuation.DIRECT
    pressures, times = (DIRECT_AT, (DIRECT_PILOT, DIRECT_MAIN)) if direct else (TWO, (PILOT, MAIN))
    driven = (
        _driven(injector, Drive.REGULATED) if injector.variant.drive in (Drive.CURRENT, Drive.VOLTAGE) else injector
    )
    group = f"{injector.name}, pilot and main injection, dwells of 600 to 1200 us"
    return [
        Task(group, driven, _pair(pressure, dwell, *times), PAIR, method="lsoda" if direct else "explicit")
        for dwell in LONG_DWELLS
        for pressure in pressures
    ]


def _random_injectors(injector: Injector) -> list[Task]:
    """The first of the draws that lie in their domains, rest closed and open at all."""
    names = [name for name, value in injector.values.items() if value != 0.0 and not name.startswith(IDLE)]
    low, high = np.log((1.0 - AROUND, 1.0 + AROUND))
    factors = np.exp(np.random.default_rng(SEED).uniform(low, high, (DRAWS, len(names))))
    own = np.array([injector.values[name] for name in names])
    point = OperatingPoint(RANDOM_AT, ENERGISING, horizon=RANDOM_HORIZON)
    batch = simulate_batch(injector, [point], names, factors * own)
    refused = np.isin(batch.status[:, 0], (Status.OUTSIDE_DOMAIN, Status.NOT_CLOSED_AT_START))
    drawn = factors[~refused & ~(batch.injected_volume[:, 0] < SOME)][:INJECTORS]  # what fails otherwise stays
    group = f"{len(drawn)} random injectors, every parameter within ± {100 * AROUND:.0f} %"
    return [Task(group, _scaled(injector, names, row), point, ANY) for row in drawn]


def drop(pressure: float) -> Trace:
    """Rail pressure that falls by 10 MPa while fuel is drawn from it."""
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


def _scaled(injector: Injector, names: list[str], factors: Floats) -> Injector:
    return injector.with_values({n: injector.values[n] * float(x) for n, x in zip(names, factors, strict=True)})


# Checks that the code solves the equations it states, each with its figure and its limit.
#
# The fast engine against the reference, which shares its laws but none of its scheme, at the points of
# `verification_cases`; its batches against its single simulations; the objective against the reported scores
# (`commonrail.plugins.verification.external`); all against closed forms
# (`commonrail.plugins.verification.closed_forms`) and against the figures of a program outside the project
# (`commonrail.plugins.verification.external`). Nothing here says that the equations describe a given injector.

INTERVAL = 3e-6  # of a rate meter's samples [s]
# A batch ends once a valve train is at rest: what a relaxing SAC dribbles after that was 1e-5 mm³ at the most [mm³].
BATCH = 1e-4
INJECTS = 1e-12  # more than this is an injection [m³]
HOLES = ("control_chamber.z_hole_diameter", "control_chamber.a_hole_diameter")
DIRECT_HOLES = ("nozzle.hole_diameter",)  # of an injector without a control chamber
SHIFT = 5e-4  # the share by which they are moved
UNITS = {"rate, L1": "%", "volume": "%", "opening": "us", "closing": "us"}  # of the fields of `Course`


class Difference(NamedTuple):
    """Lanes less reference: rate (L1) and volume [%], opening and closing [us].

    NaN where one has failed, they ended otherwise than each other, or nothing was injected.
    """

    rate: float
    volume: float
    opening: float
    closing: float


class Compared(NamedTuple):
    """Outcome of a task: single simulations in f64, and in f32 if it was asked for, against the reference.

    `volume` is injected by the reference [m³], `gap` by the fast engine less that [m³], `batch` by `simulate_batch`
    less that of `simulate` [m³]; NaN where one has failed. `sensitivity` is the change of the injected volume [%] per 1
    % of the Z- or A-hole's diameter, whichever is larger, or of the nozzle's holes; NaN where the limits are those of a
    course.
    """

    double: Difference
    single: Difference | None
    volume: float
    gap: float
    batch: float
    sensitivity: float


def compare(task: Task) -> Compared:
    """Run both engines and measure the distance between them.

    The rate's L1 is Σ|lanes − reference|/Σ|reference| over samples of `INTERVAL`, as a rate meter takes them.
    """
    injector, point = task.injector, task.point
    method = cast(Literal["lsoda", "explicit"], task.method)
    reference = simulate_reference(injector, point, INTERVAL, Resolution(method=method))
    double = simulate(injector, point, sample_interval=INTERVAL)
    single = simulate(injector, point, sample_interval=INTERVAL, precision=Precision.F32) if task.single else None
    batch = simulate_batch(injector, [point], threads=1)
    return Compared(
        difference(double, reference),
        difference(single, reference) if single else None,
        reference.injected_volume,
        _sound(double, reference) * (double.injected_volume - reference.injected_volume),
        _sound(double) * float(batch.injected_volume[0, 0]) - double.injected_volume,
        _sensitivity(task),
    )


def _sound(*solutions: Solution) -> float:
    """1, or NaN if one of them failed or they ended otherwise than each other."""
    status = solutions[0].status
    same = all(solution.status is status for solution in solutions)
    return math.nan if status.failed or not same else 1.0


def _sensitivity(task: Task) -> float:
    if isinstance(task.limits, Course):
        return math.nan
    holes = DIRECT_HOLES if task.injector.variant.actuation is Actuation.DIRECT else HOLES
    own = np.array([task.injector.values[name] for name in holes])
    shifts = SHIFT * np.array([sign * row for row in np.eye(len(holes)) for sign in (1.0, -1.0)])
    volume = simulate_batch(task.injector, [task.point], holes, own * (1.0 + shifts), threads=1).injected_volume[:, 0]
    moved = np.abs(volume[::2] - volume[1::2])
    return float(np.max(moved) / np.sum(volume) / SHIFT * 2.0) if np.sum(volume) > 0.0 else 0.0


def difference(fast: Solution, reference: Solution) -> Difference:
    """Distance of a solution from the reference, both with samples at the same bounds."""
    samples = min(len(fast.mass_rate), len(reference.mass_rate))
    level = float(np.sum(np.abs(reference.mass_rate)))
    if not level > 0.0:
        return Difference(math.nan, math.nan, math.nan, math.nan)
    sound = _sound(fast, reference)
    gap = np.abs(fast.mass_rate[:samples] - reference.mass_rate[:samples])
    return Difference(
        sound * 100.0 * float(np.sum(gap)) / level,
        sound * 100.0 * (fast.injected_mass / reference.injected_mass - 1.0),
        sound * 1e6 * (fast.opening - reference.opening),
        sound * 1e6 * (fast.closing - reference.closing),
    )


def verify(
    injector: Injector,
    progress: Callable[[str], None] | None = None,
    processes: int | None = None,
    quick: bool = False,
    outside: Sequence[Run] = (),
    catalogue: Sequence[Injector] = (),
) -> list[Check]:
    """Check the fast engine against the reference and both against what is known otherwise.

    The injector is flexible, fed by an ideal rail and driven by PWM or regulator: the catalogue's "virtual-lino-2016".
    `progress` is told after every comparison; `outside` are figures of a program outside the project. Of each group of
    comparisons, batches, scores, figures from outside and closed forms the worst figure is returned.
    """
    tell = progress or (lambda text: None)
    tasks = comparisons(injector, quick, catalogue)
    tell(f"comparing the engines: {len(tasks)} simulations by the reference")
    found: list[Compared] = []
    with ProcessPoolExecutor(processes) as pool:
        for k, (task, one) in enumerate(zip(tasks, pool.map(compare, tasks), strict=True)):
            found.append(one)
            tell(f"{k + 1} of {len(tasks)}: {task.group}")
        checks = judged(tasks, found)
        tell("objective against scores")
        checks += objective_and_scores(injector)
        if outside:
            tell(f"figures from outside: {len(outside)} runs")
            checks += against_outside(outside, pool)
    for form in closed_forms.ALL:
        tell(form.__name__.replace("_", " "))
        checks += form(injector)
    return checks


def judged(tasks: Sequence[Task], found: Sequence[Compared]) -> list[Check]:
    """The worst figures of each group, in the order in which the groups appear, then of the batches."""
    groups: dict[str, list[tuple[Task, Compared]]] = {}
    for task, one in zip(tasks, found, strict=True):
        groups.setdefault(task.group, []).append((task, one))
    single: dict[str, list[Difference]] = {}
    for task, one in zip(tasks, found, strict=True):
        if one.single is not None:
            single.setdefault(task.single, []).append(one.single)
    checks: list[Check] = []
    for group, members in groups.items():
        limits = members[0][0].limits
        if isinstance(limits, Course):
            checks += _courses(group, limits, [one.double for _, one in members])
        else:
            checks += [_volumes(group, limit, members) for limit in limits]
    for group, differences in single.items():
        checks += _courses(group, Course(), differences)
    return [*checks, _batches(tasks, found)]


def _courses(group: str, limits: Course, differences: Sequence[Difference]) -> Iterator[Check]:
    for (name, unit), limit, values in zip(UNITS.items(), limits, zip(*differences, strict=True), strict=True):
        size = np.abs(values)
        worst = float(np.max(size))  # NaN, where a needle did not close, fails
        detail = f"lanes at 1 us against the reference, median {np.median(size):.2g} {unit}, {len(size)} simulations"
        yield check(f"{group}: {name}", worst, limit, unit, detail)


def _volumes(group: str, limit: Volume, members: Sequence[tuple[Task, Compared]]) -> Check:
    shares = np.array([100.0 * abs(one.gap) / limit.of(one.volume) for _, one in members])
    shares = np.where(np.isnan(shares), np.inf, shares)
    # the largest of those that must keep the limit
    k = int(np.argsort(shares)[math.ceil(limit.share * len(shares)) - 1])
    task, worst = members[k]
    some = sum(one.volume > INJECTS for _, one in members)
    detail = (
        f"share of {limit.text}, median {np.median(shares):.2g} %, {len(shares)} simulations, of which {some} inject; "
        f"here {1e9 * abs(worst.gap):.2g} of {1e9 * worst.volume:.4g} mm3{_where(task)}, where 1 % of a hole's "
        f"diameter moves {worst.sensitivity:.0f} %"
    )
    of = "volume" if limit.share == 1.0 else f"volume of {100.0 * limit.share:g} % of them"
    return check(f"{group}: {of}", float(shares[k]), 100.0, "% of its limit", detail)


def _where(task: Task) -> str:
    pressure = task.point.at_start(task.point.rail_pressure) * 1e-6
    return f" at {pressure:.0f} MPa, {task.injector.variant.drive.value} drive"


def _batches(tasks: Sequence[Task], found: Sequence[Compared]) -> Check:
    gaps = np.array([1e9 * abs(one.batch) for one in found])
    k = int(np.argmax(gaps))
    detail = (
        f"injected volume, early stop, {len(gaps)} simulations, worst: {tasks[k].group}; limit: what a SAC gives after "
        "its needle and valve have come to rest"
    )
    return check("simulate_batch against simulate", gaps[k], BATCH, "mm3", detail)
