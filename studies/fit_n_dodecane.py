"""Fit Eq. (2) to n-dodecane as CoolProp computes it, and print the catalogue's coefficients.

Run ``python studies/fit_n_dodecane.py``; CoolProp is a development dependency only. The printed
figures are what `commonrail/physics/catalogue/fuels/n-dodecane*.toml` holds, with the largest deviations
from CoolProp that the *printed* (rounded) coefficients leave over the whole grid.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import CoolProp.CoolProp as CoolProp
import numpy as np
from numpy.polynomial.polynomial import polyfit
from scipy.optimize import least_squares

from commonrail.base.arrays import Floats
from commonrail.physics import fuel

TEMPERATURES = np.linspace(293.15, 393.15, 11)
PRESSURES = 125.05 - 124.95 * np.cos(np.pi * np.arange(41) / 40)  # MPa, 0.1 ... 250
VISCOSITY_LIMIT = 200.0  # MPa: above it CoolProp's viscosity of cold n-dodecane runs away
DIGITS = 7

Law = Callable[[list[Floats]], Floats]


def reference() -> dict[str, Floats]:
    """Return CoolProp's properties on the grid (temperatures x pressures): SI, pressures in MPa."""
    state = CoolProp.AbstractState("HEOS", "n-Dodecane")
    names = ("density", "isothermal", "isentropic", "viscosity", "capacity")
    table = {name: np.empty((TEMPERATURES.size, PRESSURES.size)) for name in names}
    for i, temperature in enumerate(TEMPERATURES):
        for j, pressure in enumerate(PRESSURES):
            state.update(CoolProp.PT_INPUTS, pressure * 1e6, temperature)
            rho = state.rhomass()
            slope = state.first_partial_deriv(CoolProp.iDmass, CoolProp.iP, CoolProp.iT)
            table["density"][i, j] = rho
            table["isothermal"][i, j] = rho / slope / 1e6
            table["isentropic"][i, j] = rho * state.speed_sound() ** 2 / 1e6
            table["viscosity"][i, j] = state.viscosity() / rho * 1e6
            table["capacity"][i, j] = state.cpmass()
    return table


def vapour_pressures() -> Floats:
    """Return CoolProp's saturation pressure [Pa] at each temperature."""
    pressures = [CoolProp.PropsSI("P", "T", t, "Q", 0, "n-Dodecane") for t in TEMPERATURES]
    return np.array(pressures)


def split(packed: Floats, degrees: Sequence[int]) -> list[Floats]:
    """Return one ascending polynomial per entry of `degrees`."""
    return np.split(packed, np.cumsum([d + 1 for d in degrees])[:-1])


def at_temperatures(polynomials: Sequence[Floats]) -> list[Floats]:
    """Return each K as a column over the temperatures."""
    return [fuel.coefficient(polynomial, TEMPERATURES)[:, None] for polynomial in polynomials]


def fit(law: Law, target: Floats, degrees: Sequence[int], start: Sequence[float]) -> list[Floats]:
    """Return the polynomials that minimise the relative deviation of `law` from `target`.

    Each temperature is fitted alone first; polynomials through those K start the joint fit.
    """
    rows, guess = [], np.asarray(start, dtype=float)
    for row in target:
        guess = _minimise(lambda k, row=row: law(list(k)) / row - 1.0, guess)
        rows.append(guess)
    tau = fuel.scaled_temperature(TEMPERATURES)
    columns = np.array(rows).T
    packed = np.concatenate([polyfit(tau, k, d) for k, d in zip(columns, degrees, strict=True)])
    packed = _minimise(lambda c: (law(at_temperatures(split(c, degrees))) / target - 1.0).ravel(), packed)
    return [_round(polynomial) for polynomial in split(packed, degrees)]


def _minimise(residual: Callable[[Floats], Floats], start: Floats) -> Floats:
    scale = np.maximum(np.abs(start), 1e-3)
    solution = least_squares(residual, start, x_scale=scale, ftol=1e-14, xtol=1e-14, max_nfev=5000)
    return np.asarray(solution.x)


def _round(polynomial: Floats) -> Floats:
    return np.array([float(f"{value:.{DIGITS}g}") for value in polynomial])


def modulus_law(k: list[Floats]) -> Floats:
    """Eq. (2) for a bulk modulus in the limit K_B2 -> 0.

    A free K_B2 halves the deviation but is degenerate (about 4 GPa, with K_B4 < 0).
    """
    return fuel.saturating_law(PRESSURES, k[0], np.zeros_like(k[0]), k[1], k[2])


def explicit_density(k: list[Floats]) -> Floats:
    """Eq. (2) for density, all four coefficients free."""
    return fuel.saturating_law(PRESSURES, *k)


def viscosity_law(k: list[Floats]) -> Floats:
    """Eq. (2) for kinematic viscosity, up to the limit of the fit."""
    return fuel.power_law(PRESSURES[PRESSURES <= VISCOSITY_LIMIT], *k)


def report(title: str, names: str, polynomials: Sequence[Floats], deviation: Floats) -> None:
    """Print coefficients and the largest relative deviation, over all and per temperature."""
    print(f"\n{title}: largest relative deviation {np.abs(deviation).max():.5f}")
    print("  by temperature", np.abs(deviation).max(axis=1).round(5))
    for name, polynomial in zip(names.split(), polynomials, strict=True):
        print(f"  {name} = [{', '.join(repr(float(c)) for c in polynomial)}]")


def main() -> None:
    """Fit every law and print it."""
    table = reference()
    modulus = {}
    for name, start in (("isothermal", (1000, 15, 0.92)), ("isentropic", (1200, 17, 0.91))):
        modulus[name] = fit(modulus_law, table[name], (3, 2, 1), start)
        deviation = modulus_law(at_temperatures(modulus[name])) / table[name] - 1.0
        report(f"{name} bulk modulus (k2 = [0.0])", "k1 k3 k4", modulus[name], deviation)

    k1, k3, k4 = at_temperatures(modulus["isothermal"])
    growth = np.exp(fuel.log_compression(PRESSURES, k1, np.zeros_like(k1), k3, k4))
    anchor = _round(polyfit(fuel.scaled_temperature(TEMPERATURES), (table["density"] / growth).mean(axis=1), 3))
    integrated = fuel.coefficient(anchor, TEMPERATURES)[:, None] * growth
    report("integrated density", "at_zero_pressure", [anchor], integrated / table["density"] - 1.0)

    explicit = fit(explicit_density, table["density"], (3, 3, 3, 3), (749, 403, 407, -0.12))
    deviation = explicit_density(at_temperatures(explicit)) / table["density"] - 1.0
    report("explicit density", "k1 k2 k3 k4", explicit, deviation)

    target = table["viscosity"][:, PRESSURES <= VISCOSITY_LIMIT]
    viscosity = fit(viscosity_law, target, (4, 3, 2), (1.98, 0.01, 1.3))
    deviation = viscosity_law(at_temperatures(viscosity)) / target - 1.0
    report("kinematic viscosity", "k1 k2 k3", viscosity, deviation)

    logarithm = np.log(vapour_pressures())
    line = _round(polyfit(fuel.scaled_temperature(TEMPERATURES), logarithm, 4))
    deviation = np.exp(fuel.coefficient(line, TEMPERATURES) - logarithm) - 1.0
    report("vapour pressure", "ln_pressure", [line], deviation[:, None])

    capacity = table["capacity"]  # the middle of what pressure makes of it
    middle = 0.5 * (capacity.max(axis=1) + capacity.min(axis=1))
    line = _round(polyfit(fuel.scaled_temperature(TEMPERATURES), middle, 2))
    deviation = fuel.coefficient(line, TEMPERATURES)[:, None] / capacity - 1.0
    report("heat capacity", "isobaric", [line], deviation)


if __name__ == "__main__":
    main()
