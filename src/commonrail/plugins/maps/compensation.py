"""Energising times for a constant quantity: second injection at any dwell, or single injection over a condition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import Quantity, array, number
from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError
from commonrail.base.units import convert
from commonrail.engine.status import OK
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.physics.injector import Injector
from commonrail.plugins.maps.axes import MapAxes, increasing
from commonrail.plugins.maps.inverse import Inverse, invert, sample_lines
from commonrail.plugins.maps.response import Conditions, Response, sample_times, simulate_many
from commonrail.plugins.maps.run import InjectionMap, injection_map, read_sweep
from commonrail.plugins.maps.sweep import OPERATING, TIMES, Base, Variable, check_values, find_fused, table_unit

if TYPE_CHECKING:
    from commonrail.calibration.run import Calibration

NARROW = 1e-6  # bracket of the dwell at which two injections fuse [s]


@dataclass(frozen=True, repr=False)
class Compensation(Shown):
    """Energising times that deliver quantities over a condition and rail pressures.

    Attributes
    ----------
    alone : InjectionMap
        Single injections over the same pressures and quantities, with the condition unchanged.
    first_energising_time : float
        Of a first injection [s]; zero for a single injection.
    condition : Variable
        Dwell from the end of the first energising to the start of the second, or a variable of a sweep.
    energising_time : (conditions, pressures, quantities)
        Of the second injection, or of the single one [s].
    inverses : tuple of Inverse
        One for each value of the condition.
    """

    presenter = "commonrail.plugins.maps.sweep_page:COMPENSATION"

    alone: InjectionMap
    first_energising_time: float
    condition: Variable
    energising_time: Floats
    inverses: tuple[Inverse, ...]

    @property
    def unit(self) -> str:
        """Unit of the condition in files and tables."""
        return table_unit(self.condition.unit)

    @property
    def values(self) -> list[float]:
        """Values of the condition in that unit."""
        return [float(f"{v:.9g}") for v in convert(self.condition.values, self.condition.unit, self.unit).tolist()]


def compensation(
    injector: Injector, axes: MapAxes, first_energising_time: float, dwell: Floats, conditions: Conditions
) -> Compensation:
    """Find energising times of a second injection that hold its quantity, at dwells (d,) [s].

    The quantity is the total minus the quantity of the first injection alone, and NaN if both injections are fused.
    `axes` belong to the second injection. `ConfigurationError` if a dwell is negative or the first energising time [s]
    is not greater than zero.
    """
    if not (first_energising_time > 0.0 and np.all(dwell >= 0.0)):
        raise ConfigurationError("The first energising time must be greater than zero, the dwells zero or greater.")
    alone = injection_map(injector, axes, conditions)
    pressures, count = axes.rail_pressure, len(axes.rail_pressure)
    base = Base(float(pressures[0]), 0.0, first_energising_time, 0.0, conditions)
    first = simulate_many(injector, base.points({"rail_pressure": pressures}, alone=True), conditions)
    rows_pressure, rows_dwell = np.tile(pressures, len(dwell)), np.repeat(dwell, count)
    rows_first, delay = np.tile(first.injected_volume[0], len(dwell)), np.tile(first.opening[0], len(dwell))

    def simulate(rows: IndexArray, times: Floats) -> Response:
        changed = {"rail_pressure": rows_pressure[rows], "dwell": rows_dwell[rows], "energising_time": times}
        points = base.points(changed)
        batch = simulate_many(injector, points, conditions)
        is_fused = find_fused(batch, points.last_starts, delay[None, rows])[0]
        is_separate = ~is_fused & (batch.status[0] == OK)
        return Response(
            np.where(is_separate, batch.injected_volume[0] - rows_first[rows], np.nan), batch.greatest_lift[0]
        )

    lines = sample_lines(simulate, rows_pressure, sample_times(axes.energising_time))
    inverse, _ = invert(simulate, lines, axes.quantity, alone.rules)
    parts = [Inverse._make(table[i : i + count] for table in inverse) for i in range(0, len(rows_dwell), count)]
    times = np.array([inverse_at_dwell.energising_time for inverse_at_dwell in parts])
    return Compensation(alone, first_energising_time, Variable("dwell", "s", dwell), times, tuple(parts))


def hold(
    model: Injector | Calibration,
    vary: dict[str, Any],
    quantities: ArrayLike,
    *,
    longest: Quantity = 2e-3,
    time_step: Quantity = DEFAULT_STEP,
    threads: int | None = None,
    **fixed: Quantity,
) -> Compensation:
    """Find energising times that deliver quantities over rail pressures and a condition, as `commonrail sweep --hold`.

    Parameters
    ----------
    model : Injector or Calibration
    vary : dict of str to array
        Rail pressures and one condition, such as ``{"rail_pressure": ["80 MPa"], "drive.boost_voltage": [50, 65]}``.
        With a ``first_energising_time`` the condition is the dwell, and the times apply to the second injection.
    quantities : array
        SI values or texts with units [m³]; a small quantity gives the dead time.
    longest : float or str
        Longest simulated energising time [s].
    time_step, threads, **fixed
        As in `sweep`.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong type, or other variables are varied.
    SimulationError
        If no point could be simulated.
    """
    injector, variables, base = read_sweep(model, vary, fixed, time_step, threads)
    volumes = array(quantities, "m3", "quantities", 1)
    return hold_quantities(injector, variables, volumes, base, number(longest, "s", "longest energising time"))


def hold_quantities(
    injector: Injector, variables: Sequence[Variable], quantity: Floats, base: Base, longest: float
) -> Compensation:
    """Find energising times, up to `longest` [s], that deliver quantities (k,) [m³] over the variables of a sweep.

    With a first injection the variables are rail pressures and the dwell, else rail pressures and any one condition.
    `ConfigurationError` for other variables.
    """
    varied = {v.name: v for v in variables}
    rail = varied.pop("rail_pressure", Variable("rail_pressure", "Pa", np.array([base.rail_pressure])))
    axes = MapAxes(rail.values, quantity, np.array([longest]))
    if base.first_energising_time > 0.0 and set(varied) <= {"dwell"}:
        dwells = varied["dwell"].values if varied else np.array([base.dwell])
        dwells = increasing(dwells, "s", "dwells")
        return compensation(injector, axes, base.first_energising_time, dwells, base.conditions)
    if base.first_energising_time > 0.0 or len(varied) != 1 or set(varied) & set(TIMES):
        raise ConfigurationError(
            "vary rail_pressure and dwell alone, and give the energising time of a first injection, or vary "
            "rail_pressure and one condition of a single injection."
        )
    ((name, condition),) = varied.items()
    condition = condition._replace(values=increasing(condition.values, condition.unit, f"values of {name}"))
    check_values(injector, [condition])

    def at(value: float) -> Inverse:
        changed: dict[str, Any] = {name: value}
        if name in OPERATING:
            return injection_map(injector, axes, base.conditions._replace(**changed)).inverse
        return injection_map(injector.with_values(changed), axes, base.conditions).inverse

    inverses = tuple(map(at, condition.values.tolist()))
    times = np.array([inverse.energising_time for inverse in inverses])
    return Compensation(injection_map(injector, axes, base.conditions), 0.0, condition, times, inverses)


def fusion_dwell(injector: Injector, base: Base, rail_pressure: Floats, longest: float) -> Floats:
    """Find the longest dwell (n,) [s] at which two injections of a base fuse, at rail pressures (n,) [Pa].

    NaN where they fuse at `longest` [s] too, and where a simulation failed. Bisection to 1 us, which assumes that
    injections fused at one dwell are fused at all shorter ones.
    """
    low, high = np.zeros(len(rail_pressure)), np.full(len(rail_pressure), longest)
    first = simulate_many(injector, base.points({"rail_pressure": rail_pressure}, alone=True), base.conditions)
    delay, lost = first.opening, first.status[0] != OK

    def find_fused_at(dwell: Floats) -> Bools:
        points = base.points({"rail_pressure": rail_pressure, "dwell": dwell})
        batch = simulate_many(injector, points, base.conditions)
        lost[batch.status[0] != OK] = True
        return np.asarray(find_fused(batch, points.last_starts, delay)[0])

    beyond, never = find_fused_at(high), ~find_fused_at(low)
    while np.max(high - low) > NARROW:
        middle = 0.5 * (low + high)
        is_fused = find_fused_at(middle)
        low, high = np.where(is_fused, middle, low), np.where(is_fused, high, middle)
    return np.where(beyond | lost, np.nan, np.where(never, 0.0, 0.5 * (low + high)))
