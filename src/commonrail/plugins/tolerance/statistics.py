"""Statistics of a tolerance study: drawn and simulated parts, spread of their quantities, capability, shares."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arrays import Floats
from commonrail.base.record import Interval
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import Prepared, prepare
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.status import OK, Status
from commonrail.plugins.tolerance.study import Sampling, Tolerances

EDGE = 1e-12  # least distance of a share from 0 and 1, where a normal distribution is infinite


class Draws:
    """Parts of a study, drawn in order; equal block sizes give equal parts."""

    def __init__(self, tolerances: Tolerances) -> None:
        from scipy.stats import qmc  # slow to import

        rng = np.random.default_rng(tolerances.seed)
        self._dimensions, self._factor = tolerances.dimensions, tolerances.factor()
        d = len(self._dimensions)
        even = tolerances.sampling is Sampling.QUASI_RANDOM
        self._sequence = qmc.Sobol(d, rng=rng) if even else None
        self._rng = rng

    def take(self, count: int) -> Floats:
        """Draw the next parts (count, dimensions) [SI]; powers of two keep the sequence even."""
        shares = self._rng.random((count, len(self._dimensions))) if self._sequence is None else self._even(count)
        shares = np.clip(shares, EDGE, 1.0 - EDGE)
        if self._factor is not None:
            from scipy.special import ndtr, ndtri  # slow to import

            shares = np.clip(ndtr(ndtri(shares) @ self._factor.T), EDGE, 1.0 - EDGE)
        columns = [dimension.distribution.at(shares[:, j]) for j, dimension in enumerate(self._dimensions)]
        return np.stack(columns, axis=1)

    def _even(self, count: int) -> Floats:
        assert self._sequence is not None
        power_of_two = 1 << (count - 1).bit_length()  # SciPy warns of other numbers
        if self._sequence.num_generated or power_of_two == count:
            return np.asarray(self._sequence.random(count))
        return np.asarray(self._sequence.random(power_of_two)[:count])


class Parts(NamedTuple):
    """Quantities (parts, points) [m³], NaN for failed simulations, and codes (values of `Status`)."""

    quantities: Floats
    codes: NDArray[np.int8]


class PartSimulator:
    """Simulator of parts: the study's injector with its dimensions as columns; counts the injections."""

    def __init__(self, tolerances: Tolerances, threads: int | None = None) -> None:
        self.tolerances, self.threads = tolerances, threads
        self.injections = 0
        self.points = [p.point for p in tolerances.points]
        self._prepared = prepare(tolerances.injector, self.points, tolerances.time_step)

    def parts(self, values: Floats | None) -> Parts:
        """Quantities of parts (n, dimensions) [SI] at the study's points; None: the part as drawn."""
        return self._run(self.points, values, self._prepared)

    def at(self, point: OperatingPoint, values: Floats | None) -> Parts:
        """Quantities of parts at another point, as in `parts`."""
        return self._run([point], values, None)

    def _run(self, points: Sequence[OperatingPoint], values: Floats | None, prepared: Prepared | None) -> Parts:
        t = self.tolerances
        self.injections += (1 if values is None else len(values)) * len(points)
        batch = simulate_batch(
            t.injector,
            points,
            () if values is None else t.names,
            values,
            time_step=t.time_step,
            threads=self.threads,
            precision=t.precision,
            prepared=prepared,
        )
        good = batch.status == OK
        return Parts(np.where(good, batch.injected_volume, np.nan), batch.status.astype(np.int8))


# Share of each dimension in the variance of the quantity, by regression on the simulated parts.
#
# A sum of cubic polynomials, one for each dimension, is fitted to the quantity. The share of a dimension is the
# covariance of its polynomial with the quantity over the variance of the quantity (Li et al. 2010). For independent
# dimensions this is the first-order Sobol' index. The shares and the rest (interactions, and steps that a cubic cannot
# follow) sum to 1, also for correlated dimensions.

DEGREE = 3  # of the polynomial per dimension
GROUPS = 16  # groups of parts that the jackknife leaves out in turn
WIDE = np.array([0.025, 0.975])  # shares of the parts at which the scaled dimension is -1 and 1


class Shares(NamedTuple):
    """Shares of the variance at one operating point.

    For each dimension (d,): the share with its interval (jackknife over groups of parts); `swing`, the change of the
    quantity from the 2.5 % to the 97.5 % quantile of this dimension alone [m³]; `halved`, the standard deviation of the
    quantity if this dimension scattered half as much [m³]. `rest` is the share that is not due to a single dimension.
    """

    value: Floats
    low: Floats
    high: Floats
    rest: float
    swing: Floats
    halved: Floats


class VarianceShares:
    """Sums for the shares, collected block by block; `centre` (points,) [m³] is subtracted to reduce rounding."""

    def __init__(self, tolerances: Tolerances, centre: Floats) -> None:
        ends = np.stack([dimension.distribution.at(WIDE) for dimension in tolerances.dimensions])
        self._middle, self._reach = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
        self._centre, self._d = centre, len(ends)
        columns = 1 + DEGREE * self._d
        self._products = np.zeros((GROUPS, len(centre), columns, columns))
        self._sums = np.zeros((GROUPS, len(centre), columns))
        self._squares = np.zeros((GROUPS, len(centre)))

    def add(self, group: int, values: Floats, quantities: Floats) -> None:
        """Add parts (n, dimensions) [SI] of a group with their quantities (n, points) [m³]; NaN for failed ones."""
        scaled = (values - self._middle) / self._reach
        powers = [np.ones((len(values), 1)), scaled]
        for _ in range(1, DEGREE):
            powers.append(powers[-1] * scaled)
        terms = np.hstack(powers)
        everything = terms.T @ terms
        for k, column in enumerate((quantities - self._centre).T):
            finite = np.isfinite(column)
            rows, finite_values = (terms, column) if finite.all() else (terms[finite], column[finite])
            self._products[group, k] += everything if len(rows) == len(terms) else rows.T @ rows
            self._sums[group, k] += rows.T @ finite_values
            self._squares[group, k] += float(finite_values @ finite_values)

    def shares(self, k: int, confidence: float) -> Shares | None:
        """Shares at operating point k; None for too few parts, or a quantity that does not scatter."""
        from scipy.special import stdtrit  # slow to import

        sums = [self._products[:, k], self._sums[:, k], self._squares[:, k]]
        estimate = self._fit(*(group_sums.sum(axis=0) for group_sums in sums))
        if estimate is None:
            return None
        used = [g for g in range(GROUPS) if self._products[g, k, 0, 0] > 0.0]
        others = [self._fit(*(group_sums.sum(axis=0) - group_sums[g] for group_sums in sums)) for g in used]
        estimates = np.array([other.value for other in others if other is not None])
        n = len(estimates)
        if n < 2:
            return None
        spread = np.sqrt((n - 1.0) / n * np.sum((estimates - estimates.mean(axis=0)) ** 2, axis=0))
        reach = float(stdtrit(n - 1, 0.5 + 0.5 * confidence)) * spread
        return estimate._replace(low=estimate.value - reach, high=estimate.value + reach)

    def _fit(self, products: Floats, sums: Floats, squares: Floats) -> Shares | None:
        """Shares by least squares from sums, without intervals."""
        n, d = float(products[0, 0]), self._d
        variance = float(squares) / n - (float(sums[0]) / n) ** 2 if n else 0.0
        if n < 2 * len(sums) or not variance > 0.0:
            return None
        means = products[0, 1:] / n
        covariances = products[1:, 1:] / n - np.outer(means, means)
        with_quantity = sums[1:] / n - means * float(sums[0]) / n
        slopes: Floats = np.asarray(np.linalg.lstsq(covariances, with_quantity, rcond=1e-12)[0], dtype=np.float64)
        by_degree = (slopes * with_quantity).reshape(DEGREE, d).sum(axis=0)
        powers = slopes.reshape(DEGREE, d)
        variances = np.einsum("aj,ajbj,bj->j", powers, covariances.reshape(DEGREE, d, DEGREE, d), powers)
        odd = powers[::2].sum(axis=0)
        halved = np.sqrt(np.maximum(variance - by_degree + 0.25 * variances, 0.0))
        shares = by_degree / variance
        return Shares(shares, shares, shares, float(1.0 - shares.sum()), 2.0 * odd, halved)


# Figures of the spread of a quantity over parts, and of the capability within limits.

# Quantiles of the quantity; the outer two enclose 6 sigma of a normal distribution.
QUANTILES = (0.00135, 0.025, 0.5, 0.975, 0.99865)
BARS = 60  # of the histogram


class Histogram(NamedTuple):
    """Edges of the bars [m³], and the number of parts in each."""

    edges: tuple[float, ...]
    counts: tuple[int, ...]


class Spread(NamedTuple):
    """Spread of a quantity over parts at one operating point, SI.

    `mean` and `deviation` cover the parts that did not fail; `quantiles` are keyed by the shares of `QUANTILES`;
    `below` and `above` count the parts beyond the limits; `out` is the share of parts beyond the limits or failed, with
    its interval; `cp` and `cpk` are None if limits are absent.
    """

    parts: int
    failed: int
    reasons: dict[str, int]
    mean: float
    deviation: float
    quantiles: dict[str, float]
    lower: float | None
    upper: float | None
    below: int
    above: int
    out: Interval
    cp: float | None
    cpk: float | None
    histogram: Histogram


def describe_spread(
    quantities: Floats,
    codes: NDArray[np.int8],
    limits: tuple[float | None, float | None],
    confidence: float,
) -> Spread | None:
    """Describe the spread of the quantities (n,) of parts [m³] within limits [m³].

    A failed part counts as out of limits, since it would be rejected. None if fewer than two parts could be simulated.
    """
    from scipy.stats import binomtest  # slow to import

    delivered = quantities[codes == OK]
    if len(delivered) < 2:
        return None
    lower, upper = limits
    mean, deviation = float(delivered.mean()), float(delivered.std(ddof=1))
    below = 0 if lower is None else int(np.count_nonzero(delivered < lower))
    above = 0 if upper is None else int(np.count_nonzero(delivered > upper))
    failed = len(codes) - len(delivered)
    kinds, counts = np.unique(codes[codes != OK], return_counts=True)
    reasons = {Status(int(kind)).sentence: int(number) for kind, number in zip(kinds, counts, strict=True)}
    out = below + above + failed
    interval = binomtest(out, len(codes)).proportion_ci(confidence)  # by Clopper and Pearson
    numbers, edges = np.histogram(delivered, BARS)
    cp, cpk = _capability(mean, deviation, lower, upper)
    quantiles = np.quantile(delivered, QUANTILES).tolist()
    return Spread(
        parts=len(codes),
        failed=failed,
        reasons=reasons,
        mean=mean,
        deviation=deviation,
        quantiles={f"{share:g}": value for share, value in zip(QUANTILES, quantiles, strict=True)},
        lower=lower,
        upper=upper,
        below=below,
        above=above,
        out=Interval(out / len(codes), float(interval.low), float(interval.high)),
        cp=cp,
        cpk=cpk,
        histogram=Histogram(tuple(edges.tolist()), tuple(numbers.tolist())),
    )


def _capability(
    mean: float, deviation: float, lower: float | None, upper: float | None
) -> tuple[float | None, float | None]:
    """Cp, the width of the limits over 6 standard deviations, and Cpk, the nearer limit's distance over 3."""
    if not deviation > 0.0:
        return None, None
    distances = [] if upper is None else [upper - mean]
    distances += [] if lower is None else [mean - lower]
    cp = (upper - lower) / (6.0 * deviation) if lower is not None and upper is not None else None
    return cp, min(distances) / (3.0 * deviation) if distances else None
