"""Adapt a type of injector to one part by a few reference quantities measured on the part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from commonrail.base.arguments import file_path, fraction, instance, instances, integer, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError, SimulationError
from commonrail.base.hooks import note
from commonrail.base.units import parse, to_text
from commonrail.calibration.objective import Loss
from commonrail.calibration.optimisers.staged import StagedSettings
from commonrail.calibration.run import Calibration, calibrate
from commonrail.calibration.search import Progress
from commonrail.calibration.space import Space, sample_priors
from commonrail.calibration.study import Method, Study, step_for_all
from commonrail.data.quantities.data import QuantityData
from commonrail.data.quantities.reading import AFTER_ENERGISING, QuantitiesModel, map_columns
from commonrail.data.study_block import Context
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.status import OK, check_point
from commonrail.physics.injector import Injector, Source, parameter_quantities
from commonrail.physics.law import Domain
from commonrail.plugins.family.drawn import (
    DRAWS,
    FACTORS,
    FLOW,
    FLOW_SPREAD,
    Doubts,
    at_point,
    describe_missed_references,
    describe_no_injection,
    describe_shut_points,
    explain_by_one_change,
    find_doubts,
    flow_about_drawing,
    parameters_with_priors,
    scattering_parameters,
)
from commonrail.plugins.family.from_results import OF_PART
from commonrail.plugins.family.injector_type import InjectorType, load_type
from commonrail.readers.columns import Column
from commonrail.readers.injector import load_injector
from commonrail.readers.location import Place, Reach

FAR, ANYWAY = 0.5, 1e-9  # an adapted model may miss a reference by this share or by this volume [m³]
FEWEST_FOR_PRIORS = 2  # with this many references the type's parameters are fitted too, with spreads as priors
TOLERANCE = 0.015  # relative, of reference quantities, in addition to 0.05 mm³: an estimate
MEMBERS, MOVES = 64, 24  # candidates screened, and iterations after the screening


@dataclass(frozen=True)
class Adapted:
    """Model of one part.

    Attributes
    ----------
    injector : Injector
        The model; its changed values are marked F and name the type and the data.
    flow_factor : float
        Effective area of the nozzle's holes over its value by the drawing and the type [1].
    before, after : (points,)
        Quantities of the type's injector and of the adapted one at the reference points [m³].
    points : QuantityData
        Reference quantities.
    calibration : Calibration
        The fit of the model.
    doubts : Doubts
        Reasons to doubt that the part is a sound part of the type.
    limits : tuple of str
        Warnings about references that the model misses, and about points where it injects nothing.
    """

    injector: Injector
    flow_factor: float
    before: Floats
    after: Floats
    points: QuantityData
    calibration: Calibration
    doubts: Doubts
    limits: tuple[str, ...] = ()


def adapt(
    injector_type: InjectorType | str | Path,
    points: QuantityData | str | Path,
    *,
    injector: Injector | str | Path | None = None,
    cylinder_pressure: float | str = "5 MPa",
    return_pressure: float | str = "0.5 MPa",
    tolerance: float | str = TOLERANCE,
    flow_spread: float | str = FLOW_SPREAD,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Adapted:
    """Fit the model of a type to reference quantities of one part.

    One quantity determines the flow factor: effective area of the nozzle's holes relative to the drawing. The factor
    has no prior then, and the quantity is met exactly. With two or more quantities, the parameters of the type are
    fitted too. Each parameter and the flow have their value and spread as prior. A warning names references that the
    model misses by more than their tolerance, and points of its map where it injects nothing.

    Parameters
    ----------
    injector_type : InjectorType or path
        The type, or its file.
    points : QuantityData or path
        Reference quantities, or a CSV file with columns rail_pressure, energising_time and quantity.
    injector : Injector, name or path, optional
        The part. Its nozzle, line and measured values (mark M) are used; all other values are the type's. By default
        the type's injector.
    cylinder_pressure, return_pressure : float or str
        [Pa] of the points of a file.
    tolerance : float or str
        Relative tolerance of the quantities of a file (scatter and error of the bench), in addition to 0.05 mm³.
    flow_spread : float or str
        Relative standard deviation of the nozzles' flow about their drawing.
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    progress : function of Progress, optional

    Returns
    -------
    Adapted

    Raises
    ------
    InputError
        If a file cannot be read, the injector is missing, the flow factor would lie outside 0.6 to 1.6, or the model
        misses a reference quantity by more than 1 mm³ and half of the quantity.
    ConfigurationError
        If an argument has the wrong type.
    SimulationError
        If no candidate could be simulated.
    """
    part_type = injector_type if isinstance(injector_type, InjectorType) else load_type(injector_type)
    part_injector = build_part_injector(part_type, injector)
    if not isinstance(points, QuantityData):
        points = read_points(points, part_injector, cylinder_pressure, return_pressure, tolerance)
    share = fraction(flow_spread, "flow_spread")
    study = _study(part_type, part_injector, instance(points, QuantityData, "points"), share)
    threads = thread_count(threads)
    fit = calibrate(study, threads=threads, progress=progress)
    factor = (fit.best[FLOW] / part_injector.values[FLOW]) ** 2
    low, high = FACTORS
    start, best = (np.asarray(fit.scores[label][0].values) for label in ("start", "best"))
    if study.space.parameters[0].is_at_bound(fit.best[FLOW]):
        shut = describe_no_injection(points, start[None])
        check = f"{shut}; take points with larger energising times" if shut else "check nozzle, units and pressures"
        change = explain_by_one_change(part_type, part_injector, points, threads, share)
        raise InputError(
            f"{points.name}: the flow factor reaches a limit of its range {low:g} to {high:g}; "
            f"{check}{f'; the single change of the type that fits best: {change}' if change else ''}."
        )
    _check_references(points, best)
    doubts = find_doubts(part_type, part_injector, points, fit, threads, share)
    adapted = _name_injector(part_type, study, fit, factor)
    limits = [
        *describe_missed_references(points, best),
        *describe_shut_points(fit, adapted, _map_points(adapted, points), threads),
    ]
    for sentence in limits:
        note(f"{points.name}: {sentence}.")
    return Adapted(adapted, factor, start, best, points, fit, doubts, tuple(limits))


def _check_references(points: QuantityData, best: Floats) -> None:
    """Refuse reference quantities that the adapted model misses by far: no flow factor can repair that."""
    for point, measured, predicted in zip(points.points, points.quantity, best, strict=True):
        if not abs(predicted - measured) <= max(FAR * measured, ANYWAY):
            raise InputError(
                f"{points.name}: the reference at {at_point(point)} is {measured * 1e9:.3g} mm³, and the adapted type "
                f"injects {predicted * 1e9:.3f} mm³; check units and pressures, or take a point with a larger "
                "energising time."
            )


def read_points(
    path: str | Path,
    injector: Injector,
    cylinder_pressure: float | str,
    return_pressure: float | str,
    tolerance: float | str = TOLERANCE,
) -> QuantityData:
    """Read reference quantities from a CSV file with columns rail_pressure, energising_time and quantity.

    The injector's fuel converts quantities by mass. Pressures are in Pa, or texts with units. Raises `InputError` if
    the file cannot be read, or a column is missing or has the wrong type.
    """
    file, share = file_path(path, "path of the reference quantities"), fraction(tolerance, "tolerance")
    pressures = {"cylinder_pressure": cylinder_pressure, "return_pressure": return_pressure}
    stated = {key: f"{value!r} Pa" if isinstance(value, float) else value for key, value in pressures.items()}
    for key, value in stated.items():
        parse(value, "Pa", key)
    model = QuantitiesModel.model_validate(
        {"kind": "quantities", "name": file.name, "role": "fit", "file": str(file.absolute()), **stated}
        | {"absolute": "0.05 mm3", "relative": share, "source": f"reference quantities of {file.name}"}
    )
    (read,) = QuantityData.read_all(model, Context(injector, 1e-6, Reach(file, True, announced=True), Place(str(file))))
    return read


def build_part_injector(injector_type: InjectorType, injector: Injector | str | Path | None) -> Injector:
    """Return the part's injector before the fit: measured values and nozzle of the part, other values of the type.

    Raises `InputError` if a file cannot be read, or neither part nor type has an injector.
    """
    if injector is None:
        if injector_type.injector is None:
            raise InputError(
                f"The type {injector_type.name} names no injector; give the part's injector (--injector MODEL; in "
                "Python: injector)."
            )
        return injector_type.apply_to(injector_type.injector)
    measured_injector = injector if isinstance(injector, Injector) else load_injector(injector)
    part_injector = injector_type.apply_to(measured_injector, keep=OF_PART)
    for value in injector_type.fixed:
        if value.name not in OF_PART and part_injector.values[value.name] != value.value:
            unit = parameter_quantities()[value.name].unit
            note(
                f"{value.name} stays {to_text(part_injector.values[value.name], unit)}, as measured on "
                f"{measured_injector.name}; the parts of the type were fitted with {to_text(value.value, unit)}."
            )
    return part_injector


def _study(injector_type: InjectorType, part_injector: Injector, points: QuantityData, flow_spread: float) -> Study:
    """Study that fits the flow factor, and with two or more points the type's parameters with spreads as priors."""
    free = [flow_about_drawing(part_injector, flow_spread)]
    if np.count_nonzero(points.judged) >= FEWEST_FOR_PRIORS:
        free += parameters_with_priors(injector_type, part_injector)
    else:
        free = [replace(free[0], prior=None)]
    space = Space(free)
    settings = StagedSettings(members=MEMBERS, generations=MOVES, starts=1, stage_iterations=8)
    return Study(
        f"{injector_type.name} adapted to {points.name}",
        part_injector,
        (points,),
        space,
        Method(settings),
        1,
        step_for_all(part_injector, space),
        loss=Loss.SQUARES,
    )


def _name_injector(injector_type: InjectorType, study: Study, fit: Calibration, factor: float) -> Injector:
    """Return the adapted injector with name and sources."""
    points = study.data[0]
    text = f'type "{injector_type.name}", fitted to {points.name}'
    drawn = study.injector.values[FLOW]
    notes = {name: Source("F", text) for name in study.space.names}
    notes[FLOW] = Source("F", f"effective: {drawn!r} m times the root of the flow factor {factor:.5g}; {text}")
    return replace(fit.injector, name=f"{study.injector.name}-adapted", sources={**fit.injector.sources, **notes})


# Reference point for the next part of a type: the point whose quantity predicts the part's other quantities best.

SCALES = 41  # flow factors at which the type is simulated; quantities between them are interpolated
USABLE = 0.95  # share of the drawn parts for which a proposed point must be usable
QUANTILE = 0.9
RAIL_PRESSURES = (40e6, 80e6, 120e6, 160e6)  # [Pa]
ENERGISING_TIMES = (300e-6, 400e-6, 500e-6, 700e-6, 1000e-6, 1400e-6)  # [s]


@dataclass(frozen=True)
class Advice:
    """Expected errors of the adapted type at all other points, for each candidate as the only reference point.

    Attributes
    ----------
    points : tuple of OperatingPoint
        Candidates.
    expected : (points,)
        Root mean square error over points and drawn parts [m³]; NaN if the candidate serves no part.
    upper : (points,)
        90 % of the drawn parts have a smaller error [m³].
    usable : (points,)
        Share of the drawn parts that inject at the candidate and need a flow factor of 0.6 to 1.6.
    without : float
        Error of the type itself, without any reference [m³].
    draws : int
        Drawn parts that could be simulated.
    """

    points: tuple[OperatingPoint, ...]
    expected: Floats
    upper: Floats
    usable: Floats
    without: float
    draws: int

    @property
    def order(self) -> tuple[int, ...]:
        """Indices of the candidates that serve nearly all parts, the smallest expected error first."""
        ranked = np.argsort(self.expected, kind="stable").tolist()
        return tuple(i for i in ranked if self.usable[i] >= USABLE)


def advise(
    injector_type: InjectorType | str | Path,
    points: Sequence[OperatingPoint],
    *,
    injector: Injector | str | Path | None = None,
    flow_spread: float | str = FLOW_SPREAD,
    draws: int = DRAWS,
    seed: int = 1,
    threads: int | None = None,
) -> Advice:
    """Rank reference points before anything is measured on the part.

    Parts are drawn from the type: each parameter from the normal distribution of its scatter between parts (`between`)
    within the bounds, and the flow of the nozzle. A type without any `between` uses its full spreads. For each
    candidate, the type gets the flow factor at which it injects the drawn part's quantity, as `adapt` does with one
    quantity. It is then compared with the drawn part at all other points.

    The errors of the type's values are neglected: data determine combinations of parameters better than single
    parameters, and a type file has no correlations. The expected error therefore covers the scatter of the parts only;
    an error of the type itself adds to it. For a type without `between` the expected errors are too large, and only the
    order of the points is meaningful.

    Parameters
    ----------
    injector_type, injector, threads
        As in `adapt`.
    points : sequence of OperatingPoint
        At least two candidates; the model is to predict the quantities at all of them.
    flow_spread : float or str
        Relative standard deviation of the effective hole area about the drawing.
    draws, seed : int
        Number of drawn parts, and seed of the draws.

    Raises
    ------
    InputError
        If a file cannot be read, the injector is missing, or there are fewer than two points.
    SimulationError
        If no drawn part could be simulated.
    """
    part_type = injector_type if isinstance(injector_type, InjectorType) else load_type(injector_type)
    part_injector = build_part_injector(part_type, injector)
    at = instances(points, OperatingPoint, "points")
    if len(at) < 2:
        raise InputError("A reference point is chosen among at least two points; give more candidates.")
    share, count = fraction(flow_spread, "flow_spread"), integer(draws, "draws", 2, 100_000)
    space = Space([flow_about_drawing(part_injector, share), *scattering_parameters(part_type, part_injector)])
    drawn = count, integer(seed, "seed")
    part_quantities, scaled = _simulate_draws(part_injector, at, space, drawn, thread_count(threads))
    return _rank_references(at, part_quantities, scaled)


def _map_points(injector: Injector, points: QuantityData) -> list[OperatingPoint]:
    """Reference points, and the points of `grid` within the range of the model, at the same pressures."""
    first, at = points.points[0], list(points.points)
    for point in grid(first.at_start(first.cylinder_pressure), first.at_start(first.return_pressure)):
        with suppress(ConfigurationError):
            check_point(injector, point)
            at.append(point)
    return at


def grid(cylinder_pressure: float | str = 5e6, return_pressure: float | str = 5e5) -> tuple[OperatingPoint, ...]:
    """Candidates at 40 to 160 MPa and 300 to 1400 µs; the pressures are in Pa, or texts with units."""
    return tuple(_point(p, t, cylinder_pressure, return_pressure) for p in RAIL_PRESSURES for t in ENERGISING_TIMES)


def read_candidates(
    path: str | Path, cylinder_pressure: float | str = 5e6, return_pressure: float | str = 5e5
) -> tuple[OperatingPoint, ...]:
    """Read candidates from a CSV file with columns rail_pressure and energising_time; other columns are ignored.

    Cylinder and return pressure are in Pa, or texts with units. Raises `InputError` if the file cannot be read, or a
    column is missing or has the wrong type.
    """
    columns = [Column("rail_pressure", ("Pa",)), Column("energising_time", ("s",), domain=Domain.POSITIVE)]
    table = map_columns(file_path(path, "path of the candidates"), columns, least=2).columns
    rows = zip(table["rail_pressure"].tolist(), table["energising_time"].tolist(), strict=True)
    return tuple(_point(p, t, cylinder_pressure, return_pressure) for p, t in rows)


def _point(pressure: float, duration: float, cylinder: float | str, returned: float | str) -> OperatingPoint:
    return OperatingPoint(pressure, duration, cylinder, returned, horizon=duration + AFTER_ENERGISING)


def _simulate_draws(
    part_injector: Injector, points: Sequence[OperatingPoint], space: Space, drawn: tuple[int, int], threads: int | None
) -> tuple[Floats, Floats]:
    """Quantities [m³] of drawn parts (n, points) and of the type with flow factors; NaN if a simulation fails.

    A drawn part that fails anywhere is left out: such a part would not be sold.
    """
    step, (count, seed) = step_for_all(part_injector, space), drawn
    values = sample_priors(space, count, np.random.default_rng(seed))
    scaled = np.tile(space.reference, (SCALES, 1))
    scaled[:, 0] *= _factors() ** 0.5
    batch = simulate_batch(
        part_injector, points, space.names, np.vstack([values, scaled]), time_step=step, threads=threads
    )
    quantity, good = batch.injected_volume, np.all(batch.status == OK, axis=1)
    scaled_quantity = np.where(batch.status[count:] == OK, quantity[count:], np.nan)
    if not good[:count].any() or np.any(np.sum(np.isfinite(scaled_quantity), axis=0) < SCALES // 2):
        raise SimulationError("the type could not be simulated at all points; take others, or check its spreads.")
    return quantity[:count][good[:count]], scaled_quantity


def _factors() -> Floats:
    return np.linspace(*FACTORS, SCALES)


def _rank_references(points: tuple[OperatingPoint, ...], part_quantities: Floats, scaled: Floats) -> Advice:
    """Errors of the adapted type for each candidate.

    `part_quantities` [m³]: of the drawn parts (draws, points); `scaled` [m³]: of the type with flow factors (factors,
    points).
    """
    count = len(points)
    expected, upper = np.full(count, np.nan), np.full(count, np.nan)
    usable = np.zeros(count)
    for i in range(count):
        errors = _reference_errors(part_quantities, scaled, i)
        good = np.isfinite(errors)
        usable[i] = np.mean(good)
        if good.any():
            expected[i] = np.sqrt(np.mean(errors[good] ** 2))
            upper[i] = np.quantile(errors[good], QUANTILE)
    plain = np.array([_interpolate(np.ones(1), column)[0] for column in scaled.T])
    without = float(np.sqrt(np.mean((part_quantities - plain) ** 2)))
    return Advice(
        points=points,
        expected=expected,
        upper=upper,
        usable=usable,
        without=without,
        draws=len(part_quantities),
    )


def _reference_errors(part_quantities: Floats, scaled: Floats, reference: int) -> Floats:
    """Root mean square errors (draws,) at the other points if the reference is met; NaN if it cannot be met."""
    finite = np.isfinite(scaled[:, reference])
    rising = scaled[finite, reference]
    if not np.all(np.diff(rising) > 0.0):
        return np.full(len(part_quantities), np.nan)
    factor = np.interp(part_quantities[:, reference], rising, _factors()[finite], left=np.nan, right=np.nan)
    predicted = np.stack([_interpolate(factor, column) for column in scaled.T], axis=1)
    others = np.arange(part_quantities.shape[1]) != reference
    return np.asarray(np.sqrt(np.mean((predicted - part_quantities)[:, others] ** 2, axis=1)))


def _interpolate(factor: Floats, quantity: Floats) -> Floats:
    """Quantities at flow factors, interpolated between the finite ones of `quantity` (factors,); NaN outside."""
    finite = np.isfinite(quantity)
    return np.asarray(np.interp(factor, _factors()[finite], quantity[finite], left=np.nan, right=np.nan))
