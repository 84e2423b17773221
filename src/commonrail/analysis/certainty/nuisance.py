"""Uncertain quantities of bench and injector that are not fitted: their effect on the residuals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.calibration.objective import Objective
from commonrail.errors import ConfigurationError
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector, parameter_quantities
from commonrail.kinds import DataSet
from commonrail.kinds.noise import OF_METER, TEMPERATURE, uncertain_unit
from commonrail.observation.meter import Meter
from commonrail.observation.quantities import QUANTITIES
from commonrail.parts.furniture import Q

__all__ = ["Nuisance", "nuisances_of"]


_UNNAMED = "unnamed"  # meter of a data set that has none


class Nuisance(NamedTuple):
    """Quantity that is uncertain and not fitted.

    Attributes
    ----------
    name : str
        With its meter or data set: "delay of bench".
    key : str
        The quantity alone.
    deviation : float
        Its standard deviation [SI].
    unit : str
        Its SI unit.
    shift : function of (d,)
        Change of the residuals (n,) for one standard deviation, at a point [SI].
    bend : function of (d,) and (d,)
        Second difference of the residuals (n,), halved, for one standard deviation to both sides of a point [SI], which
        moves by the second argument with it; zero where a side leaves the domain.
    sides : functions of (m, d)
        Residuals (m, n) of points [SI] with the quantity a standard deviation above, and below; none where neither, or
        one of both, lies in its domain.
    """

    name: str
    key: str
    deviation: float
    unit: str
    shift: Callable[[Floats], Floats]
    bend: Callable[[Floats, Floats], Floats] = lambda point, move: np.zeros(())
    sides: tuple[Callable[[Floats], Floats], ...] = ()


class _Owner(NamedTuple):
    """Quantity and the meter, data set or injector that it belongs to."""

    key: str
    owner: str


def nuisances_of(objective: Objective, root_weights: Floats) -> tuple[Nuisance, ...]:
    """Uncertain quantities that the noise models of data sets state, each once.

    Parameters
    ----------
    objective : Objective
    root_weights : (n,)
        Roots of the weights of its residuals, which the shifts are free of.

    Raises
    ------
    ConfigurationError
        If a quantity is free too, has two standard deviations, or has no value that it could deviate from.
    """
    stated: dict[_Owner, float] = {}
    for data in objective.data:
        for key, deviation in data.noise.deviations.items():
            own = _Owner(key, _owner(key, data))
            _check(objective, data, own)
            if stated.setdefault(own, deviation) != deviation:
                raise ConfigurationError(
                    f"The {key} of {own.owner} is uncertain by {stated[own]:g} and by {deviation:g} "
                    f"{uncertain_unit(key)}; state one of them."
                )
    return tuple(
        Nuisance(
            f"{own.key} of {own.owner}" if own.owner else own.key,
            own.key,
            deviation,
            uncertain_unit(own.key),
            *_changes(objective, own, deviation, root_weights),
        )
        for own, deviation in stated.items()
    )


def _owner(key: str, data: DataSet) -> str:
    if key not in OF_METER:
        return ""
    return data.name if data.meter is None else data.meter.name


def _check(objective: Objective, data: DataSet, own: _Owner) -> None:
    name = FUEL_TEMPERATURE if own.key == TEMPERATURE else own.key
    free = name in objective.names
    if own.key in OF_METER and data.meter is not None:
        free = data.meter.parameter(own.key) in objective.names
    if free:
        raise ConfigurationError(
            f"{own.key} is uncertain in the noise of {data.name} and free in the fit; give it a prior, or fix it."
        )
    if own.key == "cutoff" and (data.meter is None or "cutoff" not in data.meter.values):
        raise ConfigurationError(
            f"{data.name}: the cutoff is uncertain, and no meter has one that it could deviate from; describe the "
            "meter in a table [meters.NAME]."
        )
    if own.key in OF_METER and own.key not in data.seen:
        raise ConfigurationError(
            f"{data.name}: the {own.key} of a meter has no effect on data of this kind; remove it."
        )


def _concerned(data: DataSet, own: _Owner) -> bool:
    """True if a quantity acts on a data set."""
    if own.key in OF_METER:
        return _owner(own.key, data) == own.owner
    return own.key != TEMPERATURE or own.key in data.noise.deviations


def _changes(
    objective: Objective, own: _Owner, deviation: float, root_weights: Floats
) -> tuple[Callable[[Floats], Floats], Callable[[Floats, Floats], Floats], tuple[Callable[[Floats], Floats], ...]]:
    """Functions `Nuisance.shift`, `Nuisance.bend` and `Nuisance.sides` of a quantity."""
    rows = np.concatenate([np.full(len(d.measured), _concerned(d, own)) for d in objective.data])
    sides = [moved for sign in (1.0, -1.0) if (moved := _moved(objective, own, sign * deviation)) is not None]

    def shift(point: Floats) -> Floats:
        ends = [side.residuals(point[None])[0][: len(rows)] for side in sides]
        if len(ends) == 1:  # the other side leaves the domain
            ends.append(2.0 * objective.residuals(point[None])[0][: len(rows)] - ends[0])
        change = 0.5 * (ends[0] - ends[1]) / root_weights
        return np.where(rows & np.isfinite(change), change, 0.0)

    def bend(point: Floats, move: Floats) -> Floats:
        if len(sides) == 1:
            return np.zeros(len(rows))
        middle = objective.residuals(point[None])[0][: len(rows)]
        ends = [
            side.residuals((point + sign * move)[None])[0][: len(rows)]
            for sign, side in zip((1.0, -1.0), sides, strict=True)
        ]
        change = (0.5 * (ends[0] + ends[1]) - middle) / root_weights
        return np.where(np.isfinite(change), change, 0.0)

    def with_side(side: Objective) -> Callable[[Floats], Floats]:
        def residuals(points: Floats) -> Floats:
            found = side.residuals(points)[:, : len(rows)]
            if not rows.all():
                found = np.where(rows, found, objective.residuals(points)[:, : len(rows)])
            return np.asarray(found / root_weights)

        return residuals

    return shift, bend, tuple(with_side(side) for side in sides if len(sides) == 2)


def _moved(objective: Objective, own: _Owner, change: float) -> Objective | None:
    """The objective with a quantity changed; None where the change leaves its domain."""
    data: Sequence[DataSet] = objective.data
    injector: Injector = objective.injector
    if own.key in OF_METER:
        changed = [_with_change(d, own.key, change) if _concerned(d, own) else d for d in data]
        data = [d for d in changed if d is not None]
        if len(data) < len(changed):
            return None
    else:
        name = FUEL_TEMPERATURE if own.key == TEMPERATURE else own.key
        value = injector.values[name] + change
        if not _admits(parameter_quantities()[name], value):
            return None
        injector = injector.with_values({name: value})
    return Objective(
        injector,
        objective.names,
        data,
        objective.time_step,
        objective.threads,
        goal=objective.goal,
        same_bits=objective.simulator.same_bits,
    )


def _admits(quantity: Q, value: float) -> bool:
    return bool(quantity.domain.admits(value))


def _with_change(data: DataSet, key: str, change: float) -> DataSet | None:
    meter = data.meter or Meter(_UNNAMED)
    default = QUANTITIES[key].default
    value = meter.values.get(key, 0.0 if default is None else default) + change
    if not _admits(QUANTITIES[key], value):
        return None
    return data.with_meter(replace(meter, values={**meter.values, key: value}))
