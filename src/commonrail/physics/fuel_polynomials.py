"""Polynomials of the hot loop, fitted to a fuel at one temperature.

Least squares over Chebyshev-distributed pressures from zero to 1.4 times the fuel's range. Every
engine uses these polynomials, so their distance from the laws is a modelling error, not a
difference between engines. Over the catalogue and its ranges it is at most 1e-5 in density, 0.2 %
in bulk modulus, 0.6 % in the ratio of the moduli and 1.7 % in viscosity; `_errors` measures
it, docs/theory/fuel.md lists it.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyval

from commonrail.base.arrays import Bools, Floats
from commonrail.base.errors import ConfigurationError
from commonrail.physics.elementary import cosine, least_squares
from commonrail.physics.fuel import Fuel
from commonrail.physics.fuel_kernel import FuelCoefficients

_POINTS = 64
_BEYOND = 1.4  # fitted this far beyond the range, so an overshoot stays defined
_OUTSIDE_WEIGHT = 0.3  # and with this weight there
_DEGREE_PRESSURE, _DEGREE_START, _DEGREE_FLUIDITY, _DEGREE_RATIO = 7, 4, 5, 2
_TOGETHER = 32  # temperatures whose laws are evaluated at once: some megabytes
_LARGEST_ERROR = 0.01  # of the bulk modulus; the catalogue stays below 0.002


class PolynomialErrors(NamedTuple):
    """Largest relative deviation of polynomials from a fuel's laws, over its pressure range."""

    density: float
    bulk_modulus: float
    modulus_ratio: float
    kinematic_viscosity: float


@functools.lru_cache(maxsize=256)
def fuel_coefficients(fuel: Fuel, temperature: float) -> FuelCoefficients:
    """Return the polynomials of a fuel at one temperature.

    `fuel`: the laws; equal fuels share one result (it is cached); `temperature`: temperature [K].

    Raises InputError if the temperature lies outside the fuel's range. Raises ConfigurationError if the fuel's laws
    bend too sharply for a polynomial (an explicit density law does).
    """
    return FuelCoefficients._make(coefficient_rows(fuel, (temperature,))[0].tolist())


@functools.lru_cache(maxsize=64)
def coefficient_rows(fuel: Fuel, temperatures: tuple[float, ...]) -> Floats:
    """Polynomials at several temperatures, as rows (temperatures, coefficients) in the order of `FuelCoefficients`.

    A row has the bits that its temperature has alone.

    `temperatures`: [K]. Raises InputError, ConfigurationError: as `fuel_coefficients`, for the first temperature that
    is refused.
    """
    with np.errstate(all="ignore"):  # what no polynomial fits is refused in a sentence
        parts = [temperatures[i : i + _TOGETHER] for i in range(0, len(temperatures), _TOGETHER)]
        rows = np.concatenate([_fit_coefficients(fuel, np.array(group)) for group in parts])
    rows.flags.writeable = False  # it is cached
    return rows


class _Values(NamedTuple):
    """Values of a fuel's laws (temperatures, pressures) [SI]."""

    density: Floats
    modulus: Floats
    viscosity: Floats
    ratio: Floats

    @classmethod
    def of(cls, fuel: Fuel, p: Floats, temperatures: Floats) -> _Values:
        """Values at pressures (n,) and temperatures (k,)."""
        at = temperatures[:, None]
        modulus = fuel.bulk_modulus(p, at)
        ratio = fuel.isentropic_bulk_modulus(p, at) / modulus
        return cls(fuel.density(p, at), modulus, fuel.kinematic_viscosity(p, at), ratio)

    def at_pressures(self, pressures: slice) -> _Values:
        """Values at some of the pressures."""
        return _Values._make(law[:, pressures] for law in self)


def _fit_coefficients(fuel: Fuel, temperatures: Floats) -> Floats:
    """Coefficients (k, c) at temperatures (k,), all laws evaluated together: fitted here, checked there."""
    p, inside = _grid(fuel)
    check = np.linspace(*fuel.pressure_range, 101)  # pressures [Pa] that the polynomials are measured at
    every = _Values.of(fuel, np.concatenate(([0.0], p, check)), temperatures)
    weight = np.where(inside, 1.0, _OUTSIDE_WEIGHT)
    reference = every.density[:, :1]
    values, tested = every.at_pressures(slice(1, 1 + len(p))), every.at_pressures(slice(1 + len(p), None))
    x = values.density / reference - 1.0
    s = np.broadcast_to(p * 1e-8, x.shape)
    fluidity = 1.0 / values.viscosity
    sound = np.isfinite(np.stack((x, values.modulus, fluidity, values.ratio))).all(axis=(0, 2))
    for temperature in temperatures[~sound].tolist():
        raise ConfigurationError(
            f"Fuel {fuel.name} at {temperature:g} K cannot be simulated: within its range of pressure its laws give "
            "values that are no numbers; check their coefficients."
        )
    vapour = fuel.vapour_pressure(temperatures)[:, None]
    fitted = (
        _pressure_polynomial(x, p, values.modulus, weight),
        _polynomial(s, x, _DEGREE_START, 1, weight / (1.0 + x)),
        _polynomial(s, fluidity, _DEGREE_FLUIDITY, 0, weight / fluidity),
        _polynomial(s, values.ratio, _DEGREE_RATIO, 0, weight / values.ratio),
    )
    rows = np.concatenate((reference, 1.0 / reference, *fitted, vapour), axis=1)
    for i, temperature in enumerate(temperatures.tolist()):
        law_values = _Values._make(law[i : i + 1] for law in tested)
        _refuse_if_poor(fuel, temperature, _errors(law_values, check, FuelCoefficients._make(rows[i].tolist())))
    return rows


def _errors(values: _Values, p: Floats, f: FuelCoefficients) -> PolynomialErrors:
    """Measure polynomials against values (1, n) of the laws at pressures (n,)."""
    rho, modulus, viscosity, ratio = (law[0] for law in values)
    s = p * 1e-8
    x = rho / f.reference_density - 1.0
    pressure = np.array((0.0, f.p1, f.p2, f.p3, f.p4, f.p5, f.p6, f.p7))
    slope = pressure[1:] * np.arange(1, pressure.size)
    return PolynomialErrors(
        # a pressure error dp is a density error dp/K at given pressure
        density=_largest((polyval(x, pressure) - p) / modulus),
        bulk_modulus=_largest(polyval(x, slope) * (1.0 + x) / modulus - 1.0),
        modulus_ratio=_largest(polyval(s, np.array((f.r0, f.r1, f.r2))) / ratio - 1.0),
        kinematic_viscosity=_largest(
            1.0 / polyval(s, np.array((f.u0, f.u1, f.u2, f.u3, f.u4, f.u5))) / viscosity - 1.0
        ),
    )


def _grid(fuel: Fuel) -> tuple[Floats, Bools]:
    """Return Chebyshev-distributed pressures [Pa] from zero, and which lie inside the range."""
    top = fuel.pressure_range[1]
    p = 0.5 * _BEYOND * top * (1.0 - cosine(np.pi * np.arange(_POINTS) / (_POINTS - 1)))
    return p, p <= top


def _pressure_polynomial(x: Floats, p: Floats, modulus: Floats, weight: Floats) -> Floats:
    """Fit p(x) (k, degree), zero at zero, to the pressures (n,) and, with equal weight, to the moduli (k, n)."""
    scale = x[:, -1:]
    power = np.arange(1, _DEGREE_PRESSURE + 1)
    powers = _powers(x / scale, _DEGREE_PRESSURE)
    values = powers[..., 1:] / modulus[..., None]
    slopes = power * powers[..., :-1] / scale[..., None] * ((1.0 + x) / modulus)[..., None]
    rows = np.concatenate((values, slopes), axis=1) * np.tile(weight, 2)[:, None]
    target = np.concatenate((p / modulus, np.ones_like(x)), axis=1) * np.tile(weight, 2)
    return least_squares(rows, target) / _powers(scale, _DEGREE_PRESSURE)[:, 0, 1:]


def _polynomial(s: Floats, y: Floats, degree: int, lowest: int, weight: Floats) -> Floats:
    """Fit y(s) (k, n) by the powers `lowest` to `degree`, ascending."""
    return least_squares(_powers(s, degree)[..., lowest:] * weight[..., None], y * weight)


def _powers(x: Floats, degree: int) -> Floats:
    """Powers (…, degree + 1) of numbers (…), by multiplication."""
    columns = [np.ones_like(x)]
    for _ in range(degree):
        columns.append(columns[-1] * x)
    return np.stack(columns, axis=-1)


def _refuse_if_poor(fuel: Fuel, temperature: float, errors: PolynomialErrors) -> None:
    error = errors.bulk_modulus
    if not error <= _LARGEST_ERROR:
        raise ConfigurationError(
            f"Fuel {fuel.name} at {temperature:g} K cannot be simulated: its bulk modulus "
            f"rho dp/d(rho) bends too sharply with pressure (a polynomial misses it by "
            f"{100.0 * error:.2g} %, at most {100.0 * _LARGEST_ERROR:g} % is accepted); use a fuel "
            f'whose density is of kind "integrated" and whose modulus law is smooth.'
        )


def _largest(deviation: Floats) -> float:
    return float(np.max(np.abs(deviation)))
