"""Derive the temperature dependence of the ISO 4113-like oil, and print the catalogue's numbers.

At 80 °C the laws are given (an engineering estimate); this script only carries them to 20...120 °C:
density on a straight line through the specification's 825 kg/m3 at 15 °C, viscosity on the Walther
line through the specification's 2.6 mm2/s at 40 °C, and the trends that no specification gives
(modulus, pressure coefficient of viscosity) relative to 80 °C as in n-dodecane.
"""

from __future__ import annotations

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.physics import fuel
from commonrail.readers.fuel import load_fuel

TEMPERATURES = np.linspace(293.15, 393.15, 41)
MODULUS = (1050.0, 12.5)  # K_B1 [MPa] and K_B3 at 80 °C
VISCOSITY = (1.30, 0.0105)  # K_nu1 [mm2/s] and K_nu2 at 80 °C
DENSITY_80, DENSITY_15 = 783.0, 825.0  # kg/m3
VISCOSITY_40 = 2.6  # mm2/s
TREND_PRESSURE = 160e6  # Pa, where the trends with pressure are compared: the usual rail pressure


def fit_anchored(values: Floats, degree: int, first: float, also: tuple[float, float] | None) -> Floats:
    """Fit a polynomial that equals `first` at 80 °C and, if given, also (temperature, value)."""
    tau = fuel.scaled_temperature(TEMPERATURES)
    powers = tau[:, None] ** np.arange(1, degree + 1)
    if also is None:
        rest = np.linalg.lstsq(powers / values[:, None], 1.0 - first / values, rcond=None)[0]
        return np.concatenate(([first], rest))
    at = fuel.scaled_temperature(also[0])
    # eliminate the linear coefficient by the second condition
    slope = (also[1] - first) / at
    higher = powers[:, 1:] - tau[:, None] * at ** np.arange(1, degree)
    target = 1.0 - (first + slope * tau) / values
    rest = np.linalg.lstsq(higher / values[:, None], target, rcond=None)[0]
    return np.concatenate(([first, slope - rest @ at ** np.arange(1, degree)], rest))


def walther() -> Floats:
    """Return the viscosity [mm2/s] on lg lg(nu + 0.7) = A - B lg T through 40 and 80 °C."""
    ordinates = np.log10(np.log10(np.array([VISCOSITY_40, VISCOSITY[0]]) + 0.7))
    ends = np.log10([313.15, 353.15])
    steepness = (ordinates[1] - ordinates[0]) / (ends[1] - ends[0])
    line = ordinates[0] + steepness * (np.log10(TEMPERATURES) - ends[0])
    return np.asarray(10.0 ** (10.0**line) - 0.7)


def show(name: str, polynomial: Floats, target: Floats) -> None:
    """Print a polynomial and its largest relative deviation."""
    rounded = np.array([float(f"{value:.7g}") for value in polynomial])
    deviation = np.abs(fuel.coefficient(rounded, TEMPERATURES) / target - 1.0).max()
    print(f"{name} = [{', '.join(repr(float(c)) for c in rounded)}]  # within {deviation:.1e}")


def main() -> None:
    """Print the coefficient polynomials of the oil."""
    slope = (DENSITY_80 - DENSITY_15) / 65.0
    line = DENSITY_80 + slope * (TEMPERATURES - 353.15)
    show("density at_zero_pressure", np.array([DENSITY_80, 40.0 * slope]), line)

    model = load_fuel("n-dodecane")
    hot = fuel.TEMPERATURE_ORIGIN
    at_zero = model.isentropic_bulk_modulus(0.0, TEMPERATURES)
    trend = at_zero / model.isentropic_bulk_modulus(0.0, hot)
    show("bulk_modulus k1", fit_anchored(MODULUS[0] * trend, 3, MODULUS[0], None), MODULUS[0] * trend)
    rise = model.isentropic_bulk_modulus(TREND_PRESSURE, TEMPERATURES) - at_zero
    trend = rise / np.interp(hot, TEMPERATURES, rise)
    show("bulk_modulus k3", fit_anchored(MODULUS[1] * trend, 2, MODULUS[1], None), MODULUS[1] * trend)

    base = walther()
    show("viscosity k1", fit_anchored(base, 5, VISCOSITY[0], (313.15, VISCOSITY_40)), base)
    thin = model.kinematic_viscosity(0.0, TEMPERATURES)
    thickening = model.kinematic_viscosity(TREND_PRESSURE, TEMPERATURES) / thin - 1.0
    trend = thickening / np.interp(hot, TEMPERATURES, thickening)
    rise = VISCOSITY[1] * base / VISCOSITY[0] * trend
    show("viscosity k2", fit_anchored(rise, 4, VISCOSITY[1], None), rise)

    # Cragoe 1929, NBS Miscellaneous Publication 97, for petroleum products; water has 999 kg/m3 at 15 °C
    cragoe = (1685.0 + 3.40 * (TEMPERATURES - 273.15)) / np.sqrt(round(DENSITY_15 / 999.0, 3))
    show("heat_capacity isobaric", fit_anchored(cragoe, 1, float(np.interp(hot, TEMPERATURES, cragoe)), None), cragoe)


if __name__ == "__main__":
    main()
