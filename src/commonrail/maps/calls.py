"""Maps and sweeps in one call, with units in texts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from commonrail.arguments import Quantity, array, instance, number
from commonrail.calibration.run import Calibration
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.errors import ConfigurationError
from commonrail.injector.definition import Injector
from commonrail.maps.axes import MapAxes
from commonrail.maps.choices import Beyond, Several
from commonrail.maps.inverse import Rules
from commonrail.maps.quantity_map import InjectionMap, injection_map, usual_axes
from commonrail.maps.response import Conditions
from commonrail.maps.sweep import OPERATING, Base, Sweep, Variable, unit_of
from commonrail.maps.sweep import sweep as swept

__all__ = ["map", "sweep"]

# Operating point of a sweep where nothing is said: SI values.
_USUAL = {"rail_pressure": 100e6, "energising_time": 500e-6, "first_energising_time": 0.0, "dwell": 1e-3}
_PRESSURES = {"cylinder_pressure": 5e6, "return_pressure": 0.5e6}


def map(
    model: Injector | Calibration,
    *,
    pressures: ArrayLike | None = None,
    times: ArrayLike | None = None,
    quantities: ArrayLike | None = None,
    cylinder_pressure: Quantity = 5e6,
    return_pressure: Quantity = 0.5e6,
    time_step: Quantity = DEFAULT_STEP,
    several: Several = Several.SHORTEST,
    beyond: Beyond = Beyond.EXTRAPOLATE,
    threads: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> InjectionMap:
    """Quantity map of an injector and its inverse, as `commonrail map` computes it.

    Parameters
    ----------
    model : Injector or Calibration
        Of a calibration the calibrated injector.
    pressures, times, quantities : array, optional
        Axes, SI or texts with units, ``["40 MPa", "80 MPa"]``; by default those of a control unit.
    cylinder_pressure, return_pressure : float or str
        [Pa].
    time_step : float or str
        [s].
    several : Several
        Energising time where several deliver a quantity.
    beyond : Beyond
        Rule for quantities that are not reached.
    threads : int, optional
        All usable processors by default.
    progress : function of str, optional
        Called before each stage.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, or an axis does not increase.
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
    return injection_map(injector, axes, conditions, Rules(several, beyond), progress)


def sweep(
    model: Injector | Calibration,
    vary: dict[str, Any],
    *,
    time_step: Quantity = DEFAULT_STEP,
    threads: int | None = None,
    **fixed: Quantity,
) -> Sweep:
    """Quantities over all combinations of one to three variables, as `commonrail sweep` computes them.

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
        Operating point besides: the first six names above.

    Raises
    ------
    ConfigurationError
        If a name is unknown, there are too many variables or values, or a point is refused.
    SimulationError
        If all simulations failed.
    """
    injector = _injector(model)
    for name in fixed:
        if name not in OPERATING:
            raise ConfigurationError(f"There is no {name} of an operating point; there are {', '.join(OPERATING)}.")
    own = {name: number(value, OPERATING[name], name) for name, value in fixed.items()}
    given = _USUAL | _PRESSURES | own
    pressures = given["cylinder_pressure"], given["return_pressure"]
    conditions = Conditions(*pressures, number(time_step, "s", "time step"), threads)
    base = Base(**{name: given[name] for name in _USUAL}, conditions=conditions)
    return swept(injector, [_variable(*item) for item in vary.items()], base)


def _variable(name: str, values: Sequence[Any]) -> Variable:
    full, unit = unit_of(name)
    return Variable(full, unit, np.atleast_1d(array(values, unit, name)))


def _injector(model: object) -> Injector:
    return model.injector if isinstance(model, Calibration) else instance(model, Injector, "model")
