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
from commonrail.readers.tables import open_sheet, take_columns

FEWEST = 3  # pressures at each temperature: a modulus that grows with pressure needs as many densities
_WEIGHTS = (2e-4, 5e-3)  # deviations of density and modulus that count alike, as good measurements have them
_OPTIONAL = {"bulk_modulus": "Pa", "sound_speed": "m/s"}
_MODULUS, _SOUND = (1000.0, 15.0, 0.92), (1200.0, 17.0, 0.91)  # start values K1 [MPa], K3, K4: those of n-dodecane


class FittedLaw(NamedTuple):
    """Law of a fuel file: its table, unit, polynomials by name, and largest relative deviation from the data."""

    table: str
    unit: str
    polynomials: dict[str, list[float]]
    error: float


class FittedFuel(NamedTuple):
    """Laws fitted to a table, its ranges of pressure [Pa] and temperature [K], and its number of rows."""

    laws: tuple[FittedLaw, ...]
    pressure: tuple[float, float]
    temperature: tuple[float, float]
    rows: int


def fit_fuel(path: Path) -> FittedFuel:
    """Fit the laws of Eq. (2) to the columns of a table.

    `path` has columns pressure, temperature, density and viscosity (kinematic or dynamic), and perhaps bulk_modulus
    (isothermal) and sound_speed. Without bulk_modulus the modulus is that with which density grows with pressure.
    InputError if a column is missing, temperatures or pressures are too few, or no positive modulus fits.
    """
    sheet = open_sheet(path)
    wanted = [
        Column("pressure", "Pa", domain=Domain.NON_NEGATIVE),
        Column("temperature", "K", domain=Domain.POSITIVE),
        Column("density", "kg/m3", domain=Domain.POSITIVE),
        Column("viscosity", ("m2/s", "Pa s"), domain=Domain.POSITIVE),
    ]
    wanted += [Column(name, unit, domain=Domain.POSITIVE) for name, unit in _OPTIONAL.items() if name in sheet.names]
    table = take_columns(sheet, wanted, least=2 * FEWEST)
    known = [column.name for column in wanted]
    if unused := [name for name in sheet.names if name not in known]:
        meant = nearest(unused[0], [*known, *_OPTIONAL])
        note(f"{path}: not used: {', '.join(unused)}{meant}")
    _check_repeated(table, known)
    c = table.columns
    p, temperature, density = c["pressure"] * 1e-6, c["temperature"], c["density"]
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
    line = np.polynomial.polynomial.Polynomial.fit
    if "sound_speed" in c:
        modulus = density * c["sound_speed"] ** 2 * 1e-6
        degrees = (min(3, most), min(2, most), 0)
        found = _least_squares(
            lambda a, *k: saturating_law(p, a, 0.0 * a, *k) / modulus - 1.0,
            temperature,
            degrees,
            _starts(_SOUND),
        )
        laws.append(_law("isentropic_bulk_modulus", "MPa", found, k2=True))
    viscosity = 1e6 * (c["viscosity"] / density if table.units["viscosity"] == "Pa s" else c["viscosity"])
    degrees = (min(4, most), min(3, most), min(1, most))
    lowest = np.concatenate([rows[p[rows] == p[rows].min()] for rows in levels])
    start = line(scaled_temperature(temperature[lowest]), viscosity[lowest], degrees[0]).convert().coef.tolist()
    found = _least_squares(
        lambda *k: power_law(p, *k) / viscosity - 1.0, temperature, degrees, [start, *_starts((0.01, 1.1))]
    )
    laws.append(_law("kinematic_viscosity", "mm2/s", found))
    low, high = ((float(end(c["pressure"])), float(end(temperature))) for end in (np.min, np.max))
    return FittedFuel(tuple(laws), (low[0], high[0]), (low[1], high[1]), len(p))


def _check_repeated(table: Table, names: Sequence[str]) -> None:
    """Refuse rows of one pressure and temperature that state two values."""
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
    """Density at zero pressure and isothermal modulus, from which density over pressure follows."""
    p, temperature, density, modulus = c["pressure"] * 1e-6, c["temperature"], c["density"], c.get("bulk_modulus")

    def both(rho: Floats, *k: Floats) -> tuple[Floats, Floats]:
        laws = k[0], 0.0 * k[0], *k[1:]
        return rho * np.exp(log_compression(p, *laws)) / density - 1.0, saturating_law(p, *laws)

    def deviation(*k: Floats) -> Floats:
        of_density, found = both(*k)
        of_modulus = [] if modulus is None else [(found * 1e6 / modulus - 1.0) / _WEIGHTS[1]]
        return np.concatenate([of_density / _WEIGHTS[0], *of_modulus])

    degrees = (min(3, most), min(3, most), min(2, most), 0)
    parts, _ = _least_squares(deviation, temperature, degrees, _starts((float(density.mean()), *_MODULUS)))
    of_density, found = both(*(coefficient(part, temperature) for part in parts))
    if not (np.all(np.isfinite(of_density)) and np.all(found > 0.0)):
        raise InputError(f"{path}: no positive bulk modulus fits the densities; they must grow with pressure.")
    if modulus is not None:
        error = np.abs(found * 1e6 / modulus - 1.0)
    else:  # that of the compression from the lowest to the highest pressure
        ends = [(rows[np.argmin(p[rows])], rows[np.argmax(p[rows])]) for rows in levels]
        law = density * (1.0 + of_density)
        error = np.abs([(law[b] - law[a]) / (density[b] - density[a]) - 1.0 for a, b in ends])
    density_law = FittedLaw("density", "kg/m3", {"at_zero_pressure": parts[0]}, _rounded_up(np.abs(of_density)))
    return [density_law, _law("bulk_modulus", "MPa", (parts[1:], _rounded_up(error)), k2=True)]


def _law(table: str, unit: str, found: tuple[list[list[float]], float], k2: bool = False) -> FittedLaw:
    parts, error = found
    every = [parts[0], [0.0], *parts[1:]] if k2 else parts  # K2 = 0: a free one is degenerate, see the theory
    return FittedLaw(table, unit, {f"k{i}": part for i, part in enumerate(every, start=1)}, error)


def _starts(values: Sequence[float]) -> list[list[float]]:
    return [[value] for value in values]


def _least_squares(
    deviation: Callable[..., Floats], temperature: Floats, degrees: Sequence[int], starts: Sequence[list[float]]
) -> tuple[list[list[float]], float]:
    """Polynomials that minimise deviations of laws from data, with nine digits, and the largest deviation left."""
    from scipy.optimize import least_squares  # slow to import

    sizes = np.cumsum([d + 1 for d in degrees])

    def polynomials(x: Floats) -> list[list[float]]:
        return [part.tolist() for part in np.split(x, sizes[:-1])]

    def residual(x: Floats) -> Floats:
        with np.errstate(all="ignore"):
            found = deviation(*(coefficient(part, temperature) for part in polynomials(x)))
        return np.nan_to_num(found, nan=1e6, posinf=1e6, neginf=-1e6)

    start = np.concatenate([[*part, *[0.0] * (d + 1 - len(part))] for part, d in zip(starts, degrees, strict=True)])
    scale = np.maximum(np.abs(start), 1e-2)
    try:
        found = least_squares(residual, start, x_scale=scale, ftol=1e-13, xtol=1e-13, max_nfev=4000)
    except ValueError as error:  # values of other orders of magnitude: the slopes overflow
        raise InputError("No law of a fuel comes near these values; check the units of the columns.") from error
    x = np.array([float(f"{value:.9g}") for value in found.x.tolist()])
    return polynomials(x), _rounded_up(np.abs(residual(x)))


def _rounded_up(deviations: Floats) -> float:
    """Largest of deviations, with two digits."""
    worst = float(np.max(deviations))
    unit = 10.0 ** (np.floor(np.log10(worst)) - 1.0) if worst > 0.0 else 1.0
    return float(f"{np.ceil(worst / unit) * unit:.2g}")
