"""Checks that the code solves the equations it states, each with its figure and its limit.

The fast engine against the reference, which shares its laws but none of its scheme, at the points of `study`; its
batches against its single simulations; the objective against the reported scores and both engines against the figures
of a program outside the project (`external`); all against closed forms (`closed_forms`). Nothing here says that the
equations describe a given injector.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np

from commonrail.base.choices import Actuation, Precision
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.solution import Solution
from commonrail.physics.injector import Injector
from commonrail.plugins.verification import closed_forms
from commonrail.plugins.verification.closed_forms import Check, check
from commonrail.plugins.verification.external import against_outside, load_outside, objective_and_scores
from commonrail.plugins.verification.study import RateLimits, Task, VolumeLimit, comparisons
from commonrail.readers.injector import injector_catalogue, load_injector

INTERVAL = 3e-6  # of a rate meter's samples [s]
# A batch ends once a valve train is at rest: what a relaxing SAC dribbles after that was 1e-5 mm³ at the most [mm³].
BATCH = 1e-4
INJECTS = 1e-12  # more than this is an injection [m³]
HOLES = ("control_chamber.z_hole_diameter", "control_chamber.a_hole_diameter")
DIRECT_HOLES = ("nozzle.hole_diameter",)  # of an injector without a control chamber
SHIFT = 5e-4  # the share by which they are moved
UNITS = {"rate, L1": "%", "volume": "%", "opening": "us", "closing": "us"}  # of the fields of `RateLimits`


class Difference(NamedTuple):
    """Lanes less reference: rate (L1) and volume [%], opening and closing [us].

    NaN where one has failed, they ended otherwise than each other, or nothing was injected.
    """

    rate: float
    volume: float
    opening: float
    closing: float


class Compared(NamedTuple):
    """Outcome of a task: single simulations in f64, and optionally in f32, against the reference.

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
    reference = simulate_reference(injector, point, INTERVAL, Resolution(method=task.method))
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
    if isinstance(task.limits, RateLimits):
        return math.nan
    holes = DIRECT_HOLES if task.injector.variant.actuation is Actuation.DIRECT else HOLES
    nominal = np.array([task.injector.values[name] for name in holes])
    shifts = SHIFT * np.array([sign * row for row in np.eye(len(holes)) for sign in (1.0, -1.0)])
    volume = simulate_batch(task.injector, [task.point], holes, nominal * (1.0 + shifts), threads=1).injected_volume[
        :, 0
    ]
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
) -> list[Check]:
    """Check the fast engine against the reference and both against independent figures.

    The injector is flexible, fed by an ideal rail and driven by PWM or regulator: the catalogue's "virtual-lino-2016".
    The injectors of the catalogue and figures of a program outside the project are compared too. `progress` is told
    after every comparison. Of each group of comparisons, batches, scores, figures from outside and closed forms the
    worst figure is returned.
    """
    tell = progress or (lambda _: None)
    outside = load_outside()
    tasks = comparisons(injector, quick, [load_injector(name) for name in injector_catalogue()])
    tell(f"comparing the engines: {len(tasks)} simulations by the reference")
    compared: list[Compared] = []
    with ProcessPoolExecutor(processes) as pool:
        for k, (task, comparison) in enumerate(zip(tasks, pool.map(compare, tasks), strict=True)):
            compared.append(comparison)
            tell(f"{k + 1} of {len(tasks)}: {task.group}")
        checks = checks_of(tasks, compared)
        tell("objective against scores")
        checks += objective_and_scores(injector)
        tell(f"figures from outside: {len(outside)} runs")
        checks += against_outside(outside, pool)
    for form in closed_forms.ALL:
        tell(form.__name__.replace("_", " "))
        checks += form(injector)
    return checks


def checks_of(tasks: Sequence[Task], compared: Sequence[Compared]) -> list[Check]:
    """The worst figures of each group, in the order in which the groups appear, then of the batches."""
    groups: dict[str, list[tuple[Task, Compared]]] = {}
    single: dict[str, list[Difference]] = {}
    for task, comparison in zip(tasks, compared, strict=True):
        groups.setdefault(task.group, []).append((task, comparison))
        if comparison.single is not None:
            single.setdefault(task.single, []).append(comparison.single)
    checks: list[Check] = []
    for group, members in groups.items():
        limits = members[0][0].limits
        if isinstance(limits, RateLimits):
            checks += _rate_checks(group, limits, [comparison.double for _, comparison in members])
        else:
            checks += [_volume_check(group, limit, members) for limit in limits]
    for group, differences in single.items():
        checks += _rate_checks(group, RateLimits(), differences)
    return [*checks, _batches(tasks, compared)]


def _rate_checks(group: str, limits: RateLimits, differences: Sequence[Difference]) -> Iterator[Check]:
    for (name, unit), limit, values in zip(UNITS.items(), limits, zip(*differences, strict=True), strict=True):
        size = np.abs(values)
        worst = float(np.max(size))  # NaN, where a needle did not close, fails
        detail = f"lanes at 1 us against the reference, median {np.median(size):.2g} {unit}, {len(size)} simulations"
        yield check(f"{group}: {name}", worst, limit, unit, detail)


def _volume_check(group: str, limit: VolumeLimit, members: Sequence[tuple[Task, Compared]]) -> Check:
    shares = np.array([100.0 * abs(comparison.gap) / limit.of(comparison.volume) for _, comparison in members])
    shares = np.where(np.isnan(shares), np.inf, shares)
    # the largest among the share that must keep the limit
    k = int(np.argsort(shares)[math.ceil(limit.share * len(shares)) - 1])
    task, worst = members[k]
    some = sum(comparison.volume > INJECTS for _, comparison in members)
    pressure, drive = task.point.at_start(task.point.rail_pressure), task.injector.variant.drive.value
    detail = (
        f"share of {limit.text}, median {np.median(shares):.2g} %, {len(shares)} simulations, of which {some} inject; "
        f"here {1e9 * abs(worst.gap):.2g} of {1e9 * worst.volume:.4g} mm³ at {1e-6 * pressure:.0f} MPa, {drive} drive, "
        f"where 1 % of a hole's diameter moves {worst.sensitivity:.0f} %"
    )
    of = "volume" if limit.share == 1.0 else f"volume of {100.0 * limit.share:g} % of them"
    return check(f"{group}: {of}", float(shares[k]), 100.0, "% of its limit", detail)


def _batches(tasks: Sequence[Task], compared: Sequence[Compared]) -> Check:
    gaps = np.array([1e9 * abs(comparison.batch) for comparison in compared])
    k = int(np.argmax(gaps))
    detail = (
        f"injected volume, early stop, {len(gaps)} simulations, worst: {tasks[k].group}; limit: what a SAC gives after "
        "its needle and valve have come to rest"
    )
    return check("simulate_batch against simulate", gaps[k], BATCH, "mm3", detail)
