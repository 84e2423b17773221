"""Certainty of given values without a search, for fleets: by a linear model about them, from 2 d + 1 simulations.

Another loss or an unfinished search leaves the given values at a distance from the most likely values; the distance is
added to their error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.base.errors import SimulationError
from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.calibration.study import Study
from commonrail.plugins.certainty.ascent import Ascent, linearised
from commonrail.plugins.certainty.covariance import covariance_of
from commonrail.plugins.certainty.estimate import ROUNDS, bounded, estimate_at
from commonrail.plugins.certainty.lack_of_fit import lack_of_fit, withdrawal
from commonrail.plugins.certainty.likelihood import Likelihood, central_slopes
from commonrail.plugins.certainty.uncertain import with_uncertain_free
from commonrail.plugins.certainty.verdict import verdicts_of

ESTIMATOR = "curvature of the likelihood at the fitted values, their distance from the most likely ones added"
DIGITS = 5  # of a standard error: the last bits of LAPACK depend on the processor


class Near(NamedTuple):
    """Certainty of a given value of a parameter."""

    standard_error: float | None  # of the given value [SI]; None where nothing holds the parameter
    verdict: ParameterVerdict


def certify_near(study: Study, best: Mapping[str, float], threads: int | None = None) -> dict[str, Near]:
    """Certainty of the values [SI] of a fit, as `Calibration.best`, by the name of the parameter.

    Noise and optimum of the linear model are estimated alternately, from its residuals at the optimum. Raises
    `SimulationError` if the values cannot be simulated.
    """
    free, d = with_uncertain_free(study), study.space.dimension
    likelihood = Likelihood.of(free, threads)
    point = np.append(study.space.point(best), free.space.reference[d:])
    unit = likelihood.space.to_unit(point)
    errors = likelihood.residuals(point[None])[0]
    if not np.isfinite(errors).all():
        raise SimulationError("The best values cannot be simulated, so nothing can be said of their certainty.")
    slopes, top = central_slopes(likelihood, unit), unit
    noisy = likelihood.estimated(errors, [0.0] * len(likelihood.blocks), correlated=False)
    for last in range(ROUNDS + 1):
        step = linearised(noisy, top, slopes, errors).full_step()[0][0]
        top, errors = top + step, errors + step @ slopes
        if last < ROUNDS:
            covariance = covariance_of(noisy, unit, slopes, errors)
            noisy = noisy.estimated(errors, covariance.used.tolist(), covariance.root.T @ slopes)
    end = Ascent(unit[None], np.zeros(1), errors[None], slopes[None])
    result = replace(estimate_at(noisy, end, slopes), gain=0.0)
    total = result.covariance.noise + np.outer(top - unit, top - unit)
    result = replace(result, covariance=result.covariance._replace(noise=total))
    scale = np.abs(likelihood.scaled(unit))
    half = result.half_widths() * scale
    deviations = bounded(total)
    correlation = deviations / np.sqrt(np.outer(np.diag(deviations), np.diag(deviations)))
    at_top = replace(result, unit=top, point=likelihood.space.from_unit(top))  # the residuals belong to the optimum
    reason = withdrawal(result, lack_of_fit(at_top, d))
    judged = verdicts_of(result, d, ((point - half)[:d], (point + half)[:d]), correlation, reason)
    standard_errors = (np.sqrt(np.diag(total)) * scale).tolist()
    return {
        name: Near(float(f"{error:.{DIGITS}g}") if np.isfinite(error) else None, verdict.verdict)
        for name, error, verdict in zip(study.space.names, standard_errors, judged, strict=False)
    }
