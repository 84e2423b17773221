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
from commonrail.plugins.certainty.likelihood import prior_slopes_at, weights_of
from commonrail.plugins.certainty.noise_fit import FittedNoise, sample_count, scale_of, spread

LEAST = 8  # values held out, from which their scatter is believed
HELD = 1e-6  # of the variance of a residual, below which the fit follows the value whatever it is
TAILS = {Law.STUDENT: 4.0, Law.LAPLACE: 3.0}  # degrees of freedom of t whose quantiles are those of the law


class Scatter(NamedTuple):
    """Scatter of measured values about the best prediction: noise and discrepancy of the model."""

    # multiple of the tolerance of a kind that states one; else a standard deviation in the unit of the values
    factor: float
    freedom: float  # degrees of freedom of the factor; infinite where it is stated
    # factor on the whole standard deviation of a prediction, parameters included: root mean square of the values that
    # were held out, each over the deviation predicted for it. 1 where too few could be held out
    calibration: float = 1.0
    left_out: int = 0  # number of those values
    least: float = 1.0  # share of the factor at a rate of zero; less than 1 where the noise grows with the rate
    slope: float = 0.0  # rise over that for one SI unit of the rate
    share: float = 0.0  # discrepancy of the model and scatter of whole curves, as a share of the values

    def deviations(self, data: DataSet, values: Floats) -> Floats:
        """Standard deviations (n,) about predicted values (n,)."""
        size, stated = np.nan_to_num(values), data.discrepancy(values)
        if stated is None:
            stated = self.least * (1.0 + self.slope * np.maximum(size, 0.0))
        return np.hypot(self.factor * stated, self.share * np.abs(size))


class LeftOut(NamedTuple):
    """Prediction errors of values that are held out one at a time, over their predicted standard deviations."""

    errors: Floats  # (m,)
    freedom: float  # degrees of freedom of their mean square (Satterthwaite): they are correlated


def left_out(estimate: Estimate, rows: IndexArray) -> LeftOut:
    """Values held out one at a time, by the linear model about the estimate and without a further simulation.

    With the influence H of the fit, courses that values are off by together among what is fitted, the error of the
    value i that is held out is u_i/(1 − H_ii), and its predicted variance 1/(1 − H_ii).

    `rows` (m,): rows of the residuals.
    """
    d, pairs = len(estimate.unit), zip(estimate.likelihood.blocks, estimate.likelihood.noises, strict=True)
    courses = [spread(block, noise.courses.reshape(-1, block.size), estimate.likelihood.size) for block, noise in pairs]
    plain = [replace(noise, courses=np.empty((0, 0))) for noise in estimate.likelihood.noises]
    likelihood = estimate.likelihood.with_noises(plain)
    innovations = likelihood.whiten(estimate.errors)
    robust = np.sqrt(weights_of(likelihood, innovations))
    wide = np.vstack([estimate.slopes, *courses])
    tangents = robust * likelihood.whiten(wide)
    prior_slopes = prior_slopes_at(likelihood, estimate.unit)
    prior_information = np.eye(len(wide))
    prior_information[:d, :d] = prior_slopes.T @ prior_slopes
    force = tangents @ (robust * innovations)
    force[:d] += prior_slopes.T @ likelihood.priors.residuals(likelihood.space.from_unit(estimate.unit[None]))[0]
    inverse = np.linalg.pinv(tangents @ tangents.T + prior_information, hermitian=True)
    rest = (robust * innovations - (inverse @ force) @ tangents)[rows]
    seen = tangents[:, rows]
    left = np.eye(len(rows)) - seen.T @ inverse @ seen
    free = np.diag(left) > HELD
    root = np.sqrt(np.diag(left)[free])
    related = left[np.ix_(free, free)] / np.outer(root, root)
    return LeftOut(rest[free] / root, float(np.count_nonzero(free) ** 2 / max(float(np.sum(related**2)), 1e-300)))


def _noises(estimate: Estimate, fitted: Sequence[DataSet]) -> list[FittedNoise]:
    """Noises whose scales are no smaller than stated tolerances, of data with too few values to hold out.

    `fitted`: in the order of the blocks.
    """
    few = [
        data.discrepancy(data.measured) is not None and len(_rows(estimate, fitted, data.kind)) < LEAST
        for data in fitted
    ]
    return [
        replace(noise, scale=1.0 / noise.density.deviation, freedom=np.inf, stated=True)
        if low and not noise.stated and noise.sigma < 1.0
        else noise
        for low, noise in zip(few, estimate.likelihood.noises, strict=True)
    ]


def scatter_of(estimate: Estimate, fitted: Sequence[DataSet]) -> dict[str, Scatter]:
    """Scatter of each kind of data: that of the fitted set that scatters most, judged by the values held out.

    Where none are, residuals that exceed a stated noise, or that of repeated shots, count in its place: the model's
    own error is in them.

    `fitted`: in the order of the blocks.
    """
    estimate = replace(estimate, likelihood=estimate.likelihood.with_noises(_noises(estimate, fitted)))
    scatter: dict[str, Scatter] = {}
    levels: dict[str, Scatter] = {}  # where residuals exceed a noise that is not estimated from them, they count
    tails: dict[str, float] = {}  # errors are weighted as their law asks: their mean square is of its scale
    for i, data in enumerate(fitted):
        of_set, level = _of_set(estimate, i, data)
        tail = TAILS.get(estimate.likelihood.noises[i].law, np.inf)
        tails[data.kind] = min(tail, tails.get(data.kind, np.inf))
        _keep_larger(scatter, data.kind, of_set)
        _keep_larger(levels, data.kind, level)
    for kind, of_set in scatter.items():
        scatter[kind] = levels[kind]
        rows = _rows(estimate, fitted, kind)
        judged = left_out(estimate, rows) if len(rows) >= LEAST else None
        if judged is not None and len(judged.errors) >= LEAST:
            size, freedom = float(np.sqrt(np.mean(judged.errors**2))), min(judged.freedom, tails[kind])
            scatter[kind] = of_set._replace(calibration=size, freedom=freedom, left_out=len(judged.errors))
    return scatter


def curve_scatter(estimate: Estimate, fitted: Sequence[DataSet]) -> dict[str, Scatter]:
    """Scatter of each fitted curve by its name: its own, which for a mean of many strokes is that of the mean.

    `fitted`: in the order of the blocks.
    """
    blocks = estimate.likelihood.blocks
    return {data.name: _of_set(estimate, i, data)[1] for i, data in enumerate(fitted) if blocks[i].ordered}


def _of_set(estimate: Estimate, index: int, data: DataSet) -> tuple[Scatter, Scatter]:
    """Scatter of a data set by its noise, and the larger one of its residuals where these exceed a known noise.

    `index`: of the block.
    """
    noise, block = estimate.likelihood.noises[index], estimate.likelihood.blocks[index]
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
    return of_noise, of_noise if level <= of_noise.factor else of_noise._replace(
        factor=level, freedom=min(freedom, tail)
    )


def _keep_larger(scatter: dict[str, Scatter], kind: str, candidate: Scatter) -> None:
    if kind not in scatter or scatter[kind].factor < candidate.factor:
        scatter[kind] = candidate


def _rows(estimate: Estimate, fitted: Sequence[DataSet], kind: str) -> IndexArray:
    """Rows of the residuals that are values of a kind that is no course in time."""
    rows = [
        np.arange(block.rows.start, block.rows.stop)[data.judged]
        for data, block in zip(fitted, estimate.likelihood.blocks, strict=True)
        if data.kind == kind and not block.ordered
    ]
    return np.concatenate(rows) if rows else np.zeros(0, dtype=np.intp)
