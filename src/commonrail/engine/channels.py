"""Channels of a solution, read off the states of an engine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from commonrail.arrays import Floats
from commonrail.choices import Actuation, Boundary
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.plan import coefficients_at
from commonrail.injector.definition import Injector
from commonrail.injector.variants import Variant, wiring
from commonrail.parts import solenoid

States = Mapping[str, Floats]

_PRESSURES = {  # names of the states, those that an injector has
    "control_pressure": "control_chamber.fuel.pressure",
    "accumulation_pressure": "accumulation.fuel.pressure",
    "sac_pressure": "sac.pressure",
    "rail_pressure": "rail.pressure",
    "return_pressure": "return_line.pressure",
}


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
    held = dict(states)
    if isinstance(point.rail_pressure, Trace) and injector.variant.boundary is not Boundary.VOLUME:
        held["rail.pressure"] = point.rail_pressure.at(time)
    elif "rail.pressure" not in held:
        held["rail.pressure"] = np.full(len(time), point.rail_pressure)
    pressures = {name: held[path] for name, path in _PRESSURES.items() if path in held}
    return all_channels(coefficients_at(injector, point, 1e-6), injector.wired(), states, pressures)


def all_channels(c: Any, variant: Variant, states: States, pressures: States) -> dict[str, Floats]:
    """Lifts, the given pressures, and what follows from flux and lift reached, as any engine names them.

    Parameters
    ----------
    c : Coefficients
        Of the variant's actuation.
    variant : Variant
    states, pressures : mapping of str to (samples,)
    """
    wired = wiring(variant)
    body, discharge = wired.body, wired.laws.discharge
    moved = states[f"body.{body.TOP}"]
    if variant.actuation is Actuation.DIRECT:
        lifts, gap = {"armature_lift": moved}, c.armature.travel - moved
    else:
        lifts = {"plunger_lift": moved, "valve_lift": states["valve.lift"]}
        gap = c.valve.lift - states["valve.lift"]
    magnet = solenoid.circuit(c.solenoid, states["solenoid.flux"], gap)  # type: ignore[arg-type]
    return {
        "needle_lift": states[f"body.{body.TIP}"],
        **lifts,
        **pressures,
        "coil_current": np.asarray(magnet.current),
        "magnetic_force": np.asarray(solenoid.magnetic_force(c.solenoid, states["solenoid.pulling_flux"])),  # type: ignore[arg-type]
        "discharge_coefficient": np.array([discharge(c.nozzle, z) for z in states["nozzle.lift_reached"]]),
    }
