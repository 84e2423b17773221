"""The reference engine of the direct-acting injector: the same laws by SciPy's LSODA, error-controlled.

Written apart from the lanes' scheme, and in plain Python: no splitting, no lag, no averaging of contacts; the feed
pipe is resolved by finite volumes. Solves restart at every edge of the schedule and, as a current that is measured has
a kink at each of its samples, the longest step is short.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from commonrail.arrays import Floats
from commonrail.choices import Drive
from commonrail.engine.balance import relative_to_injected
from commonrail.engine.channels import all_channels
from commonrail.engine.crossings import Crossings, instants
from commonrail.engine.explicit import Instants
from commonrail.engine.instant import Outside, coil_law
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import coefficients_at, reference_density
from commonrail.engine.rates import pipe_rates
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status
from commonrail.engine.timetable import courses, segments, value_at
from commonrail.errors import ConfigurationError
from commonrail.flow.orifice import jet
from commonrail.injector import direct_setup, joints
from commonrail.injector.definition import Injector
from commonrail.injector.direct_model import Coefficients
from commonrail.injector.layout import layout_of
from commonrail.injector.model import Setting
from commonrail.injector.variants import wiring
from commonrail.parts import direct_needle, drive, flux_decay, needle_seat, nozzle, sac, solenoid
from commonrail.parts.contents import Contents, contents

__all__ = ["simulate_direct"]


INSTANT = 1e-9  # in place of a lag of zero [s]: the flux then follows within a thousandth of a step


class Core(NamedTuple):
    """State behind the feed pipe, all at one time, or its rates: fuel [kg], positions, speeds, fluxes, nozzle."""

    store: float
    sac: float
    z: direct_needle.Pair
    v: direct_needle.Pair
    solenoid: solenoid.State
    nozzle: nozzle.State
    supplied: float


CORE = layout_of(Core)
# typical sizes for the solver's absolute tolerances, but for the masses of fuel
TYPICAL = Core(
    0.0,
    0.0,
    direct_needle.Pair(1e-4, 1e-4),
    direct_needle.Pair(1.0, 1.0),
    solenoid.TYPICAL,
    nozzle.State(1e-4, 1e-5),
    1e-5,
)


class Model:
    """One direct-acting injector at one point, as functions of time and state."""

    def __init__(self, injector: Injector, point: OperatingPoint, cells: int) -> None:
        if injector.variant.drive is Drive.PWM:
            raise ConfigurationError(
                f"{injector.name}: the reference of a direct-acting injector knows no switching drive; set drive_kind "
                'to "regulated", or use the lanes.'
            )
        self.injector, self.point, self.cells = injector, point, cells
        self.variant = injector.wired()
        self.c: Coefficients = coefficients_at(injector, point, 1e-6)
        self.laws, self.coil = wiring(self.variant).laws, coil_law(self.variant)
        at = Setting(*point.initial_pressures(), 1e-6)
        rest = direct_setup.rest(self.c, at)
        self.closed_at_start = rest.body.z.needle < 0.0 and rest.body.z.armature < 0.0
        core = Core(
            rest.accumulation.fuel.mass, rest.sac.mass, rest.body.z, rest.body.v, rest.solenoid, rest.nozzle, 0.0
        )
        self.first = 2 * cells + 1  # of the core, behind the pipe's flows and pressures
        self.start = np.zeros(self.first + len(CORE.paths))
        self.start[1 : self.first : 2] = at.rail
        CORE.store(self.start, self.first, 1, core)
        self.sizes = np.full(len(self.start), 1e-1)
        self.sizes[1 : self.first : 2] = at.rail
        CORE.store(self.sizes, self.first, 1, TYPICAL._replace(store=core.store, sac=core.sac))
        self.tip = self.first + CORE.row("z.needle")
        self.injected = self.first + CORE.row("nozzle.injected")

    def hydraulics(self, s: Core) -> tuple[Contents, Contents]:
        """Fuel in accumulation and SAC."""
        tip = s.z.needle
        room = sac.volume(self.c.sac, self.c.needle_seat.area, tip)
        store = contents(self.c.fuel, s.store, 1.0 / direct_setup.accumulation_volume(self.c, tip))
        return store, contents(self.c.fuel, s.sac, 1.0 / room)

    def outside(self, t: float, on: float, peak: float) -> Outside:
        """Boundary values and drive at a time.

        Parameters
        ----------
        t : float
            [s].
        on, peak : float
            Schedule: energised, in the peak phase [1].
        """
        rail, cylinder, low, trace = (value_at(course, t) for course in courses(self.point))
        return Outside(rail, cylinder, low, on, peak, 1.0, trace)

    def slopes(self, outside: Outside, y: Floats) -> Floats:
        """Rates of the whole vector.

        Parameters
        ----------
        outside : Outside
        y : array
            The vector.
        """
        c, s = self.c, CORE.load(y, self.first, 1)
        store, held = self.hydraulics(s)
        gain = needle_seat.gap_drive(c.needle_seat, s.z.needle)
        seat = jet(gain * (store.pressure - held.pressure), store.density, c.needle_seat.offset).mass_flow
        reached = max(s.nozzle.lift_reached, s.z.needle)
        spray_drive, _ = joints.nozzle_drive(c, held.pressure, outside.cylinder, self.laws.discharge(c.nozzle, reached))
        spray = jet(spray_drive, held.density, c.nozzle.offset).mass_flow
        pressing = -c.needle_seat.area * (store.pressure - held.pressure)
        load = direct_needle.Loads(solenoid.pull(c.solenoid, s.solenoid.pulling_flux), pressing)
        excess = held.pressure - outside.cylinder
        remembering = joints.memory_rate(c, s.nozzle.lift_reached, s.z.needle, s.v.needle, excess)
        dy = np.empty_like(y)
        rates = Core(
            store=y[self.first - 1] - seat,
            sac=seat - spray,
            z=s.v,
            v=direct_needle.accelerations(direct_setup.moved(c), s.z, s.v, load),
            solenoid=self.coil_rates(outside, s),
            nozzle=nozzle.State(remembering, spray),
            supplied=y[0],
        )
        CORE.store(dy, self.first, 1, rates)
        pipe_rates(y, dy, self.cells, c, outside.rail, store.pressure)
        return dy

    def coil_rates(self, outside: Outside, s: Core) -> solenoid.State:
        """Rates of both fluxes [V].

        Parameters
        ----------
        outside : Outside
        s : Core
        """
        c = self.c
        now = solenoid.circuit(c.solenoid, s.solenoid.flux, c.armature.travel - s.z.armature)
        supply = drive.Supply(drive.Schedule(outside.on, outside.peak), outside.trace)
        lags = (max(c.solenoid.eddy_lag, INSTANT), max(c.flux_decay.lag, INSTANT))
        return solenoid.State(
            self.coil(c, outside, supply, now),
            flux_decay.rate(s.solenoid.flux, s.solenoid.pulling_flux, *lags),
        )

    def run(self, time: Floats, relative: float, longest_step: float) -> tuple[Floats, Instants, bool]:
        """States at `time`, instants of the needle, and whether the end was reached.

        Parameters
        ----------
        time : (n,)
            [s].
        relative : float
            Tolerance.
        longest_step : float
            [s].
        """
        states = np.full((len(time), len(self.start)), np.nan)
        states[0] = y = self.start
        found = Crossings([], [], [])
        band = len(CORE.paths) + 2
        for part in segments(self.point, self.c.drive.peak_duration, float(time[0]), float(time[-1])):
            inside = time[(time > part.start) & (time <= part.stop)]
            at = np.unique(np.append(inside, part.stop))
            result = solve_ivp(
                lambda t, y, part=part: self.slopes(self.outside(t, part.on, part.peak), y),
                (part.start, part.stop),
                y,
                "LSODA",
                t_eval=at,
                events=self.events(),
                rtol=relative,
                atol=self.sizes * relative,
                max_step=longest_step,
                first_step=min(1e-9, part.stop - part.start),
                lband=band,
                uband=band,
            )
            if not result.success or not np.isfinite(result.y).all():
                return states, instants(found), False
            for kept, times, at_events in zip(found, result.t_events, result.y_events, strict=True):
                kept.extend((float(t), float(one[self.injected])) for t, one in zip(times, at_events, strict=True))
            k = int(np.searchsorted(time, part.start, side="right"))
            states[k : k + len(inside)] = result.y.T[: len(inside)]
            y = result.y[:, -1]
        return states, instants(found), True

    def events(self) -> list[Callable[[float, Floats], float]]:
        """Those of `Crossings`."""

        def clears(t: float, y: Floats) -> float:
            return float(y[self.tip]) - joints.CLEAR_LIFT

        def closes(t: float, y: Floats) -> float:
            return float(y[self.tip])

        def lifts(t: float, y: Floats) -> float:
            return float(y[self.tip])

        clears.direction, closes.direction, lifts.direction = 1.0, -1.0, 1.0  # type: ignore[attr-defined]
        return [clears, closes, lifts]

    def named(self, states: Floats) -> dict[str, Floats]:
        """Core by the names of the lanes' state."""
        held = {path: states[:, self.first + row] for row, path in enumerate(CORE.paths)}
        return {f"body.{path}" if path[:2] in ("z.", "v.") else path: row for path, row in held.items()}

    def pressures(self, time: Floats, states: Floats) -> dict[str, Floats]:
        """In the volumes and in the rail, which is also that at the feed pipe's inlet."""
        found = np.array([[one.pressure for one in self.hydraulics(CORE.load(y, self.first, 1))] for y in states])
        rail = np.array([value_at(self.point.rail_pressure, t) for t in time])
        return {
            "accumulation_pressure": found[:, 0].copy(),
            "sac_pressure": found[:, 1].copy(),
            "rail_pressure": rail,
            "inlet_pressure": rail,
        }

    def balance(self, states: Floats) -> float:
        """Balance of `relative_to_injected`."""
        gain = states[-1] - states[0]
        core = CORE.load(gain, self.first, 1)
        per_cell = self.c.feed_pipe.travel_time / self.cells / self.c.feed_pipe.impedance
        stored = core.store + core.sac + per_cell * float(np.sum(gain[1 : self.first : 2]))
        return relative_to_injected(core.supplied - core.nozzle.injected - stored, core.nozzle.injected)


def simulate_direct(
    injector: Injector, point: OperatingPoint, time: Floats, cells: int, relative: float, longest_step: float
) -> Solution:
    """Simulate one injection of a direct-acting injector with the reference engine.

    Parameters
    ----------
    injector : Injector
    point : OperatingPoint
    time : (n,)
        Bounds of the samples [s].
    cells : int
        Of the feed pipe.
    relative : float
        Tolerance of LSODA.
    longest_step : float
        [s].

    Raises
    ------
    ConfigurationError
        If the drive switches. A simulation that fails returns a `Solution` whose status says so.
    """
    model = Model(injector, point, cells)
    states, found, finished = model.run(time, relative, longest_step)
    named = model.named(states)
    injected = named["nozzle.injected"]
    channels = all_channels(model.c, model.variant, named, model.pressures(time, states))
    status = Status.STILL_INJECTING if channels["needle_lift"][-1] > 0.0 else Status.OK
    if not finished:
        status = Status.NOT_FINITE
    if not model.closed_at_start:
        status = Status.NOT_CLOSED_AT_START
    return Solution(
        time,
        np.diff(injected) / np.diff(time),
        injected,
        channels,
        float(injected[-1]),
        0.0,
        *found,
        reference_density(injector, point),
        status,
        "reference",
        model.balance(states),
    )
