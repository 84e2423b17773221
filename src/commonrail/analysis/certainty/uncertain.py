"""Study whose uncertain quantities are fitted too, with their stated deviations as priors."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from commonrail.arguments import COUNTS
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.prior import Prior
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study
from commonrail.injector.definition import FUEL_TEMPERATURE
from commonrail.kinds import DataSet, Role, of_role
from commonrail.kinds.noise import OF_METER, TEMPERATURE
from commonrail.observation.meter import Meter
from commonrail.observation.quantities import QUANTITIES, known_quantity
from commonrail.parts.furniture import Domain

__all__ = ["one_sided", "wider", "with_uncertain_free"]

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
        plain = data.with_noise(replace(data.noise, uncertain=left))
        fitted.append(plain if not set(OF_METER) & set(own) else plain.with_meter(meter))
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
