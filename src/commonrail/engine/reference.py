"""The reference engine: the same equations by SciPy's LSODA, error-controlled, restarted at every switching.

It is slow and simple; the lanes are checked against it. If LSODA's step becomes too small after a kink, DOP853 repeats
the segment. Pipes are resolved by `cells` finite volumes. On request the explicit march of `reference_kernels` solves
instead.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from commonrail.base.arrays import Floats
from commonrail.base.choices import Actuation, Boundary, Drive
from commonrail.base.errors import ConfigurationError
from commonrail.compiler.cache import Source
from commonrail.compiler.load import Kernel
from commonrail.engine import reference_kernels as kernels
from commonrail.engine.operating_point import OperatingPoint, courses, knots, segments, value_at, values_at
from commonrail.engine.plan import coefficients_at, reference_density
from commonrail.engine.reference_kernels import Fixed, Plan
from commonrail.engine.solution import Solution, all_channels, relative_to_injected
from commonrail.engine.status import Status, check_point, note_limits
from commonrail.physics.components import drive
from commonrail.physics.connections import CLEAR_LIFT, REOPENED
from commonrail.physics.equations import (
    AT,
    Inlet,
    feed,
    inlet_law,
    make_air_gap,
    make_hydraulics,
    make_rates,
    past_limit,
)
from commonrail.physics.flow import contents
from commonrail.physics.injector import Injector
from commonrail.physics.model import Setting
from commonrail.physics.state_vector import core_of, make_frame, start_vector, typical_sizes, vector_states
from commonrail.physics.variants import Variant, connections_of, kernel_name, wiring


class Instants(NamedTuple):
    """Opening, last and first closing of the needle [s], as `Solution` defines them."""

    opening: float = math.nan
    closing: float = math.nan
    first_closing: float = math.nan


# Crossings of the needle's seat recorded by a reference engine, and the instants that follow.


class Crossings(NamedTuple):
    """Times [s] at which the tip rises above `CLEAR_LIFT`, meets its seat, leaves it, each with the mass injected."""

    clears: list[tuple[float, float]]
    meets: list[tuple[float, float]]
    lifts: list[tuple[float, float]]


def instants(crossings: Crossings) -> Instants:
    """Opening, last and first closing, as `Solution` defines them."""
    clears = [t for t, _ in crossings.clears]
    if not clears:
        return Instants()
    left, is_open, closings = 0.0, True, []
    events = [(*at, kind) for kind, row in crossings._asdict().items() for at in row if at[0] >= clears[0]]
    for t, injected, kind in sorted(events):
        if kind == "lifts":
            left, is_open = injected, False
        elif kind == "clears":
            is_open = True
        elif is_open or injected - left > REOPENED * injected:
            closings.append(t)
            is_open = False
    last = [t for t in closings if t > clears[-1]]
    return Instants(clears[0], last[-1] if last else math.nan, closings[0] if closings else math.nan)


SAME = 1e-13  # stops of the integration closer than this coincide [s]


class Resolution(NamedTuple):
    """Resolution of the reference.

    `cells` of the feed pipe and of the return line; `relative` tolerance of LSODA, its absolute tolerances are
    `relative` times a typical value of each state; `longest_step` [s]. The method "explicit" uses a longest `step` [s]
    instead; a step is shorter if a wave would pass a cell or the SAC would settle within it.
    """

    cells: tuple[int, int] = (240, 120)
    relative: float = 1e-8
    longest_step: float = 2e-6
    method: Literal["lsoda", "explicit"] = "lsoda"
    step: float = 5e-8


CRAWL = (2000, 0.5e-6)  # LSODA is stuck if this many evaluations advance it by less [s]; 40 per us are usual


@functools.cache
def _compile_rates(variant: Variant) -> Kernel:
    """Function (y, outside, constants, cells, friction, dy) of a variant, compiled."""
    source = Source(f"{kernels.__name__}:rates_entries", variant.words, "f64", kernel_name(variant))
    return Kernel(source, "rates", kernels.RATES, make_rates(variant))


@functools.cache
def _compile_march(variant: Variant) -> Callable[..., int]:
    """Function (plan, fixed, step, start, states, recorded, memory) of a variant, compiled."""
    source = Source(f"{kernels.__name__}:march_entries", variant.words, "f64", kernel_name(variant))
    return Kernel(source, "march", kernels.MARCH, kernels.make_march(variant))


class _Crawling(Exception):
    """LSODA's step has become too small, as happens after a kink."""


def simulate_reference(
    injector: Injector,
    point: OperatingPoint,
    sample_interval: float = 3e-6,
    resolution: Resolution | None = None,
    friction: Floats | None = None,
) -> Solution:
    """Simulate one injection with the reference engine.

    `sample_interval`: spacing of the samples [s]; `friction` (9, 2), optional: Coulomb force [N] and viscous
    coefficient [N s/m] of the guides on each mass, in a rigid body their sums; used by the virtual test bench, not
    part of the paper's model. `ConfigurationError` if the resolution is out of range, or the injector or its fuel does
    not cover the point. A failed simulation returns a `Solution` with that status.
    """
    resolution = resolution or Resolution()
    _check(resolution)
    samples = max(round(point.duration / sample_interval), 1)
    time: Floats = np.asarray(point.start + sample_interval * np.arange(samples + 1), float)
    note_limits(injector, [point])
    if injector.variant.actuation is Actuation.DIRECT and friction is not None:
        raise ConfigurationError(f"{injector.name} is direct-acting: the needle has no guides; omit the friction.")
    model = Model(injector, point, resolution, friction)
    if resolution.method == "explicit":
        return solution(model, time, *model.march(time))
    return solution(model, time, *model.run(time))


def _check(resolution: Resolution) -> None:
    if resolution.method not in ("lsoda", "explicit"):
        raise ConfigurationError(f'The reference\'s method must be "lsoda" or "explicit", not "{resolution.method}".')
    if min(resolution.cells) < 1:
        raise ConfigurationError(f"Each pipe needs at least one cell, and {min(resolution.cells)} are asked for.")
    if not 1e-10 <= resolution.step <= 1e-7:
        raise ConfigurationError(
            f"The step of the explicit method must lie between 0.1 ns and 100 ns, not {resolution.step * 1e9:g} ns."
        )


class Model:
    """One injector at one point, as functions of time and state; another solver can override `solve`."""

    def __init__(
        self, injector: Injector, point: OperatingPoint, resolution: Resolution, friction: Floats | None
    ) -> None:
        check_point(injector, point)
        self.injector, self.point, self.resolution = injector, point, resolution
        variant = injector.wired()
        at = Setting(*point.initial_pressures(), 1e-6)
        self.c = coefficients_at(injector, point, at.dt)
        wired = wiring(variant)
        state = connections_of(variant).rest(self.c, at)
        self.direct = variant.actuation is Actuation.DIRECT
        lifts = wired.body.lifts(state.body.z)
        self.closed_at_start = lifts.tip < 0.0 and (lifts.top if self.direct else state.valve.lift) < 0.0
        has_line = not self.direct and self.c.return_line.impedance > 0.0
        line = resolution.cells[1] if has_line else 0
        self.cells = np.array((resolution.cells[0], line))
        self.start = start_vector(variant, self.c, state, self.cells, at)
        self.at, self.core = make_frame(variant)(self.cells), core_of(variant)
        self.constants = np.zeros(len(wired.coefficients.paths))
        wired.coefficients.store(self.constants, 0, 1, self.c)
        self.friction = np.zeros((9, 2)) if friction is None else np.ascontiguousarray(friction, float)
        self.outside = np.zeros(len(AT))
        self.y, self.dy = np.empty_like(self.start), np.empty_like(self.start)
        self.evaluate = _compile_rates(variant).bound(
            self.y, self.outside, self.constants, self.cells, self.friction, self.dy
        )
        self.variant = variant
        self._evaluations, self._checked_at = 0, point.start
        self.last = self.start

    def march(self, time: Floats) -> tuple[Floats, Instants, bool]:
        """States at `time` (n,), increasing [s], by explicit integration; results as of `run`.

        Steps are shorter than the resolution's if a wave would pass a cell or the SAC would settle sooner.
        """
        states = np.full((len(time), len(self.start)), np.nan)
        recorded = np.append(np.full(3, np.nan), (0.0, 0.0))
        memory = np.zeros(len(AT)), np.empty((4, len(self.start)))
        step = min(self.resolution.step, self.passage())
        fixed = Fixed(self.constants, self.cells, self.friction)
        loop = _compile_march(self.variant)
        finished = loop(self._plan(time), fixed, step, self.start, states, recorded, memory)
        return states, Instants(*recorded[:3].tolist()), bool(finished)

    def passage(self) -> float:
        """Time in which a wave passes a cell [s]: 12 % below Runge–Kutta's limit for staggered volumes."""
        c, (feed, line) = self.c, self.cells
        return float(min(c.feed_pipe.travel_time / feed, 0.5 * c.return_line.round_trip / line if line else math.inf))

    def _plan(self, time: Floats) -> Plan:
        """Stops of the integration, with courses and schedule in between."""
        first, last = float(time[0]), float(time[-1])
        stretches = segments(self.point, self.c.drive.peak_duration, first, last)
        edges = np.array([s.start for s in stretches])
        stops = np.sort(np.concatenate((time, edges, knots(self.point))))
        stops = stops[(stops >= first) & (stops <= last)]
        stops = stops[np.append(True, np.diff(stops) > SAME)]
        rows = np.full(len(stops), -1)
        rows[np.minimum(np.searchsorted(stops, time - SAME), len(stops) - 1)] = np.arange(len(time))
        stretch_index = np.searchsorted(edges, 0.5 * (stops[1:] + stops[:-1]), side="right") - 1
        schedule = np.array([(s.on, s.peak) for s in stretches])[stretch_index]
        at_stops = np.array([[value_at(course, t) for course in courses(self.point)] for t in stops])
        return Plan(stops, at_stops, schedule, rows)

    def run(self, time: Floats) -> tuple[Floats, Instants, bool]:
        """States at `time`, instants of the needle, and whether the end was reached."""
        states = np.full((len(time), len(self.start)), np.nan)
        states[0] = y = self.start
        crossings = Crossings([], [], [])
        self.outside[AT.conducting] = 2.0
        now = time[0]
        for segment in segments(self.point, self.c.drive.peak_duration, time[0], time[-1]):
            self.outside[AT.on], self.outside[AT.peak] = segment.on, segment.peak
            if not segment.on:
                self.outside[AT.conducting] = 2.0
            while now < segment.stop - 1e-15:
                if not np.isfinite(y).all():  # SciPy would raise an error of its own
                    return states, instants(crossings), False
                if self.past_limit(y) > 1e-9:
                    self.outside[AT.conducting] = drive.toggle_conduction(self.outside[AT.conducting])
                inside = time[(time > now) & (time <= segment.stop)]
                result = self.solve(now, segment.stop, y, inside)
                if not result.success:
                    return states, instants(crossings), False
                self._note(crossings, result)
                got = min(len(result.t), len(inside))
                k = int(np.searchsorted(time, now, side="right"))
                if got:
                    states[k : k + got] = result.y.T[: len(inside)]
                switched = result.status == 1
                now, y = (result.t_events[-1][-1], result.y_events[-1][-1]) if switched else (segment.stop, self.last)
                if switched:
                    self.outside[AT.conducting] = drive.toggle_conduction(self.outside[AT.conducting])
        return states, instants(crossings), True

    def _note(self, crossings: Crossings, result: Any) -> None:
        """Add the crossings of a solve, with the mass injected by then [kg]."""
        injected = self.at.core + self.core.row("nozzle.injected")
        for records, times, states in zip(crossings, result.t_events, result.y_events, strict=False):
            records.extend((float(t), float(y[injected])) for t, y in zip(times, states, strict=True))

    def solve(self, start: float, stop: float, y: Floats, inside: Floats) -> Any:
        """Solve between two switchings, with samples `inside`; returns a result of `solve_ivp` and sets `last`."""
        at = np.append(inside, stop) if not len(inside) or inside[-1] < stop else inside
        common = {
            "t_eval": at,
            "events": self.events(),
            "rtol": self.resolution.relative,
            "atol": self.scales() * self.resolution.relative,
            "max_step": self.resolution.longest_step,
            "first_step": min(1e-10, stop - start),
        }
        self._evaluations, self._checked_at = 0, start
        try:
            result = solve_ivp(self._rhs, (start, stop), y, "LSODA", lband=self.band, uband=self.band, **common)
        except _Crawling:
            self._evaluations = 10**9  # DOP853 is explicit: it needs many evaluations, but never sticks
            result = solve_ivp(self._rhs, (start, stop), y, "DOP853", **common)
        if result.success and result.status == 0:
            self.last = result.y[:, -1].copy()
        return result

    def events(self) -> list[Callable[[float, Floats], float]]:
        """Events of `Crossings`, then the PWM's current at its limit, which ends a solve."""
        tip = self.at.tip

        def closes(t: float, y: Floats) -> float:
            return float(y[tip])

        def switches(t: float, y: Floats) -> float:
            return self.past_limit(y)

        def clears(t: float, y: Floats) -> float:
            return float(y[tip]) - CLEAR_LIFT

        def lifts(t: float, y: Floats) -> float:
            return float(y[tip])

        clears.direction, closes.direction, lifts.direction = 1.0, -1.0, 1.0  # type: ignore[attr-defined]
        switches.terminal, switches.direction = True, 1.0  # type: ignore[attr-defined]
        return [clears, closes, lifts, switches]

    @property
    def band(self) -> int:
        """Half-width of the Jacobian: the injector's block is coupled internally and to the ends of the pipes.

        With a rail volume, the pipe's inlet also depends on the rail's mass. This entry lies outside the band and is
        omitted; the iteration converges without it.
        """
        return self.at.line - self.at.core + 2

    def _rhs(self, t: float, y: Floats) -> Floats:
        self._evaluations += 1
        if self._evaluations == CRAWL[0]:
            if t - self._checked_at < CRAWL[1]:
                raise _Crawling
            self._evaluations, self._checked_at = 0, t
        return self.slopes(t, y)

    def slopes(self, t: float, y: Floats) -> Floats:
        """Right-hand side."""
        at_time = [value_at(course, t) for course in courses(self.point)]
        self.outside[:3], self.outside[AT.trace] = at_time[:3], at_time[3]
        self.y[:] = y
        self.evaluate()  # into `dy`
        return self.dy.copy()

    def past_limit(self, y: Floats) -> float:
        """Distance of the PWM's current past its limit, relative to the band; negative before it."""
        if self.variant.drive is not Drive.PWM or not self.outside[AT.on]:
            return -1.0
        flux, gap = y[self.at.core + self.core.row("solenoid.flux")], make_air_gap(self.variant)(self.c, y, self.cells)
        return float(past_limit(self.c, self.outside[AT.peak], self.outside[AT.conducting], float(flux), float(gap)))

    def scales(self) -> Floats:
        """Typical size of each state, for absolute tolerances."""
        rail = self.outside[AT.rail] or self.point.at_start(self.point.rail_pressure)
        return typical_sizes(self.variant, self.start, self.cells, rail)


def solution(model: Model, time: Floats, states: Floats, instants: Instants, finished: bool) -> Solution:
    """States as a `Solution`."""
    state_columns = vector_states(model.variant, states, model.cells)
    injected = state_columns["nozzle.injected"]
    cylinder = values_at(model.point.cylinder_pressure, time)
    channels = all_channels(model.c, model.variant, state_columns, _pressures(model, time, states), cylinder)
    still = channels["needle_lift"][-1] > 0.0
    status = Status.STILL_INJECTING if still else Status.OK
    if not finished:
        status = Status.NOT_FINITE
    if not model.closed_at_start:
        status = Status.NOT_CLOSED_AT_START
    return Solution(
        time=time,
        mass_rate=np.diff(injected) / np.diff(time),
        injected=injected,
        channels=channels,
        injected_mass=float(injected[-1]),
        returned_mass=float(state_columns["cumulative_flows.returned"][-1]),
        **instants._asdict(),
        reference_density=reference_density(model.injector, model.point),
        status=status,
        engine="reference",
        balance=_balance(model, states),
        point=model.point,
    )


def _pressures(model: Model, time: Floats, states: Floats) -> dict[str, Floats]:
    """In the volumes, in the rail and at the feed pipe's inlet; the last two differ for a rail volume."""
    hydraulics, masses, c = make_hydraulics(model.variant), wiring(model.variant).positions, model.c
    control: list[float] = []
    needle_side: list[tuple[float, float]] = []
    rail = values_at(model.point.rail_pressure, time)
    inlet = rail.copy()
    for i, y in enumerate(states):
        core = model.core.load(y, model.at.core, 1)
        h = hydraulics(c, core.fuel, core.nozzle.lift_reached, masses.load(y, model.at.body, 2))
        needle_side.append((h.accumulation.pressure, h.sac.pressure))
        if model.direct:
            continue
        control.append(contents(c.fuel, core.fuel.control, h.volumes.control).pressure)
        at = Inlet(rail[i], core.rail_mass, y[0])
        inlet[i] = feed(c, inlet_law(model.variant), at, h.accumulation.pressure, control[i]).inlet
        if model.variant.boundary is Boundary.VOLUME:
            rail[i] = contents(c.fuel, core.rail_mass, c.rail.volume).pressure
    accumulation, sac = np.array(needle_side).T.copy()
    return {
        **({} if model.direct else {"control_pressure": np.array(control)}),
        "accumulation_pressure": accumulation,
        "sac_pressure": sac,
        "rail_pressure": rail,
        "inlet_pressure": inlet,
    }


def _balance(model: Model, states: Floats) -> float:
    """Missing mass relative to the injected mass, see `relative_to_injected`."""
    gain = states[-1] - states[0]
    core = model.core.load(gain, model.at.core, 1)
    per_cell = model.c.feed_pipe.travel_time / model.cells[0] / model.c.feed_pipe.impedance
    stored = sum(core.fuel) + per_cell * float(np.sum(gain[1 : model.at.core : 2]))
    left = core.cumulative_flows.supplied - core.nozzle.injected - core.cumulative_flows.returned - stored
    return relative_to_injected(left, core.nozzle.injected)
