"""Scatter of measured values about predictions, judged by fitted values that are held out one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, IndexArray
from commonrail.data.base import DataSet
from commonrail.data.noise import Law
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.likelihood import prior_slopes_at
from commonrail.plugins.certainty.noise_fit import sample_count, scale_of

LEAST = 8  # fewest left-out values for an estimate of the scatter
HELD = 1e-6  # share of a residual's variance, below which the fit reproduces any value
TAILS = {Law.STUDENT: 4.0, Law.LAPLACE: 3.0}  # degrees of freedom of t with the quantiles of the law


class Scatter(NamedTuple):
    """Scatter of measured values about the best prediction: noise and discrepancy of the model."""

    factor: float  # in stated tolerances, or a standard deviation in the unit of the values
    freedom: float  # degrees of freedom of the factor; infinite if it is stated
    # factor on the standard deviation of a prediction, parameters included: root mean square of the errors of left-out
    # values, each over its predicted deviation; 1 if there are too few values
    calibration: float = 1.0
    left_out: int = 0  # number of left-out values
    least: float = 1.0  # share of the factor at a rate of zero; less than 1 if the noise grows with the rate
    slope: float = 0.0  # relative increase per SI unit of the rate
    share: float = 0.0  # discrepancy of the model and scatter of whole curves, as a share of the values

    def deviations(self, data: DataSet, values: Floats) -> Floats:
        """Standard deviations (n,) about predicted values (n,)."""
        size, stated = np.nan_to_num(values), data.discrepancy(values)
        if stated is None:
            stated = self.least * (1.0 + self.slope * np.maximum(size, 0.0))
        return np.hypot(self.factor * stated, self.share * np.abs(size))


class LeftOut(NamedTuple):
    """Prediction errors of values that are left out one at a time, over their predicted standard deviations."""

    errors: Floats  # (m,)
    freedom: float  # degrees of freedom of their mean square (Satterthwaite): they are correlated


def left_out(estimate: Estimate, rows: IndexArray) -> LeftOut:
    """Leave out each value at rows (m,) of the residuals in turn, by the linear model around the estimate.

    H is the influence of the fit, including the weights of the courses. A left-out value i has the error
    u_i/(1 − H_ii) and the predicted variance 1/(1 − H_ii).
    """
    d, fitted = len(estimate.unit), estimate.likelihood
    likelihood = fitted.with_noises([replace(noise, courses=np.empty((0, 0))) for noise in fitted.noises])
    wide = [estimate.slopes]
    for block, noise in fitted.pairs:
        courses = noise.courses.reshape(-1, block.size)
        wide.append(np.zeros((len(courses), fitted.size)))
        wide[-1][:, block.rows] = courses
    innovations = likelihood.whiten(estimate.errors)
    robust = np.sqrt(likelihood.weights(innovations))
    tangents = robust * likelihood.whiten(np.vstack(wide))
    prior_slopes = prior_slopes_at(likelihood, estimate.unit)
    prior_information = np.eye(len(tangents))
    prior_information[:d, :d] = prior_slopes.T @ prior_slopes
    force = tangents @ (robust * innovations)
    force[:d] += prior_slopes.T @ likelihood.prior_residuals(estimate.unit)
    inverse = np.linalg.pinv(tangents @ tangents.T + prior_information, hermitian=True)
    rest = (robust * innovations - (inverse @ force) @ tangents)[rows]
    left = np.eye(len(rows)) - tangents[:, rows].T @ inverse @ tangents[:, rows]
    free = np.diag(left) > HELD
    root = np.sqrt(np.diag(left)[free])
    related = left[np.ix_(free, free)] / np.outer(root, root)
    return LeftOut(rest[free] / root, float(np.count_nonzero(free) ** 2 / max(float(np.sum(related**2)), 1e-300)))


def scatter_of(estimate: Estimate, fitted: Sequence[DataSet]) -> dict[str, Scatter]:
    """Scatter of each kind of data: scatter of the fitted set that scatters most, calibrated on left-out values.

    With too few values to leave out, the scatter is at least the stated tolerance. Residuals larger than a stated
    noise, or than the noise of repeated shots, then replace the noise, because they contain the model's error.

    `fitted`: in the order of the blocks.
    """
    likelihood, noises = estimate.likelihood, []
    rows: dict[str, IndexArray] = {}  # of the residuals, values of a kind that is not a course in time
    for data, block in zip(fitted, likelihood.blocks, strict=True):
        values = (
            np.arange(block.rows.start, block.rows.stop)[data.judged] if not block.ordered else np.zeros(0, np.intp)
        )
        rows[data.kind] = np.append(rows.get(data.kind, np.zeros(0, np.intp)), values)
    for data, noise in zip(fitted, likelihood.noises, strict=True):
        few = data.discrepancy(data.measured) is not None and len(rows[data.kind]) < LEAST
        if few and not noise.stated and noise.sigma < 1.0:
            noise = replace(noise, scale=1.0 / noise.density.deviation, freedom=np.inf, stated=True)
        noises.append(noise)
    estimate = replace(estimate, likelihood=likelihood.with_noises(noises))
    by_noise: dict[str, Scatter] = {}
    by_level: dict[str, Scatter] = {}
    tails: dict[str, float] = {}  # by kind; the weights of a law make the mean square of errors match its scale
    for i, data in enumerate(fitted):
        tails[data.kind] = min(TAILS.get(noises[i].law, np.inf), tails.get(data.kind, np.inf))
        for largest, scatter in zip((by_noise, by_level), _of_set(estimate, i, data), strict=True):
            if data.kind not in largest or largest[data.kind].factor < scatter.factor:
                largest[data.kind] = scatter
    for kind, scatter in by_noise.items():
        judged = left_out(estimate, rows[kind]) if len(rows[kind]) >= LEAST else None
        if judged is not None and len(judged.errors) >= LEAST:
            size, freedom = float(np.sqrt(np.mean(judged.errors**2))), min(judged.freedom, tails[kind])
            by_level[kind] = scatter._replace(calibration=size, freedom=freedom, left_out=len(judged.errors))
    return by_level


def curve_scatter(estimate: Estimate, fitted: Sequence[DataSet]) -> dict[str, Scatter]:
    """Scatter of each fitted curve by its name; for a mean of many strokes, scatter of the mean.

    `fitted`: in the order of the blocks.
    """
    blocks = estimate.likelihood.blocks
    return {data.name: _of_set(estimate, i, data)[1] for i, data in enumerate(fitted) if blocks[i].ordered}


def _of_set(estimate: Estimate, index: int, data: DataSet) -> tuple[Scatter, Scatter]:
    """Scatter of a data set by its noise, and by its residuals if they exceed a known noise."""
    block, noise = estimate.likelihood.pairs[index]
    extra = block.noise.discrepancy if block.noise.length else 0.0
    tail = TAILS.get(noise.law, np.inf)
    of_noise = Scatter(
        float(np.hypot(noise.value_scale, extra)) / data.residual_scale,
        min(noise.freedom, tail),
        least=noise.growth.least,
        slope=noise.growth.slope * data.residual_scale,
        share=float(np.hypot(noise.share, noise.scatter)),
    )
    if not (noise.stated or block.shots is not None):
        return of_noise, of_noise
    errors = estimate.errors[block.rows] / noise.growth.shape
    freedom = max(sample_count(errors) - float(estimate.covariance.used[index]), 1.0)
    level = scale_of(noise.law, errors, freedom) / data.residual_scale
    larger = of_noise._replace(factor=level, freedom=min(freedom, tail))
    return of_noise, larger if level > of_noise.factor else of_noise
