"""Simulate the quantity map of an injector and its inverse, and find where the quantity is not monotone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import Quantity, array, enum_member, flag, instance, mapping, number
from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError
from commonrail.base.text import count_noun
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.physics.injector import Injector
from commonrail.plugins.maps import response
from commonrail.plugins.maps.adjust import UNADJUSTED, Adjustment, Cost, Curves, adjust
from commonrail.plugins.maps.axes import MapAxes
from commonrail.plugins.maps.choices import Beyond, CellState, Several
from commonrail.plugins.maps.inverse import Inverse, Rules, invert, sample_lines
from commonrail.plugins.maps.response import Conditions
from commonrail.plugins.maps.sweep import OPERATING, Base, Sweep, Variable, resolve_variable
from commonrail.plugins.maps.sweep import sweep as swept

if TYPE_CHECKING:
    from commonrail.calibration.run import Calibration
    from commonrail.calibration.study import Study

Edges = Mapping[float, tuple[Floats, Floats]]

BALLISTIC = 0.98  # share of the largest lift at a rail pressure, below which an injection is ballistic


class MapBands(NamedTuple):
    """Edges [m³] of the bands in which measured quantities are expected, by level.

    `estimator` comes from the `Prediction`; `quantity` holds edges (pressures, energising times) of the quantity map,
    `delivered` edges (pressures, quantities) of the quantities delivered by the inverse; NaN in cells without a
    simulated time.
    """

    estimator: str
    quantity: Edges
    delivered: Edges


@dataclass(frozen=True, repr=False)
class InjectionMap(Shown):
    """Simulated map of an injector.

    Attributes
    ----------
    injector : Injector
    axes : MapAxes
    conditions : Conditions
    rules : Rules
    density : float
        Reference density [kg/m³]: mass over volume of every quantity.
    curves : Curves
        Quantities over a fine axis of energising times, in which `quantity` interpolates.
    volume : (pressures, energising times)
        Injected volumes [m³], NaN where the simulation failed.
    ballistic : (pressures, energising times) bool
        Needle turns round below `BALLISTIC` of its largest lift at that rail pressure.
    inverse : Inverse
        Over pressures and quantities.
    inverse_ballistic : (pressures, quantities) bool
    falls : tuple of Fall
        Places where the quantity falls with the energising time, found on all simulated points.
    lines : tuple of Line
        All simulated points, one line for each rail pressure.
    adjustment : Adjustment
        Steps applied to `curves`, `volume` and `inverse`.
    costs : tuple of Cost
        Quantity errors of these steps.
    bands : MapBands or None
        Of measured quantities, if the model comes from a fit.
    """

    presenter = "commonrail.plugins.maps.page:INJECTION_MAP"

    injector: Injector
    axes: MapAxes
    conditions: Conditions
    rules: Rules
    density: float
    curves: Curves
    volume: Floats
    ballistic: Bools
    inverse: Inverse
    inverse_ballistic: Bools
    falls: tuple[response.Fall, ...]
    lines: tuple[response.Line, ...]
    adjustment: Adjustment = UNADJUSTED
    costs: tuple[Cost, ...] = ()
    bands: MapBands | None = None

    @property
    def simulations(self) -> int:
        """Number of simulated injections."""
        return sum(len(line.time) for line in self.lines)

    @property
    def falls_with_pressure(self) -> Bools:
        """Cells (pressures, energising times) whose quantity is smaller than at the rail pressure before."""
        fallen = np.zeros(self.volume.shape, bool)
        fallen[1:] = np.diff(self.volume, axis=0) < -1e-11
        return fallen

    def quantity(self, rail_pressure: ArrayLike, energising_time: ArrayLike) -> Floats:
        """Injected volume [m³], interpolated linearly in `curves` over both axes.

        Parameters
        ----------
        rail_pressure, energising_time : float, text with a unit, or array of these
            [Pa], [s]; they broadcast, and the result has their shape.

        Returns
        -------
        array or float
            NaN outside the pressures of the map, beyond its longest time, and next to a failed simulation.
        """
        rail, time = self._arguments(rail_pressure, energising_time, "energising time", "s")
        return np.asarray(self._interpolator(np.stack([rail, time], axis=-1)).reshape(rail.shape))[()]

    def energising_time(self, rail_pressure: ArrayLike, quantity: ArrayLike) -> Floats:
        """Energising time [s] at which `quantity` gives a volume.

        If several do, the one nearest to the inverse map.

        Parameters
        ----------
        rail_pressure, quantity : float, text with a unit, or array of these
            [Pa], [m³]; they broadcast, and the result has their shape.

        Returns
        -------
        array or float
            Zero for no quantity; NaN outside the pressures of the map and for unreachable quantities.
        """
        rail, volume = self._arguments(rail_pressure, quantity, "quantity", "m3")
        times, target = self.curves.time, volume.reshape(-1, 1)
        places = np.broadcast_arrays(rail.reshape(-1, 1), times)
        row = self._interpolator(np.stack(places, axis=-1))
        low, high = row[:, :-1], row[:, 1:]
        rises = (low < target) & (high >= target)
        with np.errstate(invalid="ignore", divide="ignore"):
            crossing = np.where(rises, times[:-1] + (target - low) / (high - low) * np.diff(times), np.inf)
        axes = self.axes.rail_pressure, self.axes.quantity
        expected = _interpolator(axes, self.inverse.energising_time)(np.stack([rail, volume], axis=-1))
        nearest = np.argmin(np.abs(crossing - np.nan_to_num(expected).reshape(-1, 1)), axis=1)
        time = np.take_along_axis(crossing, nearest[:, None], axis=1).reshape(volume.shape)
        zero = (volume == 0.0) & np.isfinite(row[:, 0]).reshape(volume.shape)
        return np.where(zero, 0.0, np.where(np.isfinite(time), time, np.nan))[()]

    def _arguments(self, rail_pressure: ArrayLike, other: ArrayLike, what: str, unit: str) -> tuple[Floats, Floats]:
        rail = array(rail_pressure, "Pa", "rail pressure", finite=False)
        values = array(other, unit, what, finite=False)
        try:
            return tuple(np.broadcast_arrays(rail, values))  # type: ignore[return-value]
        except ValueError as error:
            raise ConfigurationError(
                f"Rail pressures of shape {rail.shape} and values of the {what} of shape {values.shape} do not "
                "broadcast; give arrays of one shape, or a column and a row."
            ) from error

    @property
    def _interpolator(self) -> Callable[[Floats], Floats]:
        return _interpolator((self.axes.rail_pressure, self.curves.time), self.curves.volume)

    def count(self, state: CellState) -> int:
        """Number of cells of the inverse in a state."""
        return int(np.count_nonzero(self.inverse.state == state))


def _interpolator(axes: tuple[Floats, Floats], values: Floats) -> Callable[[Floats], Floats]:
    """Linear interpolator for points (..., 2); NaN outside the axes."""
    from scipy.interpolate import RegularGridInterpolator  # slow to import

    interpolate: Callable[[Floats], Floats] = RegularGridInterpolator(
        axes, values, bounds_error=False, fill_value=np.nan
    )
    return interpolate


def usual_axes(injector: Injector) -> MapAxes:
    """Axes of a control unit, up to the highest pressure of the injector's fuel."""
    return MapAxes.usual(injector.fuel.pressure_range[1])


def injection_map(
    injector: Injector,
    axes: MapAxes | None = None,
    conditions: Conditions = Conditions(),
    rules: Rules = Rules(),
    progress: Callable[[str], None] | None = None,
    adjustment: Adjustment = UNADJUSTED,
) -> InjectionMap:
    """Simulate the quantity map of an injector and its inverse, by default over the axes of a control unit.

    `progress` receives a line of text before each stage. `ConfigurationError` if an argument is of the wrong type or
    the model does not cover a pressure; `SimulationError` if no point could be simulated.
    """
    instance(injector, Injector, "injector")
    axes = usual_axes(injector) if axes is None else instance(axes, MapAxes, "axes")
    tell = progress or (lambda _: None)

    def simulate(rows: IndexArray, times: Floats) -> response.Response:
        return response.respond(injector, axes.rail_pressure[rows], times, conditions)

    knots = response.sample_times(axes.energising_time)
    at = count_noun(len(axes.rail_pressure), "rail pressure")
    tell(f"simulating {count_noun(len(knots), 'energising time')} at {at} ...")
    lines = sample_lines(simulate, axes.rail_pressure, knots)
    response.require_some(injector, lines, conditions)
    forward = [line.at(axes.energising_time) for line in lines]
    volume = np.array([line.at(knots).volume for line in lines])
    curves = Curves(np.concatenate([[0.0], knots]), np.pad(volume, ((0, 0), (1, 0))))
    cells = len(axes.rail_pressure) * len(axes.quantity)
    tell(f"inverting {count_noun(cells, 'cell')} ...")
    inverse, lines = invert(simulate, lines, axes.quantity, rules)
    curves, inverse, costs = adjust(adjustment.check(), axes, curves, inverse, simulate)
    full = np.array([np.nanmax(line.lift, initial=0.0) for line in lines])[:, None]
    return InjectionMap(
        injector=injector,
        axes=axes,
        conditions=conditions,
        rules=rules,
        density=response.density_at(injector, conditions),
        curves=curves,
        volume=curves.volume[:, np.isin(curves.time, axes.energising_time)],
        ballistic=np.array([samples.lift for samples in forward]) < BALLISTIC * full,
        inverse=inverse,
        inverse_ballistic=np.nan_to_num(inverse.lift, nan=np.inf) < BALLISTIC * full,
        falls=tuple(fall for line in lines for fall in response.find_falls(line)),
        lines=tuple(lines),
        adjustment=adjustment,
        costs=costs,
    )


# Maps and sweeps in one call, with units in texts.


def quantity_map(
    model: Injector | Calibration,
    *,
    pressures: ArrayLike | None = None,
    times: ArrayLike | None = None,
    quantities: ArrayLike | None = None,
    cylinder_pressure: Quantity = 5e6,
    return_pressure: Quantity = 0.5e6,
    time_step: Quantity = DEFAULT_STEP,
    several: Several = Several.NEIGHBOURS,
    beyond: Beyond = Beyond.EXTRAPOLATE,
    smooth: Quantity | None = None,
    monotone: bool = False,
    resolution: tuple[Quantity | None, Quantity | None] = (None, None),
    threads: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> InjectionMap:
    """Simulate the quantity map of an injector and its inverse, as `commonrail map`.

    Parameters
    ----------
    model : Injector or Calibration
        A calibration stands for its calibrated injector.
    pressures, times, quantities : array, optional
        Axes, SI or texts with units, ``["40 MPa", "80 MPa"]``; default: axes of a control unit.
    cylinder_pressure, return_pressure : float or str
        [Pa].
    time_step : float or str
        [s].
    several : Several
        Energising time if several deliver a quantity.
    beyond : Beyond
        Rule for unreachable quantities.
    smooth : float or str, optional
        Quantity error that smoothing may cost in both maps, root mean square over their cells [m³].
    monotone : bool
        Pool quantities that fall with the energising time, and times that fall with the quantity.
    resolution : (float or str or None, float or str or None)
        Resolution of energising times [s] and of quantities [m³] in the control unit, to which both maps are rounded.
    threads : int, optional
        All usable processors by default.
    progress : function of str, optional
        Called before each stage.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong type, or an axis does not increase.
    SimulationError
        If no point could be simulated.
    """
    injector = _injector(model)
    usual = usual_axes(injector)
    axes = MapAxes(
        usual.rail_pressure if pressures is None else array(pressures, "Pa", "pressures", 1),
        usual.quantity if quantities is None else array(quantities, "m3", "quantities", 1),
        usual.energising_time if times is None else array(times, "s", "times", 1),
    )
    conditions = Conditions(
        number(cylinder_pressure, "Pa", "cylinder pressure"),
        number(return_pressure, "Pa", "return pressure"),
        number(time_step, "s", "time step"),
        threads,
    )
    if not (isinstance(resolution, Sequence) and not isinstance(resolution, str) and len(resolution) == 2):
        raise ConfigurationError('The resolution is a pair of a time and a quantity, such as ("0.4 us", "0.01 mm3").')
    limits = (smooth, "m3", "smoothing"), (resolution[0], "s", "resolution"), (resolution[1], "m3", "resolution")
    error, finest_time, finest_quantity = (None if value is None else number(value, *what) for value, *what in limits)
    adjustment = Adjustment(error, flag(monotone, "monotone"), finest_time, finest_quantity)
    rules = Rules(enum_member(several, Several, "several"), enum_member(beyond, Beyond, "beyond"))
    return injection_map(injector, axes, conditions, rules, progress, adjustment)


def sweep(
    model: Injector | Calibration,
    vary: dict[str, Any],
    *,
    time_step: Quantity = DEFAULT_STEP,
    threads: int | None = None,
    **fixed: Quantity,
) -> Sweep:
    """Simulate quantities over all combinations of one to three variables, as `commonrail sweep`.

    Parameters
    ----------
    model : Injector or Calibration
    vary : dict of str to array
        Values by name: rail_pressure, energising_time, first_energising_time, dwell, cylinder_pressure,
        return_pressure, temperature, or a parameter of the injector; SI or texts with units.
    time_step : float or str
        [s].
    threads : int, optional
        All usable processors by default.
    **fixed : float or str
        Fixed conditions, by the first six names above.

    Raises
    ------
    ConfigurationError
        If a name is unknown, there are too many variables or values, or a point is refused.
    SimulationError
        If all simulations failed.
    """
    return swept(*read_sweep(model, vary, fixed, time_step, threads))


def read_sweep(
    model: object, vary: object, fixed: Mapping[str, Quantity], time_step: Quantity, threads: int | None
) -> tuple[Injector, list[Variable], Base]:
    """Injector, variables and base of the arguments of `sweep`."""
    injector = _injector(model)
    for name in fixed:
        if name not in OPERATING:
            raise ConfigurationError(f"An operating point has no {name}; it has {', '.join(OPERATING)}.")
    point = {name: number(fixed.get(name, usual), unit, name) for name, (unit, usual) in OPERATING.items()}
    pressures = point.pop("cylinder_pressure"), point.pop("return_pressure")
    base = Base(**point, conditions=Conditions(*pressures, number(time_step, "s", "time step"), threads))
    variables = []
    for name, values in mapping(vary, "variables of a sweep", '{"dwell": ["400 us", "800 us"]}').items():
        full, unit = resolve_variable(name)
        variables.append(Variable(full, unit, np.atleast_1d(array(values, unit, name))))
    return injector, variables, base


def _injector(model: object) -> Injector:
    if isinstance(model, Injector):
        return model
    from commonrail.calibration.run import Calibration  # late import: maps of injectors do not need calibration

    calibration: Any = instance(model, Injector | Calibration, "model")
    injector: Injector = calibration.injector
    return injector


# Bands of measured quantities around the cells of a map, from the fit of the model.

SAME = 1e-6  # relative difference from the fit's value that counts as rounding in the injector's file


def add_bands(
    mapped: InjectionMap, study: Study, best: Mapping[str, float], draws: Floats | None = None
) -> InjectionMap:
    """Add bands by `predict` to the map of a calibrated injector; `best` holds the values [SI] of the fit.

    The bands are predicted with the conditions and the time step of the map, around its quantities: from `draws`
    (m, d), parameters [SI] of the posterior, or from new draws of `predict`.

    `ConfigurationError` if the injector of the map does not have the values of the fit, or the study fits no quantity
    map; `SimulationError` if the best values cannot be simulated.
    """
    from commonrail.plugins.prediction.run import LEVELS, predict

    values = mapped.injector.values
    for name, value in best.items():
        if name in values and not np.isclose(values[name], value, rtol=SAME, atol=0.0):
            raise ConfigurationError(
                f"{mapped.injector.name} has {name} = {values[name]:g} and the fit {value:g}: bands apply to the "
                "calibrated injector only; omit the changes or the bands."
            )
    axes, conditions = mapped.axes, mapped.conditions
    forward, inverse = np.isfinite(mapped.volume), np.isfinite(mapped.inverse.delivered) & (axes.quantity > 0.0)
    pairs = _pairs(axes.rail_pressure, np.broadcast_to(axes.energising_time, forward.shape), forward)
    pairs += _pairs(axes.rail_pressure, mapped.inverse.energising_time, inverse)
    # a needle that closes late is not a failure: simulations end with their injection anyway
    points = [replace(conditions.point(rail, time), horizon=time + response.LONGEST_AFTER) for rail, time in pairs]
    study = replace(study, time_step=conditions.time_step)
    predicted = predict(study, best, points, draws=draws, levels=LEVELS, threads=conditions.threads)
    (band,) = predicted.bands
    stated = float(np.asarray(band.data.mass_density))  # density of the data; NaN for the injector's
    factor = stated / mapped.density if np.isfinite(stated) else 1.0
    count = int(forward.sum())
    quantity, delivered = {}, {}
    for level, edges in band.edges.items():
        offsets = [factor * (edge - band.values) for edge in edges]
        quantity[level] = _tables(mapped.volume, forward, [offset[:count] for offset in offsets])
        delivered[level] = _tables(mapped.inverse.delivered, inverse, [offset[count:] for offset in offsets])
    return replace(mapped, bands=MapBands(predicted.estimator, quantity, delivered))


def _pairs(rail_pressure: Floats, time: Floats, which: Bools) -> list[tuple[float, float]]:
    """Rail pressures and energising times of marked cells."""
    rail = np.broadcast_to(rail_pressure[:, None], time.shape)
    return list(zip(rail[which].tolist(), time[which].tolist(), strict=True))


def _tables(volume: Floats, which: Bools, offsets: list[Floats]) -> tuple[Floats, Floats]:
    """Edges of all cells, from their distances to the quantities of marked cells; negative quantities are cut off."""
    low, high = np.full((2, *volume.shape), np.nan)
    centre = volume[which]
    low[which], high[which] = np.maximum(centre + offsets[0], np.minimum(centre, 0.0)), centre + offsets[1]
    return low, high
