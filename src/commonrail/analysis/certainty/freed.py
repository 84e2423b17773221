"""Tests for lack of fit once more, with what a study states as uncertain free within its standard deviation.

A delay of two microseconds bends the path that the parameters imitate it along: what is left of it at the fitted values
is neither its derivative nor its second one, and a test that knows these two takes it for a fault of the model. Where
such a test finds something, the uncertain quantities are fitted too, with their standard deviations as priors, and the
test is made there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.certainty.estimate import Estimate, estimate
from commonrail.analysis.certainty.lack_of_fit import LackOfFit, lack_of_fit
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.certainty.missing_delay import MissingDelay
from commonrail.analysis.certainty.steps import Walls
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.prior import Prior
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study
from commonrail.errors import SimulationError
from commonrail.injector.definition import FUEL_TEMPERATURE
from commonrail.kinds import DataSet, Role, of_role
from commonrail.kinds.noise import OF_METER, TEMPERATURE
from commonrail.observation.meter import Meter
from commonrail.observation.quantities import QUANTITIES, known_quantity

__all__ = ["judged_residuals"]

Floats = NDArray[np.float64]

BEGINS = np.array([0.0, -1.5, 1.5])  # standard deviations of all uncertain quantities that the search begins at
REACH = (6.0, 3.0, 1.0, 0.0)  # standard deviations that a quantity may go to either side, as far as its domain admits


def judged_residuals(
    study: Study, found: Estimate, delay: MissingDelay | None, threads: int | None = None
) -> tuple[list[LackOfFit], int]:
    """Tests for lack of fit of an estimate, and the points simulated for them.

    Parameters
    ----------
    study : Study
    found : Estimate
        Of the study.
    delay : MissingDelay or None
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    """
    tests = lack_of_fit(found, delay)
    if not found.likelihood.nuisances or not any(test.found for test in tests):
        return tests, 0
    wide = _with_uncertain_free(study, found.likelihood, threads)
    if wide is None:
        return tests, 0
    try:
        freed = estimate(wide, _starts(wide, found))
    except SimulationError:
        return tests, wide.simulated
    again = lack_of_fit(freed, delay, priors_from=len(found.unit))
    return [min(pair, key=lambda test: test.found) for pair in zip(tests, again, strict=True)], freed.simulated


def _with_uncertain_free(study: Study, own: Likelihood, threads: int | None) -> Likelihood | None:
    """Likelihood with the uncertain quantities as its last parameters; None if one has no room about its value."""
    fitted: list[DataSet] = []
    added: dict[str, Parameter] = {}
    for i, data in enumerate(of_role(study.data, Role.FIT)):
        meter = data.meter or Meter(f"unnamed_{i + 1}")
        plain = data.with_noise(replace(data.noise, uncertain={}))
        fitted.append(plain if not set(OF_METER) & set(data.noise.deviations) else plain.with_meter(meter))
        for key, deviation in data.noise.deviations.items():
            if key in OF_METER:
                default = QUANTITIES[key].default
                name, value = meter.parameter(key), meter.values.get(key, 0.0 if default is None else default)
            else:
                name = FUEL_TEMPERATURE if key == TEMPERATURE else key
                value = study.injector.values[name]
            added[name] = _parameter(name, float(value), deviation)
    if not all(parameter.lower < parameter.upper for parameter in added.values()):
        return None
    rows = own.space.rows
    if len(rows):
        rows = replace(rows, matrix=np.column_stack([rows.matrix, np.zeros((len(rows), len(added)))]))
    space = Space((*own.space.parameters, *added.values()), rows if len(rows) else (), own.space.products)
    return Likelihood.of(replace(study, data=tuple(fitted), space=space), threads)


def _parameter(name: str, value: float, deviation: float) -> Parameter:
    """An uncertain quantity as a parameter with a prior, as far to both sides as its domain admits."""
    quantity = known_quantity(name)
    low, high = (
        next(end for end in (value + sign * reach * deviation for reach in REACH) if quantity.domain.admits(end))
        for sign in (-1.0, 1.0)
    )
    source = "stated as uncertain"
    prior = Prior(value, deviation, source)
    return Parameter(name, value, low, high, quantity.unit, mark="E", source=source, prior=prior)


def _starts(wide: Likelihood, found: Estimate) -> Floats:
    """Positions (k, d + m): the fitted values, and those that imitate other uncertain quantities in a linear model."""
    d = len(found.unit)
    priors = [parameter.prior for parameter in wide.space.parameters[d:]]
    middle = np.array([prior.value for prior in priors if prior is not None])
    widths = np.array([prior.sigma for prior in priors if prior is not None])
    move = found.covariance.nuisances.sum(axis=0)
    starts = Walls.of(found.likelihood.space).within(
        np.tile(found.unit, (len(BEGINS), 1)), found.unit + BEGINS[:, None] * move
    )
    points = np.column_stack([found.likelihood.space.from_unit(starts), middle + BEGINS[:, None] * widths])
    return np.clip(wide.space.to_unit(points), 0.0, 1.0)
