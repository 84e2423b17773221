"""Noise of each data set of a fit, from its residuals: law, correlation, growth with the rate, discrepancy.

A course is a pattern of errors that all values of a data set share; its random weight has unit variance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from scipy import ndimage, special

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.data.base import DataSet
from commonrail.data.noise import NOISE, Correlation, Law, Noise

FREEDOM = 4.0  # of Student's t
ROUNDING = 0.2  # radius of the rounded corner of the Laplace law, and kernel width of its density, in scales
_NORMAL = 1.4826  # standard deviation of a normal sample over its median magnitude
_TURNS = 60


class DensityLaw(NamedTuple):
    """Law of a standardised residual u: functions of arrays, and constants of its density.

    The slope of the Laplace law is a kernel density estimate: its mean over residuals is twice their density at zero.
    """

    cost: Callable[[Floats], Floats]  # ρ = −2 ln of the density, without its constant
    weight: Callable[[Floats], Floats]  # ψ/u with ψ = ρ′/2
    slope: Callable[[Floats], Floats]  # ψ′
    constant: float  # −2 ln of the density at zero, with scale 1
    deviation: float  # standard deviation over the scale
    tail: Callable[[Floats], Floats]  # probability that a residual exceeds u ≥ 0


def _rounded(u: Floats) -> Floats:
    return np.asarray(np.sqrt(u * u + ROUNDING**2))


LAWS: dict[Law, DensityLaw] = {
    Law.GAUSSIAN: DensityLaw(
        cost=lambda u: u * u,
        weight=np.ones_like,
        slope=np.ones_like,
        constant=math.log(2.0 * math.pi),
        deviation=1.0,
        tail=lambda u: np.asarray(special.ndtr(-u)),
    ),
    Law.STUDENT: DensityLaw(
        cost=lambda u: np.asarray((FREEDOM + 1.0) * np.log1p(u * u / FREEDOM)),
        weight=lambda u: np.asarray((FREEDOM + 1.0) / (FREEDOM + u * u)),
        slope=lambda u: np.asarray((FREEDOM + 1.0) * (FREEDOM - u * u) / (FREEDOM + u * u) ** 2),
        constant=2.0
        * (math.lgamma(0.5 * FREEDOM) + 0.5 * math.log(FREEDOM * math.pi) - math.lgamma(0.5 * (FREEDOM + 1.0))),
        deviation=math.sqrt(FREEDOM / (FREEDOM - 2.0)),
        tail=lambda u: np.asarray(special.stdtr(FREEDOM, -u)),
    ),
    Law.LAPLACE: DensityLaw(
        cost=lambda u: 2.0 * (_rounded(u) - ROUNDING),
        weight=lambda u: 1.0 / _rounded(u),
        slope=lambda u: ROUNDING**2 / _rounded(u) ** 3,
        constant=2.0 * math.log(2.0),
        deviation=math.sqrt(2.0),
        tail=lambda u: np.asarray(0.5 * np.exp(-u)),
    ),
}


def as_normal(law: Law, u: Floats) -> Floats:
    """Magnitudes (n,) of normal variables that are as likely to be exceeded as standardised residuals (n,) of a law."""
    if law is Law.GAUSSIAN:
        return np.asarray(np.abs(u))
    return np.asarray(-special.ndtri(np.maximum(LAWS[law].tail(np.abs(u)), np.finfo(float).tiny)))


def samples_of(errors: Floats) -> Floats:
    """Errors that are not exactly zero, or all if each is zero.

    Meters and evaluations state exactly zero before and after an injection, as the model does. Such an agreement is not
    a sample of the noise, and would make outliers of all other values.
    """
    nonzero = errors[errors != 0.0]
    return nonzero if len(nonzero) else errors


def count_exact(errors: Floats) -> int:
    """Number of exact zeros among errors (n,), or of values that are zero in all series (k, n); 0 if all are zero."""
    exact = (np.atleast_2d(errors) == 0.0).all(axis=0)
    return 0 if exact.all() else int(np.count_nonzero(exact))


def sample_count(errors: Floats) -> int:
    """Number of values of errors (n,) or series (k, n) that are samples of the noise, without exact zeros."""
    return int(errors.shape[-1] - count_exact(errors))


def scale_of(law: Law, errors: Floats, freedom: float) -> float:
    """Scale of errors (n,) under a law other than "auto": root of Σ weight · error²/freedom, by iteration."""
    if law is Law.GAUSSIAN:
        return float(np.sqrt(np.sum(errors**2) / freedom))
    variance = max((_NORMAL * float(np.median(np.abs(samples_of(errors))))) ** 2, np.finfo(float).tiny)
    for _ in range(_TURNS):
        variance = float(np.sum(LAWS[law].weight(errors / math.sqrt(variance)) * errors**2) / freedom)
        if not variance > 0.0:
            return 0.0
    return math.sqrt(variance)


MOST = 15  # largest order
_SHARE = 0.1  # of the samples that the order may reach
_LIMIT = 0.995  # largest reflection coefficient
BIAS = 2.0  # of the first reflection coefficient r of n samples with known mean: −2 r/n


class Autoregression:
    """Stationary autoregressive noise by its reflection coefficients (order,): partial autocorrelations."""

    def __init__(self, reflections: Floats) -> None:
        self.reflections = np.clip(np.asarray(reflections, float), -_LIMIT, _LIMIT)

    @property
    def order(self) -> int:
        """Number of previous samples that a sample depends on."""
        return len(self.reflections)

    @cached_property
    def predictors(self) -> list[Floats]:
        """Coefficients of the best predictors from 0, 1, … `order` previous samples, by Levinson's recursion."""
        predictors = [np.empty(0)]
        for k in self.reflections:
            previous = predictors[-1]
            predictors.append(np.append(previous - k * previous[::-1], k))
        return predictors

    @property
    def innovation_share(self) -> float:
        """Standard deviation of an innovation over the standard deviation of a sample."""
        return float(np.sqrt(np.prod(1.0 - self.reflections**2)))

    def whiten(self, errors: Floats) -> Floats:
        """Innovations (…, n) of errors (…, n), scaled to one standard deviation; the first samples are kept."""
        order = min(self.order, errors.shape[-1])
        innovations = np.array(errors, float)
        for lag, factor in enumerate(self.predictors[-1], 1):
            innovations[..., lag:] -= factor * errors[..., :-lag]
        for t in range(order):
            predictor = self.predictors[t]
            former = errors[..., :t][..., ::-1]
            wider = np.sqrt(np.prod(1.0 - self.reflections[t:] ** 2))
            innovations[..., t] = wider * (errors[..., t] - np.sum(predictor * former, axis=-1))
        return innovations


def fit_autoregression(series: Floats) -> Autoregression:
    """Autoregression of the order with the least AIC, by Burg's method.

    Residuals are smaller and less correlated than the noise, because the fit follows the noise. As in expectation
    maximisation, the sums of products of the fit's own errors are therefore added.

    `series` (1 + d, n): residuals, then d courses of the fit's own errors: columns of a root of the covariance of the
    parameters, times the derivatives.
    """
    samples = sample_count(series[0])
    forward, backward = np.array(series, float), np.array(series, float)
    reflections: list[float] = []
    criterion = [0.0]
    for _ in range(min(MOST, int(_SHARE * samples))):
        ahead, behind = forward[:, 1:], backward[:, :-1]
        energy = float(np.sum(ahead**2) + np.sum(behind**2))
        if not energy > 0.0:
            break
        k = float(np.clip(2.0 * np.sum(ahead * behind) / energy, -_LIMIT, _LIMIT))
        forward, backward = ahead - k * behind, behind - k * ahead
        reflections.append(k)
        criterion.append(criterion[-1] + samples * float(np.log(1.0 - k * k)) + 2.0)
    selected = np.array(reflections[: int(np.argmin(criterion))])
    if len(selected):
        selected[0] *= 1.0 + BIAS / samples
    return Autoregression(selected)


LEAST = 50  # fewest samples for an estimate of the growth
# Least gain of 2 ln L. Chance exceeds it in 0.16 % of cases (chi-squared with one degree of freedom; 0.15 and 0.2 % of
# 20 000 series of 400 and 100 values).
GAIN = 10.0
GRID = np.geomspace(0.1, 100.0, 61)  # standard deviation at the highest rate over the deviation at zero, less 1
# Share of the root mean square of a series, below which a value counts as an exact zero. Measured noise exceeds 5 % of
# it even if shots scatter by 1 % and the sensor by 0.02 mm³/ms.
AGREED = 1e-4


class Growth(NamedTuple):
    """Standard deviations of values relative to each other, in proportion to 1 + slope · rate."""

    shape: Floats  # (n,) or (1,), their logarithms add up to zero
    least: float  # value at a rate of zero
    slope: float  # 0 for values of one standard deviation

    @classmethod
    def of(cls, rate: Floats, slope: float) -> Growth:
        """Growth of values with rates (n,); a negative rate counts as zero."""
        if not slope:
            return EVEN
        grown = 1.0 + slope * np.maximum(rate, 0.0)
        least = float(np.exp(-np.mean(np.log(grown))))
        return cls(least * grown, least, slope)

    def at(self, rate: Floats) -> Growth:
        """Growth for other rates (m,), relative to the same scale."""
        return self._replace(shape=self.least * (1.0 + self.slope * np.maximum(rate, 0.0)))


EVEN = Growth(np.ones(1), 1.0, 0.0)


def growth_of(innovations: Floats, rate: Floats) -> Growth:
    """Growth of innovations (n,) with the rates (n,) of their values; `EVEN` if it is not significant.

    The growth is fitted to the logarithms of the magnitudes by least squares, on which outliers have little effect.
    """
    top = float(np.max(rate, initial=0.0))
    size = np.abs(innovations)
    live = size > AGREED * np.sqrt(np.mean(size**2))
    many = np.count_nonzero(live)
    if many < LEAST or not top > 0.0:
        return EVEN
    logarithms = np.log(size[live])
    grown = np.log1p(GRID[:, None] * np.maximum(rate[live], 0.0) / top)
    left = np.var(logarithms - grown, axis=1)
    best = int(np.argmin(left))
    gain = many * float(np.log(np.var(logarithms) / left[best]))
    return Growth.of(rate, float(GRID[best]) / top) if gain > GAIN else EVEN


WHITE = Autoregression(np.empty(0))
FAR, FAR_SHARE, FAR_LEAST = 4.0, 0.01, 50  # deviations, share and number of values by which outliers are recognised
# Share of the largest measured value. Rounding in the filters of a meter leaves about 1e-13 of it at zero flow.
_ROUNDING = 1e-9
NEGLIGIBLE = 1e-10  # power of a course over the largest power, below which the course is omitted
_CLIP = 3.0  # deviations to which outliers are cut before the autocorrelation is estimated


@dataclass(frozen=True)
class FittedNoise:
    """Fitted noise of a block: autoregressive noise of one scale, and `courses` of errors shared by all values."""

    law: Law  # not "auto"
    scale: float  # of an innovation, in the unit of the residuals; times `density.deviation`: standard deviation
    freedom: float  # degrees of freedom of the scale; infinite if the scale is exactly known
    autoregression: Autoregression = WHITE
    stated: bool = False  # the scale is stated or from repeated measurements, not estimated from the residuals
    growth: Growth = EVEN  # standard deviations of the values relative to each other
    scatter: float = 0.0  # common error of all values, as a share of them
    courses: Floats = field(default_factory=lambda: np.empty((0, 0)))  # (k, n), one standard deviation of each
    share: float = 0.0  # discrepancy of the model that was estimated, as a share of the values
    drift: Floats | None = None  # (k, n), the courses that are an estimated slow drift

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
        """Standard deviation of a value, correlation included; at a rate of zero if it grows with the rate."""
        return self.value_scale * self.density.deviation * self.growth.least

    @property
    def relative(self) -> float:
        """Growth of `sigma` per unit of the rate."""
        return self.sigma * self.growth.slope

    def mean_slope(self, innovations: Floats) -> float:
        """Mean slope of the law over innovations (n,), 0.05 at least."""
        return max(float(self.density.slope(samples_of(innovations)).mean()), 0.05)

    def at(self, rate: Floats) -> FittedNoise:
        """Noise of a curve with other rates (m,), in the same unit, without the estimated discrepancy."""
        return replace(self, growth=self.growth.at(rate), courses=self.scatter * rate[None], share=0.0)

    def whiten(self, errors: Floats) -> Floats:
        """Standardised innovations (…, n) of residuals (…, n).

        With the whitened courses U (k, n), in deviations of the law, the covariance of the innovations is 1 + UᵀU. Its
        inverse root divides the component along a principal axis of U with the power λ by √(1 + λ), and leaves
        components orthogonal to all axes unchanged.
        """
        innovations = self._innovations(errors)
        axes, powers = self._axes
        if not len(powers):
            return innovations
        return np.asarray(innovations - ((innovations @ axes.T) * (1.0 - 1.0 / np.sqrt(1.0 + powers))) @ axes)

    def explained(self, errors: Floats) -> Floats:
        """Most likely contribution (n,) of the courses to residuals (n,)."""
        moves = self._innovations(self.courses) / self.density.deviation
        u = self._innovations(errors) / self.density.deviation
        return np.asarray(np.linalg.solve(np.eye(len(moves)) + moves @ moves.T, moves @ u) @ self.courses)

    @property
    def absorbed(self) -> float:
        """Degrees of freedom that the courses take: trace of their influence matrix."""
        powers = self._axes[1]
        return float(np.sum(powers / (1.0 + powers)))

    def log_determinant(self, n: int) -> float:
        """Logarithm of the determinant of the covariance of n values."""
        k = self.autoregression.reflections
        begin = -float(np.sum(np.arange(1, len(k) + 1) * np.log1p(-(k**2))))  # first values have their own deviations
        return 2.0 * n * math.log(self.scale) + begin + float(np.sum(np.log1p(self._axes[1])))

    @cached_property
    def _axes(self) -> tuple[Floats, Floats]:
        """Principal axes (k, n) of the whitened courses, orthonormal, and their powers (k,)."""
        if not self.courses.any():
            return np.empty((0, self.courses.shape[1])), np.empty(0)
        moves = self._innovations(self.courses) / self.density.deviation
        values, vectors = np.linalg.eigh(moves @ moves.T)
        seen = values > NEGLIGIBLE * values.max()
        return np.asarray((vectors[:, seen] / np.sqrt(values[seen])).T @ moves), values[seen]

    def _innovations(self, errors: Floats) -> Floats:
        """Standardised innovations without the courses."""
        return self.autoregression.whiten(errors / self.growth.shape) / self.scale


# Chosen correlation lengths of a model's discrepancy: of a curve, the duration of a needle stroke; of a map, in
# energising time and rail pressure.
LENGTH, TIME_LENGTH, PRESSURE_LENGTH = 50e-6, 0.2e-3, 40e6  # [s], [s], [Pa]
SMALL_VALUE = 0.03  # share of the largest value of a map; smaller values have the discrepancy of this share
HEIGHT = (2.0 / math.pi) ** 0.25  # of bumps one length apart whose squares add up to 1
LEAST_NEAR = 3  # fewest samples per length for a curve to have a discrepancy
MOST_ROOTED = 600  # most values of a map for which the covariance itself is decomposed
MOST_BUMPS = 150  # along an axis; in a longer record the bumps are farther apart
HALF_PERIODS = 3  # of a drift: cosines with 1, 2 and 3 half periods over the record


@dataclass(frozen=True)
class Block:
    """Residuals of a data set within the residuals of a fit."""

    name: str
    rows: slice  # rows within all residuals
    noise: Noise = NOISE  # as stated, with standard deviations in the unit of the residuals
    unit: str = ""  # unit of the residuals, for texts
    ordered: bool = False  # the values are a curve over time
    at_zero: Floats = field(default_factory=lambda: np.empty(0))  # (n,), residuals of simulated values of zero
    # (n,), change of the residuals if each simulated value rises by one unit
    offset: Floats = field(default_factory=lambda: np.empty(0))
    # (n, 2), time [s] and rail pressure [Pa] of each value; the correlation of a discrepancy depends on their distances
    places: Floats = field(default_factory=lambda: np.empty((0, 2)))
    shots: FittedNoise | None = None  # noise estimated from repeated shots

    @property
    def size(self) -> int:
        """Number of values."""
        return int(self.rows.stop - self.rows.start)

    @property
    def rounding(self) -> Floats:
        """Limits (n,) of residuals that count as zero, for values measured as exactly zero or not judged; else 0."""
        return np.where(self.at_zero == 0.0, _ROUNDING * np.max(np.abs(self.at_zero), initial=0.0), 0.0)

    def courses(self, deviations: Floats, length: float, pressure_length: float = math.inf) -> Floats:
        """Courses (k, n) whose sum, with independent unit weights, is a discrepancy with a Gaussian correlation.

        The courses are bumps one length apart, along a curve over time or over the energising times and rail pressures
        of a map; the variance of their sum is constant to 1.4 %. A length of zero gives no courses: the discrepancy is
        then part of the noise.

        `deviations` (n,): standard deviations, in the unit of the residuals; `length`, `pressure_length`: [s], [Pa].
        """
        if not (length and deviations.any()):
            return np.zeros((0, self.size))
        if not self.ordered and self.size <= MOST_ROOTED:  # the root of the covariance itself
            distance = (self.places[:, None] - self.places[None]) / np.array([length, pressure_length])
            values, vectors = np.linalg.eigh(np.exp(-0.5 * np.sum(distance**2, axis=-1)))
            seen = values > NEGLIGIBLE * values.max()
            return np.asarray(deviations * (vectors[:, seen] * np.sqrt(values[seen])).T)
        live = self.places[deviations > 0.0]
        bumps = np.ones((1, self.size))
        for axis, reach in enumerate((length, pressure_length)[: 1 if self.ordered else 2]):
            if not math.isfinite(reach) or not np.ptp(live[:, axis]):
                continue
            reach = max(reach, float(np.ptp(live[:, axis])) / min(MOST_BUMPS, max(0.5 * len(live), 1.0)))
            low, high = live[:, axis].min() - 2.0 * reach, live[:, axis].max() + 2.0 * reach
            centres = np.arange(low, high, reach)
            profile = HEIGHT * np.exp(-(((self.places[:, axis] - centres[:, None]) / reach) ** 2))
            bumps = (bumps[:, None] * profile[None]).reshape(-1, self.size)
        bumps = deviations * bumps
        size = np.sum(bumps**2, axis=1)
        return np.asarray(bumps[size > NEGLIGIBLE * size.max()])

    def stated_courses(self) -> Floats:
        """Courses of the discrepancy that the study states."""
        deviations = np.full(self.size, self.noise.discrepancy)
        return self.courses(deviations, self.noise.length, self.noise.pressure_length)

    def model_courses(self, rate: Floats) -> Floats:
        """Courses (k, n) of a discrepancy of 100 % of simulated values (n,).

        In a curve it is proportional to the largest value within a length, so that it covers an edge that comes too
        late.
        """
        if self.ordered:
            interval = float(np.median(np.diff(self.places[:, 0]))) if self.size > 1 else LENGTH
            near = round(LENGTH / interval)
            if near < LEAST_NEAR:  # so few samples per length look like noise
                return np.zeros((0, self.size))
            around = ndimage.maximum_filter1d(np.abs(rate), 2 * near + 1, mode="nearest")
            return self.courses(ndimage.gaussian_filter1d(around, near, mode="nearest"), LENGTH)
        floor = SMALL_VALUE * float(np.max(np.abs(rate), initial=0.0)) if self.size else 0.0
        judged = self.offset != 0.0
        return self.courses(np.where(judged, np.maximum(np.abs(rate), floor), 0.0), TIME_LENGTH, PRESSURE_LENGTH)

    def drift_courses(self) -> Floats:
        """Constant and cosines (1 + `HALF_PERIODS`, n) over the record, with an amplitude of one unit of the values."""
        times = self.places[:, 0] - self.places[:, 0].min()
        phase = np.pi * times / max(float(np.ptp(times)), 1e-300)
        return np.asarray(np.cos(np.arange(HALF_PERIODS + 1)[:, None] * phase) * self.offset)


def block_of(data: DataSet, start: int) -> Block:
    """Block of a data set whose residuals begin at a row."""
    n, scale = len(data.measured), data.residual_scale
    root = np.sqrt(row_weights(data))
    zero, unit = (np.asarray(data.residuals(np.full((1, n), value))[0] / root) for value in (0.0, 1.0))
    sigma = None if data.noise.sigma is None else data.noise.sigma * scale
    return Block(
        name=data.name,
        rows=slice(start, start + n),
        noise=replace(data.noise, sigma=sigma, discrepancy=data.noise.discrepancy * scale),
        unit=data.residual_unit,
        ordered=data.bounds is not None,
        at_zero=np.where(data.judged, zero, 0.0),
        offset=np.where(data.judged, unit - zero, 0.0),
        places=coordinates_of(data),
    )


def row_weights(data: DataSet) -> Floats:
    """Weights (n,) that the objective applies to squared residuals of a data set, but the likelihood does not.

    Repeated quantities do not show the scatter of dead times, whose standard deviation therefore remains one tolerance.
    """
    weights = np.full(len(data.measured), data.weight)
    if data.noise.sigma is not None and math.isfinite(data.noise.freedom):
        weights[~data.judged] /= (data.noise.sigma * data.residual_scale) ** 2
    return weights


def coordinates_of(data: DataSet) -> Floats:
    """Time [s] and rail pressure [Pa] of each value (n, 2); the time of a quantity is its first energising time."""
    pressures = [point.initial_pressures()[0] for point in data.points]
    if data.bounds is not None:
        middle = 0.5 * (data.bounds[1:] + data.bounds[:-1])
        return np.column_stack([middle, np.full(len(middle), pressures[0])])
    return np.column_stack([[point.pulses[0].duration if point.pulses else 0.0 for point in data.points], pressures])


PASSES = 3  # alternating estimates of noise and courses
FEW_VALUES = 5  # fewest values of a map whose noise is estimated
SMALLEST = np.finfo(float).tiny ** 0.25  # smallest scale of a noise whose fourth power is not zero


def fit_noise(
    block: Block,
    errors: Floats,
    used: float,
    fitted_courses: Floats | None = None,
    *,
    correlated: bool = True,
    rate: Floats | None = None,
    more: Floats | None = None,
) -> FittedNoise:
    """Noise of a block from its residuals (n,) at the best values.

    `used`: degrees of freedom that the fit takes from the block (trace of its part of the influence matrix);
    `fitted_courses` (d, n): courses of the fit's own errors, see `fit_autoregression`; `correlated`: look for
    autocorrelation, outliers and growth with the rate; `rate` (n,): rates with which the noise may grow, by default
    simulated rates, because weights from measured rates would favour low values; `more` (k, n): courses in addition to
    the stated courses.
    """
    rate = errors - block.at_zero if rate is None else rate
    fitted_courses = np.zeros((0, len(errors))) if fitted_courses is None else fitted_courses
    scatter_course = block.noise.scatter * rate[None] if block.noise.scatter else None
    stated = block.stated_courses() if block.noise.discrepancy else None
    courses = _stacked(np.zeros((0, len(errors))), scatter_course, stated, more)
    if block.shots is not None:
        return replace(block.shots, courses=courses)
    if not len(courses):
        return _fit(block, errors, used, fitted_courses, correlated, rate)
    # start with white noise: differences between neighbours, which hardly contain courses, or a third of the residuals
    size = np.diff(errors) / math.sqrt(2.0) if block.ordered and len(errors) > 1 else errors / 3.0
    scale = max(float(np.sqrt(np.mean(samples_of(size) ** 2))), 1e-6 * float(np.max(np.abs(errors), initial=0.0)))
    noise = FittedNoise(Law.GAUSSIAN, max(scale, SMALLEST), math.inf, courses=courses)
    for _ in range(PASSES):
        rest, spent = errors - noise.explained(errors), used + noise.absorbed
        rest = rest if not errors.any() else np.where(errors == 0.0, 0.0, rest)  # exact zeros remain excluded
        noise = _fit(block, rest, spent, fitted_courses, correlated, rate)
        noise = replace(noise, courses=courses, scatter=block.noise.scatter)
    return noise


def _fit(
    block: Block, errors: Floats, used: float, fitted_courses: Floats, correlated: bool, rate: Floats
) -> FittedNoise:
    """Noise of errors (n,) without courses."""
    growth = _growth(block, errors, rate, fitted_courses) if correlated else EVEN
    errors, fitted_courses = errors / growth.shape, fitted_courses / growth.shape
    law = block.noise.law
    if law is Law.AUTO:
        law = _recognise_law(block, errors, fitted_courses) if correlated else Law.GAUSSIAN
    regression = _regression(block, errors, fitted_courses, law) if correlated else WHITE
    sigma = block.noise.sigma
    if sigma is not None:
        floor = block.noise.discrepancy if not block.noise.length else 0.0
        if correlated:
            sigma = sigma / growth.least
        else:  # at the mean rate: early in a search the rates may be far from the true rates
            sigma += block.noise.relative * float(np.mean(np.maximum(rate, 0.0)))
        widened = math.hypot(sigma, floor)
        freedom = block.noise.freedom * (widened / sigma) ** 4  # Satterthwaite: the discrepancy is exactly known
        scale = widened * regression.innovation_share / LAWS[law].deviation
        return FittedNoise(law, scale, freedom, regression, True, growth)
    freedom = max(sample_count(errors) - used, 1.0)
    scale = max(scale_of(law, regression.whiten(errors), freedom), SMALLEST)
    if not block.ordered and sample_count(errors) < FEW_VALUES:  # only their tolerance is known
        return FittedNoise(law, max(scale, 1.0 / LAWS[law].deviation), math.inf, regression, True, growth)
    return FittedNoise(law, scale, freedom, regression, growth=growth)


def _growth(block: Block, errors: Floats, rate: Floats, fitted_courses: Floats) -> Growth:
    """Growth of the noise with the rate, as stated or estimated from the innovations."""
    if not block.ordered:
        return EVEN
    if block.noise.sigma is not None:
        return Growth.of(rate, block.noise.relative / block.noise.sigma)
    innovations = _regression(block, errors, fitted_courses, Law.STUDENT).whiten(errors)
    sampled = errors != 0.0 if errors.any() else np.ones(len(errors), bool)  # exact zeros are not samples
    growth = growth_of(innovations[sampled], rate[sampled])
    return growth.at(rate) if growth.slope else EVEN


def _recognise_law(block: Block, errors: Floats, fitted_courses: Floats) -> Law:
    """Student's t if many innovations are outliers, else the normal distribution."""
    innovations = samples_of(np.abs(_regression(block, errors, fitted_courses, Law.STUDENT).whiten(errors)))
    robust = _NORMAL * float(np.median(innovations))
    many = len(innovations) >= FAR_LEAST and np.mean(innovations > FAR * robust) > FAR_SHARE
    return Law.STUDENT if many else Law.GAUSSIAN


def _regression(block: Block, errors: Floats, fitted_courses: Floats, law: Law) -> Autoregression:
    """Autoregression of the errors (n,) of a curve over time; outliers are clipped if the law allows for them."""
    if not block.ordered or block.noise.correlation is Correlation.WHITE:
        return WHITE
    cut = errors
    if law is not Law.GAUSSIAN:
        limit = _CLIP * _NORMAL * float(np.median(np.abs(samples_of(errors))))
        cut = np.clip(errors, -limit, limit)
    share = np.sqrt(np.sum(cut**2) / max(float(np.sum(errors**2)), 1e-300))
    return fit_autoregression(np.vstack([cut, share * fitted_courses]))


# A discrepancy or a drift has the most likely size, if its gain in likelihood is significant.

SHARES = np.geomspace(0.004, 0.4, 9)  # tried discrepancies, as shares of the values
# Least gain of 2 ln L for a discrepancy. If the noise has outliers, chance alone gained 20, because courses are normal.
SHARE_GAIN = 30.0
LEAST_SCORE = 4.0  # score in standard deviations, below which no size is tried
DRIFTS = np.geomspace(0.2, 6.0, 5)  # in standard deviations of the noise


def cost_of(block: Block, noise: FittedNoise, errors: Floats) -> float:
    """−2 ln L of residuals (n,) of a block under its noise, plus 2 per order of the autoregression (AIC)."""
    n = sample_count(errors)
    cost = float(np.sum(noise.density.cost(noise.whiten(errors)))) + n * noise.density.constant
    sampled = (errors != 0.0) if n < len(errors) else np.ones(len(errors), bool)
    grown = 2.0 * float(np.sum(np.log(np.broadcast_to(noise.growth.shape, errors.shape))[sampled]))
    return cost + grown + noise.log_determinant(n) + 2.0 * noise.autoregression.order


def fit_noises(
    blocks: Sequence[Block],
    errors: Floats,
    used: Sequence[float],
    fitted_courses: Floats,
    *,
    correlated: bool = True,
    like: Sequence[FittedNoise] | None = None,
) -> list[FittedNoise]:
    """Noise of all blocks of a fit, with a discrepancy of the model that is the same share of the values in each block.

    The common share makes data sets comparable: with separate scales, a curve of 900 samples would outweigh a map of 88
    quantities. The share is zero if a study states discrepancies, or if the likelihood gains too little. Arguments as
    for `fit_noise`, for all blocks; `like`: noises whose discrepancy and drifts are used instead of estimates.
    """
    parts = [(b, errors[b.rows], paid, fitted_courses[:, b.rows]) for b, paid in zip(blocks, used, strict=True)]
    if like is not None:
        drifts = [noise.drift for noise in like]
    else:
        drifts = [_drift(*arguments) if correlated else None for arguments in parts]

    model_courses = [b.model_courses(e - b.at_zero) for b, e, _, _ in parts]

    def fit(size: float) -> tuple[float, list[FittedNoise]]:
        """Cost and noises for a size of the discrepancy."""
        noises = []
        for arguments, courses, drift in zip(parts, model_courses, drifts, strict=True):
            more = _stacked(size * courses, drift) if size else drift
            noises.append(replace(fit_noise(*arguments, correlated=correlated, more=more), share=size, drift=drift))
        return sum(cost_of(b, noise, e) for noise, (b, e, _, _) in zip(noises, parts, strict=True)), noises

    open_to_share = correlated and not any(block.noise.discrepancy for block in blocks)
    if like is not None:
        return fit(max(noise.share for noise in like) if open_to_share else 0.0)[1]
    cost, plain = fit(0.0)
    if not (open_to_share and any(map(_shows, plain, parts, model_courses))):
        return plain
    return _lowest(fit, SHARES, cost - SHARE_GAIN) or plain


def _shows(noise: FittedNoise, arguments: tuple[Block, Floats, float, Floats], courses: Floats) -> bool:
    """True if courses (k, n) explain a significant part of the residuals: score test of a variance component.

    q = Σ (c·u)² over the whitened courses c has the mean Σ c·c and the variance 2 Σ (c·c′)².
    """
    if not len(courses):
        return False
    u, moves = noise.whiten(arguments[1]) / noise.density.deviation, noise.whiten(courses)
    gram = moves @ moves.T
    return bool(np.sum((moves @ u) ** 2) - np.trace(gram) > LEAST_SCORE * math.sqrt(2.0 * float(np.sum(gram**2))))


def _stacked(*courses: Floats | None) -> Floats:
    return np.vstack([rows for rows in courses if rows is not None])


Trial = TypeVar("Trial")


def _lowest(trial: Callable[[float], tuple[float, Trial]], sizes: Floats, limit: float) -> Trial | None:
    """Trial with the lowest cost below a limit, or None; sizes increase until the cost has risen twice in a row."""
    best, last, rises = None, math.inf, 0
    for size in sizes.tolist():
        cost, result = trial(size)
        if cost < limit:
            limit, best = cost, result
        rises = rises + 1 if cost > last else 0
        last = cost
        if rises == 2:
            break
    return best


def _drift(block: Block, errors: Floats, used: float, fitted_courses: Floats) -> Floats | None:
    """Courses (k, n) of a slow drift of the record, scaled to its size; None if it is not significant."""
    if not block.ordered or block.noise.sigma is not None or block.shots is not None or sample_count(errors) < LEAST:
        return None
    plain = fit_noise(block, errors, used, fitted_courses)
    if plain.law is not Law.GAUSSIAN:  # outliers would distort the courses
        return None
    courses = plain.sigma * block.drift_courses() / max(float(np.max(np.abs(block.offset))), 1e-300)

    def trial(size: float) -> tuple[float, Floats]:
        noise = fit_noise(block, errors, used, fitted_courses, more=size * courses)
        return cost_of(block, noise, errors), size * courses

    return _lowest(trial, DRIFTS, cost_of(block, plain, errors) - GAIN)


def with_shots(blocks: Sequence[Block], data: Sequence[DataSet]) -> tuple[Block, ...]:
    """Blocks in which the noise of repeated shots is estimated from differences between the shots, without a model.

    `data`: in the order of the blocks. Raises `ConfigurationError` if a group has a single data set, or its data sets
    differ in kind or number of values.
    """
    groups: dict[str, list[int]] = {}
    for i, block in enumerate(blocks):
        if block.noise.shots:
            groups.setdefault(block.noise.shots, []).append(i)
    updated = list(blocks)
    for name, members in groups.items():
        kinds = {(data[i].kind, blocks[i].size) for i in members}
        if len(members) < 2 or len(kinds) > 1:
            raise ConfigurationError(
                f'The repeated shots "{name}" must be two data sets or more of one kind with equally many values; '
                f"{', '.join(blocks[i].name for i in members)} cannot be compared."
            )
        shots = np.array([blocks[i].at_zero for i in members])
        mean = -shots.mean(axis=0)
        deviations = shots + mean
        used = sample_count(deviations)  # the mean shot
        first = blocks[members[0]]
        first = replace(first, noise=replace(first.noise, shots="", discrepancy=0.0, scatter=0.0))
        noise = fit_noise(first, deviations.reshape(-1), used, rate=np.tile(mean, len(members)))
        for i in members:
            updated[i] = replace(blocks[i], shots=replace(noise.at(mean), stated=True))
    return tuple(updated)
