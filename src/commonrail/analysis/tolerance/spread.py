"""Figures of the spread of a quantity over parts, and of the capability within limits."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.arrays import Floats
from commonrail.engine.status import OK, Status

__all__ = ["QUANTILES", "Spread", "binomial_interval", "spread_of"]


# Shares of the parts below the quantiles that are given; the outer two enclose 6 sigma of a normal distribution.
QUANTILES = (0.00135, 0.025, 0.5, 0.975, 0.99865)
BARS = 60  # of the histogram


class Spread(NamedTuple):
    """Spread of a quantity over parts at one operating point, SI.

    Attributes
    ----------
    parts, failed : int
        Number of parts, and of those whose simulation failed.
    reasons : dict of str to int
        Failed parts by reason.
    mean, deviation : float
        Of the parts that did not fail.
    quantiles : tuple of float
        At `QUANTILES`.
    lower, upper : float or None
        Limits.
    below, above : int
        Parts beyond the limits.
    out : tuple of float
        Share of the parts beyond the limits or failed, and its interval.
    cp, cpk : float or None
        Capability indices; None where limits are missing.
    histogram : tuple of (edges, counts)
    """

    parts: int
    failed: int
    reasons: dict[str, int]
    mean: float
    deviation: float
    quantiles: tuple[float, ...]
    lower: float | None
    upper: float | None
    below: int
    above: int
    out: tuple[float, float, float]
    cp: float | None
    cpk: float | None
    histogram: tuple[tuple[float, ...], tuple[int, ...]]

    def record(self) -> dict[str, Any]:
        """JSON-able form."""
        edges, counts = self.histogram
        found = self._asdict()
        found["quantiles"] = {f"{share:g}": value for share, value in zip(QUANTILES, self.quantiles, strict=True)}
        found["out"] = dict(zip(("value", "low", "high"), self.out, strict=True))
        found["histogram"] = {"edges": list(edges), "counts": list(counts)}
        return found


def spread_of(
    quantities: Floats,
    codes: NDArray[np.int8],
    limits: tuple[float | None, float | None],
    confidence: float,
) -> Spread | None:
    """Spread of the quantities of parts.

    A part whose simulation failed counts as out of limits: it would be rejected.

    Parameters
    ----------
    quantities : (n,)
        [m³]; NaN where the simulation failed.
    codes : (n,)
        Values of `Status`.
    limits : (lower, upper)
        [m³], None where there is none.
    confidence : float
        Probability of the interval.

    Returns
    -------
    Spread or None
        None if fewer than two parts could be simulated.
    """
    known = quantities[codes == OK]
    if len(known) < 2:
        return None
    lower, upper = limits
    mean, deviation = float(known.mean()), float(known.std(ddof=1))
    below = 0 if lower is None else int(np.count_nonzero(known < lower))
    above = 0 if upper is None else int(np.count_nonzero(known > upper))
    failed = len(codes) - len(known)
    kinds, counts = np.unique(codes[codes != OK], return_counts=True)
    reasons = {Status(int(kind)).sentence: int(number) for kind, number in zip(kinds, counts, strict=True)}
    out = below + above + failed
    numbers, edges = np.histogram(known, BARS)
    return Spread(
        len(codes),
        failed,
        reasons,
        mean,
        deviation,
        tuple(float(q) for q in np.quantile(known, QUANTILES)),
        lower,
        upper,
        below,
        above,
        (out / len(codes), *binomial_interval(out, len(codes), confidence)),
        *_capability(mean, deviation, lower, upper),
        (tuple(edges.tolist()), tuple(numbers.tolist())),
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


def binomial_interval(hits: int, tries: int, confidence: float) -> tuple[float, float]:
    """Interval of a share by Clopper and Pearson, which covers at least with the stated probability.

    Parameters
    ----------
    hits, tries : int
    confidence : float
    """
    from scipy.special import betaincinv  # slow to import

    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if hits == 0 else float(betaincinv(hits, tries - hits + 1, tail))
    high = 1.0 if hits == tries else float(betaincinv(hits + 1, tries - hits, 1.0 - tail))
    return low, high
