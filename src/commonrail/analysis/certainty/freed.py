"""Tests for lack of fit once more, with what a study states as uncertain free within its standard deviation.

A delay of two microseconds bends the path that the parameters imitate it along: what is left of it at the fitted values
is neither its derivative nor its second one, and a test that knows these two takes it for a fault of the model. Where
such a test finds something, the uncertain quantities are fitted too, with their standard deviations as priors, and the
test is made there, and one of each quantity: is it where the study states it?
"""

from __future__ import annotations

import numpy as np

from commonrail.analysis.certainty.estimate import Estimate, estimate
from commonrail.analysis.certainty.lack_of_fit import LackOfFit, beyond_stated, lack_of_fit, level_of
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.certainty.missing_delay import MissingDelay
from commonrail.analysis.certainty.uncertain import with_uncertain_free
from commonrail.arrays import Floats
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.study import Study
from commonrail.errors import SimulationError

__all__ = ["judged_residuals"]


BEGINS = np.array([0.0, -1.5, 1.5])  # standard deviations of all uncertain quantities that the search begins at


def judged_residuals(
    study: Study,
    found: Estimate,
    delay: MissingDelay | None,
    threads: int | None = None,
    *,
    priors_from: int | None = None,
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
    priors_from : int, optional
        As for `lack_of_fit`.
    """
    first = len(found.unit) if priors_from is None else priors_from
    level = level_of(found, delay is not None, len(found.unit) - first)
    tests = lack_of_fit(found, delay, priors_from=first, level=level)
    stated = beyond_stated(found, first, level)
    free = with_uncertain_free(study) if found.likelihood.nuisances and any(test.found for test in tests) else None
    if free is None:
        return [*tests, *stated], 0
    wide = Likelihood.of(free, threads)
    try:
        freed = estimate(wide, _starts(wide, found))
    except SimulationError:
        return [*tests, *stated], wide.simulated
    again = lack_of_fit(freed, delay, priors_from=first, level=level)
    merged = [min(pair, key=lambda test: test.found) for pair in zip(tests, again, strict=True)]
    return [*merged, *beyond_stated(freed, first, level)], freed.simulated


def _starts(wide: Likelihood, found: Estimate) -> Floats:
    """Positions (k, d + m): the fitted values, and those that imitate other uncertain quantities in a linear model."""
    d = len(found.unit)
    priors = [parameter.prior for parameter in wide.space.parameters[d:]]
    middle = np.array([prior.value for prior in priors if prior is not None])
    widths = np.array([prior.sigma for prior in priors if prior is not None])
    move = found.covariance.nuisances.sum(axis=0)
    starts = FeasibleSet.of(found.likelihood.space).within(
        np.tile(found.unit, (len(BEGINS), 1)), found.unit + BEGINS[:, None] * move
    )
    points = np.column_stack([found.likelihood.space.from_unit(starts), middle + BEGINS[:, None] * widths])
    return np.clip(wide.space.to_unit(points), 0.0, 1.0)
