"""Subject of a page: an injector, and of a run its data, its free parameters and the fits near its best one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from commonrail.base.arguments import COUNTS
from commonrail.base.arrays import Floats
from commonrail.base.choices import Drive
from commonrail.base.errors import ConfigurationError, InputError, nearest
from commonrail.base.hooks import note as tell
from commonrail.calibration.goal import Goal
from commonrail.calibration.influence import around
from commonrail.calibration.objective import Objective
from commonrail.calibration.parameter import Priors
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Role
from commonrail.data.curves.data import RateData
from commonrail.data.kinds import of_role
from commonrail.data.metering import with_meters
from commonrail.data.quantities.data import QuantityData
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.meters import is_of_meter
from commonrail.plugins.certainty.posterior.file import POSTERIOR, RefusedDrawsError, read_posterior
from commonrail.runs.folder import RESULT, read_fit
from commonrail.runs.model_name import read_model_name

# Fan of a page: several fits that explain the data almost as well as the best one, or parts that scatter.

MEMBERS = 16
TRIED = 128  # directions, of which the bounds and orders of a study may stop many at once
WORSE = 0.05  # share by which the objective of a member may exceed that of the best fit
SCATTER = 0.05  # of the parameters of a model of which nothing was fitted
SEED = 1
HALVINGS = 12  # of the distance at which the objective is to be met
FLOOR = 1e-3  # smallest share of the largest curvature: beyond it a direction is as good as free


@dataclass(frozen=True)
class Fan:
    """Members of a fan.

    Attributes
    ----------
    short, note : str
        Text of the legend, and a sentence that says what the members are.
    names : tuple of str
        Dotted names of the parameters in which they differ.
    members : (members, names)
        [SI].
    """

    short: str
    note: str
    names: tuple[str, ...]
    members: Floats


def scattered(names: tuple[str, ...], values: Floats, injector: Injector) -> Fan | None:
    """Parts whose parameters scatter about their values, at random.

    Parameters
    ----------
    names : tuple of str
    values : (names,)
        [SI].
    injector : Injector
        Its domains bound what may be drawn.
    """
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
    """Draws from the posterior of a run if it has one that may be used, else fits little worse than the best one.

    Parameters
    ----------
    run : Path
    study : Study
    best : mapping of str to float
        [SI].
    threads : int, optional

    Raises
    ------
    InputError
        If posterior.npz is damaged.
    """
    names = tuple(study.space.names)
    if (run / POSTERIOR).is_file():
        try:
            draws = read_posterior(run, names)
        except RefusedDrawsError as error:
            tell(f"{error} The page shows fits near the best one instead.")
        else:
            chosen = draws[np.linspace(0, len(draws) - 1, MEMBERS).astype(int)]
            note = f"Fan: {len(chosen)} draws of the {len(draws)} from the posterior of the run."
            return _of_injector(Fan("draws", note, names, chosen))
    found = _on_level(study, np.array([best[name] for name in names]), threads)
    if found is None:
        return None
    note = (
        f"Fan: {len(found)} fits whose objective on the fitted data is at most {WORSE:.0%} above that of the best fit, "
        f"the farthest in {TRIED} random directions of equal curvature (seed {SEED})."
    )
    return _of_injector(Fan(f"fits within {WORSE:.0%}", note, names, found))


def _of_injector(fan: Fan) -> Fan | None:
    """The same fan without the quantities of meters, which no simulated flow depends on."""
    own = [i for i, name in enumerate(fan.names) if not is_of_meter(name)]
    if not own:
        return None
    return Fan(fan.short, fan.note, tuple(fan.names[i] for i in own), fan.members[:, own])


def _on_level(study: Study, best: Floats, threads: int | None) -> Floats | None:
    """Fits (members, d) [SI] at or just below the level of the objective, None where the best cannot be simulated."""
    goal = Goal(study.loss, Priors.of(study.space.parameters), scale=study.loss_scale)
    fitted, space = of_role(study.data, Role.FIT), study.space
    objective = Objective(
        study.injector, space.names, fitted, study.time_step, threads, goal=goal, same_bits=study.same_bits
    )
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
    """Random directions (tried, d) of equal curvature of the squares, the largest component of each being 1."""
    _, sizes, axes = np.linalg.svd(slopes, full_matrices=False)
    sizes = np.maximum(sizes, FLOOR * sizes[0])
    drawn = random.standard_normal((TRIED, len(sizes)))
    directions = (drawn / np.linalg.norm(drawn, axis=1, keepdims=True) / sizes) @ axes
    return np.asarray(directions / np.abs(directions).max(axis=1, keepdims=True))


# Sliders of a model of which nothing was fitted, those that it has; each may be moved by this share of its value.
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
class Slid:
    """Parameter on a slider: dotted name and ends [SI]."""

    name: str
    low: float
    high: float


@dataclass(frozen=True)
class Subject:
    """Content of a page before it is put into numbers.

    Attributes
    ----------
    title : str
    injector : Injector
        With the calibrated values of a run.
    sliders : tuple of Slid
        Those of a run's free parameters first.
    time_step : float
        [s].
    start : dict of str to float
        Start values of a run's free parameters [SI]; empty for a model.
    data : tuple of RateData
        Injection curves of a run.
    synthetic : tuple of str
        Sentences about what is not measured.
    fan : Fan or None
        Fits near the best one.
    space : Space or None
        Of a run, whose linear constraints its sliders keep.
    maps : tuple of QuantityData
        Quantity maps of a run, without those of the quantity that returns.
    """

    title: str
    injector: Injector
    sliders: tuple[Slid, ...]
    time_step: float
    start: dict[str, float]
    data: tuple[RateData, ...]
    synthetic: tuple[str, ...]
    fan: Fan | None
    space: Space | None = None
    maps: tuple[QuantityData, ...] = ()

    @property
    def points(self) -> list[OperatingPoint]:
        """Operating points of all data."""
        return [d.point for d in self.data] + [point for d in self.maps for point in d.points]


def read_subject(text: str, more: tuple[str, ...] = (), threads: int | None = None) -> Subject:
    """Subject that the command line names.

    Parameters
    ----------
    text : str
        A run folder, an injector's file or a name of the catalogue, as `read_model_name` takes them.
    more : tuple of str
        Dotted names of further parameters for sliders.
    threads : int, optional
        That simulate the fits near the best one.

    Raises
    ------
    InputError
        If it cannot be read, or there is no such parameter.
    ConfigurationError
        If the injector follows a measured voltage or current, and there are no data that hold it.
    """
    run = Path(text)
    if run.is_dir() and (run / RESULT).is_file():
        return _of_run(run, more, threads)
    named = read_model_name(text)
    if is_traced(named.injector):
        raise ConfigurationError(
            f"{named.injector.name} follows a measured {named.injector.variant.drive.value}, which the file does not "
            "hold; make the page from a run folder, whose data have it."
        )
    sliders = _with_more(named.injector, _around(named.injector, USUAL), more)
    names = tuple(s.name for s in sliders)
    values = np.array([named.injector.values[name] for name in names])
    injector = named.injector
    notes = (injector.synthetic,) if injector.synthetic else ()
    fan = scattered(names, values, injector)
    return Subject(injector.title, injector, sliders, DEFAULT_STEP, {}, (), notes, fan)


def _of_run(run: Path, more: tuple[str, ...], threads: int | None) -> Subject:
    study, best = read_fit(run)
    own = {name: value for name, value in best.items() if not is_of_meter(name)}
    injector = study.injector.with_values(own)
    meters = [d.meter.with_best(best) for d in study.data if d.meter is not None]
    metered = with_meters(study.data, meters)
    data, maps = _curves(metered), () if is_traced(injector) else _maps(metered)
    if is_traced(injector) and not data:
        raise ConfigurationError(
            f"{injector.name} follows a measured {injector.variant.drive.value}, and the run has no injection curve "
            "that holds it; a page of this run cannot be made."
        )
    sliders = _with_more(injector, _bounded(study.space, own), more)
    start = {p.name: p.reference for p in study.space.parameters if p.name in own}
    fan = near_fits(run, study, best, threads)
    notes = tuple(dict.fromkeys(note for note in (injector.synthetic, *(d.synthetic for d in (*data, *maps))) if note))
    return Subject(study.title, injector, sliders, study.time_step, start, data, notes, fan, study.space, maps)


def _curves(data: tuple[DataSet, ...]) -> tuple[RateData, ...]:
    """Injection curves, those of the fit first."""
    curves = [d for d in data if isinstance(d, RateData)]
    return tuple(sorted(curves, key=lambda d: d.role is not Role.FIT))


def _maps(data: tuple[DataSet, ...]) -> tuple[QuantityData, ...]:
    """Maps of the injected quantity of single injections at constant pressures, those of the fit first."""
    maps = [d for d in data if isinstance(d, QuantityData) and d.kind == QuantityData.kind]
    return tuple(sorted((d for d in maps if all(map(_is_plain, d.points))), key=lambda d: d.role is not Role.FIT))


def _is_plain(point: OperatingPoint) -> bool:
    courses = (point.rail_pressure, point.cylinder_pressure, point.return_pressure, point.drive)
    return len(point.pulses) == 1 and not any(isinstance(course, Trace) for course in courses)


def is_traced(injector: Injector) -> bool:
    """Return whether the coil follows a measured voltage or current."""
    return injector.variant.drive in (Drive.VOLTAGE, Drive.CURRENT)


def _bounded(space: Space, best: dict[str, float]) -> tuple[Slid, ...]:
    """Free parameters between their bounds."""
    return tuple(
        Slid(p.name, min(p.lower, best[p.name]), max(p.upper, best[p.name]))
        for p in space.parameters
        if p.name in best and p.name != FUEL_TEMPERATURE
    )


def _around(injector: Injector, names: tuple[str, ...]) -> tuple[Slid, ...]:
    """Parameters that the injector has, `SHARE` to both sides of their values."""
    known = {name: injector.values[name] for name in names if injector.values.get(name)}
    ends = {name: sorted(((1.0 - SHARE) * value, (1.0 + SHARE) * value)) for name, value in known.items()}
    return tuple(Slid(name, low, high) for name, (low, high) in ends.items())


def _with_more(injector: Injector, sliders: tuple[Slid, ...], more: tuple[str, ...]) -> tuple[Slid, ...]:
    """Sliders and those that were asked for besides, each once."""
    for name in more:
        if name not in injector.quantities or name == FUEL_TEMPERATURE:
            known = [path for path in injector.quantities if path != FUEL_TEMPERATURE]
            raise InputError(
                f"{name}: the injector has no such parameter for a slider{nearest(name, known)}; "
                "`commonrail catalogue parameters` lists them."
            )
        if name in COUNTS:
            raise InputError(f"{name} counts pieces, so a slider cannot move it; set it in the injector's file.")
        if not injector.values[name]:
            raise InputError(f"{name} is zero, which gives its slider no range; choose a parameter with a value.")
    had = {s.name for s in sliders}
    return sliders + _around(injector, tuple(name for name in dict.fromkeys(more) if name not in had))
