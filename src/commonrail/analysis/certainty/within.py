"""Most likely values where a quantity is uncertain about an end of what it can be, such as friction about zero.

Such a quantity moves the estimates to one side alone, and along a curved path: without it, a fit ends where a linear
move by a few standard deviations does not hold the truth. It is therefore fitted too, within what is possible and with
its standard deviation as a prior. What it is uncertain by then is part of the covariance of the parameters, whose
derivatives let it follow. All other uncertain quantities stay beside the fit, see `nuisance`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.analysis.certainty.covariance import Covariance, moved_by
from commonrail.analysis.certainty.estimate import Estimate, estimate
from commonrail.analysis.certainty.lack_of_fit import level_of
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.certainty.mixture import Mixture, mixture_of
from commonrail.analysis.certainty.nuisance import Nuisance
from commonrail.analysis.certainty.uncertain import one_sided, with_uncertain_free
from commonrail.arrays import Floats
from commonrail.calibration.study import Study

__all__ = ["Within", "estimate_within"]


BEGINS = (0.1, 0.8)  # standard deviations of the fitted quantities that the starts begin at, in turn


class Within(NamedTuple):
    """Estimate of a study's parameters, and that with its one-sided uncertain quantities among the parameters.

    Attributes
    ----------
    study : Study
        Whose last parameters are these quantities; the study itself where there are none.
    whole : Estimate
        Of that study.
    found : Estimate
        Of the parameters alone, the other quantities at their most likely values.
    fitted : mapping of str to float
        Most likely values [SI] of these quantities.
    integrated : bool
        The quantities were integrated out; False where too few draws agree with the data, and the wider of these and
        the curvature at the most likely values was taken.
    """

    study: Study
    whole: Estimate
    found: Estimate
    fitted: Mapping[str, float]
    integrated: bool = True

    @property
    def level(self) -> float:
        """Level of each test of the fit, where a delay and friction have tests of their own."""
        return level_of(self.whole, True, len(self.whole.unit) - len(self.found.unit))


def estimate_within(study: Study, own: Likelihood, starts: Floats, threads: int | None = None) -> Within:
    """Most likely values from several starts, with all that is uncertain about an end of what it can be fitted too.

    Parameters
    ----------
    study : Study
    own : Likelihood
        Of the study.
    starts : (k, d) or (k, d + m)
        Positions between the bounds; of the parameters, or of the fitted quantities too.
    threads : int, optional
        All usable processors by default; the result does not depend on it.

    Raises
    ------
    SimulationError
        If the first start cannot be simulated.
    """
    keys = one_sided(study)
    free = with_uncertain_free(study, keys) if keys else None
    if free is None:
        found = estimate(own, starts)
        return Within(study, found, found, {})
    wide, d = Likelihood.of(free, threads), own.space.dimension
    if starts.shape[1] == d:
        starts = np.column_stack([starts, _begins(wide, d, len(starts))])
    whole = estimate(wide, starts)
    fitted = dict(zip(wide.names[d:], _rounded(wide, whole.point)[d:].tolist(), strict=True))
    over = mixture_of(whole, d)
    whole = replace(whole, simulated=whole.simulated + over.simulated)
    return Within(free, whole, _alone(own, whole, over), fitted, over.believed)


def _rounded(wide: Likelihood, point: Floats) -> Floats:
    """Values (d + m,) [SI]; those within 1e-9 of their range from their lower bound are that bound."""
    lower, upper = wide.space.lower, wide.space.upper
    return np.where(point - lower < 1e-9 * (upper - lower), lower, point)


def _begins(wide: Likelihood, d: int, many: int) -> Floats:
    """Positions (many, m) of the last parameters, by turns near the stated value and away from it.

    Parameters
    ----------
    wide : Likelihood
    d : int
        Number of the parameters before them.
    many : int
    """
    priors = [parameter.prior for parameter in wide.space.parameters[d:]]
    places = [
        np.append(wide.space.reference[:d], [prior.value + side * prior.sigma for prior in priors if prior is not None])
        for side in BEGINS
    ]
    unit = np.clip([wide.space.to_unit(place)[d:] for place in places], 0.0, 1.0)
    return np.asarray(unit[np.arange(many) % len(places)])


def _alone(own: Likelihood, whole: Estimate, over: Mixture) -> Estimate:
    """Estimate of the first parameters; the last ones are held, and follow in the derivatives and the covariance.

    Parameters
    ----------
    own : Likelihood
        Of the first parameters.
    whole : Estimate
        Of all.
    over : Mixture
    """
    d, last = own.space.dimension, whole.point[own.space.dimension :]
    wide = whole.likelihood

    def residuals(points: Floats) -> Floats:
        return wide.residuals(np.column_stack([points, np.tile(last, (len(points), 1))]))

    alone = wide.with_space(own.space, residuals, [_held(nuisance, last) for nuisance in wide.nuisances])
    return replace(
        whole,
        likelihood=alone.with_noises(wide.noises),
        unit=whole.unit[:d],
        point=whole.point[:d],
        slopes=whole.slopes[:d] + _following(whole.covariance.inverse, d) @ whole.slopes[d:],
        covariance=_of_first(whole, over, d),
    )


def _held(nuisance: Nuisance, last: Floats) -> Nuisance:
    """Uncertain quantity as a function of the first parameters, the last ones held."""
    return nuisance._replace(
        shift=lambda point: nuisance.shift(np.append(point, last)),
        bend=lambda point, move: nuisance.bend(np.append(point, last), np.append(move, 0.0 * last)),
        sides=(),
    )


def _following(inverse: Floats, d: int) -> Floats:
    """Moves (d, m) of the last parameters with each of the first d, by the inverse of the information."""
    return np.asarray(np.linalg.lstsq(inverse[:d, :d], inverse[:d, d:], rcond=None)[0])


def _of_first(whole: Estimate, over: Mixture, d: int) -> Covariance:
    """Covariance of the first d parameters, whatever the others are.

    What else is uncertain moves them farther where the last ones are held than where these follow, or the other way
    about; a fit cannot tell which, and the larger move counts.

    Parameters
    ----------
    whole : Estimate
    over : Mixture
    d : int
    """
    known = whole.covariance
    own = whole.likelihood
    inverse = np.asarray(np.linalg.pinv(np.linalg.pinv(known.inverse, hermitian=True)[:d, :d], hermitian=True))
    tangents, innovations = own.whiten(whole.slopes[:d]), own.whiten(whole.errors)
    held = moved_by(own, inverse, tangents, innovations, own.whiten(whole.shifts))
    follow = known.nuisances[:, :d]
    noise = known.noise[:d, :d]
    seen = np.isfinite(np.diag(noise))  # a parameter without effect has an infinite variance
    if seen.any():
        rows = np.ix_(seen, seen)
        moment, local = over.moment[rows], noise[rows]
        noise = noise.copy()
        noise[rows] = moment if over.believed else max(1.0, _excess(moment, local)) * local
    return known._replace(
        inverse=known.inverse[:d, :d],
        noise=noise,
        nuisances=np.where(np.abs(held) > np.abs(follow), held, follow),
        discrepancy=known.discrepancy[:d, :d],
        shares=known.shares[:, :d],
        freedom=known.freedom[:d],
        alone=known.alone[:d],
        beyond=known.beyond[:d],
    )


def _excess(moment: Floats, noise: Floats) -> float:
    """Largest ratio of the variances of two covariances."""
    return float(np.max(np.diag(moment) / np.maximum(np.diag(noise), 1e-300)))
