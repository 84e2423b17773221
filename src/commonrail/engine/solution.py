"""Results of simulations: one injection, and figures of many."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from commonrail.arrays import Bools, Floats, Ints
from commonrail.engine.status import Status
from commonrail.engine.time_step import step_advice


@dataclass(frozen=True)
class Solution:
    """Course of one injection; SI units unless the name says otherwise.

    Attributes
    ----------
    time : (samples + 1,)
        Bounds of the samples [s].
    mass_rate : (samples,)
        Mean mass flow through the nozzle between two bounds [kg/s].
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
        Instants at which the tip meets the seat for the last and for the first time after it was open [s]. It is open
        above 5 um, and in a reopening below that through which more than 0.1 % of all that was injected flows; ringing
        and smaller bounces do not count. The two differ where the needle reopens. NaN where there is none; no last one
        where the needle is above 5 um at the end.
    reference_density : float
        Fuel at cylinder pressure at rest (`OperatingPoint.at_start`) and fuel temperature [kg/m³]: turns mass into
        the volume that a rate meter shows.
    status : Status
    engine : str
        "lanes" or "reference".
    balance : float
        In − out − stored, relative to the injected mass, or to 1 mg where less was injected.
    longest_step : float
        Longest time step that the fast engines bear for this injector [s]; infinite for the reference.
    """

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
    longest_step: float = math.inf

    @property
    def sentence(self) -> str:
        """End of the simulation in words; for a step that is too long, one that is short enough."""
        if self.status is not Status.STEP_UNSTABLE:
            return self.status.sentence
        return f"{self.status.sentence} {step_advice(self.longest_step)}"

    @property
    def sample_time(self) -> Floats:
        """Middles of the samples [s]."""
        return np.asarray(0.5 * (self.time[1:] + self.time[:-1]))

    @property
    def rate(self) -> Floats:
        """Rate of injection by volume [m³/s] at the reference density."""
        return np.asarray(self.mass_rate / self.reference_density)

    @property
    def rate_mg_per_ms(self) -> Floats:
        """Rate of injection by mass [mg/ms]."""
        return np.asarray(self.mass_rate * 1e3)

    @property
    def rate_mm3_per_ms(self) -> Floats:
        """Rate of injection by volume [mm³/ms]."""
        return np.asarray(self.rate * 1e6)

    @property
    def injected_volume(self) -> float:
        """Per stroke [m³]."""
        return self.injected_mass / self.reference_density

    @property
    def returned_volume(self) -> float:
        """Returned per stroke, leakage included [m³]."""
        return self.returned_mass / self.reference_density


@dataclass(frozen=True)
class Batch:
    """Figures of many candidates at many operating points; arrays are (candidates, points).

    Attributes
    ----------
    injected_mass, returned_mass : [kg] per stroke, NaN for a failed simulation
    opening, closing, first_closing : [s], as in `Solution`, NaN where there is none
    greatest_lift : [m]
    status : int
        Values of `Status`.
    reference_density : (candidates, points)
        [kg/m³], each at its own fuel temperature.
    absolute_error, squared_error : (candidates, points)
        Weighted sums over the samples of a rate measurement, [m³/s] and [(m³/s)²]; zero without one.
    """

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
        """Mask of the simulations that failed."""
        return ~np.isin(self.status, (Status.OK, Status.STILL_INJECTING))

    @property
    def injected_volume(self) -> Floats:
        """Per stroke [m³] at the reference density."""
        return np.asarray(self.injected_mass / self.reference_density)

    @property
    def returned_volume(self) -> Floats:
        """Returned per stroke [m³] at the reference density."""
        return np.asarray(self.returned_mass / self.reference_density)
