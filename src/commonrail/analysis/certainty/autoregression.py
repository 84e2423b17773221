"""Autoregressive noise: Burg's reflection coefficients, order by AIC, and the whitening that belongs to them."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from commonrail.analysis.certainty.laws import sample_count
from commonrail.arrays import Floats

__all__ = ["MOST", "Autoregression", "estimate"]


MOST = 15  # largest order
_SHARE = 0.1  # of the samples that the order may reach
_LIMIT = 0.995  # largest reflection coefficient
BIAS = 2.0  # of the first reflection coefficient of a series whose mean is known: −2 r/n


class Autoregression:
    """Stationary autoregressive noise, described by its reflection coefficients.

    Parameters
    ----------
    reflections : (order,)
        Partial autocorrelations, each between −1 and 1; none for white noise.
    """

    def __init__(self, reflections: Floats) -> None:
        self.reflections = np.clip(np.asarray(reflections, float), -_LIMIT, _LIMIT)

    @property
    def order(self) -> int:
        """Number of former samples that a sample depends on."""
        return len(self.reflections)

    @cached_property
    def predictors(self) -> list[Floats]:
        """Coefficients of the best predictors from 0, 1, … `order` former samples, by Levinson's recursion."""
        found = [np.empty(0)]
        for k in self.reflections:
            last = found[-1]
            found.append(np.append(last - k * last[::-1], k))
        return found

    @property
    def innovation_share(self) -> float:
        """Standard deviation of an innovation over that of a sample."""
        return float(np.sqrt(np.prod(1.0 - self.reflections**2)))

    def whiten(self, errors: Floats) -> Floats:
        """Innovations (…, n) of errors (…, n), all with the deviation of the last ones.

        The first samples are predicted from those that there are, so that nothing is lost at the begin.
        """
        order = min(self.order, errors.shape[-1])
        found = np.array(errors, float)
        for lag, factor in enumerate(self.predictors[-1], 1):
            found[..., lag:] -= factor * errors[..., :-lag]
        for t in range(order):
            own = self.predictors[t]
            former = errors[..., :t][..., ::-1]
            wider = np.sqrt(np.prod(1.0 - self.reflections[t:] ** 2))
            found[..., t] = wider * (errors[..., t] - np.sum(own * former, axis=-1))
        return found


def estimate(series: Floats, most: int = MOST) -> Autoregression:
    """Autoregression of the order with the least AIC, by Burg's method.

    Residuals are smaller than the noise, and less correlated, because the fit has followed it. Their sums of products
    are therefore completed by those of what the fit may be off by, as in expectation maximisation.

    Parameters
    ----------
    series : (1 + d, n)
        Residuals, then d courses with unit weights that the fitted values may be off by: columns of a root of the
        covariance of the parameters, times the derivatives.
    most : int
        Largest order; at most a tenth of the samples is taken.
    """
    samples = sample_count(series[0])
    forward, backward = np.array(series, float), np.array(series, float)
    reflections: list[float] = []
    criterion = [0.0]
    for _ in range(min(most, int(_SHARE * samples))):
        ahead, behind = forward[:, 1:], backward[:, :-1]
        energy = float(np.sum(ahead**2) + np.sum(behind**2))
        if not energy > 0.0:
            break
        k = float(np.clip(2.0 * np.sum(ahead * behind) / energy, -_LIMIT, _LIMIT))
        forward, backward = ahead - k * behind, behind - k * ahead
        reflections.append(k)
        criterion.append(criterion[-1] + samples * float(np.log(1.0 - k * k)) + 2.0)
    chosen = np.array(reflections[: int(np.argmin(criterion))])
    if len(chosen):
        chosen[0] *= 1.0 + BIAS / samples
    return Autoregression(chosen)
