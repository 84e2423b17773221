"""Laws of a fuel, Eq. (2), fitted to a table of its properties over pressure and temperature."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.errors import InputError, nearest
from commonrail.base.hooks import note
from commonrail.physics.fuel import coefficient, log_compression, power_law, saturating_law, scaled_temperature
from commonrail.physics.law import Domain
from commonrail.readers.columns import Column, Table
from commonrail.readers.tables import has_columns, open_sheet, take_columns

FEWEST = 3  # pressures per temperature, for a modulus that grows with pressure
_WEIGHTS = (2e-4, 5e-3)  # relative errors of good measurements of density and modulus
_OPTIONAL = {"bulk_modulus": "Pa", "sound_speed": "m/s", "heat_capacity": "J/(kg K)"}
_MODULUS, _SOUND = (1000.0, 15.0, 0.92), (1200.0, 17.0, 0.91)  # start values K1 [MPa], K3, K4, of n-dodecane


class FittedLaw(NamedTuple):
    """Law of a fuel file: table, unit, polynomials by name, and largest relative deviation from the data."""

    table: str
    unit: str
    polynomials: dict[str, list[float]]
    error: float


class FittedFuel(NamedTuple):
    """Fitted laws, ranges of pressure [Pa] and temperature [K], and number of rows of the data."""

    laws: tuple[FittedLaw, ...]
    pressure: tuple[float, float]
    temperature: tuple[float, float]
    rows: int


def fit_fuel(path: Path) -> FittedFuel:
    """Fit the laws of Eq. (2) to the columns of a table.

    Columns: pressure, temperature, density, viscosity (kinematic or dynamic); optional bulk_modulus (isothermal),
    sound_speed and heat_capacity (isobaric). Without bulk_modulus the modulus follows from the densities. InputError if
    a column is missing, temperatures or pressures are too few, or no positive modulus fits.
    """
    sheet = open_sheet(path)
    columns = [
        Column("pressure", "Pa", domain=Domain.NON_NEGATIVE),
        Column("temperature", "K", domain=Domain.POSITIVE),
        Column("density", "kg/m3", domain=Domain.POSITIVE),
        Column("viscosity", ("m2/s", "Pa s"), domain=Domain.POSITIVE),
    ]
    columns += has_columns(sheet, [Column(name, unit, domain=Domain.POSITIVE) for name, unit in _OPTIONAL.items()])
    table = take_columns(sheet, columns, least=2 * FEWEST)
    names = [column.name for column in columns]
    if unused := [name for name in sheet.names if name not in (*names, *table.headings.values())]:
        meant = nearest(unused[0], [*names, *_OPTIONAL])
        note(f"{path}: not used: {', '.join(unused)}{meant}")
    _check_repeated(table, names)
    c = table.columns
    p, temperature = c["pressure"] * 1e-6, c["temperature"]
    density = c["density"]
    levels = [np.flatnonzero(temperature == level) for level in np.unique(temperature)]
    if len(levels) < 2 or min(len(np.unique(p[rows])) for rows in levels) < FEWEST:
        raise InputError(f"{path}: at least two temperatures and at each {FEWEST} pressures are needed.")
    for rows in levels:
        low, high = rows[np.argmin(p[rows])], rows[np.argmax(p[rows])]
        if density[high] <= density[low]:
            raise InputError(
                f"{path}: at {temperature[low]:g} K density does not grow from {p[low]:g} to {p[high]:g} MPa; "
                "check both columns."
            )
    most = len(levels) - 1  # degree of a polynomial in temperature
    laws = _density_and_modulus(path, c, levels, most)
    if "sound_speed" in c:
        modulus = density * c["sound_speed"] ** 2 * 1e-6
        laws.append(modulus_law("isentropic_bulk_modulus", p, temperature, modulus, (min(3, most), min(2, most), 0)))
    viscosity = 1e6 * (c["viscosity"] / density if table.units["viscosity"] == "Pa s" else c["viscosity"])
    laws.append(viscosity_law(p, temperature, viscosity, (min(4, most), min(3, most), min(1, most))))
    if "heat_capacity" in c:
        laws.append(heat_capacity_law(temperature, c["heat_capacity"], min(2, most)))
    low, high = ((float(end(c["pressure"])), float(end(temperature))) for end in (np.min, np.max))
    return FittedFuel(tuple(laws), (low[0], high[0]), (low[1], high[1]), len(p))


def modulus_law(table: str, p: Floats, temperature: Floats, modulus: Floats, degrees: Sequence[int]) -> FittedLaw:
    """Fit Eq. (2) with K2 = 0 to moduli (n,) [MPa] at pressures [MPa] and temperatures [K]; `degrees`: K1, K3, K4."""

    def deviation(*k: Floats) -> Floats:
        return saturating_law(p, k[0], 0.0 * k[0], *k[1:]) / modulus - 1.0

    return _law(table, "MPa", _least_squares(deviation, temperature, degrees, _starts(_SOUND)), k2=True)


def viscosity_law(p: Floats, temperature: Floats, viscosity: Floats, degrees: Sequence[int]) -> FittedLaw:
    """Fit Eq. (2) to viscosities (n,) [mm2/s] or to their logarithm, whichever has the smaller largest deviation."""
    levels = [np.flatnonzero(temperature == level) for level in np.unique(temperature)]
    lowest = np.concatenate([rows[p[rows] == p[rows].min()] for rows in levels])
    line = np.polynomial.polynomial.Polynomial.fit

    def fit_law(unit: str, values: Floats, deviation: Callable[[Floats], Floats], start: Sequence[float]) -> FittedLaw:
        first = line(scaled_temperature(temperature[lowest]), values[lowest], degrees[0]).convert().coef.tolist()
        starts = [first, *_starts(start)]
        solution = _least_squares(lambda *k: deviation(power_law(p, *k)), temperature, degrees, starts)
        return _law("kinematic_viscosity", unit, solution)

    logarithm = np.log(viscosity)
    plain = fit_law("mm2/s", viscosity, lambda law: law / viscosity - 1.0, (0.01, 1.1))
    other = fit_law("ln(mm2/s)", logarithm, lambda law: np.expm1(law - logarithm), (0.02, 0.8))
    return min(plain, other, key=lambda law: law.error)


def heat_capacity_law(temperature: Floats, heat_capacity: Floats, degree: int) -> FittedLaw:
    """Fit a polynomial in temperature to isobaric heat capacities (n,) [J/(kg K)]."""
    line = np.polynomial.polynomial.Polynomial.fit(scaled_temperature(temperature), heat_capacity, degree).convert()
    coefficients = [float(f"{value:.9g}") for value in line.coef]
    error = round_up(np.abs(coefficient(coefficients, temperature) / heat_capacity - 1.0))
    return FittedLaw("heat_capacity", "J/(kg K)", {"isobaric": coefficients}, error)


def _check_repeated(table: Table, names: Sequence[str]) -> None:
    """Refuse rows that state two values at one pressure and temperature."""
    rows: dict[tuple[float, ...], int] = {}
    values = [table.columns[name].tolist() for name in names]
    for i, (pressure, temperature, *properties) in enumerate(zip(*values, strict=True)):
        first = rows.setdefault((pressure, temperature), i)
        for name, value, column in zip(names[2:], properties, values[2:], strict=True):
            if value != column[first]:
                raise InputError(
                    f"{table.path}, {table.row}s {table.rows[first]} and {table.rows[i]}: both are at "
                    f"{1e-6 * pressure:.6g} MPa and {temperature:g} K, and their {name} differs; keep one, or the mean."
                )


def _density_and_modulus(path: Path, c: dict[str, Floats], levels: Sequence[IndexArray], most: int) -> list[FittedLaw]:
    """Fit density at zero pressure and isothermal modulus, which give the density over pressure."""
    p, temperature = c["pressure"] * 1e-6, c["temperature"]
    density, modulus = c["density"], c.get("bulk_modulus")

    def both(rho: Floats, *k: Floats) -> tuple[Floats, Floats]:
        laws = k[0], 0.0 * k[0], *k[1:]
        return rho * np.exp(log_compression(p, *laws)) / density - 1.0, saturating_law(p, *laws)

    def deviation(*k: Floats) -> Floats:
        of_density, modulus_of_law = both(*k)
        of_modulus = [] if modulus is None else [(modulus_of_law * 1e6 / modulus - 1.0) / _WEIGHTS[1]]
        return np.concatenate([of_density / _WEIGHTS[0], *of_modulus])

    degrees = (min(3, most), min(3, most), min(2, most), 0)
    parts, _ = _least_squares(deviation, temperature, degrees, _starts((float(density.mean()), *_MODULUS)))
    of_density, modulus_of_law = both(*(coefficient(polynomial, temperature) for polynomial in parts))
    if not (np.all(np.isfinite(of_density)) and np.all(modulus_of_law > 0.0)):
        raise InputError(f"{path}: no positive bulk modulus fits the densities; they must grow with pressure.")
    if modulus is not None:
        error = np.abs(modulus_of_law * 1e6 / modulus - 1.0)
    else:  # error of the compression from the lowest to the highest pressure
        ends = [(rows[np.argmin(p[rows])], rows[np.argmax(p[rows])]) for rows in levels]
        law = density * (1.0 + of_density)
        error = np.abs([(law[b] - law[a]) / (density[b] - density[a]) - 1.0 for a, b in ends])
    density_law = FittedLaw("density", "kg/m3", {"at_zero_pressure": parts[0]}, round_up(np.abs(of_density)))
    return [density_law, _law("bulk_modulus", "MPa", (parts[1:], round_up(error)), k2=True)]


def _law(table: str, unit: str, solution: tuple[list[list[float]], float], k2: bool = False) -> FittedLaw:
    parts, error = solution
    every = [parts[0], [0.0], *parts[1:]] if k2 else parts  # K2 = 0: a free K2 is degenerate, see the theory
    return FittedLaw(table, unit, {f"k{i}": polynomial for i, polynomial in enumerate(every, start=1)}, error)


def _starts(values: Sequence[float]) -> list[list[float]]:
    return [[value] for value in values]


def _least_squares(
    deviation: Callable[..., Floats], temperature: Floats, degrees: Sequence[int], starts: Sequence[list[float]]
) -> tuple[list[list[float]], float]:
    """Fit polynomials (nine digits) that minimise the deviations, and return the largest remaining deviation."""
    from scipy.optimize import least_squares  # slow to import

    sizes = np.cumsum([d + 1 for d in degrees])

    def polynomials(x: Floats) -> list[list[float]]:
        return [coefficients.tolist() for coefficients in np.split(x, sizes[:-1])]

    def residual(x: Floats) -> Floats:
        with np.errstate(all="ignore"):
            error = deviation(*(coefficient(coefficients, temperature) for coefficients in polynomials(x)))
        return np.nan_to_num(error, nan=1e6, posinf=1e6, neginf=-1e6)

    start = np.concatenate(
        [
            [*start_coefficients, *[0.0] * (d + 1 - len(start_coefficients))]
            for start_coefficients, d in zip(starts, degrees, strict=True)
        ]
    )
    scale = np.maximum(np.abs(start), 1e-2)
    try:
        with np.errstate(all="ignore"):
            solution = least_squares(residual, start, x_scale=scale, ftol=1e-13, xtol=1e-13, max_nfev=4000)
    except ValueError as error:  # slopes overflow for values of other orders of magnitude
        raise InputError("No fuel law fits these values; check the units of the columns.") from error
    x = np.array([float(f"{value:.9g}") for value in solution.x.tolist()])
    return polynomials(x), round_up(np.abs(residual(x)))


def round_up(deviations: Floats) -> float:
    """Largest deviation, rounded up to two digits."""
    worst = float(np.max(deviations))
    unit = 10.0 ** (np.floor(np.log10(worst)) - 1.0) if worst > 0.0 else 1.0
    return float(f"{np.ceil(worst / unit) * unit:.2g}")
