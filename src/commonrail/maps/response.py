"""Quantities of one injector at many pairs of rail pressure and energising time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats, Ints
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import reference_density
from commonrail.engine.status import OK, STILL_INJECTING, Status
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.errors import SimulationError
from commonrail.injector.definition import Injector
from commonrail.maps.many_points import simulate_many

__all__ = ["Conditions", "Response", "density_at", "require_some", "respond", "simulate_points"]


# Simulated after the end of energising, a time and a share of the energising; a simulation ends early once its needle
# has closed, and one whose needle has not is repeated with the longest horizon.
AFTER = (2e-3, 0.5)  # [s], [1]
LONGEST_AFTER = 12e-3  # [s]


class Conditions(NamedTuple):
    """Conditions that all points of a map share.

    Attributes
    ----------
    cylinder_pressure, return_pressure : float
        [Pa].
    time_step : float
        [s].
    threads : int or None
        All usable processors by default.
    """

    cylinder_pressure: float = 5e6
    return_pressure: float = 0.5e6
    time_step: float = DEFAULT_STEP
    threads: int | None = None

    def point(self, rail_pressure: float, energisings: Iterable[tuple[float, float]] | float) -> OperatingPoint:
        """Operating point with these pressures.

        Parameters
        ----------
        rail_pressure : float
            [Pa].
        energisings : iterable of (start, duration), or float
            [s]; a number is a single energising time.
        """
        pulses = [(0.0, energisings)] if isinstance(energisings, float) else list(energisings)
        horizon = pulses[-1][0] + (1.0 + AFTER[1]) * pulses[-1][1] + AFTER[0]
        return OperatingPoint(
            rail_pressure, tuple(pulses), self.cylinder_pressure, self.return_pressure, horizon=horizon
        )


@dataclass(frozen=True)
class Response:
    """Simulated injections, arrays of one shape.

    Attributes
    ----------
    volume : array
        Injected volume at the reference density [m³], NaN where the simulation failed or the needle did not close.
    lift : array
        Largest needle lift [m].
    """

    volume: Floats
    lift: Floats


def density_at(injector: Injector, conditions: Conditions) -> float:
    """Reference density [kg/m³], which turns volumes of a map into masses: that at cylinder pressure."""
    return reference_density(injector, conditions.point(max(20e6, 2.0 * conditions.cylinder_pressure), 1e-4))


def respond(injector: Injector, rail_pressure: Floats, energising_time: Floats, conditions: Conditions) -> Response:
    """Simulate single injections.

    Parameters
    ----------
    injector : Injector
    rail_pressure, energising_time : arrays of one shape
        [Pa], [s].
    conditions : Conditions

    Raises
    ------
    ConfigurationError
        If a point lies outside what the injector's model covers.
    """
    pairs = zip(rail_pressure.ravel().tolist(), energising_time.ravel().tolist(), strict=True)
    found = simulate_points(injector, [conditions.point(rail, time) for rail, time in pairs], conditions)
    return Response(found.volume.reshape(rail_pressure.shape), found.lift.reshape(rail_pressure.shape))


def simulate_points(injector: Injector, points: Sequence[OperatingPoint], conditions: Conditions) -> Response:
    """Simulate operating points; one whose needle is still open at its end is repeated with a longer horizon.

    Parameters
    ----------
    injector : Injector
    points : sequence of OperatingPoint
    conditions : Conditions
        Time step and number of threads; the pressures are those of the points.
    """
    volume, lift, status = _simulated(injector, points, conditions)
    open_ = np.flatnonzero(status == STILL_INJECTING).tolist()
    if open_:
        longer = [replace(points[i], horizon=_last_end(points[i]) + LONGEST_AFTER) for i in open_]
        volume[open_], lift[open_], status[open_] = _simulated(injector, longer, conditions)
    return Response(np.where(status == OK, volume, np.nan), lift)


def require_some(injector: Injector, points: Sequence[OperatingPoint], found: Response, conditions: Conditions) -> None:
    """Refuse a response without a single sound simulation, with the reason of its first one.

    Parameters
    ----------
    injector : Injector
    points : sequence of OperatingPoint
    found : Response
    conditions : Conditions

    Raises
    ------
    SimulationError
        If all of them failed.
    """
    if np.all(np.isnan(found.volume)):
        status = _simulated(injector, points[:1], conditions)[2]
        raise SimulationError(f"{injector.name}: no point could be simulated. {Status(int(status[0])).sentence}")


def _last_end(point: OperatingPoint) -> float:
    """End of the last energising [s]."""
    last = point.pulses[-1]
    return last.start + last.duration


def _simulated(
    injector: Injector, points: Sequence[OperatingPoint], conditions: Conditions
) -> tuple[Floats, Floats, Ints]:
    """Volumes [m³], lifts [m] and statuses of points."""
    batch = simulate_many(injector, points, time_step=conditions.time_step, threads=conditions.threads)
    return batch.injected_volume[0], batch.greatest_lift[0], batch.status[0]
