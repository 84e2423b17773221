"""Growth of the noise with the rate: standard deviations of sigma + relative · rate, as shots scatter about their mean.

The logarithms of the magnitudes of innovations are those of their standard deviations, beside noise of one and the same
distribution. The growth is that of the least squares of these logarithms, which outliers hardly move; there is one
where it gains more of 2 ln L than chance does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats

__all__ = ["EVEN", "Growth", "growth_of"]


LEAST = 50  # values of the noise, below which none is looked for
# Of 2 ln L, which chance exceeds in 0.16 % (chi-squared of one degree of freedom; 0.15 and 0.2 % of 20 000 series of
# 400 and 100 values).
GAIN = 10.0
MOST = 100.0  # deviation at the highest rate over that at zero, above which the latter is taken for that of a hundredth
GRID = np.geomspace(0.1, MOST, 61)
# Of the root mean square of a series, below which a value is an exact agreement and no sample: measured noise is more
# than 5 % of it even where shots scatter by 1 % and the sensor by 0.02 mm³/ms.
AGREED = 1e-4


class Growth(NamedTuple):
    """Standard deviations of values relative to each other.

    Attributes
    ----------
    shape : (n,) or (1,)
        Their logarithms add up to zero.
    least : float
        That at a rate of zero.
    slope : float
        Rise over `least` for one unit of the rate.
    """

    shape: Floats
    least: float
    slope: float

    @classmethod
    def of(cls, rate: Floats, slope: float) -> Growth:
        """Growth in proportion to 1 + slope · rate.

        Parameters
        ----------
        rate : (n,)
            Negative ones count as zero.
        slope : float
            Zero for values of one standard deviation.
        """
        if not slope:
            return EVEN
        grown = 1.0 + slope * np.maximum(rate, 0.0)
        least = float(np.exp(-np.mean(np.log(grown))))
        return cls(least * grown, least, slope)

    def at(self, rate: Floats) -> Growth:
        """The same noise of other values (m,): in the same unit, so that a scale stays what it is."""
        return self._replace(shape=self.least * (1.0 + self.slope * np.maximum(rate, 0.0)))


EVEN = Growth(np.ones(1), 1.0, 0.0)
"""Values of one standard deviation."""


def growth_of(innovations: Floats, rate: Floats) -> Growth:
    """Growth that innovations (n,) show with the rates (n,) of their values; `EVEN` where chance would show as much."""
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
