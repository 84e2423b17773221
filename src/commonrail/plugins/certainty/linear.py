"""Certainty of given values without a search: the most likely values are those of a linear model about the given ones.

It costs 2 d + 1 simulations, for fleets. The distance of the given values from the most likely ones, which another loss
or an unfinished search leaves, counts as an error of theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import SimulationError
from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.calibration.study import Study
from commonrail.plugins.certainty.ascent import linearised
from commonrail.plugins.certainty.covariance import covariance_of
from commonrail.plugins.certainty.estimate import ROUNDS, Estimate, estimate_at, with_outliers
from commonrail.plugins.certainty.lack_of_fit import lack_of_fit
from commonrail.plugins.certainty.likelihood import Likelihood, central_slopes
from commonrail.plugins.certainty.verdict import verdicts_of, withdrawal

ESTIMATOR = "curvature of the likelihood at the fitted values, their distance from the most likely ones added"
DIGITS = 5  # of a standard error: LAPACK has other last bits on other processors


class Near(NamedTuple):
    """Certainty of a given value of a parameter."""

    standard_error: float | None  # of the given value [SI]; None where nothing holds the parameter
    verdict: ParameterVerdict


def certify_near(study: Study, best: Mapping[str, float], threads: int | None = None) -> dict[str, Near]:
    """Certainty of the values of a fit, by the name of the parameter, see `estimate_near`.

    `best`: values [SI], as `Calibration.best`. Raises `SimulationError` if the values cannot be simulated.
    """
    likelihood = Likelihood.of(study, threads)
    found = estimate_near(likelihood, likelihood.space.to_unit(likelihood.space.point(best)))
    low, high = found.interval()
    judged = verdicts_of(found, low, high, withdrawal(found, lack_of_fit(found)))
    errors = np.sqrt(np.diag(found.covariance.total)) * np.abs(likelihood.scaled(found.unit))
    return {
        name: Near(float(f"{error:.{DIGITS}g}") if np.isfinite(error) else None, one.verdict)
        for name, error, one in zip(likelihood.names, errors, judged, strict=True)
    }


def estimate_near(likelihood: Likelihood, unit: Floats) -> Estimate:
    """Estimate at given positions (d,), whose distance from the top of a linear model is part of its covariance.

    Noise and top are found in turn; the residuals are those that the linear model leaves at the top.

    `likelihood`: its noise need not be known; `unit` (d,). Raises `SimulationError` if the positions cannot be
    simulated.
    """
    before = likelihood.simulated
    first = likelihood.residuals(likelihood.space.from_unit(unit[None]))[0]
    if not np.isfinite(first).all():
        raise SimulationError("The best values cannot be simulated, so nothing can be said of their certainty.")
    slopes = central_slopes(likelihood, unit[None])[0]
    own = likelihood.estimated(first, [0.0] * len(likelihood.blocks), correlated=False)
    errors, nothing = first, np.zeros((0, own.size))
    top = unit
    for last in range(ROUNDS + 1):
        step = linearised(own, top, slopes, errors).full_step()[0][0]
        top, errors = top + step, errors + step @ slopes
        if last < ROUNDS:
            known = covariance_of(own, unit, slopes, errors, nothing)
            own = own.estimated(errors, known.used.tolist(), known.root.T @ slopes)
    found = with_outliers(estimate_at(own, unit, errors, slopes))
    simulated = likelihood.simulated - before + own.simulated
    return replace(found.with_errors((top - unit)[None]), gain=0.0, simulated=simulated)
