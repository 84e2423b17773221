"""Checks that the code solves its equations, each with a value and a limit.

The fast engine is compared with the reference, which shares its laws but not its scheme, at the points of `study`; its
batches with its single simulations; the objective with the reported scores; both engines with an independent program
(`external`); and all with closed forms (`closed_forms`). The checks do not show that the equations describe a given
injector.
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
# A batch ends once the valve train is at rest; the SAC then dribbled at most 1e-5 mm³ [mm³].
BATCH = 1e-4
INJECTS = 1e-12  # smallest injection [m³]
HOLES = ("control_chamber.z_hole_diameter", "control_chamber.a_hole_diameter")
DIRECT_HOLES = ("nozzle.hole_diameter",)  # of an injector without a control chamber
SHIFT = 5e-4  # relative change of the holes
UNITS = {"rate, L1": "%", "volume": "%", "opening": "us", "closing": "us"}  # of the fields of `RateLimits`


class Difference(NamedTuple):
    """Fast engine minus reference: rate (L1) and volume [%], opening and closing [us].

    NaN if one of them failed, their statuses differ, or nothing was injected.
    """

    rate: float
    volume: float
    opening: float
    closing: float


class Compared(NamedTuple):
    """Outcome of a task: single simulations in f64, and optionally in f32, against the reference.

    `volume`: injected by the reference [m³]; `gap`: fast engine minus reference [m³]; `batch`: `simulate_batch` minus
    `simulate` [m³]; NaN for failures. `sensitivity`: change of the injected volume [%] for 1 % of the diameter of the
    Z- or A-hole (the larger one) or of the nozzle holes; NaN for tasks with limits on the rate.
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
        double=difference(double, reference),
        single=difference(single, reference) if single else None,
        volume=reference.injected_volume,
        gap=_sound(double, reference) * (double.injected_volume - reference.injected_volume),
        batch=_sound(double) * float(batch.injected_volume[0, 0]) - double.injected_volume,
        sensitivity=_sensitivity(task),
    )


def _sound(*solutions: Solution) -> float:
    """1, or NaN if one of them failed or their statuses differ."""
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
    """Distance of a solution from the reference, sampled at equal bounds."""
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

    The injector is flexible with an ideal rail and a PWM or regulated drive, such as "virtual-lino-2016". Injectors of
    the catalogue and the results of an independent program are compared too. `progress` is called after every
    comparison. Returns the worst value of each group.
    """
    report = progress or (lambda _: None)
    outside = load_outside()
    tasks = comparisons(injector, quick, [load_injector(name) for name in injector_catalogue()])
    report(f"comparing the engines: {len(tasks)} simulations by the reference")
    compared: list[Compared] = []
    with ProcessPoolExecutor(processes) as pool:
        for k, (task, comparison) in enumerate(zip(tasks, pool.map(compare, tasks), strict=True)):
            compared.append(comparison)
            report(f"{k + 1} of {len(tasks)}: {task.group}")
        checks = check_groups(tasks, compared)
        report("objective against scores")
        checks += objective_and_scores(injector)
        report(f"independent program: {len(outside)} runs")
        checks += against_outside(outside, pool)
    for form in closed_forms.ALL:
        report(form.__name__.replace("_", " "))
        checks += form(injector)
    return checks


def check_groups(tasks: Sequence[Task], compared: Sequence[Compared]) -> list[Check]:
    """Worst values of each group, in order of appearance, then of the batches."""
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
        worst = float(np.max(size))  # NaN (a needle that did not close) fails
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
        f"where a 1 % larger hole diameter changes it by {worst.sensitivity:.0f} %"
    )
    of = "volume" if limit.share == 1.0 else f"volume of {100.0 * limit.share:g} % of them"
    return check(f"{group}: {of}", float(shares[k]), 100.0, "% of its limit", detail)


def _batches(tasks: Sequence[Task], compared: Sequence[Compared]) -> Check:
    gaps = np.array([1e9 * abs(comparison.batch) for comparison in compared])
    k = int(np.argmax(gaps))
    detail = (
        f"injected volume, early stop, {len(gaps)} simulations, worst: {tasks[k].group}; difference: flow from the "
        "sac after needle and valve have come to rest"
    )
    return check("simulate_batch against simulate", gaps[k], BATCH, "mm3", detail)
