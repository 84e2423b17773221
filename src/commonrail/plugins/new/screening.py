"""Screening of an injector's parameters at the points of measured data: those that a first fit should free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.base.arguments import COUNTS
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError, nearest
from commonrail.calibration.influence import around
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.data.base import DataSet
from commonrail.data.simulator import Simulator
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.law import Domain
from commonrail.physics.variants import unread_parameters

# Half widths of ranges as shares of the value, chosen: how far an estimate is off where nobody has measured.
LENGTH, SMALL_LENGTH, ANGLE, COEFFICIENT, OTHER = 0.05, 0.2, 0.1, 0.15, 0.4
SMALL = 1e-3  # length below which a part is measured with difficulty [m]
SEEN = 0.05  # rms change of the data over their rms from which a parameter is freed: chosen, above a bench's noise
MOST = 15  # parameters that are freed
MOST_SIMULATIONS = 40_000  # some 10 s


def usual_space(injector: Injector, names: Sequence[str] = ()) -> Space:
    """Parameters of an injector, each within a usual range about its value; by default what nobody has measured.

    Measured values, counts, zeros and the temperature of the fuel are no part of these. Raises `InputError` for a name
    that is unknown, and `ConfigurationError` for one that the variant does not read, or that has no range.
    """
    for name in names:
        if name not in injector.values:
            raise InputError(f"{injector.name} has no parameter {name}{nearest(name, injector.values)}.")
    injector.check_read(names)
    return Space([_ranged(injector, name) for name in names or _names(injector)])


def screen(injector: Injector, space: Space, data: Sequence[DataSet], time_step: float) -> list[Parameter]:
    """Parameters of a space to free, best seen first; none where the data have too many points.

    From the local slopes of the simulated data: each is the parameter whose range changes them most beyond what those
    before it imitate (pivoted Gram-Schmidt; Yao et al. 2003, Polym. React. Eng. 11, 563), as long as that is `SEEN`.
    `time_step` in [s].
    """
    place = around(space, space.reference)
    left = MOST_SIMULATIONS // len(place.values)
    simulator = Simulator(injector, space.names, time_step)
    slopes = []
    for one in sorted(data, key=lambda one: len(one.simulated_points)):
        left -= len(one.simulated_points)
        size = float(np.linalg.norm(one.measured))
        if left >= 0 and size > 0.0:
            slopes.append(place.slopes(one.simulated(simulator, place.values)) / size)
    if not slopes:
        return []
    changes = np.concatenate(slopes) / np.sqrt(len(slopes))
    return [space.parameters[i] for i in _best_seen(np.where(np.isfinite(changes).all(axis=0), changes, 0.0))]


def _best_seen(changes: Floats) -> list[int]:
    """Columns of changes (n, parameters) in the order in which the data see them, up to `MOST`."""
    rest, found = changes.copy(), list[int]()
    while len(found) < MOST:
        further = np.linalg.norm(rest, axis=0)
        i = int(np.argmax(further))
        if not further[i] >= SEEN:
            break
        found.append(i)
        direction = rest[:, i] / further[i]
        rest -= np.outer(direction, direction @ rest)
    return found


def _names(injector: Injector) -> list[str]:
    of_the_model = "solenoid.turns", "drive.regulator_gain", FUEL_TEMPERATURE  # wound, chosen, stated by the bench
    fixed = {*COUNTS, *of_the_model, *unread_parameters(injector.variant)}
    return [
        name
        for name, value in injector.values.items()
        if value != 0.0 and name not in fixed and injector.sources[name].mark not in ("M", "C")
    ]


def _ranged(injector: Injector, name: str) -> Parameter:
    """Parameter with the range that is usual for what nobody has measured, within the domain."""
    q, value = injector.quantities[name], injector.values[name]
    is_coefficient = q.domain in (Domain.COEFFICIENT, Domain.UNIT)
    share = {"m": LENGTH, "rad": ANGLE, "1": COEFFICIENT}.get(q.unit, OTHER)
    if q.unit == "m" and abs(value) < SMALL:
        share = SMALL_LENGTH
    low, high = sorted((value * (1.0 - share), value * (1.0 + share)))
    high = min(high, 1.0) if is_coefficient else high
    source = injector.sources[name]
    return Parameter(name, value, low, high, q.unit, mark=source.mark, source=source.text, signed=True)  # type: ignore[arg-type]
