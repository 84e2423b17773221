"""Blocks of residuals: one for each data set of a fit, with its noise as stated and as fitted."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from commonrail.analysis.certainty.autoregression import Autoregression, estimate
from commonrail.analysis.certainty.growth import EVEN, Growth, growth_of
from commonrail.analysis.certainty.laws import LAWS, DensityLaw, sample_count, scale_of, unequal
from commonrail.arrays import Floats
from commonrail.kinds import DataSet
from commonrail.kinds.noise import NOISE, Correlation, Law, Noise

__all__ = ["Block", "FittedNoise", "block_of", "fit_noise", "places_of", "row_weights"]


WHITE = Autoregression(np.empty(0))
FAR, FAR_SHARE, FAR_LEAST = 4.0, 0.01, 50  # deviations, share and number of values by which outliers are recognised
# Share of the largest measured value. The filters of a meter leave some 1e-13 of it by rounding where the flow is zero.
_ROUNDING = 1e-9
_CLIP = 3.0  # deviations to which outliers are cut before the autocorrelation is estimated
_NORMAL = 1.4826


@dataclass(frozen=True)
class FittedNoise:
    """Noise of a block as it was fitted.

    Attributes
    ----------
    law : Law
        Not "auto".
    scale : float
        Of an innovation, in the unit of the residuals; `density.deviation` of it are a standard deviation.
    freedom : float
        Degrees of freedom of the scale; infinite where it is exactly known.
    autoregression : Autoregression
    known : bool
        The scale is stated, or that of repeated measurements: it does not come from the residuals.
    growth : Growth
        Standard deviations of the values relative to each other.
    """

    law: Law
    scale: float
    freedom: float
    autoregression: Autoregression = WHITE
    known: bool = False
    growth: Growth = EVEN

    @property
    def density(self) -> DensityLaw:
        """Cost, weight and slope of the law."""
        return LAWS[self.law]

    @property
    def value_scale(self) -> float:
        """Scale of a value, correlation included."""
        return self.scale / self.autoregression.innovation_share

    @property
    def sigma(self) -> float:
        """Standard deviation of a value, correlation included; at a rate of zero where it grows with the rate."""
        return self.value_scale * self.density.deviation * self.growth.least

    @property
    def relative(self) -> float:
        """Share of the rate that `sigma` grows by."""
        return self.sigma * self.growth.slope

    def whiten(self, errors: Floats) -> Floats:
        """Standardised innovations (…, n) of residuals (…, n)."""
        return self.autoregression.whiten(errors / self.growth.shape) / self.scale


@dataclass(frozen=True)
class Block:
    """Residuals of a data set within the residuals of a fit.

    Attributes
    ----------
    name : str
    rows : slice
        Its place.
    noise : Noise
        As stated; a standard deviation in the unit of the residuals.
    unit : str
        Unit of the residuals, for texts.
    ordered : bool
        The values are a course in time.
    at_zero : (n,)
        Residuals where the model gives nothing.
    offset : (n,)
        Change of the residuals for one more unit of the values everywhere.
    places : (n, 2)
        Time [s] and rail pressure [Pa] of each value, between which a discrepancy is correlated.
    shots : FittedNoise or None
        Noise estimated from repeated shots.
    """

    name: str
    rows: slice
    noise: Noise = NOISE
    unit: str = ""
    ordered: bool = False
    at_zero: Floats = field(default_factory=lambda: np.empty(0))
    offset: Floats = field(default_factory=lambda: np.empty(0))
    places: Floats = field(default_factory=lambda: np.empty((0, 2)))
    shots: FittedNoise | None = None

    @property
    def size(self) -> int:
        """Number of values."""
        return int(self.rows.stop - self.rows.start)

    @property
    def rounding(self) -> Floats:
        """Residuals (n,) below which a value that was measured as exactly zero, or is not judged, is met exactly."""
        return np.where(self.at_zero == 0.0, _ROUNDING * np.max(np.abs(self.at_zero), initial=0.0), 0.0)

    def courses(self, deviation: float, length: float, pressure_length: float = math.inf) -> Floats:
        """Courses (k, n) with independent unit weights that add up to a discrepancy with a correlation in between.

        Along a course in time they are bumps half a length apart, whose sum has a Gaussian correlation; a map has the
        roots of its covariance. Without a length there are none: white discrepancy is part of the noise.

        Parameters
        ----------
        deviation : float
            Standard deviation, in the unit of the residuals.
        length, pressure_length : float
            Distances over which it is correlated [s], [Pa].
        """
        if not (deviation and length):
            return np.zeros((0, self.size))
        if self.ordered:
            times = self.places[:, 0]
            centres = np.arange(times.min() - 2.0 * length, times.max() + 2.0 * length, 0.5 * length)
            height = deviation * math.sqrt(0.5 * math.sqrt(2.0 / math.pi))
            return np.asarray(height * np.exp(-(((times - centres[:, None]) / length) ** 2)))
        apart = (self.places[:, None] - self.places[None]) / np.array([length, pressure_length])
        values, vectors = np.linalg.eigh(np.exp(-0.5 * np.sum(apart**2, axis=-1)))
        return np.asarray((deviation * vectors * np.sqrt(np.maximum(values, 0.0))).T)

    def stated_courses(self) -> Floats:
        """Courses of the discrepancy that the study states."""
        return self.courses(self.noise.discrepancy, self.noise.length, self.noise.pressure_length)


def block_of(data: DataSet, start: int) -> Block:
    """Block of a data set whose residuals begin at a row."""
    zero = _plain(data, np.zeros(len(data.measured)))
    scale = data.residual_scale
    stated = data.noise
    sigma = None if stated.sigma is None else stated.sigma * scale
    noise = replace(stated, sigma=sigma, discrepancy=stated.discrepancy * scale)
    return Block(
        data.name,
        slice(start, start + len(zero)),
        noise,
        data.residual_unit,
        data.bounds is not None,
        np.where(data.judged, zero, 0.0),
        np.where(data.judged, _plain(data, np.ones(len(zero))) - zero, 0.0),
        places_of(data),
    )


def row_weights(data: DataSet) -> Floats:
    """Weights (n,) of the residuals of a data set, which its likelihood is free of.

    Repeated quantities say nothing of the dead times of a map: these keep a standard deviation of one tolerance.
    """
    found = np.full(len(data.measured), data.weight)
    if data.noise.sigma is not None and math.isfinite(data.noise.freedom):
        found[~data.judged] /= (data.noise.sigma * data.residual_scale) ** 2
    return found


def _plain(data: DataSet, values: Floats) -> Floats:
    """Residuals without their weights."""
    return np.asarray(data.residuals(values[None])[0] / np.sqrt(row_weights(data)))


def places_of(data: DataSet) -> Floats:
    """Time [s] and rail pressure [Pa] of each value (n, 2); the time of a quantity is its first energising time."""
    if data.bounds is not None:
        middle = 0.5 * (data.bounds[1:] + data.bounds[:-1])
        return np.column_stack([middle, np.full(len(middle), data.points[0].initial_pressures()[0])])
    points = data.points
    durations = [point.pulses[0].duration if point.pulses else 0.0 for point in points]
    return np.column_stack([durations, [point.initial_pressures()[0] for point in points]])


def fit_noise(
    block: Block,
    errors: Floats,
    used: float,
    off: Floats | None = None,
    *,
    correlated: bool = True,
    rate: Floats | None = None,
) -> FittedNoise:
    """Noise of a block from its residuals at the best values.

    Parameters
    ----------
    block : Block
    errors : (n,)
    used : float
        Parameters that the block pays for: trace of its part of the influence matrix.
    off : (d, n), optional
        Courses that the fitted values may be off by, see `autoregression.estimate`.
    correlated : bool
        Estimate the autocorrelation where the noise model has one, and look for outliers and for growth with the rate.
    rate : (n,), optional
        Rates that the noise may grow with, in the unit of the residuals; the simulated ones by default. They have no
        noise: weights by measured ones would favour values that are too low.
    """
    if block.shots is not None:
        return block.shots
    off = np.zeros((0, len(errors))) if off is None else off
    growth = _growth(block, errors, rate, off) if correlated else EVEN
    errors, off = errors / growth.shape, off / growth.shape
    law = _law(block, errors, off, correlated)
    free = correlated and block.ordered and block.noise.correlation is not Correlation.WHITE
    regression = _regression(errors, off, law) if free else WHITE
    sigma = block.noise.sigma
    if sigma is not None:
        floor = block.noise.discrepancy if not block.noise.length else 0.0
        sigma = sigma / growth.least if correlated else _typical(block, errors)
        whole = math.hypot(sigma, floor)
        freedom = block.noise.freedom * (whole / sigma) ** 4  # Satterthwaite: the discrepancy is exactly known
        scale = whole * regression.innovation_share / LAWS[law].deviation
        return FittedNoise(law, scale, freedom, regression, known=True, growth=growth)
    freedom = max(sample_count(errors) - used, 1.0)
    scale = scale_of(law, regression.whiten(errors), freedom)
    return FittedNoise(law, max(scale, np.finfo(float).tiny ** 0.25), freedom, regression, growth=growth)


def _growth(block: Block, errors: Floats, rate: Floats | None, off: Floats) -> Growth:
    """Growth of the noise with the rate: as stated, or as the innovations show it."""
    if not block.ordered:
        return EVEN
    rate = errors - block.at_zero if rate is None else rate
    if block.noise.sigma is not None:
        return Growth.of(rate, block.noise.relative / block.noise.sigma)
    white = block.noise.correlation is Correlation.WHITE
    return growth_of((WHITE if white else _regression(errors, off, Law.STUDENT)).whiten(errors), rate)


def _typical(block: Block, errors: Floats) -> float:
    """Stated standard deviation at the mean rate, for a search whose first rates may be far from the true ones."""
    mean = float(np.mean(np.maximum(errors - block.at_zero, 0.0))) if block.noise.relative else 0.0
    return (block.noise.sigma or 0.0) + block.noise.relative * mean


def _law(block: Block, errors: Floats, off: Floats, correlated: bool) -> Law:
    if block.noise.law is not Law.AUTO:
        return block.noise.law
    if not correlated:
        return Law.GAUSSIAN
    white = WHITE
    if block.ordered and block.noise.correlation is not Correlation.WHITE:
        white = _regression(errors, off, Law.STUDENT)
    innovations = unequal(np.abs(white.whiten(errors)))
    robust = _NORMAL * float(np.median(innovations))
    many = len(innovations) >= FAR_LEAST and np.mean(innovations > FAR * robust) > FAR_SHARE
    return Law.STUDENT if many else Law.GAUSSIAN


def _regression(errors: Floats, off: Floats, law: Law) -> Autoregression:
    """Autoregression of errors, outliers cut; what the fit may be off by is then smaller in proportion."""
    cut = _cut(errors, law)
    share = np.sqrt(np.sum(cut**2) / max(float(np.sum(errors**2)), 1e-300))
    return estimate(np.vstack([cut, share * off]))


def _cut(errors: Floats, law: Law) -> Floats:
    """Errors, outliers cut where the law expects them."""
    if law is Law.GAUSSIAN:
        return errors
    limit = _CLIP * _NORMAL * float(np.median(np.abs(unequal(errors))))
    return np.clip(errors, -limit, limit)
