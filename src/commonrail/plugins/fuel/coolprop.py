"""Laws of a pure fuel, Eq. (2), fitted to properties from CoolProp within limits of accuracy."""

from __future__ import annotations

import tomllib
from itertools import product
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError, nearest
from commonrail.base.text import percent, quantity, quantity_range, significant
from commonrail.physics import fuel_kernel
from commonrail.physics.fuel import Fuel, coefficient, log_compression, scaled_temperature
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.plugins.fuel.file import document
from commonrail.plugins.fuel.run import FittedFuel, FittedLaw, heat_capacity_law, modulus_law, round_up, viscosity_law
from commonrail.readers.fuel import parse_fuel

LIMITS = {"density": 1e-3, "sound_speed": 5e-3, "kinematic_viscosity": 3e-2}
"""Largest accepted deviations of a fuel from CoolProp [1]."""

_FOUND = ("density", "bulk_modulus", "isentropic_bulk_modulus", "sound_speed", "kinematic_viscosity", "heat_capacity")

_PRESSURES, _TEMPERATURES = 21, 9  # of the fit
_CHECKS = 32, 12  # of the check: between the points of the fit, except at the ends
_DEGREES = (3, 2, 1)  # of K1, K3, K4 of the moduli; higher degrees improved n-dodecane and methanol by less than 10 %
_VISCOSITY = (4, 3, 2)


class Deviation(NamedTuple):
    """Largest relative deviation of a property from CoolProp, and its state in words."""

    largest: float
    state: str


class Fluid:
    """Pure fluid of CoolProp, liquid over a range of pressure [Pa] and temperature [K].

    Raises InputError if CoolProp or the fluid is missing, its equation of state ends within the range, or the fluid is
    not liquid there.
    """

    def __init__(self, name: str, pressure: tuple[float, float], temperature: tuple[float, float]) -> None:
        try:
            from CoolProp import CoolProp
        except ImportError as error:
            raise InputError(
                "--coolprop: CoolProp is not installed; install it with pip install 'commonrail[fuel]'."
            ) from error
        self.name, self._of = name, CoolProp
        self.version = CoolProp.get_global_param_string("version")
        fluid_names = CoolProp.get_global_param_string("fluids_list").split(",")
        try:
            self._state = CoolProp.AbstractState("HEOS", "" if set("&[]:") & set(name) else name)
        except ValueError as error:
            raise InputError(f"--coolprop: CoolProp has no pure fluid {name!r}{nearest(name, fluid_names)}.") from error
        self._check(pressure, temperature)

    def _check(self, pressure: tuple[float, float], temperature: tuple[float, float]) -> None:
        state, hottest = self._state, min(self._state.Tmax(), self._state.T_critical())
        if not (state.Tmin() <= temperature[0] and temperature[1] < hottest):
            liquid = f"has liquid {self.name} from {_celsius(state.Tmin())} to {_celsius(hottest)} only"
            raise InputError(f"--temperature: CoolProp {liquid}; narrow the range.")
        if pressure[1] > state.pmax():
            end = f"equation of state of {self.name} holds up to {quantity(state.pmax(), 'Pa')}"
            raise InputError(f"--pressure: CoolProp's {end}; narrow the range.")
        boils = self.vapour_pressure(temperature[1])
        if pressure[0] <= boils:
            at = f"at {_celsius(temperature[1])} {self.name} boils below {quantity(boils, 'Pa')}"
            raise InputError(f"--pressure: {at}; begin the range above that, or end --temperature earlier.")

    def vapour_pressure(self, temperature: float) -> float:
        """Pressure at which the liquid boils [Pa]."""
        self._state.update(self._of.QT_INPUTS, 0.0, temperature)
        return float(self._state.p())

    def properties(self, pressures: Floats, temperatures: Floats) -> dict[str, Floats]:
        """Properties by name, SI units, (temperatures, pressures), at pressures [Pa] and temperatures [K]."""
        state, rows = self._state, []
        try:
            for temperature, p in product(temperatures.tolist(), pressures.tolist()):
                state.update(self._of.PT_INPUTS, p, temperature)
                rho, sound = state.rhomass(), state.speed_sound()
                modulus = rho / state.first_partial_deriv(self._of.iDmass, self._of.iP, self._of.iT)
                rows.append((rho, modulus, rho * sound**2, sound, state.viscosity() / rho, state.cpmass()))
        except ValueError as error:
            raise InputError(f"--coolprop: CoolProp cannot compute {self.name}: {error}") from error
        columns = np.array(rows).T.reshape(len(_FOUND), len(temperatures), len(pressures))
        vapour = np.array([[self.vapour_pressure(level)] for level in temperatures.tolist()])
        return dict(zip(_FOUND, columns, strict=True)) | {"vapour_pressure": vapour}


def fit_pure_fuel(
    name: str, pressure: tuple[float, float], temperature: tuple[float, float]
) -> tuple[FittedFuel, dict[str, float], str]:
    """Fit the laws of a pure fluid; returns laws, errors of the simulation's polynomials by property, and source.

    Errors of the laws are the largest deviations at pressures and temperatures between those of the fit. From the
    lowest pressure down to zero the laws are extrapolated.

    `pressure` [Pa], `temperature` [K]: lowest and highest. Raises InputError as `Fluid`, or if a deviation exceeds
    `LIMITS`.
    """
    fluid = Fluid(name, pressure, temperature)
    fit = _fit_laws(fluid, pressure, temperature)
    source = (
        f"fitted to CoolProp {fluid.version}, {name}, from {quantity_range(*pressure, 'Pa')} and "
        f"{quantity_range(*temperature, 'K')}"
    )
    fuel = parse_fuel(tomllib.loads(document(fit, name, source)), name, name)
    p, t = (np.linspace(*ends, n) for ends, n in zip((pressure, temperature), _CHECKS, strict=True))
    true = fluid.properties(p, t)
    with np.errstate(all="ignore"):  # a NaN is refused below
        deviations = {prop: _largest(values / true[prop] - 1.0, p, t) for prop, values in _laws(fuel, p, t).items()}
    _refuse_inaccurate(f"{name}: over this range the law misses", deviations)
    simulated = {prop: _largest(values / true[prop] - 1.0, p, t) for prop, values in _simulate(fuel, p, t).items()}
    _refuse_inaccurate(f"{name}: over this range the polynomial of a simulation misses", simulated)
    laws = tuple(law._replace(error=round_up(np.array([law.error, deviations[law.table].largest]))) for law in fit.laws)
    return fit._replace(laws=laws), {prop: deviation.largest for prop, deviation in simulated.items()}, source


def _fit_laws(fluid: Fluid, pressure: tuple[float, float], temperature: tuple[float, float]) -> FittedFuel:
    """Fit laws to a fluid at pressures that are denser at both ends."""
    spread = pressure[0] + (pressure[1] - pressure[0]) * (0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, _PRESSURES)))
    levels = np.linspace(*temperature, _TEMPERATURES)
    at = {name: values.ravel() for name, values in fluid.properties(spread, levels).items()}
    p, t = np.tile(spread, len(levels)) * 1e-6, np.repeat(levels, len(spread))
    modulus = modulus_law("bulk_modulus", p, t, at["bulk_modulus"] * 1e-6, _DEGREES)
    k = [coefficient(polynomial, t) for polynomial in modulus.polynomials.values()]
    at_zero = _line(t, at["density"] / np.exp(log_compression(p, *k)))
    vapour = _line(levels, np.log(at["vapour_pressure"]))
    laws = (
        FittedLaw("density", "kg/m3", {"at_zero_pressure": at_zero}, 0.0),
        modulus,
        modulus_law("isentropic_bulk_modulus", p, t, at["isentropic_bulk_modulus"] * 1e-6, _DEGREES),
        viscosity_law(p, t, at["kinematic_viscosity"] * 1e6, _VISCOSITY),
        FittedLaw("vapour_pressure", "ln(Pa)", {"ln_pressure": vapour}, 0.0),
        heat_capacity_law(t, at["heat_capacity"], 2),
    )
    # from zero: a constant modulus below the lowest pressure would have a kink that polynomials cannot follow
    return FittedFuel(laws, (0.0, pressure[1]), temperature, len(p))


def _line(temperature: Floats, values: Floats) -> list[float]:
    line = np.polynomial.polynomial.Polynomial.fit(scaled_temperature(temperature), values, 4).convert()
    return [float(f"{value:.9g}") for value in line.coef]


def _laws(fuel: Fuel, p: Floats, temperature: Floats) -> dict[str, Floats]:
    """Properties by a fuel's laws (temperatures, pressures), by name."""
    column = temperature[:, None]
    values = {name: getattr(fuel, name)(p, column) for name in _FOUND[:-1]}
    assert fuel.heat_capacity_law is not None
    return values | {
        "heat_capacity": fuel.heat_capacity_law.at(column)[0],
        "vapour_pressure": fuel.vapour_pressure(column),
    }


def _simulate(fuel: Fuel, p: Floats, temperature: Floats) -> dict[str, Floats]:
    """Properties with `LIMITS` by the polynomials of a simulation (temperatures, pressures)."""
    properties = np.empty((len(LIMITS), len(temperature), len(p)))
    for i, f in enumerate(fuel_coefficients(fuel, level) for level in temperature.tolist()):
        for j, at in enumerate(p.tolist()):
            rho = fuel_kernel.density(f, at)
            properties[:, i, j] = rho, fuel_kernel.sound_speed(f, rho), fuel_kernel.kinematic_viscosity(f, at)
    return dict(zip(LIMITS, properties, strict=True))


def _largest(error: Floats, p: Floats, temperature: Floats) -> Deviation:
    size = np.where(np.isnan(error), np.inf, np.abs(error))
    i, j = np.unravel_index(int(np.argmax(size)), size.shape)
    return Deviation(float(size[i, j]), f"at {quantity(p[j], 'Pa')} and {_celsius(temperature[i])}")


def _refuse_inaccurate(what: str, deviations: dict[str, Deviation]) -> None:
    """Raise InputError if a deviation exceeds its limit; `what`: fluid and law in words."""
    for prop, limit in LIMITS.items():
        deviation = deviations[prop]
        if not deviation.largest <= limit:
            most = f"by {significant(deviation.largest, 3, 100.0)} %" if deviation.largest < 1.0 else "altogether"
            raise InputError(
                f"--coolprop {what} the {prop.replace('_', ' ')} {most}, {deviation.state}, "
                f"and at most {percent(limit)} % is "
                "accepted; narrow --temperature or --pressure there."
            )


def _celsius(temperature: float) -> str:
    return f"{temperature - 273.15:.1f} °C"
