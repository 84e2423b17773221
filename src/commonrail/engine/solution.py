"""Results of simulations: one injection, directly and through a meter, and figures of many."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from commonrail.base.arguments import instance
from commonrail.base.arrays import Bools, Floats, Ints
from commonrail.base.choices import Actuation, Boundary
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError
from commonrail.engine.operating_point import OperatingPoint, Trace, values_at
from commonrail.engine.plan import reference_densities
from commonrail.engine.status import Status
from commonrail.engine.time_step import step_advice
from commonrail.physics.components import feed_pipe, solenoid
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.model import SharedCoefficients
from commonrail.physics.variants import Variant, wiring

if TYPE_CHECKING:
    from commonrail.physics.meters import Meter

# Mass balance of a whole simulation, from the traced state.

SMALL = 1e-6  # least reference mass [kg], a small pilot injection; avoids division by zero without an injection

_VOLUMES = ("control_chamber.fuel.mass", "accumulation.fuel.mass", "sac.mass")


def relative_balance(c: SharedCoefficients, states: Mapping[str, Floats], dt: float) -> float:
    """Missing mass relative to the injected mass, see `relative_to_injected`.

    In: drawn from the rail. Out: injected, returned. Stored: in the volumes and the feed pipe.

    `c`: `plan.coefficients_at` that step; `states` (mapping of str to (steps + 1,)): state after every step, by the
    names of `lanes.trace_paths`; `dt`: time step [s].
    """
    stored = sum(float(states[name][-1] - states[name][0]) for name in _VOLUMES if name in states)
    stored += _pipe(states["waves.down"], c.delays.feed, dt * c.feed_pipe.admittance / 2)
    stored += _pipe(states["waves.up"], c.delays.feed, dt * c.feed_pipe.admittance / 2)
    inlet, end = states["feed_pipe.inlet_flow"][-1], states["feed_pipe.end_flow"][-1]
    # friction is subtracted when a wave leaves and when it arrives; the second part of the last step is pending
    late = feed_pipe.end_loss(c.feed_pipe, float(inlet)) - feed_pipe.end_loss(c.feed_pipe, float(end))
    stored += dt * c.feed_pipe.admittance / 2 * late
    injected = float(states["nozzle.injected"][-1])
    put_in = float(states["cumulative_flows.supplied"][-1])
    taken_out = injected + float(states["cumulative_flows.returned"][-1])
    left = put_in - taken_out - stored
    return relative_to_injected(left, injected)


def relative_to_injected(left: float, injected: float) -> float:
    """Mass missing in the cumulative flows [kg], relative to the injected mass, at least `SMALL` [1]."""
    return float(left / max(injected, SMALL))


def _pipe(wave: Floats, delay: float, share: float) -> float:
    """Gain in fuel under way [kg]: waves that have left but not arrived, minus those at the start."""
    whole_steps = int(min(max(delay, 1.0), len(wave)))  # a wave under way longer than the simulation has not left yet
    fraction = max(delay, 1.0) - whole_steps
    weights = np.concatenate((np.ones(whole_steps), [fraction]))
    recent = wave[::-1][: whole_steps + 1]
    return float(share * np.sum(weights[: len(recent)] * (recent - wave[0])))


# Channels of a solution, from the states of an engine.

States = Mapping[str, Floats]

_PRESSURES = {  # channel names and states; absent ones are skipped
    "control_pressure": "control_chamber.fuel.pressure",
    "accumulation_pressure": "accumulation.fuel.pressure",
    "sac_pressure": "sac.pressure",
    "rail_pressure": "rail.pressure",
    "return_pressure": "return_line.pressure",
}


def read_channels(c: Any, variant: Variant, point: OperatingPoint, time: Floats, states: States) -> dict[str, Floats]:
    """Channels of a `Solution` of the fast engines.

    `c`: `plan.coefficients_at` the point; `variant`: wired variant; `time` (samples,): [s]; `states`: arrays (samples,)
    of the state by the names of `lanes.trace_paths`.
    """
    pressure_states = dict(states)
    measured = isinstance(point.rail_pressure, Trace) and variant.boundary is not Boundary.VOLUME
    if measured or "rail.pressure" not in pressure_states:
        pressure_states["rail.pressure"] = values_at(point.rail_pressure, time)
    pressures = {name: pressure_states[path] for name, path in _PRESSURES.items() if path in pressure_states}
    cylinder = values_at(point.cylinder_pressure, time)
    channels = all_channels(c, variant, states, pressures, cylinder)
    return {name: np.ascontiguousarray(values) for name, values in channels.items()}  # frees the trace


def all_channels(c: Any, variant: Variant, states: States, pressures: States, cylinder: Floats) -> dict[str, Floats]:
    """Lifts, pressures, and quantities derived from flux and lift, with the names shared by all engines.

    `c`: of the variant's actuation; `states`, `pressures`: (mapping of str to (samples,)).
    """
    wired = wiring(variant)
    body, at = wired.body, (states["nozzle.lift_reached"], pressures["sac_pressure"], cylinder)
    moved = states[f"body.{body.TOP}"]
    if variant.actuation is Actuation.DIRECT:
        lifts, gap = {"armature_lift": moved}, c.armature.travel - moved
    else:
        lifts = {"plunger_lift": moved, "valve_lift": states["valve.lift"]}
        gap = c.valve.lift - states["valve.lift"]
    magnet = solenoid.circuit(c.solenoid, states["solenoid.flux"], gap)  # type: ignore[arg-type]
    return {
        "needle_lift": states[f"body.{body.TIP}"],
        **lifts,
        **pressures,
        "coil_current": np.asarray(magnet.current),
        "magnetic_force": np.asarray(solenoid.magnetic_force(c.solenoid, states["solenoid.pulling_flux"])),  # type: ignore[arg-type]
        "discharge_coefficient": _discharge(wired.discharge, c.nozzle, at, variant.nozzle_law != ""),
    }


def _discharge(law: Callable[..., Any], c: Any, at: tuple[Floats, Floats, Floats], foreign: bool) -> Floats:
    """Discharge coefficient at the samples of lift, SAC and cylinder pressure; a foreign law is called one by one."""
    if foreign or len(at[0]) == 1:  # a foreign law may branch; for one sample the loop is ten times faster
        return np.array([law(c, *sample) for sample in zip(*at, strict=True)])
    return np.asarray(_of_arrays(law)(c, *at))


@functools.cache
def _of_arrays(law: Callable[..., Any]) -> Callable[..., Any]:
    """Array version of a law without branches, with equal bits: `max` and `min` act element by element."""
    names = law.__globals__
    called = {name: _of_arrays(names[name]) for name in law.__code__.co_names if inspect.isfunction(names.get(name))}
    return FunctionType(law.__code__, {**names, **called, "max": np.maximum, "min": np.minimum}, None, law.__defaults__)


@dataclass(frozen=True, repr=False)
class Solution(Shown):
    """Course of one injection; SI units unless the name says otherwise.

    Attributes
    ----------
    time : (samples + 1,)
        Bounds of the samples [s].
    mass_rate : (samples,)
        Mean mass flow through the nozzle between two bounds [kg/s]; rates are drawn over `rate_time`.
    injected : (samples + 1,)
        Mass injected up to a bound [kg].
    channels : dict of str to (samples + 1,)
        Instantaneous values at the bounds: needle_lift, plunger_lift, valve_lift [m], control_pressure,
        accumulation_pressure, sac_pressure, rail_pressure, return_pressure, inlet_pressure (at the feed pipe; of the
        reference only) [Pa], coil_current [A], magnetic_force [N], discharge_coefficient [1].
    injected_mass, returned_mass : float
        Per stroke [kg].
    opening : float
        Instant at which the needle's tip first rises by 5 um [s]; NaN if it never does.
    closing, first_closing : float
        Instants at which the tip meets the seat for the last and for the first time after it was open [s]. The needle
        is open above 5 um, or if more than 0.1 % of the injected mass flows during a lower lift; smaller bounces do not
        count. The two differ if the needle reopens. NaN if absent; no last closing if the needle is above 5 um at the
        end.
    reference_density : float
        Fuel density at cylinder pressure (`OperatingPoint.at_start`) and fuel temperature [kg/m³]; converts mass to the
        volume that a rate meter shows.
    status : Status
    engine : str
        "lanes" or "reference".
    balance : float
        Mass balance error (in − out − stored), relative to the injected mass or to 1 mg if that is larger.
    find_longest_step : function () -> float, optional
        Gives `longest_step`.
    point : OperatingPoint, optional
        The simulated one.
    """

    presenter = "commonrail.report.notebook:SOLUTION"

    time: Floats
    mass_rate: Floats
    injected: Floats
    channels: dict[str, Floats]
    injected_mass: float
    returned_mass: float
    opening: float
    closing: float
    first_closing: float
    reference_density: float
    status: Status
    engine: str
    balance: float
    find_longest_step: Callable[[], float] | None = None
    point: OperatingPoint | None = None

    @functools.cached_property
    def longest_step(self) -> float:
        """Longest stable time step of the fast engines for this injector [s]; infinite for the reference.

        Computed at first access, which takes about half as long as the simulation.
        """
        return math.inf if self.find_longest_step is None else self.find_longest_step()

    @property
    def sentence(self) -> str:
        """End of the simulation in words; if the step was too long, with a suitable step."""
        if self.status is not Status.STEP_UNSTABLE:
            return self.status.sentence
        return f"{self.status.sentence} {step_advice(self.longest_step)}"

    @property
    def rate_time(self) -> Floats:
        """Time axis (samples,) of the rates: the middles of the samples [s]."""
        return np.asarray(0.5 * (self.time[1:] + self.time[:-1]))

    @property
    def rate(self) -> Floats:
        """Injection rate by volume (samples,) [m³/s] at the reference density, at `rate_time`."""
        return np.asarray(self.mass_rate / self.reference_density)

    @property
    def rate_mg_per_ms(self) -> Floats:
        """Injection rate by mass (samples,) [mg/ms], at `rate_time`."""
        return np.asarray(self.mass_rate * 1e3)

    @property
    def rate_mm3_per_ms(self) -> Floats:
        """Injection rate by volume (samples,) [mm³/ms], at `rate_time`."""
        return np.asarray(self.rate * 1e6)

    @property
    def injected_volume(self) -> float:
        """Per stroke [m³]."""
        return self.injected_mass / self.reference_density

    @property
    def returned_volume(self) -> float:
        """Returned per stroke, leakage included [m³]."""
        return self.returned_mass / self.reference_density


@dataclass(frozen=True, repr=False)
class Batch(Shown):
    """Figures of many candidates at many operating points; arrays are (candidates, points).

    Attributes
    ----------
    injected_mass, returned_mass : [kg] per stroke, NaN for a failed simulation
    opening, closing, first_closing : [s], as in `Solution`, NaN if absent
    greatest_lift : [m]
    status : int
        Values of `Status`.
    reference_density : (candidates, points)
        [kg/m³], each at its own fuel temperature.
    absolute_error, squared_error : (candidates, points)
        Weighted sums over the samples of a rate measurement, [m³/s] and [(m³/s)²]; zero without one.
    """

    presenter = "commonrail.report.notebook:BATCH"

    injected_mass: Floats
    returned_mass: Floats
    opening: Floats
    closing: Floats
    first_closing: Floats
    greatest_lift: Floats
    status: Ints
    reference_density: Floats
    absolute_error: Floats
    squared_error: Floats

    def at_points(self, points: slice) -> Batch:
        """Batch of some of the operating points."""
        return Batch(**{f.name: getattr(self, f.name)[:, points] for f in fields(self)})

    @property
    def failed(self) -> Bools:
        """Mask of failed simulations."""
        return ~np.isin(self.status, (Status.OK, Status.STILL_INJECTING))

    @property
    def injected_volume(self) -> Floats:
        """Per stroke [m³] at the reference density."""
        return np.asarray(self.injected_mass / self.reference_density)

    @property
    def returned_volume(self) -> Floats:
        """Returned per stroke [m³] at the reference density."""
        return np.asarray(self.returned_mass / self.reference_density)


# A single simulation through a meter.

UNEVEN = 1e-6  # relative difference between intervals that counts as rounding


@dataclass(frozen=True)
class Metered:
    """Rate and quantity of one injection through a meter.

    Attributes
    ----------
    meter : Meter
    rate : (samples,)
        Means between the same bounds as the simulated rate [m³/s].
    quantity : float
        Per stroke, with gain and offset, as for a map [m³].
    """

    meter: Meter
    rate: Floats
    quantity: float

    @property
    def rate_mm3_per_ms(self) -> Floats:
        """Rate [mm³/ms]."""
        return np.asarray(self.rate * 1e6)


def metered(solution: Solution, meter: Meter, injector: Injector, point: OperatingPoint) -> Metered:
    """Show a simulated injection as a meter would.

    The flow is zero before the first and after the last sample; a zero-phase filter, which looks ahead, needs a
    simulation that ends after the injection.

    Parameters
    ----------
    solution : Solution
        Of `simulate`, with samples at equal intervals.
    meter : Meter
        Its values are used unchanged; fitted ones have their start values.
    injector : Injector
        The simulated one; its fuel gives the density at a temperature of the meter.
    point : OperatingPoint
        The simulated one.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong type, or the intervals of the samples differ.
    """
    instance(solution, Solution, "solution")
    from commonrail.physics.meters import Flow, Meter, given_values, shown_quantities, shown_rates

    instance(meter, Meter, "meter")
    instance(injector, Injector, "injector")
    instance(point, OperatingPoint, "point")
    steps = np.diff(solution.time)
    if np.ptp(steps) > UNEVEN * steps[0]:
        raise ConfigurationError(
            "A meter shows samples at equal intervals, and those of the solution differ; simulate with another "
            "sample_interval."
        )
    meter_values = given_values(meter, {}, 1)
    density = _density(solution, meter, injector, point)
    flow = Flow(solution.mass_rate[None] / density, float(solution.time[0]), float(steps.mean()))
    quantity = shown_quantities(meter_values, np.array([[solution.injected_mass / density]]))
    return Metered(meter, shown_rates(meter, meter_values, flow, solution.time)[0], float(quantity[0, 0]))


def _density(solution: Solution, meter: Meter, injector: Injector, point: OperatingPoint) -> float:
    """Density [kg/m³] of the meter's volumes."""
    if "temperature" in meter.values:
        warmth = np.array([[meter.values["temperature"]]])
        return float(reference_densities(injector, [point], [FUEL_TEMPERATURE], warmth)[0, 0])
    return meter.values.get("density", solution.reference_density)
