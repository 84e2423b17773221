"""Subject of a page: an injector; for a run also its data, its free parameters and fits near the best fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from commonrail.base.arguments import COUNTS
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError, nearest
from commonrail.base.text import number
from commonrail.calibration.identifiability import plain_objective
from commonrail.calibration.influence import around
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study
from commonrail.cli.model_name import read_model_name
from commonrail.data.base import DataSet, Role
from commonrail.data.curves.data import RateData
from commonrail.data.metering import with_meters
from commonrail.data.quantities.data import QuantityData
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.plan import candidate_matrix
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.time_step import DEFAULT_STEP, longest_step, medium_of, stiffest_corner
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.meters import is_of_meter
from commonrail.physics.variants import Variant
from commonrail.runs.folder import DRAWS, RESULT, read_draws, read_fit, read_result

# Fan of a page: several fits that explain the data almost as well as the best one, or parts that scatter.

MEMBERS = 16
TRIED = 128  # random directions; bounds and orders of a study may block many
WORSE = 0.05  # share by which the objective of a member may exceed that of the best fit
SCATTER = 0.05  # relative scatter of the parameters of a model that was not fitted
SEED = 1
HALVINGS = 12  # bisection steps for the distance at which the objective reaches the level
FLOOR = 1e-3  # smallest slope relative to the largest; directions with smaller slopes count as free


@dataclass(frozen=True)
class Fan:
    """Members of a fan (members, names) [SI] in the parameters of these dotted names.

    `short` is the text of the legend, `note` a sentence on the members.
    """

    short: str
    note: str
    names: tuple[str, ...]
    members: Floats


def scatter_parts(names: tuple[str, ...], values: Floats, injector: Injector) -> Fan | None:
    """Parts with random parameters around values (names,) [SI]; None if a parameter leaves its domain."""
    if not names:
        return None
    random = np.random.default_rng(SEED)
    members = values * (1.0 + random.uniform(-SCATTER, SCATTER, (MEMBERS, len(names))))
    inside = all(
        injector.quantities[name].domain.admits(column).all() for name, column in zip(names, members.T, strict=True)
    )
    if not inside:
        return None
    note = (
        f"Fan: {MEMBERS} parts whose parameters on sliders scatter by ±{SCATTER:.0%} about the file's values, evenly, "
        f"at random (seed {SEED}); an assumption, no measured scatter."
    )
    return Fan(f"±{SCATTER:.0%} scatter", note, names, members)


def near_fits(run: Path, study: Study, best: Mapping[str, float], threads: int | None = None) -> Fan | None:
    """Draws from the posterior of a run if it has one that may be used, else fits little worse than the best one [SI].

    InputError if draws.npz is damaged.
    """
    names = tuple(study.space.names)
    if (run / DRAWS).is_file():
        draws = read_draws(run, names)
        members = draws[np.linspace(0, len(draws) - 1, MEMBERS).astype(int)]
        note = f"Fan: {len(members)} draws of the {len(draws)} from the posterior of the run."
        return _of_injector(Fan("draws", note, names, members))
    members = _on_level(study, np.array([best[name] for name in names]), threads)
    if members is None:
        return None
    note = (
        f"Fan: {len(members)} fits, the farthest of {TRIED} in random directions of equal curvature (seed {SEED}); "
        f"their objective on the fitted data exceeds the objective of the best fit by at most {WORSE:.0%}."
    )
    return _of_injector(Fan(f"fits within {WORSE:.0%}", note, names, members))


def _of_injector(fan: Fan) -> Fan | None:
    """The fan without parameters of meters, which do not affect simulated flows."""
    of_injector = [i for i, name in enumerate(fan.names) if not is_of_meter(name)]
    if not of_injector:
        return None
    return Fan(fan.short, fan.note, tuple(fan.names[i] for i in of_injector), fan.members[:, of_injector])


def _on_level(study: Study, best: Floats, threads: int | None) -> Floats | None:
    """Fits (members, d) [SI] at or just below the level of the objective; None if the best fit cannot be simulated."""
    objective, space = plain_objective(study, threads), study.space
    level = (1.0 + WORSE) * float(objective.costs(best[None]).costs[0])
    place = around(space, best)
    residuals = objective.residuals(place.values)
    if not (np.isfinite(level) and np.isfinite(residuals).all()):
        return None
    directions = _directions(place.slopes(residuals), np.random.default_rng(SEED))
    unit = space.to_unit(best)
    inside, outside = np.zeros(TRIED), np.ones(TRIED)
    for _ in range(HALVINGS):
        middle = 0.5 * (inside + outside)
        candidates = space.from_unit(np.clip(unit + middle[:, None] * directions, 0.0, 1.0))
        good = (objective.costs(candidates).costs <= level) & space.satisfies(candidates)
        inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
    farthest = np.sort(np.argsort(-inside, kind="stable")[:MEMBERS])
    return np.asarray(space.from_unit(np.clip(unit + inside[farthest, None] * directions[farthest], 0.0, 1.0)))


def _directions(slopes: Floats, random: np.random.Generator) -> Floats:
    """Random directions (tried, d) of equal curvature of the sum of squares; their largest component is 1."""
    _, sizes, axes = np.linalg.svd(slopes, full_matrices=False)
    sizes = np.maximum(sizes, FLOOR * sizes[0])
    drawn = random.standard_normal((TRIED, len(sizes)))
    directions = (drawn / np.linalg.norm(drawn, axis=1, keepdims=True) / sizes) @ axes
    return np.asarray(directions / np.abs(directions).max(axis=1, keepdims=True))


# Sliders of a model without a fit, as far as it has these parameters; each moves by this share of its value.
USUAL = (
    "valve.spring_preload",
    "valve.lift",
    "control_chamber.z_hole_diameter",
    "control_chamber.a_hole_diameter",
    "nozzle.hole_diameter",
    "needle_seat.diameter",
    "plunger_needle.spring_preload",
    "feed_pipe.length",
    "armature.spring_preload",
    "armature.travel",
)
SHARE = 0.3


@dataclass(frozen=True)
class Slider:
    """Parameter on a slider: dotted name and ends [SI]."""

    name: str
    low: float
    high: float


@dataclass(frozen=True)
class Subject:
    """Content of a page before it is encoded.

    The injector of a run has the calibrated values. The run's free parameters are the first sliders; `start` holds
    their start values [SI] and is empty for a model. `time_step` is in s. `synthetic` states which data are not
    measured, `fan` has fits near the best fit. The sliders of a run satisfy the linear constraints of `space`. `data`
    are a run's injection curves, `maps` its maps of injected quantities. If the run has `effects` of parameters on the
    fitted data, they order the sliders.
    """

    title: str
    injector: Injector
    sliders: tuple[Slider, ...]
    time_step: float
    start: dict[str, float]
    data: tuple[RateData, ...]
    synthetic: tuple[str, ...]
    fan: Fan | None
    space: Space | None = None
    maps: tuple[QuantityData, ...] = ()
    effects: Mapping[str, float] = field(default_factory=dict)

    @property
    def points(self) -> list[OperatingPoint]:
        """Operating points of all data."""
        return [d.point for d in self.data] + [point for d in self.maps for point in d.points]


def read_subject(
    text: str,
    more: tuple[str, ...] = (),
    threads: int | None = None,
    with_fan: bool = True,
    changed: Callable[[Injector], Injector] = lambda injector: injector,
) -> Subject:
    """Subject named on the command line: a run folder, an injector file or a name of the catalogue.

    `more`: dotted names of further parameters for sliders; `with_fan`: add fits near the best fit of a run, simulated
    with `threads`; `changed`: change of the injector on a page without data. InputError if the subject cannot be read,
    or a parameter does not exist; ConfigurationError if the injector follows a measured voltage or current that no data
    contain.
    """
    run = Path(text)
    if run.is_dir() and (run / RESULT).is_file():
        return _of_run(run, more, threads, with_fan)
    model = read_model_name(text)
    if model.injector.variant.drive.is_trace:
        raise ConfigurationError(
            f"{model.injector.name} follows a measured {model.injector.variant.drive.value}, which the file does not "
            "hold; make the page from a run folder, whose data have it."
        )
    injector = changed(model.injector)
    sliders = _with_more(injector, _around(injector, USUAL), more)
    names = tuple(s.name for s in sliders)
    values = np.array([injector.values[name] for name in names])
    notes = (injector.synthetic,) if injector.synthetic else ()
    fan = scatter_parts(names, values, injector)
    return Subject(injector.title, injector, sliders, DEFAULT_STEP, {}, (), notes, fan)


def _of_run(run: Path, more: tuple[str, ...], threads: int | None, with_fan: bool) -> Subject:
    study, best = read_fit(run)
    calibrated = {name: value for name, value in best.items() if not is_of_meter(name)}
    injector = study.injector.with_values(calibrated)
    meters = [d.meter.with_best(best) for d in study.data if d.meter is not None]
    metered = with_meters(study.data, meters)
    data, maps = _curves(metered), () if injector.variant.drive.is_trace else _maps(metered)
    if injector.variant.drive.is_trace and not data:
        raise ConfigurationError(
            f"{injector.name} follows a measured {injector.variant.drive.value}, and the run has no injection curve "
            "that holds it; a page of this run cannot be made."
        )
    sliders = _with_more(injector, _bounded_sliders(study.space, calibrated), more)
    start = {p.name: p.reference for p in study.space.parameters if p.name in calibrated}
    effects = {str(p["name"]): e for p in read_result(run)["parameters"] if (e := number(p.get("effect"))) is not None}
    fan = near_fits(run, study, best, threads) if with_fan else None
    notes = tuple(dict.fromkeys(note for note in (injector.synthetic, *(d.synthetic for d in (*data, *maps))) if note))
    return Subject(study.title, injector, sliders, study.time_step, start, data, notes, fan, study.space, maps, effects)


def _curves(data: tuple[DataSet, ...]) -> tuple[RateData, ...]:
    """Injection curves, fitted ones first."""
    curves = [d for d in data if isinstance(d, RateData)]
    return tuple(sorted(curves, key=lambda d: d.role is not Role.FIT))


def _maps(data: tuple[DataSet, ...]) -> tuple[QuantityData, ...]:
    """Maps of the injected quantity of single injections at constant pressures, fitted ones first."""
    maps = [d for d in data if isinstance(d, QuantityData) and d.kind == QuantityData.kind]
    return tuple(sorted((d for d in maps if all(map(_is_plain, d.points))), key=lambda d: d.role is not Role.FIT))


def _is_plain(point: OperatingPoint) -> bool:
    courses = (point.rail_pressure, point.cylinder_pressure, point.return_pressure, point.drive)
    return len(point.pulses) == 1 and not any(isinstance(course, Trace) for course in courses)


def _bounded_sliders(space: Space, best: dict[str, float]) -> tuple[Slider, ...]:
    """Free parameters between their bounds."""
    return tuple(
        Slider(p.name, min(p.lower, best[p.name]), max(p.upper, best[p.name]))
        for p in space.parameters
        if p.name in best and p.name != FUEL_TEMPERATURE
    )


def _around(injector: Injector, names: tuple[str, ...]) -> tuple[Slider, ...]:
    """Parameters that the injector has, `SHARE` to both sides of their values."""
    values = {name: injector.values[name] for name in names if injector.values.get(name)}
    ends = {name: sorted(((1.0 - SHARE) * value, (1.0 + SHARE) * value)) for name, value in values.items()}
    return tuple(Slider(name, low, high) for name, (low, high) in ends.items())


def _with_more(injector: Injector, sliders: tuple[Slider, ...], more: tuple[str, ...]) -> tuple[Slider, ...]:
    """Sliders and the additional ones asked for, each once."""
    for name in more:
        if name not in injector.quantities or name == FUEL_TEMPERATURE:
            candidates = [path for path in injector.quantities if path != FUEL_TEMPERATURE]
            raise InputError(
                f"{name}: the injector has no such parameter for a slider{nearest(name, candidates)}; "
                "`commonrail catalogue parameters` lists them."
            )
        if name in COUNTS:
            raise InputError(f"{name} counts pieces, so a slider cannot move it; set it in the injector's file.")
        injector.check_read([name])
        if not injector.values[name]:
            raise InputError(f"{name} is zero, which gives its slider no range; choose a parameter with a value.")
    had = {s.name for s in sliders}
    return sliders + _around(injector, tuple(name for name in dict.fromkeys(more) if name not in had))


# Ends of the sliders, narrowed where the time step would be unstable in a corner of them.

ONE = np.empty((1, 0))  # one candidate: the unchanged injector
RAIL = (25e6, 200e6)  # ends of the sliders as far as the fuel's range reaches [Pa]
CYLINDER, RETURN = (0.1e6, 20e6), (0.05e6, 3e6)
ENERGISING, DWELL = (50e-6, 3e-3), (20e-6, 4e-3)  # [s]
LONG = 1.5e-3  # energising time with the largest needle lift [s]
LIFTED = 1.25  # margin on the largest lift, which reduces the volume of the control chamber
SHRUNK = 24  # bisection steps for the share of the sliders' ranges with a stable time step


def variant_of(subject: Subject) -> Variant:
    """Variant of the model on a page, with the laws that moved sliders may need."""
    return subject.injector.wired([s.name for s in subject.sliders])


def limits_of(subject: Subject, point: OperatingPoint) -> dict[str, tuple[float, float]]:
    """Ends of the sliders of the operating point [SI]; the ranges contain `point` and the points of the data."""
    low, high = subject.injector.fuel.pressure_range
    points = [point, *subject.points]
    rails, cylinders, returns = np.array([p.initial_pressures() for p in points]).T

    def ends(usual: tuple[float, float], used: Floats) -> tuple[float, float]:
        return max(min(usual[0], used.min()), low), min(max(usual[1], used.max()), high)

    limits = {"rail": ends(RAIL, rails), "cylinder": ends(CYLINDER, cylinders), "low": ends(RETURN, returns)}
    below = 0.9 * limits["rail"][0]  # all other pressures are below the rail pressure
    for name in ("cylinder", "low"):
        limits[name] = limits[name][0], min(limits[name][1], below)
    return {name: (float(a), float(b)) for name, (a, b) in limits.items()} | {"energising": ENERGISING, "dwell": DWELL}


def stable_sliders(subject: Subject, rail: float) -> tuple[tuple[Slider, ...], float]:
    """Sliders with ranges narrowed until the time step is stable in every corner, and the share that remains."""
    injector, variant = subject.injector, variant_of(subject)
    medium, lift = medium_of(injector, rail), LIFTED * _largest_lift(subject, rail)

    def narrow_to(share: float) -> tuple[Slider, ...]:
        middles = [(s, injector.values[s.name]) for s in subject.sliders]
        return tuple(Slider(s.name, v + share * (s.low - v), v + share * (s.high - v)) for s, v in middles)

    def is_stable(share: float) -> bool:
        sliders = narrow_to(share)
        lower, upper = ({s.name: getattr(s, end) for s in sliders} for end in ("low", "high"))
        corner = replace(injector, values=stiffest_corner(injector.values, lower, upper), variant=variant)
        return subject.time_step <= longest_step(corner, candidate_matrix(corner, (), ONE)[0], medium, lift)

    if not is_stable(0.0):
        raise ConfigurationError(
            f"{injector.name}: the time step of {subject.time_step * 1e6:g} us is too long for it at "
            f"{rail * 1e-6:g} MPa, the highest rail pressure of the page; calibrate with a shorter time_step."
        )
    low, high = 0.0, 1.0
    if is_stable(high):
        return narrow_to(high), high
    for _ in range(SHRUNK):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_stable(middle) else (low, middle)
    return narrow_to(low), low


def _largest_lift(subject: Subject, rail: float) -> float:
    """Largest lift [m] of the unchanged injector at the highest rail pressure."""
    points = (
        [d.point for d in subject.data] if subject.injector.variant.drive.is_trace else [OperatingPoint(rail, LONG)]
    )
    return float(np.nanmax(simulate_batch(subject.injector, points, time_step=subject.time_step).greatest_lift))
