"""Temperatures of the fuel along its way, and their effect on the quantities: an estimate in addition to a simulation.

A simulation has one temperature. The slopes along a change of pressure without exchange of heat are those of
thermodynamics,

    throttled, at constant enthalpy:    dT/dp = (alpha T - 1)/(rho c_p)
    compressed, at constant entropy:    dT/dp = alpha T/(rho c_p)

with alpha the expansivity of the density law and c_p stated by the fuel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import Quantity, flag, instance
from commonrail.base.arrays import Bools, Floats
from commonrail.base.choices import Actuation
from commonrail.base.errors import CommonrailError, ConfigurationError
from commonrail.base.text import number, percent, pressure, to_signed
from commonrail.base.units import to_text
from commonrail.cli.verbs.simulate import Beside
from commonrail.engine.operating_point import OperatingPoint, values_at
from commonrail.engine.plan import coefficients_at
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Solution
from commonrail.engine.time_step import DEFAULT_STEP, check_step
from commonrail.physics.flow import conductance_growth
from commonrail.physics.fuel import Fuel
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.variants import Variant, connections_of

_INTERVALS = 16  # from rail pressure to zero: temperatures are exact to about 0.01 K
_LENGTHS = ("plunger_needle.plunger_guide_length", "plunger_needle.needle_guide_length")
_HALF_DIFFERENCE = 0.5  # [K], for the derivative of density; third derivatives are negligible


def density_and_expansivity(fuel: Fuel, pressure: float, temperature: float) -> tuple[float, float]:
    """Density [kg/m3] and isobaric expansivity alpha = -(d rho/dT)/rho [1/K], a central difference.

    `pressure` [Pa]; `temperature` [K]: limited to the fuel's range.
    """
    low, high = fuel.temperature_range
    at = min(max(temperature, low + _HALF_DIFFERENCE), high - _HALF_DIFFERENCE)
    real = replace(fuel, adiabatic=False)  # density at the given temperature
    cold, hot = real.density(pressure, np.array([at - _HALF_DIFFERENCE, at + _HALF_DIFFERENCE])).tolist()
    mean = 0.5 * (cold + hot)
    return mean, (cold - hot) / (2.0 * _HALF_DIFFERENCE * mean)


def heat_capacity(fuel: Fuel, temperature: float) -> float:
    """Isobaric specific heat capacity [J/(kg K)] at a temperature [K], limited to the fuel's range.

    Raises ConfigurationError if the fuel states no heat capacity.
    """
    if fuel.heat_capacity_law is None:
        raise ConfigurationError(
            f"Fuel {fuel.name} states no heat capacity; add a table [heat_capacity] to its file (docs/howto/fuel.md)."
        )
    low, high = fuel.temperature_range
    return float(fuel.heat_capacity_law.at(min(max(temperature, low), high))[0])


def throttle(fuel: Fuel, temperature: float, pressures: Floats) -> Floats:
    """Temperatures (n,) [K] at pressures (n,) [Pa] that a fuel passes at constant enthalpy.

    This describes a hole or a guide after the outflow has lost its kinetic energy, without heat to the walls. The
    midpoint rule is used between the pressures: 16 intervals over 160 MPa are exact to 0.01 K.

    `temperature`: at the first pressure [K]. Raises ConfigurationError as `heat_capacity` does.
    """
    return _along(fuel, temperature, pressures, 1.0)


def compress(fuel: Fuel, temperature: float, pressures: Floats) -> Floats:
    """Temperatures (n,) [K] at pressures (n,) [Pa] that a fuel passes at constant entropy; as `throttle`."""
    return _along(fuel, temperature, pressures, 0.0)


def _along(fuel: Fuel, temperature: float, pressures: Floats, dissipated: float) -> Floats:
    """Solution of dT/dp = (alpha T - dissipated)/(rho c_p) by the midpoint rule."""

    def slope(p: float, t: float) -> float:
        rho, alpha = density_and_expansivity(fuel, p, t)
        return (alpha * t - dissipated) / (rho * heat_capacity(fuel, t))

    temperatures = [temperature]
    for p, step in zip(pressures[:-1].tolist(), np.diff(pressures).tolist(), strict=True):
        half = temperatures[-1] + 0.5 * step * slope(p, temperatures[-1])
        temperatures.append(temperatures[-1] + step * slope(p + 0.5 * step, half))
    return np.array(temperatures)


class Effect(NamedTuple):
    """Relative changes [1] of injected and returned mass caused by heating, from two further simulations.

    Attributes
    ----------
    injected, returned : float
        With all fuel at the temperature of the control chamber while the valve is open, and with the heated leak of the
        guides. The real fuel upstream of the needle is colder.
    returned_by_leak : float
        With the heated leak of the guides only.
    """

    injected: float
    returned: float
    returned_by_leak: float


@dataclass(frozen=True)
class Heating:
    """Temperatures [K] along the flow path, without heat to the walls; NaN without flow.

    Attributes
    ----------
    rail : float
        In the rail: the simulation's temperature; with adiabatic compression the one after the pump.
    control_chamber : float
        After the Z-hole, mean of the fuel that leaves through the valve; NaN also without a return pressure, as from
        the reference engine.
    returned : float
        After valve and guides, at the return pressure.
    sac : float
        After the needle's seat, mean of the injected mass.
    jet : float
        At the end of the nozzle's holes, where the share c_d² of the pressure drop is kinetic energy (jet not
        contracted).
    injected : float
        After the kinetic energy of the jet has become heat.
    leak_factor : float
        Leak of the guides with the viscosity at the temperature in the gap, over the leak at the temperature `rail`
        [1].
    beyond : bool
        A temperature is above the fuel's range; the properties are then taken at the end of the range.
    limits : tuple of str
        Where the fuel would boil, and which holes cavitate, in words.
    effect : Effect or None
        None if not requested, or if the control chamber's temperature is unknown or above the fuel's range.
    """

    rail: float
    control_chamber: float
    returned: float
    sac: float
    jet: float
    injected: float
    leak_factor: float
    beyond: bool
    limits: tuple[str, ...]
    effect: Effect | None = None

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI units; null where there is no flow."""
        numbers = {key: number(value) for key, value in vars(self).items() if type(value) is float}
        effect = self.effect and {key: number(value) for key, value in self.effect._asdict().items()}
        return numbers | {"beyond": self.beyond, "limits": list(self.limits), "effect": effect}


def heating(
    injector: Injector,
    point: OperatingPoint,
    solution: Solution,
    *,
    effect: bool = True,
    time_step: Quantity = DEFAULT_STEP,
) -> Heating:
    """Estimate how hot throttling makes the fuel of a simulation.

    Parameters
    ----------
    injector, point, solution
        Simulated injector and point, and their solution.
    effect : bool
        Simulate again, with the heat (`Effect`).
    time_step : float or str
        [s], or text, of these simulations.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, the solution is one of another point, or the fuel states no heat capacity.
    """
    instance(injector, Injector, "injector")
    _refuse_other(instance(point, OperatingPoint, "point"), instance(solution, Solution, "solution"))
    step = check_step(time_step)
    way = _way(injector, point)
    c = coefficients_at(injector, point, step)
    sac, jet, injected, limits = _nozzle(injector.fuel, c, point, solution, way)
    control = returned = factor = np.nan
    if injector.variant.actuation is not Actuation.DIRECT:
        low = point.at_start(point.return_pressure)
        cavitation: tuple[str, ...] = ()
        if "return_pressure" in solution.channels:
            control, cavitation = _drain(c, injector.variant, solution, way)
        returned = way.at(low)
        factor = _leak_factor(injector.fuel, c.plunger_needle.guides, way, low)
        limits += cavitation + _boiling(injector.fuel, "returned fuel", returned, low, "return")
    rail, highest = float(way.temperatures[0]), injector.fuel.temperature_range[1]
    beyond = bool(np.nanmax([rail, injected, returned]) > highest)
    estimate = Heating(rail, control, returned, sac, jet, injected, factor, beyond, limits)
    if not flag(effect, "effect") or np.isnan(control) or max(control, rail) > highest:
        return estimate
    return replace(estimate, effect=_effect(injector, point, estimate, step))


def _refuse_other(point: OperatingPoint, solution: Solution) -> None:
    """Refuse a solution whose duration or initial rail pressure differs from the operating point."""
    rail = solution.channels.get("rail_pressure", np.array([point.initial_pressures()[0]]))[0]
    for words, unit, stated, simulated, slack in (
        ("duration", "s", point.duration, float(np.ptp(solution.time)), 2.0 * float(np.diff(solution.time[:2])[0])),
        ("rail pressure", "Pa", point.initial_pressures()[0], float(rail), 1e-6 * float(rail)),
    ):
        if abs(stated - simulated) > slack:
            raise ConfigurationError(
                f"The solution is of another point: its {words} is {to_text(simulated, unit)}, and the point's "
                f"{to_text(stated, unit)}; give the point that was simulated."
            )


class _Way(NamedTuple):
    """Temperatures (n,) [K] of throttled fuel at pressures (n,) [Pa] that fall from the rail's to zero."""

    pressures: Floats
    temperatures: Floats

    def at(self, p: float) -> float:
        """Temperature at a pressure [Pa]; above rail pressure, in a wave, the rail's temperature; NaN for NaN."""
        return float(np.interp(p, self.pressures[::-1], self.temperatures[::-1])) if np.isfinite(p) else np.nan


def _way(injector: Injector, point: OperatingPoint) -> _Way:
    """Way of a simulation's fuel; `ConfigurationError` if it states no heat capacity."""
    fuel, start = injector.fuel, injector.values[FUEL_TEMPERATURE]
    rail, _, low = point.initial_pressures()
    if fuel.adiabatic:  # the stated temperature is upstream of the pump
        start = float(compress(fuel, start, np.linspace(low, rail, _INTERVALS + 1))[-1])
    pressures = np.linspace(rail, 0.0, _INTERVALS + 1)
    return _Way(pressures, throttle(fuel, start, pressures))


def _nozzle(
    fuel: Fuel, c: Any, point: OperatingPoint, solution: Solution, way: _Way
) -> tuple[float, float, float, tuple[str, ...]]:
    """Temperatures after the seat, after the holes and of the jet at rest, averaged over mass, and limits reached."""
    weight, channels = np.maximum(solution.mass_rate, 0.0), solution.channels
    sac, discharge = _middles(channels["sac_pressure"]), _middles(channels["discharge_coefficient"])
    cylinder = _middles(values_at(point.cylinder_pressure, solution.time))
    behind = _mean(cylinder, weight)
    if np.isnan(behind):
        return np.nan, np.nan, np.nan, ()
    at_rest = way.at(behind)
    before = _mean(sac, weight)
    density, _ = density_and_expansivity(fuel, 0.5 * (before + behind), float(way.temperatures[0]))  # ∫dp/ρ = Δp/ρ
    motion = _mean(discharge**2 * (sac - cylinder), weight) / density  # v²/2 [J/kg]
    jet = at_rest - motion / heat_capacity(fuel, at_rest)
    jet = at_rest - motion / heat_capacity(fuel, 0.5 * (at_rest + jet))
    free = c.nozzle.area_squared * discharge**2 * (sac - cylinder)
    limits = _cavitation("the nozzle", free, c.nozzle.cda2_choked * (sac - c.fuel.vapour_pressure), weight > 0.0)
    return way.at(before), jet, at_rest, limits + _boiling(fuel, "injected fuel", jet, behind, "cylinder")


def _drain(c: Any, variant: Variant, solution: Solution, way: _Way) -> tuple[float, tuple[str, ...]]:
    """Temperature in the control chamber, averaged over the valve's outflow, and the holes that cavitate."""
    channels, hole, vapour = solution.channels, c.control_chamber, c.fuel.vapour_pressure
    feed, chamber = channels["accumulation_pressure"], channels["control_pressure"]
    gap = np.square(c.valve.gap_slope * np.maximum(channels["valve_lift"], 0.0))  # (c_d A)², as `valve.gap_cda2`
    behind = channels["return_pressure"]
    a_cda2, choked = hole.a_cda2, hole.a_cda2_choked
    if variant.a_hole_law:
        law = connections_of(variant).laws.a_hole
        a_cda2, choked = np.array([law(hole, *at) for at in zip(chamber.tolist(), behind.tolist(), strict=True)]).T
    free = gap * a_cda2 / (gap + a_cda2) * np.maximum(chamber - behind, 0.0)
    most = choked * (chamber - vapour)
    limits = _cavitation("the A-hole", free, most, gap > 0.0)
    limits += _cavitation("the Z-hole", hole.z_cda2 * (feed - chamber), hole.z_cda2_choked * (feed - vapour), gap > 0.0)
    return way.at(_mean(chamber, np.sqrt(np.maximum(np.minimum(free, most), 0.0)))), limits


def _leak_factor(fuel: Fuel, guides: Any, way: _Way, low: float) -> float:
    """Leak of both guides heated over unheated [1], by Reynolds' equation, q l = π d/12 ∫ g³/ν dp."""
    inside = way.pressures > low
    p = np.append(way.pressures[inside], low)
    warm = np.minimum(np.append(way.temperatures[inside], way.at(low)), fuel.temperature_range[1])
    leaks = np.zeros(2)
    for guide in (guides.plunger_gap, guides.needle_gap):
        widths = guide.conductance * np.asarray(conductance_growth(guide.growth, p))  # type: ignore[arg-type]
        for i, t in enumerate((np.full_like(warm, warm[0]), warm)):
            leaks[i] -= np.trapezoid(widths / fuel.kinematic_viscosity(p, t), p)
    return float(leaks[1] / leaks[0]) if leaks[0] > 0.0 else np.nan


def _middles(values: Floats) -> Floats:
    return np.asarray(0.5 * (values[1:] + values[:-1]))


def _mean(values: Floats, weight: Floats) -> float:
    return float(np.average(values, weights=weight)) if weight.any() else np.nan


def _cavitation(hole: str, free: Floats, most: Floats, flows: Bools) -> tuple[str, ...]:
    """Sentence on a hole whose (c_d A)² Δp is above the limit of cavitation, with the share of its flow time."""
    share = float(np.mean(free[flows] > most[flows])) if flows.any() else 0.0
    return (f"{hole} cavitates in {percent(share, 0)} % of the time in which it flows",) if share > 0.0 else ()


def _boiling(fuel: Fuel, what: str, temperature: float, behind: float, place: str) -> tuple[str, ...]:
    """Sentence on fuel that boils: its vapour pressure is above the pressure downstream [Pa]."""
    vapour = float(fuel.vapour_pressure(np.clip(temperature, *fuel.temperature_range)))
    if vapour <= behind:
        return ()
    return (
        f"the {what} would boil: its vapour pressure is {pressure(vapour)}, that of the {place} {pressure(behind)}",
    )


def _effect(injector: Injector, point: OperatingPoint, estimate: Heating, step: float) -> Effect:
    """Effect of heating, from three candidates of one batch."""
    fuel, start = injector.fuel, injector.values[FUEL_TEMPERATURE]
    rail, _, low = point.initial_pressures()
    hot = start + estimate.control_chamber - estimate.rail
    leak = float(np.nan_to_num(estimate.leak_factor, nan=1.0))
    cold_film, hot_film = fuel.kinematic_viscosity(0.5 * (rail + low), np.array([start, hot])).tolist()
    lengths = np.array([injector.values[name] for name in _LENGTHS])
    rows = [[start, *lengths], [hot, *lengths * cold_film / hot_film / leak], [start, *lengths / leak]]
    names = (FUEL_TEMPERATURE, *_LENGTHS)
    batch = simulate_batch(injector, [point], names, np.array(rows), time_step=step, threads=1, stop_when_closed=False)
    with np.errstate(all="ignore"):  # without an injection there is no relative change
        injected, returned = (mass[1:, 0] / mass[0, 0] - 1.0 for mass in (batch.injected_mass, batch.returned_mass))
    return Effect(float(injected[0]), *map(float, returned))


def beside(injector: Injector, point: OperatingPoint, solution: Solution, step: float | None) -> Beside:
    """Figures and record of heating for a simulation; if the estimate fails, the figure states the reason.

    `step`: time step [s] of the simulations of the effect; None omits them.
    """
    if injector.fuel.heat_capacity_law is None:
        text = f"not estimated: {injector.fuel.name} states no heat capacity (table [heat_capacity] of its file)"
        return Beside((("fuel temperatures", text),), {"heating": None})
    try:
        estimate = heating(injector, point, solution, effect=step is not None, time_step=step or DEFAULT_STEP)
    except Exception as error:  # a failed estimate must not cost the simulation
        text = f"not estimated: {error if isinstance(error, CommonrailError) else repr(error)}"
        return Beside((("fuel temperatures", text),), {"heating": None})
    return Beside(tuple(_figures(estimate)), {"heating": estimate.record()})


def _figures(estimate: Heating) -> Iterator[tuple[str, str]]:
    """Names and texts of the estimate."""
    parts = {
        "in the rail": estimate.rail,
        "in the control chamber": estimate.control_chamber,
        "returned": estimate.returned,
    }
    texts = [f"{_celsius(value)} {name}" for name, value in parts.items() if np.isfinite(value)]
    if np.isfinite(estimate.jet):
        texts.append(f"{_celsius(estimate.jet)} in the jet, {_celsius(estimate.injected)} after the jet has stopped")
    note = "; above the fuel data, held constant" if estimate.beyond else ""
    yield "fuel temperatures", ", ".join(texts) + note
    if estimate.effect is not None:
        injected, returned = (to_signed(100.0 * value, 1) for value in estimate.effect[:2])
        leak = (
            f" and the guides leaked {estimate.leak_factor:.2g} times as much"
            if np.isfinite(estimate.leak_factor)
            else ""
        )
        yield (
            "their effect, estimated",
            f"injected {injected} %, returned {returned} %, if all were as hot as in the control chamber{leak}",
        )
    for limit in estimate.limits:
        yield "limit", limit


def _celsius(temperature: float) -> str:
    return f"{temperature - 273.15:.0f} °C"
