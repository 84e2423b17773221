"""Uncertain quantities of bench and injector that are not fitted: parameters beside the study's, with their priors.

A quantity that a study states as uncertain is a further parameter whose prior is what is stated. As such it is fitted
by tests and where it has one side, see `with_uncertain_free`; one that the fit leaves at its value is a `Nuisance`,
whose residuals are those of the same further parameter, a standard deviation off.

What is done with it differs, each time for a reason. With room to both sides it stays beside the fit and moves the
estimates, by derivatives or, where these are large, by fits to both sides (`estimate`): the likelihood ripples along
the path on which parameters imitate it, and derivatives alone cost coverage (`tools/coverage.py`). About an end of its
domain it is fitted and integrated out (`one_sided`): it moves the estimates to one side, along a curve. Tests of what
a model lacks fit all that is stated (`missing`, `lack_of_fit`), else they take it for a fault. What nobody states is
assumed with a size, by derivatives alone (`verdict`): every verdict asks for it, and it costs no simulation. A drift is
no parameter of a model, and its courses stand beside the test for it (`lack_of_fit`).
"""

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
from commonrail.data.noise import OF_METER, TEMPERATURE, uncertain_unit
from commonrail.data.registry import of_role
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.law import Domain
from commonrail.physics.meters import QUANTITIES, Meter, known_quantity

SIDES = (1.0, -1.0)


class Nuisance(NamedTuple):
    """Quantity that is uncertain and not fitted."""

    name: str  # with its meter or data set: "delay of bench"
    key: str  # the quantity alone
    deviation: float  # its standard deviation [SI]
    unit: str  # its SI unit
    # residuals (m, n) with the quantity so many standard deviations off, of points (m, d) [SI]
    residuals: Callable[[float, Floats], Floats]
    sides: tuple[float, ...] = SIDES  # standard deviations, of 1 and -1 those that lie in its domain

    def shift(self, point: Floats) -> Floats:
        """Change of the residuals (n,) for one standard deviation, at a point (d,) [SI]; zero where it is unknown."""
        ends = [self.residuals(side, point[None])[0] for side in self.sides]
        if len(ends) == 1:  # the other side leaves the domain
            ends.append(2.0 * self.residuals(0.0, point[None])[0] - ends[0])
        change = 0.5 * (ends[0] - ends[1])
        return np.where(np.isfinite(change), change, 0.0)

    def second_change(self, point: Floats, move: Floats) -> Floats:
        """Second difference of the residuals (n,), halved, for one standard deviation to both sides of a point (d,).

        The point [SI] moves by `move` (d,) with the quantity. Zero where a side leaves the domain.
        """
        middle = self.residuals(0.0, point[None])[0]
        if len(self.sides) < len(SIDES):
            return np.zeros_like(middle)
        above, below = (self.residuals(side, (point + side * move)[None])[0] for side in SIDES)
        change = 0.5 * (above + below) - middle
        return np.where(np.isfinite(change), change, 0.0)

    def at(self, last: Floats) -> Nuisance:
        """The same quantity of a study whose last parameters are fixed at values (m,) [SI]."""

        def residuals(deviations: float, points: Floats) -> Floats:
            return self.residuals(deviations, np.column_stack([points, np.tile(last, (len(points), 1))]))

        return self._replace(residuals=residuals)


class _Stated(NamedTuple):
    """Uncertain quantity of a data set as its noise states it."""

    key: str
    name: str  # of the parameter that it would be
    value: float  # [SI]
    deviation: float  # [SI]

    @property
    def parameter(self) -> Parameter:
        """The quantity with its deviation as a prior, free as far to both sides as its domain admits."""
        quantity, source = known_quantity(self.name), "stated as uncertain"
        low, high = (_farthest(quantity.domain, self.value, side * REACH * self.deviation) for side in (-1.0, 1.0))
        prior = Prior(self.value, self.deviation, source)
        return Parameter(self.name, self.value, low, high, quantity.unit, mark="E", source=source, prior=prior)

    @property
    def sides(self) -> tuple[float, ...]:
        """Of 1 and -1 standard deviations those that lie in its domain."""
        domain = known_quantity(self.name).domain
        return tuple(side for side in SIDES if domain.admits(self.value + side * self.deviation))


def _stated_of(injector: Injector, data: DataSet) -> list[_Stated]:
    """Uncertain quantities of a data set that is seen through a meter."""
    meter, found = data.meter or Meter("unnamed"), []  # one of a meter's quantities has its own
    for key, deviation in data.noise.deviations.items():
        if key in OF_METER:
            default = QUANTITIES[key].default
            name, value = meter.parameter(key), meter.values.get(key, 0.0 if default is None else default)
        else:
            name = FUEL_TEMPERATURE if key == TEMPERATURE else key
            value = injector.values[name]
        found.append(_Stated(key, name, float(value), deviation))
    return found


def _behind_a_meter(data: DataSet, index: int) -> DataSet:
    """Data set that has a meter, a neutral one of its own where it has none and a meter's quantity is uncertain."""
    has = data.meter is not None or not set(OF_METER) & set(data.noise.uncertain)
    return data if has else data.changed(meter=Meter(f"unnamed_{index + 1}"))


def nuisances_of(objective: Objective, root_weights: Floats) -> tuple[Nuisance, ...]:
    """Uncertain quantities that the noise models of data sets state, each once.

    `root_weights` (n,): roots of the weights of its residuals, which those of the quantities are free of. Raises
    `ConfigurationError` if a quantity is free too, has two standard deviations, or has no value that it could deviate
    from.
    """
    data = [_behind_a_meter(one, i) for i, one in enumerate(objective.data)]
    stated: dict[str, _Stated] = {}
    owners: dict[str, str] = {}  # meter or data set, by the name of the parameter
    for own, metered in zip(objective.data, data, strict=True):
        for one in _stated_of(objective.injector, metered):
            _check(objective, own, one)
            owners[one.name] = (own.meter or own).name if one.key in OF_METER else ""
            first = stated.setdefault(one.name, one)
            if first.deviation != one.deviation:
                raise ConfigurationError(
                    f"The {one.key} of {owners[one.name]} is uncertain by {first.deviation:g} and by "
                    f"{one.deviation:g} {uncertain_unit(one.key)}; state one of them."
                )
    if not stated:
        return ()
    wide = Objective(
        objective.injector,
        [*objective.names, *stated],
        data,
        objective.time_step,
        objective.simulator.threads,
        goal=objective.goal,
        same_bits=objective.simulator.same_bits,
    )
    values = np.array([one.value for one in stated.values()])
    heated = np.concatenate([np.full(len(d.measured), TEMPERATURE in d.noise.deviations) for d in data])

    def moved(points: Floats, changes: Floats) -> Floats:
        columns = np.column_stack([points, np.tile(values + changes, (len(points), 1))])
        return np.asarray(wide.residuals(columns)[:, : len(root_weights)] / root_weights)

    def nuisance(column: int, one: _Stated) -> Nuisance:
        def residuals(deviations: float, points: Floats) -> Floats:
            changes = np.zeros(len(values))
            changes[column] = deviations * one.deviation
            found = moved(points, changes)
            if one.key == TEMPERATURE and not heated.all():  # the fuel of the other data sets is another
                found = np.where(heated, found, moved(points, np.zeros(len(values))))
            return found

        name = f"{one.key} of {owners[one.name]}" if owners[one.name] else one.key
        return Nuisance(name, one.key, one.deviation, uncertain_unit(one.key), residuals, one.sides)

    return tuple(nuisance(i, one) for i, one in enumerate(stated.values()))


def _check(objective: Objective, data: DataSet, one: _Stated) -> None:
    """Refuse an uncertain quantity that is free, has no value or does not act on the data set."""
    if one.name in objective.names:
        raise ConfigurationError(
            f"{one.key} is uncertain in the noise of {data.name} and free in the fit; give it a prior, or fix it."
        )
    if one.key == "cutoff" and (data.meter is None or "cutoff" not in data.meter.values):
        raise ConfigurationError(
            f"{data.name}: the cutoff is uncertain, and no meter has one that it could deviate from; describe the "
            "meter in a table [meters.NAME]."
        )
    if one.key in OF_METER and one.key not in data.meter_inputs:
        raise ConfigurationError(
            f"{data.name}: the {one.key} of a meter has no effect on data of this kind; remove it."
        )


# Study whose uncertain quantities are fitted too, with their stated deviations as priors.

REACH = 6.0  # standard deviations that a quantity may go to either side, as far as its domain admits
NEAR = 1.0  # standard deviations from an end of its domain, within which a quantity has one side
HALVINGS = 40  # of the interval that holds an end of the domain


def one_sided(study: Study) -> tuple[str, ...]:
    """Uncertain quantities within a standard deviation of an end of what is possible, such as friction about zero."""
    found: dict[str, None] = {}
    for i, data in enumerate(of_role(study.data, Role.FIT)):
        for one in _stated_of(study.injector, _behind_a_meter(data, i)):
            if one.key in COUNTS:
                continue
            parameter, room = one.parameter, NEAR * one.deviation
            if not (parameter.lower < one.value - room and one.value + room < parameter.upper):
                found[one.key] = None
    return tuple(found)


def with_uncertain_free(study: Study, keys: Collection[str] | None = None) -> Study | None:
    """Study with its uncertain quantities, or those of some `keys`, as last parameters with priors; fitted data alone.

    The others stay uncertain, as those do that count pieces. None if a quantity cannot move from its value.
    """
    fitted: list[DataSet] = []
    added: dict[str, Parameter] = {}
    for i, data in enumerate(of_role(study.data, Role.FIT)):
        metered = _behind_a_meter(data, i)
        own = {
            one.key: one.parameter
            for one in _stated_of(study.injector, metered)
            if one.key not in COUNTS and (keys is None or one.key in keys)
        }
        left = {key: value for key, value in data.noise.uncertain.items() if key not in own}
        seen = metered if set(OF_METER) & set(own) else data
        fitted.append(seen.changed(noise=replace(data.noise, uncertain=left)))
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


def _farthest(domain: Domain, value: float, reach: float) -> float:
    """Farthest value of a domain towards `value + reach`, to 1e-12 of that way."""
    if domain.admits(value + reach):
        return value + reach
    inside, outside = 0.0, 1.0
    for _ in range(HALVINGS):
        share = 0.5 * (inside + outside)
        inside, outside = (share, outside) if domain.admits(value + share * reach) else (inside, share)
    return value + inside * reach
