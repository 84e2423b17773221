"""Uncertain quantities of the bench as parameters: each has a prior, by the study or by what benches usually know.

The fit takes them along and the draws vary them with the parameters of the study, so that intervals, correlations and
bands hold what they may be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from commonrail.base.arguments import COUNTS
from commonrail.base.errors import ConfigurationError
from commonrail.base.text import quantity
from commonrail.calibration.parameter import Parameter, Prior
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study
from commonrail.calibration.usual import UNNAMED
from commonrail.data.base import DataSet, Role
from commonrail.data.noise import OF_METER, TEMPERATURE
from commonrail.data.registry import of_role
from commonrail.physics.injector import FUEL_TEMPERATURE
from commonrail.physics.law import Domain
from commonrail.physics.meters import QUANTITIES, Meter, known_quantity

# Standard deviations of what a bench leaves open where a study neither states nor frees it: the delay of a meter is
# seldom known to better than a fraction of a sample, its gain to better than a calibration. Engineering estimates.
USUAL = {"delay": 1e-6, "gain": 0.01}  # [s], [1]
STATED, ASSUMED = "stated as uncertain", "usual for a bench, the study states nothing"
REACH = 6.0  # standard deviations that a quantity may go to either side, as far as its domain admits
HALVINGS = 40  # of the interval that holds an end of the domain


def with_uncertain_free(study: Study) -> Study:
    """Study whose uncertain quantities are its last parameters, with their deviations as priors; fitted data alone.

    Raises `ConfigurationError` for a statement that does not fit the study.
    """
    fitted: list[DataSet] = []
    added: dict[str, Parameter] = {}
    for data in of_role(study.data, Role.FIT):
        seen, more = _of_data(study, data)
        fitted.append(seen.changed(noise=replace(seen.noise, uncertain={})))
        for parameter in more:
            first = added.setdefault(parameter.name, parameter)
            if first.source == ASSUMED and parameter.source == STATED:
                added[parameter.name] = parameter
            elif first.prior != parameter.prior and parameter.source == STATED:
                sizes = [quantity(p.prior.sigma, p.unit, 3) for p in (first, parameter) if p.prior is not None]
                raise ConfigurationError(
                    f"{parameter.name} is uncertain by {sizes[0]} and by {sizes[1]}; state one of them."
                )
    return replace(study, data=tuple(fitted), space=_with_parameters(study.space, list(added.values())))


def _of_data(study: Study, data: DataSet) -> tuple[DataSet, list[Parameter]]:
    """Data set with a meter, and its uncertain quantities as parameters."""
    meter, stated, parameters = data.meter or Meter(UNNAMED), data.noise.deviations, []
    usual = {
        key: deviation
        for key, deviation in USUAL.items()
        if key in data.meter_inputs and key not in stated and meter.parameter(key) not in study.space.names
    }
    for key, deviation in {**stated, **usual}.items():
        name = meter.parameter(key) if key in OF_METER else FUEL_TEMPERATURE if key == TEMPERATURE else key
        source = STATED if key in stated else ASSUMED
        if source == STATED:
            _check(study, data, key, name)
        if key in OF_METER:
            default = QUANTITIES[key].default
            value = meter.values.get(key, 0.0 if default is None else default)
        else:
            value = study.injector.values[name]
        parameters.append(_parameter(name, float(value), deviation, source))
    return (data if data.meter is not None else data.changed(meter=meter)), parameters


def _check(study: Study, data: DataSet, key: str, name: str) -> None:
    """Refuse an uncertain quantity that is free, counts pieces, has no value or does not act on the data set."""
    if name in study.space.names:
        raise ConfigurationError(
            f"{key} is uncertain in the noise of {data.name} and free in the fit; give it a prior, or fix it."
        )
    if key in COUNTS:
        raise ConfigurationError(f"{data.name}: {key} counts pieces, which have no standard deviation; remove it.")
    if key == "cutoff" and (data.meter is None or "cutoff" not in data.meter.values):
        raise ConfigurationError(
            f"{data.name}: the cutoff is uncertain, and no meter has one that it could deviate from; describe the "
            "meter in a table [meters.NAME]."
        )
    if key in OF_METER and key not in data.meter_inputs:
        raise ConfigurationError(f"{data.name}: the {key} of a meter has no effect on data of this kind; remove it.")


def _parameter(name: str, value: float, deviation: float, source: str) -> Parameter:
    """Quantity with its deviation as a prior, free as far to both sides as its domain admits."""
    quantity = known_quantity(name)
    low, high = (_farthest(quantity.domain, value, side * REACH * deviation) for side in (-1.0, 1.0))
    if not low < high:
        raise ConfigurationError(f"{name} cannot deviate from {value:g} {quantity.unit}; do not state it as uncertain.")
    prior = Prior(value, deviation, source)
    return Parameter(name, value, low, high, quantity.unit, mark="E", source=source, prior=prior)


def _with_parameters(space: Space, more: Sequence[Parameter]) -> Space:
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
