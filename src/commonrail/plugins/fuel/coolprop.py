"""Laws of a pure fuel, Eq. (2), fitted to the properties that CoolProp computes, and held to limits of accuracy."""

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
from commonrail.plugins.fuel.file import document
from commonrail.plugins.fuel.run import FittedFuel, FittedLaw, heat_capacity_law, modulus_law, rounded_up, viscosity_law
from commonrail.readers.fuel import parse_fuel

LIMITS = {"density": 1e-3, "sound_speed": 5e-3, "kinematic_viscosity": 3e-2}
"""Largest deviations of a fuel from CoolProp [1], beyond which it is refused."""

_PRESSURES, _TEMPERATURES = 21, 9  # of the fit
_CHECKS = 32, 12  # of the check: between those of the fit, but for the ends
_DEGREES = (3, 2, 1)  # of K1, K3, K4 of the moduli; higher ones did not better n-dodecane or methanol by a tenth
_VISCOSITY = (4, 3, 2)


class Properties(NamedTuple):
    """Properties (temperatures, pressures) of a liquid, SI units."""

    density: Floats
    bulk_modulus: Floats
    isentropic_bulk_modulus: Floats
    sound_speed: Floats
    kinematic_viscosity: Floats
    heat_capacity: Floats


class Deviation(NamedTuple):
    """Largest relative deviation of a property from CoolProp's, the pressure [Pa] and temperature [K] that it is at."""

    largest: float
    p: float
    temperature: float


class Fluid:
    """Pure fluid of CoolProp, liquid over a range of pressure [Pa] and temperature [K].

    Raises InputError if CoolProp is missing, knows no such fluid or no viscosity of it, if its equation of state ends
    within the range, or the fluid is no liquid there.
    """

    def __init__(self, name: str, pressure: tuple[float, float], temperature: tuple[float, float]) -> None:
        try:
            from CoolProp import CoolProp
        except ImportError as error:
            raise InputError(
                "--coolprop needs CoolProp, which is not installed: install it with pip install 'commonrail[fuel]'."
            ) from error
        self.name, self.version, self._of = name, CoolProp.get_global_param_string("version"), CoolProp
        known = CoolProp.get_global_param_string("fluids_list").split(",")
        try:
            self._state = CoolProp.AbstractState("HEOS", "" if set("&[]:") & set(name) else name)
        except ValueError as error:
            raise InputError(f"--coolprop: CoolProp knows no pure fluid {name!r}{nearest(name, known)}.") from error
        self._check(pressure, temperature)

    def _check(self, pressure: tuple[float, float], temperature: tuple[float, float]) -> None:
        state = self._state
        coldest, hottest = state.Tmin(), min(state.Tmax(), state.T_critical())
        if not (coldest <= temperature[0] and temperature[1] < hottest):
            raise InputError(
                f"--temperature: CoolProp has liquid {self.name} from {_celsius(coldest)} to {_celsius(hottest)} only; "
                "narrow the range."
            )
        if pressure[1] > state.pmax():
            raise InputError(
                f"--pressure: CoolProp's equation of state of {self.name} holds up to {quantity(state.pmax(), 'Pa')}, "
                f"not to {quantity(pressure[1], 'Pa')}; narrow the range."
            )
        boils = self.vapour_pressure(temperature[1])
        if pressure[0] <= boils:
            raise InputError(
                f"--pressure: at {_celsius(temperature[1])} {self.name} boils below {quantity(boils, 'Pa')}; begin "
                "the range above that, or end --temperature earlier."
            )

    def vapour_pressure(self, temperature: float) -> float:
        """Pressure at which the liquid boils [Pa]."""
        self._state.update(self._of.QT_INPUTS, 0.0, temperature)
        return float(self._state.p())

    def properties(self, pressures: Floats, temperatures: Floats) -> Properties:
        """Properties at all pairs of pressures [Pa] and temperatures [K]."""
        state, rows = self._state, []
        try:
            for temperature, p in product(temperatures.tolist(), pressures.tolist()):
                state.update(self._of.PT_INPUTS, p, temperature)
                rho, sound = state.rhomass(), state.speed_sound()
                modulus = rho / state.first_partial_deriv(self._of.iDmass, self._of.iP, self._of.iT)
                rows.append((rho, modulus, rho * sound**2, sound, state.viscosity() / rho, state.cpmass()))
        except ValueError as error:
            raise InputError(f"--coolprop: CoolProp cannot compute {self.name}: {error}") from error
        return Properties(*np.array(rows).T.reshape(-1, len(temperatures), len(pressures)))


def fit_pure_fuel(
    name: str, pressure: tuple[float, float], temperature: tuple[float, float]
) -> tuple[FittedFuel, dict[str, float], str]:
    """Laws of a pure fluid, what their polynomials in a simulation miss by property, and a sentence on the source.

    The laws' errors are largest deviations at pressures and temperatures other than those of the fit; below the lowest
    pressure, down to zero, the laws are extrapolated.

    `pressure` [Pa], `temperature` [K]: lowest and highest. Raises InputError if the fluid cannot be had (`Fluid`), or
    the laws miss it by more than `LIMITS`.
    """
    fluid = Fluid(name, pressure, temperature)
    found = _fitted(fluid, pressure, temperature)
    source = (
        f"fitted to CoolProp {fluid.version}, {name}, from {quantity_range(*pressure, 'Pa')} and "
        f"{quantity_range(*temperature, 'K')}"
    )
    fuel = parse_fuel(tomllib.loads(document(found, name, source)), name, name)
    grid = [np.linspace(*ends, n) for ends, n in zip((pressure, temperature), _CHECKS, strict=True)]
    with np.errstate(all="ignore"):  # laws that are no numbers are refused
        off = _deviations(fuel, fluid, *grid)
    _refuse_inaccurate(name, "the law misses", off)
    simulated = _simulated(fuel, fluid, *grid)
    _refuse_inaccurate(name, "the polynomial of a simulation misses", simulated)
    laws = tuple(law._replace(error=rounded_up(np.array([law.error, off[law.table].largest]))) for law in found.laws)
    return found._replace(laws=laws), {prop: simulated[prop].largest for prop in LIMITS}, source


def _fitted(fluid: Fluid, pressure: tuple[float, float], temperature: tuple[float, float]) -> FittedFuel:
    """Laws fitted to a fluid, at pressures that are dense at both ends."""
    spread = pressure[0] + (pressure[1] - pressure[0]) * (0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, _PRESSURES)))
    levels = np.linspace(*temperature, _TEMPERATURES)
    at = Properties(*(values.ravel() for values in fluid.properties(spread, levels)))
    p, t = np.tile(spread, len(levels)) * 1e-6, np.repeat(levels, len(spread))
    modulus = modulus_law("bulk_modulus", p, t, at.bulk_modulus * 1e-6, _DEGREES)
    k = [coefficient(part, t) for part in modulus.polynomials.values()]
    vapour = np.log([fluid.vapour_pressure(level) for level in levels.tolist()])
    laws = (
        FittedLaw("density", "kg/m3", {"at_zero_pressure": _line(t, at.density / np.exp(log_compression(p, *k)))}, 0.0),
        modulus,
        modulus_law("isentropic_bulk_modulus", p, t, at.isentropic_bulk_modulus * 1e-6, _DEGREES),
        viscosity_law(p, t, at.kinematic_viscosity * 1e6, _VISCOSITY),
        FittedLaw("vapour_pressure", "ln(Pa)", {"ln_pressure": _line(levels, vapour)}, 0.0),
        heat_capacity_law(t, at.heat_capacity, 2),
    )
    # from zero: a modulus held below the lowest pressure would have a kink that no polynomial follows
    return FittedFuel(laws, (0.0, pressure[1]), temperature, len(p))


def _line(temperature: Floats, values: Floats) -> list[float]:
    line = np.polynomial.polynomial.Polynomial.fit(scaled_temperature(temperature), values, 4).convert()
    return [float(f"{value:.9g}") for value in line.coef]


def _deviations(fuel: Fuel, fluid: Fluid, pressures: Floats, temperatures: Floats) -> dict[str, Deviation]:
    """Largest deviations of a fuel's laws from a fluid, by property."""
    true, column = fluid.properties(pressures, temperatures)._asdict(), temperatures[:, None]
    found: dict[str, Floats] = {
        name: getattr(fuel, name)(pressures, column) for name in true if name != "heat_capacity"
    }
    assert fuel.heat_capacity_law is not None
    found["heat_capacity"] = fuel.heat_capacity_law.at(column)[0]
    true["vapour_pressure"] = np.array([[fluid.vapour_pressure(level)] for level in temperatures.tolist()])
    found["vapour_pressure"] = fuel.vapour_pressure(column)
    return {name: _largest(found[name] / true[name] - 1.0, pressures, temperatures) for name in true}


def _largest(off: Floats, pressures: Floats, temperatures: Floats) -> Deviation:
    size = np.where(np.isnan(off), np.inf, np.abs(off))
    i, j = np.unravel_index(int(np.argmax(size)), size.shape)
    return Deviation(float(size[i, j]), float(pressures[j]), float(temperatures[i]))


def _simulated(fuel: Fuel, fluid: Fluid, pressures: Floats, temperatures: Floats) -> dict[str, Deviation]:
    """Largest deviations from a fluid of the polynomials of the hot loop, by property."""
    found = np.empty((len(LIMITS), len(temperatures), len(pressures)))
    for i, temperature in enumerate(temperatures.tolist()):
        f = fuel_kernel.fuel_coefficients(fuel, temperature)
        for j, p in enumerate(pressures.tolist()):
            rho = fuel_kernel.density(f, p)
            found[:, i, j] = rho, fuel_kernel.sound_speed(f, rho), fuel_kernel.kinematic_viscosity(f, p)
    true = fluid.properties(pressures, temperatures)
    return {
        name: _largest(values / getattr(true, name) - 1.0, pressures, temperatures)
        for name, values in zip(LIMITS, found, strict=True)
    }


def _refuse_inaccurate(name: str, what: str, found: dict[str, Deviation]) -> None:
    """Raise InputError if a deviation of laws or polynomials is beyond its limit; `what`: these, in words."""
    for prop, limit in LIMITS.items():
        off, words = found[prop], prop.replace("_", " ")
        if not off.largest <= limit:
            most = f"by {significant(off.largest, 3, 100.0)} %" if off.largest < 1.0 else "altogether"
            raise InputError(
                f"--coolprop {name}: over this range {what} the {words} {most}, at {quantity(off.p, 'Pa')} and "
                f"{_celsius(off.temperature)}, and at most {percent(limit)} % is accepted; narrow --temperature "
                "or --pressure there."
            )


def _celsius(temperature: float) -> str:
    return f"{temperature - 273.15:.1f} °C"
