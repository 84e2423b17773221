"""Channels of a solution, read off the states of an engine."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from commonrail.choices import Boundary
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.plan import coefficients_at
from commonrail.injector.definition import Injector
from commonrail.injector.model import Coefficients
from commonrail.injector.variants import Variant, wiring
from commonrail.parts import solenoid

Floats = NDArray[np.float64]
States = Mapping[str, Floats]


def read_channels(injector: Injector, point: OperatingPoint, time: Floats, states: States) -> dict[str, Floats]:
    """Channels of a `Solution` of the fast engines.

    Parameters
    ----------
    injector : Injector
    point : OperatingPoint
    time : (samples,)
        [s].
    states : mapping of str to (samples,)
        State at those times, by the names of `lanes.trace_paths`.
    """
    if injector.variant.boundary is Boundary.VOLUME or not isinstance(point.rail_pressure, Trace):
        rail = states["rail.pressure"]
    else:
        rail = point.rail_pressure.at(time)
    pressures = {
        "control_pressure": states["control_chamber.fuel.pressure"],
        "accumulation_pressure": states["accumulation.fuel.pressure"],
        "sac_pressure": states["sac.pressure"],
        "rail_pressure": rail,
        "return_pressure": states["return_line.pressure"],
    }
    return all_channels(coefficients_at(injector, point, 1e-6), injector.wired(), states, pressures)


def all_channels(c: Coefficients, variant: Variant, states: States, pressures: States) -> dict[str, Floats]:
    """Lifts, the given pressures, and what follows from flux and lift reached, as any engine names them.

    Parameters
    ----------
    c : Coefficients
    variant : Variant
    states, pressures : mapping of str to (samples,)
    """
    wired = wiring(variant)
    body, discharge = wired.body, wired.laws.discharge
    magnet = solenoid.circuit(c.solenoid, states["solenoid.flux"], c.valve.lift - states["valve.lift"])  # type: ignore[arg-type]
    return {
        "needle_lift": states[f"body.{body.TIP}"],
        "plunger_lift": states[f"body.{body.TOP}"],
        "valve_lift": states["valve.lift"],
        **pressures,
        "coil_current": np.asarray(magnet.current),
        "magnetic_force": np.asarray(solenoid.pull(c.solenoid, states["solenoid.pulling_flux"])),  # type: ignore[arg-type]
        "discharge_coefficient": np.array([discharge(c.nozzle, z) for z in states["nozzle.lift_reached"]]),
    }
