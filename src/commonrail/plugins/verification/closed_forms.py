"""Closed forms to compare with the model: waves in the pipe, modes of the chain, steady flow, mass balance.

Each function derives a case from the injector (without leakage and friction, as the theory requires), runs it, and
compares the run with a closed form or a scalar root that shares only the fuel's laws with the model.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.choices import Body, Boundary, Drive
from commonrail.engine import lanes, plan
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.simulate import simulate
from commonrail.physics.components import plunger_needle
from commonrail.physics.components.plunger_needle import Loads, Nine, SeatContact, State
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.variants import Variant

# The laws of steady flow, written a second time from the drawing and the fuel's laws.
#
# They use neither the model's coefficients nor its fuel polynomials; `closed_forms` compares runs with them.

RAIL = 160e6  # [Pa]


class Fluid(NamedTuple):
    """Fuel at the rail pressure: ρ [kg/m³], a [m/s], isothermal K [Pa], η [Pa s]."""

    density: float
    sound_speed: float
    modulus: float
    viscosity: float


def fluid(injector: Injector) -> Fluid:
    """Fuel at `RAIL` by its laws, not by the polynomials of the simulation."""
    temperature, fuel = injector.values[FUEL_TEMPERATURE], injector.fuel
    density = float(fuel.density(RAIL, temperature))
    return Fluid(
        density,
        float(fuel.sound_speed(RAIL, temperature)),
        float(fuel.bulk_modulus(RAIL, temperature)),
        density * float(fuel.kinematic_viscosity(RAIL, temperature)),
    )


def pipe_area(injector: Injector) -> float:
    """Cross-section of the feed pipe [m²]."""
    return math.pi / 4.0 * injector.values["feed_pipe.diameter"] ** 2


def nozzle_by_hand(injector: Injector, lift: float) -> tuple[float, float]:
    """Mass flow [kg/s] and SAC pressure [Pa] at which seat and nozzle pass the same flow, at a fixed lift [m]."""
    from scipy.optimize import brentq  # slow to import

    p, at = injector.parameters, fluid(injector)
    half = 0.5 * p.needle_seat.cone_angle
    way = lift * math.sin(half)
    gap = p.needle_seat.discharge * math.pi * way * (p.needle_seat.diameter - way * math.cos(half))
    holes = p.nozzle.holes * math.pi / 4.0 * p.nozzle.hole_diameter**2
    discharge = _equation_9(injector, lift) * holes
    choked = p.nozzle.contraction * holes
    seat_offset = _offset(at, p.needle_seat.transition_reynolds, 0.5 * math.pi * p.needle_seat.diameter)
    hole_width = p.nozzle.holes * math.pi / 4.0 * p.nozzle.hole_diameter
    hole_offset = _offset(at, p.nozzle.transition_reynolds, hole_width)
    temperature = injector.values[FUEL_TEMPERATURE]
    vapour = float(injector.fuel.vapour_pressure(temperature))

    def through_seat(sac: float) -> float:
        return _turbulent(gap, RAIL - sac, at.density, seat_offset)

    def excess(sac: float) -> float:
        density = float(injector.fuel.density(sac, temperature))
        full = min(discharge**2 * (sac - 5e6), choked**2 * (sac - vapour))
        return through_seat(sac) - _turbulent(1.0, full, density, hole_offset)

    sac = float(brentq(excess, 5.1e6, RAIL - 1e3))
    return through_seat(sac), sac


def drain_by_hand(injector: Injector, valve_lift: float) -> tuple[float, float]:
    """Mass flow [kg/s] and control pressure [Pa] at which the Z-hole, and A-hole with valve, pass the same flow."""
    from scipy.optimize import brentq  # slow to import

    p, at = injector.parameters, fluid(injector)
    low = 0.5e6
    hole = p.control_chamber
    z_area, a_area = (math.pi / 4.0 * d**2 for d in (hole.z_hole_diameter, hole.a_hole_diameter))
    ring = math.pi * p.valve.seat_diameter * valve_lift * math.sin(p.valve.seat_angle)
    first, second = hole.a_hole_discharge * a_area, p.valve.seat_discharge * ring
    both = 1.0 / math.sqrt(first**-2 + second**-2)
    temperature = injector.values[FUEL_TEMPERATURE]
    vapour = float(injector.fuel.vapour_pressure(temperature))
    z_offset, a_offset = (
        _offset(at, hole.transition_reynolds, math.pi / 4.0 * d) for d in (hole.z_hole_diameter, hole.a_hole_diameter)
    )

    def through_z(pressure: float) -> float:
        drive = min(
            (hole.z_hole_discharge * z_area) ** 2 * (RAIL - pressure),
            (hole.z_hole_contraction * z_area) ** 2 * (RAIL - vapour),
        )
        return _turbulent(1.0, drive, at.density, z_offset)

    def excess(pressure: float) -> float:
        density = float(injector.fuel.density(pressure, temperature))
        choked = (hole.a_hole_contraction * a_area) ** 2 * (pressure - vapour)
        return through_z(pressure) - _turbulent(1.0, min(both**2 * (pressure - low), choked), density, a_offset)

    pressure = float(brentq(excess, 1e6, RAIL - 1e3))
    return through_z(pressure), pressure


def _equation_9(injector: Injector, lift: float) -> float:
    n = injector.parameters.nozzle
    top = n.lift_maximum_slope * RAIL + n.lift_maximum_offset
    knee = n.lift_transition_slope * RAIL + n.lift_transition_offset
    if lift < knee:
        return float(n.discharge_transition * math.sin(0.5 * math.pi * lift / knee))
    share = min((lift - knee) / (top - knee), 1.0)
    return float(n.discharge_transition + (n.discharge_maximum - n.discharge_transition) * share)


def _offset(at: Fluid, reynolds: float, width: float) -> float:
    """Half of the mass flow at the transition Reynolds number of a hole [kg/s]."""
    return 0.5 * at.viscosity * reynolds * width


def _turbulent(effective: float, drop: float, density: float, offset: float) -> float:
    """Eq. (4) with its laminar limit [kg/s]: c_d A [m²], Δp [Pa]."""
    return math.sqrt(offset**2 + 2.0 * density * effective**2 * drop) - offset


# Traces of the fast engine and figures read from them: delay of an echo, frequency, modes of the chain.


def trace_states(injector: Injector, point: OperatingPoint, dt: float) -> dict[str, Floats]:
    """Trace states, outgoing waves and "time" [s] after each step of `dt` [s]: arrays (steps + 1,) by dotted name."""
    prepared = plan.prepare(injector, [point], dt)
    _, trace = lanes.run(plan.make_job(prepared, prepared.row[None], False), injector.wired(), traced=True)
    rows = dict(zip(lanes.trace_paths(injector.variant), trace[0, :, :, 0].T.copy(), strict=True))
    return rows | {"time": point.start + dt * np.arange(trace.shape[1])}


def echo(time: Floats, arriving: Floats, leaving: Floats, near: float) -> float:
    """Delay [s], near the expected one, after which a leaving wave (n,) returns with reversed sign."""

    def miss(delay: float) -> float:
        return float(np.sum((arriving + np.interp(time - delay, time, leaving, left=0.0)) ** 2))

    return _least(miss, np.linspace(0.8, 1.2, 401) * near, 1e-10)


def frequency(signal: Floats, dt: float, near: float) -> float:
    """Strongest frequency [1/s] of a signal (n,) sampled every `dt` [s], by a windowed Fourier integral.

    Searched between 0.3 and 1.3 times the expected frequency `near`.
    """
    shaped, time = signal * np.hanning(len(signal)), dt * np.arange(len(signal))

    def weakness(f: float) -> float:
        return -float(abs(np.sum(shaped * np.exp(-2j * np.pi * f * time))))

    return _least(weakness, np.linspace(0.3, 1.3, 501) * near, 1e-5)


def _least(function: Callable[[float], float], grid: Floats, tolerance: float) -> float:
    """Minimise a function: the best point of an even grid, refined between its neighbours."""
    from scipy.optimize import minimize_scalar  # slow to import

    best, step = grid[np.argmin([function(x) for x in grid.tolist()])], grid[1] - grid[0]
    ends = (best - step, best + step)
    return float(minimize_scalar(function, bounds=ends, method="bounded", options={"xatol": tolerance}).x)


def chain_matrices(k: Floats, masses: Floats, joint: float) -> tuple[Floats, Floats]:
    """Stiffness matrix [N/m] and nodal masses [kg] of the nine-mass chain in contact, Eq. (10).

    `k` and `masses` (7,): of the cylinders; `joint`: contact stiffness between masses 6 and 7.
    """
    springs = np.array([*k[:5], joint, *k[5:]])
    matrix = np.diag(np.append(springs, 0.0) + np.append(0.0, springs))
    matrix -= np.diag(springs, 1) + np.diag(springs, -1)
    plunger, needle = masses[:5], masses[5:]
    half = [np.append(body, 0.0) / 2 + np.append(0.0, body) / 2 for body in (plunger, needle)]
    return matrix, np.concatenate(half)


def chain_frequency(
    p: plunger_needle.Parameters, seat: SeatContact, shape: Floats, mass: Floats, omega: float
) -> float:
    """Angular frequency [1/s] of a small modal oscillation of the pressed chain, from its zero crossings.

    The mode `shape` (9,) with nodal masses (9,) [kg], expected at `omega` [1/s], is simulated for ten periods.
    """
    dt = 2.0 * math.pi / omega / 200.0
    c = plunger_needle.coefficients(p, dt)
    load = Loads(-2000.0, 0.0, 0.0, 0.0, 0.0)
    rest = np.array(plunger_needle.at_rest(c, seat, load).z)
    displacement = 1e-8 * shape / np.abs(shape).max()
    before = Nine(*(0.5 * dt * omega**2 * displacement))
    state = State(Nine(*(rest + displacement)), before, before)
    amplitude = np.empty(200 * 10)
    for i in range(len(amplitude)):
        amplitude[i] = (np.array(state.z) - rest) @ (mass * shape)
        state = plunger_needle.advance(c, seat, state, load, dt)
    at = np.flatnonzero(amplitude[:-1] * amplitude[1:] < 0.0)
    crossings = at + amplitude[at] / (amplitude[at] - amplitude[at + 1])
    return float(math.pi * (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * dt))


STEP = 1e-6  # [s]
TIGHT = {
    "feed_pipe.friction_factor": 0.0,
    "plunger_needle.plunger_gap": 0.0,
    "plunger_needle.needle_gap": 0.0,
    "control_chamber.z_hole_from_inlet": 1.0,
    "return_line.length": 0.0,
}


class Check(NamedTuple):
    """Check: the magnitude of its value must not exceed its limit."""

    name: str
    value: float
    limit: float
    unit: str
    passed: bool
    detail: str

    @property
    def margin(self) -> float:
        """Unused share of the limit [1]; negative beyond it."""
        return 1.0 - abs(self.value) / self.limit


def check(name: str, value: float, limit: float, unit: str, detail: str) -> Check:
    """Make a check that passes if |value| ≤ limit [unit]; NaN fails. `detail`: the comparison in words."""
    return Check(name, float(value), limit, unit, bool(abs(value) <= limit), detail)


def joukowsky(injector: Injector) -> list[Check]:
    """Needle opening at the end of a long pipe: Δp = ρ a Δu until the rail's echo returns after 2 L/a."""
    length = 1.5
    case = _case(injector, {"feed_pipe.length": length})
    rows = trace_states(case, OperatingPoint(RAIL, 700e-6, horizon=3.5e-3), STEP)
    at = fluid(case)
    pressure, flow = rows["accumulation.fuel.pressure"], rows["feed_pipe.end_flow"][1:]
    mean = 0.5 * (pressure[1:] + pressure[:-1]) - RAIL
    shock = at.sound_speed / pipe_area(case) * flow  # ρ a u
    arriving, leaving = mean + shock, mean - shock
    time, trip = rows["time"][1:], 2.0 * length / at.sound_speed
    quiet = time < trip
    largest = float(np.max(np.abs(mean[quiet])))
    residual = float(np.max(np.abs(arriving[quiet]))) / largest
    measured = echo(time, arriving, leaving, trip)
    return [
        check(
            "Joukowsky: pressure drop against density x sound speed x velocity",
            100.0 * residual,
            0.1,
            "%",
            f"pipe of 1.5 m, drop of {largest * 1e-6:.1f} MPa; limited by fuel polynomials and means over a step",
        ),
        check(
            "Joukowsky: the rail's echo arrives after 2 L/a",
            (measured - trip) * 1e6,
            0.5,
            "us",
            f"{trip * 1e6:.1f} us; limit: half a step",
        ),
    ]


def pipe_period(injector: Injector) -> list[Check]:
    """Pipe open at the rail and closed by a volume: cot θ = (a/A) C ω with θ = ω L/a, C = V ρ/K; V → 0: 4 L/a."""
    from scipy.optimize import brentq  # slow to import

    length = 0.3
    checks = []
    for volume, name in ((150e-9, "with a volume of 150 mm3"), (3e-9, "with 3 mm3, almost 4 L/a")):
        # almost no shoulder area: the chain's compliance would otherwise add 0.1 % to the compliance of the pipe
        slim = {
            "plunger_needle.guide_diameter": 2.72e-3,
            "plunger_needle.stem_diameter": 2.71e-3,
            "needle_seat.diameter": 2.70e-3,
        }
        case = _case(injector, {"feed_pipe.length": length, "accumulation.volume": volume} | slim)
        step = Trace.of([0.0, 100e-6, 101e-6, 1.0], [RAIL, RAIL, RAIL + 1e6, RAIL + 1e6])
        rows = trace_states(case, OperatingPoint(step, (), horizon=15e-3), STEP)
        at = fluid(case)
        stiffness = at.sound_speed / pipe_area(case) * volume * at.density / at.modulus
        per_angle = at.sound_speed / length

        def excess(angle: float, slope: float = stiffness * per_angle) -> float:
            return 1.0 / math.tan(angle) - slope * angle

        expected = brentq(excess, 1e-6, 0.5 * math.pi - 1e-12) * per_angle / (2.0 * math.pi)
        ringing = rows["accumulation.fuel.pressure"][200:] - (RAIL + 1e6)
        measured = frequency(ringing, STEP, 0.25 * per_angle)
        checks.append(
            check(
                f"pipe period {name}",
                100.0 * (expected / measured - 1.0),
                0.1,
                "%",
                f"{1e6 / expected:.2f} us, {2 * math.pi * expected / per_angle / (0.5 * math.pi):.3f} of 4 L/a in "
                "angle; limited by interpolated delays",
            )
        )
    return checks


def chain_modes(injector: Injector) -> list[Check]:
    """Oscillation of plunger and needle on the seat at the roots of the generalised eigenproblem."""
    from scipy.linalg import eigh  # slow to import

    p = injector.parameters.plunger_needle._replace(damping_ratio=0.0, spring_stiffness=0.0)
    seat = SeatContact(injector.parameters.needle_seat.contact_stiffness, 0.0)
    k = np.array([p.k1, p.k2, p.k3, p.k4, p.k5, p.k6, p.k7])
    masses = np.array([p.m1, p.m2, p.m3, p.m4, p.m5, p.m6, p.m7])
    stiffness, nodes = chain_matrices(k, masses, p.joint_stiffness)
    stiffness[8, 8] += seat.stiffness
    squares, shapes = eigh(stiffness, np.diag(nodes))
    omega = np.sqrt(squares)
    frequencies = [chain_frequency(p, seat, shapes[:, i], nodes, omega[i]) for i in range(9)]
    worst = float(np.max(np.abs(np.array(frequencies) / omega - 1.0)))
    detail = (
        f"nine modes, {omega[0] / 2e3 / math.pi:.1f} to {omega[8] / 2e3 / math.pi:.0f} kHz; limit: 200 steps a period"
    )
    return [check("modes of the chain against the eigenproblem", 100.0 * worst, 0.1, "%", detail)]


def steady_flow(injector: Injector) -> list[Check]:
    """Steady flow after 4 ms with a short pipe: seat and nozzle in series; Z-hole, A-hole and valve in series."""
    wide = _steady(injector, {}, "")
    narrow = _steady(injector, {"valve.lift": 15e-6}, ", valve as the narrowest section")
    return wide + narrow[1:]


def _steady(injector: Injector, values: dict[str, float], name: str) -> list[Check]:
    case = _case(injector, {"feed_pipe.length": 0.01} | values)
    rows = trace_states(case, OperatingPoint(RAIL, 4e-3, horizon=4e-3), STEP)
    late = slice(3000, None)
    lift, valve_lift = (float(np.mean(rows[key][late])) for key in ("body.z.i9", "valve.lift"))
    span = rows["time"][-1] - rows["time"][3000]
    injected = (rows["nozzle.injected"][-1] - rows["nozzle.injected"][3000]) / span
    returned = (rows["cumulative_flows.returned"][-1] - rows["cumulative_flows.returned"][3000]) / span
    chamber = float(np.mean(rows["control_chamber.fuel.pressure"][late]))
    nozzle_flow, _ = nozzle_by_hand(case, lift)
    drain_flow, drain_pressure = drain_by_hand(case, valve_lift)
    detail = f"needle {lift * 1e6:.0f} um open; limited by ringing of the chain and fuel polynomials"
    ratios = {
        "steady flow of seat and nozzle": injected / nozzle_flow,
        "steady flow of Z-hole, A-hole and valve": returned / drain_flow,
        "steady control pressure": chamber / drain_pressure,
    }
    return [check(what + name, 100.0 * (ratio - 1.0), 0.1, "%", detail) for what, ratio in ratios.items()]


def mass_balance(injector: Injector) -> list[Check]:
    """Fuel in minus fuel out minus fuel stored, relative to the injected fuel."""
    worst = 0.0
    for boundary in (Boundary.IDEAL, Boundary.VOLUME):
        wired = replace(injector, variant=Variant(boundary=boundary))
        for pressure in (40e6, 100e6, 180e6):
            pulses = (Energising(0.0, 300e-6), Energising(1.2e-3, 500e-6))
            worst = max(worst, abs(simulate(wired, OperatingPoint(pressure, pulses)).balance))
    detail = "40, 100, 180 MPa, two injections, ideal rail and rail volume; limit: rounding of 4000 steps with margin"
    return [check("balance of mass", worst, 1e-9, "1", detail)]


def _case(injector: Injector, values: dict[str, float]) -> Injector:
    wired = replace(injector, variant=Variant(Body.FLEXIBLE, Boundary.IDEAL, Drive.REGULATED))
    return wired.with_values(TIGHT | values)


ALL: tuple[Callable[[Injector], list[Check]], ...] = (joukowsky, pipe_period, chain_modes, steady_flow, mass_balance)
