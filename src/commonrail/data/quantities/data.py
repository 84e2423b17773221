"""Quantity map as a kind of measured data: quantities per stroke, each judged against its tolerance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import Limits, amount, array, flag, instance, instances, settle
from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.errors import ConfigurationError
from commonrail.base.text import number
from commonrail.base.units import to_text
from commonrail.data.base import (
    DataSet,
    Missing,
    Role,
    Score,
    Term,
    ToleratedData,
    is_metered,
    make_term,
    read_labels,
    relative_to,
)
from commonrail.data.noise import NOISE, Noise
from commonrail.data.quantities.baselines import (
    Interpolated,
    Sister,
    baseline_record,
    interpolation_record,
    point_places,
    read_sister,
    sister_baseline,
)
from commonrail.data.quantities.dead_times import (
    NO_DEAD_TIME,
    NOT_REACHED,
    SEARCHED,
    crossing_times,
    neighbours,
    with_duration,
)
from commonrail.data.quantities.reading import SAME, HoldOutModel, MapModel, QuantitiesModel, read_rows
from commonrail.data.records import MEASURED, point_record
from commonrail.data.repeats import average_groups, group_rows
from commonrail.data.simulator import ITSELF, Candidates, Simulator
from commonrail.data.study_block import Context, mass_density
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK
from commonrail.physics.meters import Meter, QuantityValues, shown_quantities
from commonrail.readers.location import Place, locate_errors

_Map = TypeVar("_Map", bound="QuantityData")

SMALL_QUANTITY = 3e-9  # below it errors are judged in mm³, above it in percent [m³]
TOLERANCES = Limits(1e-18, 1.0, (1e-12, 1e-6), ("mm3",))  # of a quantity per stroke [m3]
TIME_TOLERANCES = Limits(1e-12, 1.0, (1e-8, 1e-3), ("us",))  # of a dead time [s]


@dataclass(frozen=True, eq=False)
class QuantityData(ToleratedData):
    """Measured quantities per stroke at several operating points (a map).

    Attributes
    ----------
    to_horizon : bool
        Set by the class: whether the quantity depends on what follows the end of injection, see `Term.to_horizon`.
    own_keys : tuple of str
        Set by the class: further attributes that are keys of its block.
    name : str
    role : Role
    points : tuple of OperatingPoint, length n
    quantity : (n,)
        Injected quantity per stroke by volume [m³].
    absolute, relative : float
        Tolerances: an error is judged against absolute [m³] + relative × quantity.
    dead_time : (n,) bool
        Rows that state the energising time at which the given small quantity is reached.
    weight : float
    source, synthetic : str
    mass_density : float or (n,)
        As in `RateData`, of each quantity.
    dead_time_tolerance : float or None
        Tolerance [s] of dead times that are compared as times. None compares the quantity injected at the measured dead
        time; its derivative vanishes where nothing is injected.
    meter : Meter or None
        Of the bench; of its quantities, `gain`, `quantity_offset`, `density` and `temperature` concern a map.
    sister : Sister or None
        Measured map of another part of the type, for comparison.
    noise : Noise
        Its standard deviations are multiples of the tolerance.

    Raises
    ------
    ConfigurationError
        If an argument has a wrong type, or the numbers of points, quantities and dead times differ.
    """

    kind: ClassVar[str] = "quantities"
    what: ClassVar[str] = "quantity"
    unit: ClassVar[str] = "m3"
    error_head: ClassVar[tuple[str, str]] = ("rms", "%")
    model: ClassVar[type[MapModel]] = QuantitiesModel
    meter_inputs: ClassVar[frozenset[str]] = frozenset({"gain", "quantity_offset", "density", "temperature"})
    to_horizon: ClassVar[bool] = False
    own_keys: ClassVar[tuple[str, ...]] = ()

    name: str
    role: Role
    points: tuple[OperatingPoint, ...]
    quantity: Floats
    absolute: float
    relative: float
    dead_time: Bools
    weight: float
    source: str
    synthetic: str
    mass_density: Floats | float = math.nan
    dead_time_tolerance: float | None = None
    meter: Meter | None = None
    sister: Sister | None = None
    noise: Noise = NOISE

    bounds = None

    if TYPE_CHECKING:  # set by `_set_targets`
        _timed: ClassVar[IndexArray]

    def __post_init__(self) -> None:
        read_labels(self)
        points = instances(self.points, OperatingPoint, "points of the data")
        quantity = array(self.quantity, "m3", "quantity of the data", 1)
        dead_time = np.array([flag(item, "dead_time") for item in np.ravel(self.dead_time)], bool)
        if not len(points) == len(quantity) == len(dead_time):
            raise ConfigurationError(
                f"{self.name} must have as many points as quantities and marks of dead times, not {len(points)}, "
                f"{len(quantity)} and {len(dead_time)}."
            )
        settle(
            self,
            points=points,
            quantity=quantity,
            absolute=amount(self.absolute, "m3", "absolute tolerance", TOLERANCES),
            relative=amount(self.relative, "1", "relative tolerance", Limits(0.0, 1e6)),
            dead_time=dead_time,
        )
        if self.dead_time_tolerance is not None:
            tolerance = amount(self.dead_time_tolerance, "s", "dead_time_tolerance", TIME_TOLERANCES)
            settle(self, dead_time_tolerance=tolerance)
        if self.sister is not None:
            instance(self.sister, Sister, "sister")
        _set_targets(self)

    @classmethod
    def read_all(cls, model: MapModel, context: Context) -> tuple[Self, ...]:
        """Read a quantity map, and divide it into its fitted and its held-out part if the block asks for that."""
        rows = read_rows(model, context)
        quantity = np.array([row.quantity for row in rows])
        density = np.array([mass_density(context.injector, row.unit, row.point) for row in rows])
        by_volume = np.isnan(density)
        dead, sister = getattr(model, "dead_times", None), getattr(model, "sister", None)
        with locate_errors(context.at):
            read = cls(
                model.name,
                Role(model.role),
                tuple(row.point for row in rows),
                quantity / np.where(by_volume, 1.0, density),
                model.absolute,
                model.relative,
                np.array([row.dead_time for row in rows]),
                model.weight,
                model.source,
                model.synthetic,
                math.nan if by_volume.all() else density,
                None if dead is None else dead.tolerance,
                context.meter(model.meter),
                None if sister is None else read_sister(sister, context),
                **{key: getattr(model, key) for key in cls.own_keys},
            )
            read = average_repeats(read) if model.repeated == "mean" else read
        return (read,) if model.hold_out is None else divide(read, model.hold_out, context.at / "hold_out")

    @classmethod
    def terms(cls, group: Sequence[Self], time_step: float) -> list[Term]:
        """One term for each map."""
        failed = partial(np.not_equal, OK)
        return [make_term(d, partial(point_values, d), failed, to_horizon=d.to_horizon) for d in group]

    def masses(self, batch: Batch, candidates: Candidates, points: Sequence[OperatingPoint]) -> Floats:
        """Mass per stroke whose volume the map measures, (candidates, points) [kg]."""
        return batch.injected_mass

    def densities(
        self, batch: Batch, candidates: Candidates, points: Sequence[OperatingPoint], meter_values: QuantityValues
    ) -> Floats:
        """Densities that convert masses to volumes if the data state none, (1 or candidates, points) [kg/m³].

        `meter_values` (candidates,): quantities of the meter; only `density` and `temperature` are used.
        """
        density_keys = {"density", "temperature"} & meter_values.keys()
        return candidates.densities(points, meter_values) if density_keys else batch.reference_density

    def simulated(self, simulator: Simulator, values: Floats) -> Floats:
        """Quantities (candidates, points) [m³], times [s] as `measured`; NaN for a failed simulation.

        A needle that never closes is a failure too.
        """
        batch = simulator.batch(self.simulated_points, values, to_horizon=self.to_horizon)
        return point_values(self, batch, Candidates(simulator, values))

    def volumes(
        self, batch: Batch, mass_density: ArrayLike, candidates: Candidates, points: Sequence[OperatingPoint]
    ) -> Floats:
        """Volumes (candidates, points) of a batch [m³], as the meter shows them if there is one.

        `candidates` and `points` belong to the batch. Where `mass_density` is NaN, the density of the candidates
        applies.
        """
        metered = self.meter is not None and is_metered(self, candidates.simulator)
        meter_values = candidates.meter_values(self.meter) if self.meter is not None and metered else {}
        density = np.asarray(mass_density, float)
        if np.isnan(density).any():
            density = np.where(np.isnan(density), self.densities(batch, candidates, points, meter_values), density)
        volumes = np.where(batch.status == OK, self.masses(batch, candidates, points) / density, np.nan)
        return shown_quantities(meter_values, volumes) if metered else volumes

    def discrepancy(self, values: Floats) -> Floats:
        """Tolerance of predicted quantities [m³]; NaN for dead times."""
        return np.where(self.judged, self.absolute + self.relative * np.abs(values), np.nan)

    def score(self, simulator: Simulator) -> QuantityScore:
        """Score of the simulator's injector, unchanged."""
        return QuantityScore(self, self.simulated(simulator, ITSELF)[0], _find_dead_times(self, simulator))

    def record(self, scores: Mapping[str, QuantityScore]) -> dict[str, Any]:
        """Rows with the quantity or dead time of each label, and root mean squares."""
        place = np.cumsum(self.dead_time) - 1
        rows: list[dict[str, Any]] = []
        for i, point in enumerate(self.points):
            is_dead, quantity = bool(self.dead_time[i]), float(self.quantity[i])
            row: dict[str, Any] = {**point_record(point), "dead_time": is_dead}
            if is_dead:
                row |= {"quantity": quantity, MEASURED: row["energising_time"]}
                row |= {label: number(s.dead_time[place[i]]) for label, s in scores.items()}
            else:
                row[MEASURED] = quantity
                row |= {label: number(s.values[i]) for label, s in scores.items()}
            rows.append(row)
        figures = {label: s.figures for label, s in scores.items()}
        return {"rows": rows, "figures": figures, "relative_tolerance": self.relative}


@dataclass(frozen=True)
class QuantityScore(Score):
    """Predicted quantities (points,) [m³] of a map, and dead times (dead-time rows,) [s]."""

    data: QuantityData
    dead_time: Floats

    @property
    def error(self) -> float:
        """Root mean square over the large quantities [%]."""
        return 100.0 * self.rms_large

    @property
    def rms_large(self) -> float:
        """Relative root mean square over Q > 3 mm³; NaN without such a row."""
        large = (self.data.quantity > SMALL_QUANTITY) & self.data.judged
        return rms((self.values - self.data.quantity)[large] / self.data.quantity[large])

    @property
    def rms_small(self) -> float:
        """Root mean square over the rest [m³]; NaN without such a row."""
        small = ~(self.data.quantity > SMALL_QUANTITY) & self.data.judged
        return rms((self.values - self.data.quantity)[small])

    @property
    def rms_dead_time(self) -> float:
        """Root mean square of the dead times [s]; NaN without such a row."""
        rows = np.flatnonzero(self.data.dead_time)
        return rms(self.dead_time - np.array([self.data.points[i].pulses[0].duration for i in rows]))

    @property
    def figures(self) -> dict[str, float | None]:
        """JSON-able root mean squares."""
        return {
            "rms_small": number(self.rms_small),
            "rms_large_percent": number(100.0 * self.rms_large),
            "dead_time_rms": number(self.rms_dead_time),
            "limit_quantity": SMALL_QUANTITY,
        }

    def missing(self) -> list[Missing]:
        """Points whose simulation failed or whose dead time was not found."""
        points = self.data.points
        failed = np.flatnonzero(np.isnan(self.values) & self.data.judged)
        dead = np.flatnonzero(self.data.dead_time)[np.isnan(self.dead_time)]
        return [Missing(points[i]) for i in failed] + [Missing(points[i], NO_DEAD_TIME, NOT_REACHED) for i in dead]

    def quantities(self) -> tuple[Floats, Floats]:
        """Measured and simulated quantities of the points that have both [m³]."""
        both = np.isfinite(self.values) & self.data.judged
        return self.data.quantity[both], self.values[both]

    def relative_error(self) -> float:
        """Σ |error| over Σ quantity, of the points that did not fail."""
        judged, quantity = self.data.judged, self.data.quantity
        return relative_to(np.nansum(np.abs(self.values - quantity)[judged]), np.sum(quantity[judged]))

    def baselines(self, fitted: Sequence[DataSet]) -> list[dict[str, Any]]:
        """Interpolation of the fitted maps, and the map of a sister part, if there are any."""
        maps = [d for d in fitted if isinstance(d, QuantityData) and d.kind == self.data.kind]
        records = interpolation_record(self, maps), sister_baseline(self)
        return [record for record in records if record]


def _set_targets(data: QuantityData) -> None:
    """Set the target and the tolerance of each row, and all points to be simulated.

    `_timed`: rows compared as times. The points around each of them follow the points of all rows.
    """
    as_times = data.dead_time & (data.dead_time_tolerance is not None)
    timed = np.flatnonzero(as_times)
    durations = [point.pulses[0].duration if point.pulses else 0.0 for point in data.points]
    by_quantity = data.absolute + data.relative * data.quantity
    settle(
        data,
        _timed=timed,
        simulated_points=data.points + tuple(p for row in timed for p in neighbours(data.points[row])),
        measured=np.where(as_times, durations, data.quantity),
        judged=~data.dead_time,
        tolerances=np.where(as_times, data.dead_time_tolerance or 1.0, by_quantity),
    )


def point_values(data: QuantityData, batch: Batch, candidates: Candidates) -> Floats:
    """Values (candidates, points), in the units of `measured`, of a batch at the simulated points."""
    timed, count = data._timed, len(data.points)
    rows = np.concatenate([np.arange(count), np.repeat(timed, 2)])
    density = np.broadcast_to(data.mass_density, data.quantity.shape)[rows]
    volumes = data.volumes(batch, density, candidates, data.simulated_points)
    values = volumes[:, :count]
    if not len(timed):
        return values
    around = volumes[:, count:].reshape(len(volumes), -1, 2)
    three = np.stack([around[..., 0], values[:, timed], around[..., 1]], axis=-1)
    values[:, timed] = crossing_times(data.measured[timed], three, data.quantity[timed])
    return values


def average_repeats(data: _Map) -> _Map:
    """The map with one row for the repeated quantities of each point, and their scatter as noise; dead times stay."""
    places, single, dead = point_places(data), np.flatnonzero(data.judged), np.flatnonzero(data.dead_time)
    groups = [single[rows] for rows in group_rows(places[single], SAME)]
    average = average_groups(data.quantity, groups, data.absolute + data.relative * data.quantity)
    first = np.concatenate([np.array([rows[0] for rows in groups], np.intp), dead])
    least, most = int(average.counts.min()), int(average.counts.max())
    strokes = f"means of {least} strokes" if least == most else f"means of {least} to {most} strokes"
    return replace(
        _at_rows(data, first),
        quantity=np.concatenate([average.mean, data.quantity[dead]]),
        noise=NOISE if average.sigma is None else Noise(sigma=average.sigma, freedom=average.freedom),
        source="; ".join(filter(None, (data.source, strokes))),
    )


def _at_rows(data: _Map, rows: IndexArray) -> _Map:
    density = np.asarray(data.mass_density)
    return replace(
        data,
        points=tuple(data.points[i] for i in rows),
        quantity=data.quantity[rows],
        dead_time=data.dead_time[rows],
        mass_density=density[rows] if density.ndim else data.mass_density,
    )


def held_out_name(name: str) -> str:
    """Name of the part of a data set that is held out."""
    return f"{name}, held out"


def divide(data: _Map, model: HoldOutModel, at: Place) -> tuple[_Map, _Map]:
    """Part of a map that is fitted, and the part that is held out for validation.

    The held-out part has the quantities at the named rail pressures or energising times, and the dead times at the
    named rail pressures.

    Raises `ConfigurationError` if the map is not fit data, no row has a named pressure or time, or either part is
    empty.
    """
    if data.role is not Role.FIT:
        raise at.error('only data with role = "fit" can hold rows out; remove hold_out', code="not-of-fit")
    if not (model.rail_pressure or model.energising_time):
        raise at.error(
            'name rail pressures or energising times, as in { rail_pressure = ["120 MPa"] }', code="missing-value"
        )
    held_out = _select_any(data, 0, model.rail_pressure, "Pa", at / "rail_pressure")
    held_out |= _select_any(data, 1, model.energising_time, "s", at / "energising_time") & data.judged
    if not (data.judged & ~held_out).any():
        raise ConfigurationError(
            f"{at}: every quantity of {data.name} would be held out; leave some for the fit.",
            code="nothing-left",
            file=at.file,
            place=at.key,
        )
    return chosen_rows(data, ~held_out), chosen_rows(data, held_out, held_out_name(data.name), Role.VALIDATION)


def select_rows(data: QuantityData, column: int, value: float) -> Bools:
    """Rows (n,) at a rail pressure [Pa] (column 0) or an energising time [s] (column 1)."""
    return np.isclose(point_places(data)[:, column], value, rtol=SAME, atol=0.0)


def chosen_rows(data: _Map, rows: Bools, name: str = "", role: Role | None = None) -> _Map:
    """Some rows of a map.

    The mask `rows` is (n,); by default, name and role are the map's.
    """
    return replace(_at_rows(data, np.flatnonzero(rows)), name=name or data.name, role=role or data.role)


def _select_any(data: QuantityData, column: int, targets: Sequence[float], unit: str, at: Place) -> Bools:
    """Mask of the rows at any of the `targets`."""
    matching = np.zeros(len(data.points), bool)
    present = point_places(data)[data.judged, column]
    for value in targets:
        if not np.isclose(present, value, rtol=SAME, atol=0.0).any():
            available = ", ".join(to_text(float(v), unit) for v in np.unique(present)[:12])
            raise ConfigurationError(
                f"{at}: {data.name} has no quantity at {to_text(value, unit)}; it has {available}.",
                code="missing-row",
                file=at.file,
                place=at.key,
            )
        matching |= select_rows(data, column, value)
    return matching


def _find_dead_times(data: QuantityData, simulator: Simulator) -> Floats:
    """Energising time at which each dead-time row's quantity is reached [s], by interpolation; (dead-time rows,)."""
    rows = np.flatnonzero(data.dead_time)
    dead_times = np.full(len(rows), np.nan)
    mass_density = np.broadcast_to(data.mass_density, data.quantity.shape)
    points = [with_duration(data.points[row], float(t)) for row in rows.tolist() for t in SEARCHED]
    batch = simulator.once(points) if points else None
    for i, row in enumerate(rows.tolist()):
        columns = slice(i * len(SEARCHED), (i + 1) * len(SEARCHED))
        assert batch is not None
        row_batch = batch.at_points(columns)
        quantity = data.volumes(row_batch, mass_density[row], Candidates(simulator, ITSELF), points[columns])[0]
        above = np.flatnonzero(quantity > data.quantity[row])
        if len(above) and above[0] > 0:
            k = int(above[0])
            share = (data.quantity[row] - quantity[k - 1]) / (quantity[k] - quantity[k - 1])
            dead_times[i] = SEARCHED[k - 1] + share * (SEARCHED[k] - SEARCHED[k - 1])
    return dead_times


def rms(values: Floats) -> float:
    """Root mean square; NaN of no values."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


# Cross-validation: the rows of a quantity map are held out in turn, and predicted by fits to the rest.


_COLUMNS = {"rail_pressure": 0, "energising_time": 1}


class Fold(NamedTuple):
    """Held-out rows (n,) of a map, with the scores of the model, the interpolation and the members' mean on them."""

    rows: Bools
    model: QuantityScore
    baseline: Interpolated | None
    mean: QuantityScore | None = None


def levels(data: QuantityData, by: str) -> list[float]:
    """Rail pressures [Pa] or energising times [s] of the quantities of a map, in rising order."""
    return sorted(set(point_places(data)[data.judged, _COLUMNS[by]].tolist()))


def without(data: QuantityData, by: str, value: float) -> tuple[QuantityData, QuantityData, Bools] | None:
    """Map without the rows at a value, validation map of these rows, and their mask; None if either map is empty.

    Dead times are left out only `by` "rail_pressure". `value`: [Pa] or
    [s].
    """
    rows = select_rows(data, _COLUMNS[by], value)
    if by == "energising_time":
        rows = rows & data.judged
    if not (rows & data.judged).any() or not (~rows & data.judged).any():
        return None
    return chosen_rows(data, ~rows), chosen_rows(data, rows, held_out_name(data.name), Role.VALIDATION), rows


def fold_record(data: QuantityData, folds: Sequence[Fold]) -> dict[str, Any]:
    """JSON-able figures of the predictions of all rows that were held out, each by the fit that did not see it."""
    rows = np.any([fold.rows for fold in folds], axis=0)
    held_out = chosen_rows(data, rows)
    model = _join_scores(data, rows, [(fold.rows, fold.model) for fold in folds])
    record: dict[str, Any] = {"name": data.name, "values": int(held_out.judged.sum()), "figures": model.figures}
    means = [(fold.rows, fold.mean) for fold in folds if fold.mean is not None]
    if len(means) == len(folds):
        record["mean"] = _join_scores(data, rows, means).figures
    baselines = [sister_baseline(model)]
    others = [(fold.rows, fold.baseline) for fold in folds if fold.baseline is not None]
    if len(others) == len(folds):
        baseline = _join_scores(data, rows, others)
        beyond = sum(baseline_score.extrapolated for _, baseline_score in others)
        text = "interpolating the other points"
        baselines.insert(0, baseline_record(model, baseline, text=text, extrapolated=beyond))
    record["baselines"] = [baseline_score for baseline_score in baselines if baseline_score]
    return record


def _join_scores(
    data: QuantityData, held_out: Bools, parts: Sequence[tuple[Bools, QuantityScore | Interpolated]]
) -> QuantityScore:
    """Score of the rows `held_out`, joined from predictions of their parts."""
    quantity, dead_time = np.full((2, len(held_out)), np.nan)
    for rows, score in parts:
        quantity[rows] = score.values
        dead_time[rows & data.dead_time] = score.dead_time
    return QuantityScore(chosen_rows(data, held_out), quantity[held_out], dead_time[held_out & data.dead_time])
