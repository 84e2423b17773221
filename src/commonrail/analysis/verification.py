"""Does the code solve the equations it states? Every claim as a check with its figure and its limit.

The fast engine against the reference, which shares its laws but none of its scheme, and both against closed
forms (`commonrail.analysis.closed_forms`). Nothing here says that the equations describe a given injector.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis import closed_forms
from commonrail.analysis.closed_forms import Check, check
from commonrail.analysis.virtual_bench import PAPER_OPTIMUM
from commonrail.engine.lanes import Precision
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import simulate_reference
from commonrail.engine.simulate import simulate
from commonrail.engine.solution import Solution
from commonrail.injector.definition import Injector
from commonrail.injector.variants import Body, Boundary, Drive, Variant

Floats = NDArray[np.float64]

PRESSURES = (40e6, 80e6, 120e6, 160e6, 180e6)  # [Pa]
ENERGISING = 700e-6  # [s], as in the paper
HORIZON = 1.9e-3  # the needle has closed by then at all of them [s]
INTERVAL = 3e-6  # of a rate meter's samples [s]
CANDIDATES, BOX, SEED = 50, 0.6, 20160401  # random stiffnesses within ± 60 % at 160 MPa

# limits of a step of 1 us: L1 of the rate and volume [%], instants [us]
LIMITS = {"rate, L1": (0.1, "%"), "volume": (0.05, "%"), "opening": (0.5, "us"), "closing": (0.5, "us")}
SINGLE = "f32"  # group of the lanes in single precision: its rounding is far below the step's error
ROOM = {"rigid body": 2.0}  # times the limits: one mass meets its seat at full speed, no chain softens the blow


class Task(NamedTuple):
    """One comparison of the two engines."""

    group: str
    injector: Injector
    point: OperatingPoint
    precision: Precision = Precision.F64


class Difference(NamedTuple):
    """Lanes less reference: rate (L1) and volume [%], opening and closing [us]."""

    rate: float
    volume: float
    opening: float
    closing: float


def compare(task: Task) -> Difference:
    """Run both engines and tell how far apart they are.

    The rate's L1 is Σ|lanes − reference|/Σ|reference| over samples of `INTERVAL`, as a rate meter takes them.
    """
    reference = simulate_reference(task.injector, task.point, INTERVAL)
    fast = simulate(task.injector, task.point, sample_interval=INTERVAL, precision=task.precision)
    return difference(fast, reference)


def difference(fast: Solution, reference: Solution) -> Difference:
    """How far a solution lies from the reference, both with samples at the same bounds."""
    samples = min(len(fast.mass_rate), len(reference.mass_rate))
    gap = np.abs(fast.mass_rate[:samples] - reference.mass_rate[:samples])
    return Difference(
        100.0 * float(np.sum(gap) / np.sum(np.abs(reference.mass_rate))),
        100.0 * (fast.injected_mass / reference.injected_mass - 1.0),
        1e6 * (fast.opening - reference.opening),
        1e6 * (fast.closing - reference.closing),
    )


def comparisons(injector: Injector, quick: bool = False) -> list[Task]:
    """The comparisons of the study: named sets of stiffness, other wirings, single precision, random stiffnesses."""
    stiffnesses: dict[str, dict[str, float]] = {"injector as given": {}, "paper's optimal stiffness": PAPER_OPTIMUM}
    pressures, at = ((80e6, 160e6), "80 and 160 MPa") if quick else (PRESSURES, "40 to 180 MPa")
    tasks = [
        Task(f"{name}, {at}", injector.with_values(values), _point(pressure))
        for name, values in stiffnesses.items()
        for pressure in pressures
    ]
    wirings = {"rigid body": injector.variant._replace(body=Body.RIGID), "rail volume": _at_a_volume(injector)}
    tasks += [Task(f"{name}, 160 MPa", replace(injector, variant=v), _point(160e6)) for name, v in wirings.items()]
    tasks += [Task(f"{SINGLE}, {at}", injector, _point(pressure), Precision.F32) for pressure in pressures]
    count = 4 if quick else CANDIDATES
    group = f"{count} random stiffnesses within ± {100 * BOX:.0f} %, 160 MPa"
    return tasks + [Task(group, injector.with_values(values), _point(160e6)) for values in _random(injector, count)]


def verify(
    injector: Injector,
    progress: Callable[[str], None] | None = None,
    processes: int | None = None,
    quick: bool = False,
) -> list[Check]:
    """Check the fast engine against the reference and both against closed forms.

    Parameters
    ----------
    injector : Injector
        Flexible, fed by an ideal rail and driven by PWM or regulator: the catalogue's "virtual-lino-2016".
    progress : function of str, optional
        Told after every comparison.
    processes : int, optional
        Processes for the reference runs; all usable processors by default.
    quick : bool
        Fewer pressures and candidates.

    Returns
    -------
    list of Check
        The worst figure of each group of comparisons, then the closed forms.
    """
    tell = progress or (lambda text: None)
    tasks = comparisons(injector, quick)
    tell(f"comparing the engines: {len(tasks)} simulations by the reference")
    found: dict[str, list[Difference]] = {}
    with ProcessPoolExecutor(processes) as pool:
        for k, (task, one) in enumerate(zip(tasks, pool.map(compare, tasks), strict=True)):
            found.setdefault(task.group, []).append(one)
            tell(f"{k + 1} of {len(tasks)}: {task.group}")
    checks = [line for group, differences in found.items() for line in _worst(group, differences)]
    for form in closed_forms.ALL:
        tell(form.__name__.replace("_", " "))
        checks += form(injector)
    return checks


def _worst(group: str, differences: Sequence[Difference]) -> Iterator[Check]:
    room = max((times for name, times in ROOM.items() if group.startswith(name)), default=1.0)
    for (name, (limit, unit)), values in zip(LIMITS.items(), zip(*differences, strict=True), strict=True):
        size = np.abs(values)
        worst = float(np.max(size))  # NaN, where a needle did not close, fails
        detail = f"lanes at 1 us against the reference, median {np.median(size):.2g} {unit}, {len(size)} simulations"
        yield check(f"{group}: {name}", worst, room * limit, unit, detail)


def _point(rail_pressure: float) -> OperatingPoint:
    return OperatingPoint(rail_pressure, ENERGISING, horizon=HORIZON)


def _at_a_volume(injector: Injector) -> Variant:
    return injector.variant._replace(boundary=Boundary.VOLUME, drive=Drive.REGULATED)


def _random(injector: Injector, count: int) -> Iterator[dict[str, float]]:
    rng = np.random.default_rng(SEED)
    for factors in rng.uniform(1.0 - BOX, 1.0 + BOX, (count, len(PAPER_OPTIMUM))):
        yield {k: injector.values[k] * float(x) for k, x in zip(PAPER_OPTIMUM, factors, strict=True)}


__all__ = ["Check", "Difference", "Task", "compare", "comparisons", "difference", "verify"]
