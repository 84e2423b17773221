"""Coefficients of a fuel as Chebyshev series over its range of temperature, for callers without Python."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from commonrail.arrays import Floats
from commonrail.fuel.coefficients import fuel_coefficients
from commonrail.fuel.fuel import Fuel

__all__ = ["FuelTable", "fuel_table"]

# The laws are polynomials and exponentials in temperature: at 24 the series have ended in rounding for the catalogue
# (tests/export/test_fuel_table.py measures the error).
DEGREE = 24


class FuelTable(NamedTuple):
    """Series of `FuelCoefficients` over a range of temperature.

    Attributes
    ----------
    coldest, hottest : float
        [K].
    series : (coefficients, degree + 1)
        In T_k((2 T − coldest − hottest)/(hottest − coldest)).
    own : (coefficients,)
        Those of the model's own temperature, to the last bit.
    """

    coldest: float
    hottest: float
    series: Floats
    own: Floats

    def at(self, temperature: float) -> Floats:
        """Coefficients at a temperature [K]."""
        x = (2.0 * temperature - self.coldest - self.hottest) / (self.hottest - self.coldest)
        return np.asarray(chebyshev.chebval(x, self.series.T))


def fuel_table(fuel: Fuel, exact_at: float) -> FuelTable:
    """Table of a fuel.

    Single coefficients carry rounding of the fit of some 1e-11, which cancels in the polynomials; a shift makes them
    those of `fuel_coefficients` at one temperature.

    Parameters
    ----------
    fuel : Fuel
    exact_at : float
        That temperature [K].

    Raises
    ------
    ConfigurationError
        If the fuel's laws bend too sharply for the polynomials of the hot loop anywhere in its range.
    """
    low, high = fuel.temperature_range
    nodes = chebyshev.chebpts1(DEGREE + 1)
    temperatures = low + 0.5 * (nodes + 1.0) * (high - low)
    values = np.array([fuel_coefficients(fuel, float(t)) for t in temperatures])
    # exact for the polynomial through the nodes: its coefficients are cosine sums
    basis = chebyshev.chebvander(nodes, DEGREE)
    weights = np.full(DEGREE + 1, 2.0 / (DEGREE + 1))
    weights[0] *= 0.5
    own = np.array(fuel_coefficients(fuel, exact_at))
    table = FuelTable(low, max(high, float(np.nextafter(low, np.inf))), (values.T @ basis) * weights, own)
    table.series[:, 0] += own - table.at(exact_at)
    return table
