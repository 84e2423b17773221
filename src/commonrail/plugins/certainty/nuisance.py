"""Uncertain quantities of bench and injector that are not fitted: their effect on the residuals."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arguments import COUNTS
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.objective import Objective
from commonrail.calibration.parameter import Parameter, Prior
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Role
from commonrail.data.kinds import of_role
from commonrail.data.noise import OF_METER, TEMPERATURE, uncertain_unit
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_quantities
from commonrail.physics.meters import QUANTITIES, Meter, known_quantity
from commonrail.physics.parameters import Domain, Q

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
    if own.key in OF_METER and own.key not in data.meter_inputs:
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
    return data.changed(meter=replace(meter, values={**meter.values, key: value}))


# Study whose uncertain quantities are fitted too, with their stated deviations as priors.

REACH = 6.0  # standard deviations that a quantity may go to either side, as far as its domain admits
NEAR = 1.0  # standard deviations from an end of its domain, within which a quantity has one side
HALVINGS = 40  # of the interval that holds an end of the domain


def one_sided(study: Study) -> tuple[str, ...]:
    """Uncertain quantities within a standard deviation of an end of what is possible, such as friction about zero."""
    found: dict[str, None] = {}
    for data in of_role(study.data, Role.FIT):
        for key, (parameter, value) in _parameters(study, data, data.meter or Meter("unnamed")).items():
            room = NEAR * data.noise.deviations[key]
            if not (parameter.lower < value - room and value + room < parameter.upper):
                found[key] = None
    return tuple(found)


def with_uncertain_free(study: Study, keys: Collection[str] | None = None) -> Study | None:
    """Study with its uncertain quantities as last parameters, their standard deviations as priors.

    Parameters
    ----------
    study : Study
    keys : collection of str, optional
        Quantities that become free, the others stay uncertain; all by default.

    Returns
    -------
    Study or None
        With the fitted data alone; None if a quantity has no room about its value.
    """
    fitted: list[DataSet] = []
    added: dict[str, Parameter] = {}
    for i, data in enumerate(of_role(study.data, Role.FIT)):
        meter = data.meter or Meter(f"unnamed_{i + 1}")
        own = {k: p for k, (p, _) in _parameters(study, data, meter).items() if keys is None or k in keys}
        left = {key: value for key, value in data.noise.uncertain.items() if key not in own}
        plain = data.changed(noise=replace(data.noise, uncertain=left))
        fitted.append(plain if not set(OF_METER) & set(own) else plain.changed(meter=meter))
        added.update({parameter.name: parameter for parameter in own.values()})
    if not all(parameter.lower < parameter.upper for parameter in added.values()):
        return None
    return replace(study, data=tuple(fitted), space=wider(study.space, list(added.values())))


def wider(space: Space, more: Sequence[Parameter]) -> Space:
    """A space with more parameters, which no constraint names."""
    rows = space.rows
    if len(rows):
        rows = replace(rows, matrix=np.column_stack([rows.matrix, np.zeros((len(rows), len(more)))]))
    return Space((*space.parameters, *more), rows if len(rows) else (), space.products)


def _parameters(study: Study, data: DataSet, meter: Meter) -> dict[str, tuple[Parameter, float]]:
    """Uncertain quantities of a data set as parameters, and their values, by key; none of those that count pieces.

    Parameters
    ----------
    study : Study
    data : DataSet
    meter : Meter
        Of the data set.
    """
    found = {}
    for key, deviation in data.noise.deviations.items():
        if key in COUNTS:
            continue
        if key in OF_METER:
            default = QUANTITIES[key].default
            name, value = meter.parameter(key), meter.values.get(key, 0.0 if default is None else default)
        else:
            name = FUEL_TEMPERATURE if key == TEMPERATURE else key
            value = study.injector.values[name]
        found[key] = _parameter(name, float(value), deviation), float(value)
    return found


def _parameter(name: str, value: float, deviation: float) -> Parameter:
    """An uncertain quantity as a parameter with a prior, as far to both sides as its domain admits."""
    quantity = known_quantity(name)
    low, high = (_farthest(quantity.domain, value, sign * REACH * deviation) for sign in (-1.0, 1.0))
    source = "stated as uncertain"
    prior = Prior(value, deviation, source)
    return Parameter(name, value, low, high, quantity.unit, mark="E", source=source, prior=prior)


def _farthest(domain: Domain, value: float, reach: float) -> float:
    """Farthest value of a domain towards `value + reach`, to 1e-12 of that way."""
    if domain.admits(value + reach):
        return value + reach
    inside, outside = 0.0, 1.0
    for _ in range(HALVINGS):
        share = 0.5 * (inside + outside)
        inside, outside = (share, outside) if domain.admits(value + share * reach) else (inside, share)
    return value + inside * reach
