"""Names and values that a person reads off the rows of a trace."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from commonrail.choices import Body, Boundary
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.injector.definition import Injector
from commonrail.parts import nozzle, solenoid

Floats = NDArray[np.float64]


def read_channels(
    injector: Injector, point: OperatingPoint, names: Sequence[str], time: Floats, rows: Floats
) -> dict[str, Floats]:
    """Channels of a `Solution` from the state at times (samples,) [s], rows (samples, rows)."""

    def row(name: str) -> Floats:
        return np.asarray(rows[:, names.index(name)])

    flexible = injector.variant.body is Body.FLEXIBLE
    p = injector.parameters
    magnet = solenoid.coefficients(p.solenoid)
    gap = p.valve.lift - row("valve.lift")
    holes = nozzle.coefficients(p.nozzle, point.at_start(point.rail_pressure), 1.0)
    if injector.variant.boundary is Boundary.VOLUME or not isinstance(point.rail_pressure, Trace):
        rail = row("rail.pressure")
    else:
        rail = point.rail_pressure.at(time)
    return {
        "needle_lift": row("body.z.i9" if flexible else "body.z"),
        "plunger_lift": row("body.z.i1" if flexible else "body.z"),
        "valve_lift": row("valve.lift"),
        "control_pressure": row("control_chamber.fuel.pressure"),
        "accumulation_pressure": row("accumulation.fuel.pressure"),
        "sac_pressure": row("sac.pressure"),
        "rail_pressure": rail,
        "return_pressure": row("return_line.pressure"),
        "coil_current": np.array(
            [solenoid.circuit(magnet, f, g).current for f, g in zip(row("solenoid.flux"), gap, strict=True)]
        ),
        "magnetic_force": np.array([solenoid.pull(magnet, f) for f in row("solenoid.pulling_flux")]),
        "discharge_coefficient": np.array([nozzle.discharge(holes, z) for z in row("nozzle.lift_reached")]),
    }
