"""Closed forms beside the model: waves in the pipe, modes of the chain, steady flow, mass balance.

Each function makes its case from the injector (no leakage, no friction, as the theory needs it), runs it, and
sets the run beside a closed form or a scalar root that uses nothing of the model but the fuel's laws.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.analysis.by_hand import RAIL, drain_by_hand, fluid, nozzle_by_hand, pipe_area
from commonrail.analysis.ringing import chain_frequency, chain_matrices, echo, frequency, traced
from commonrail.choices import Body, Boundary, Drive
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.simulate import simulate
from commonrail.injector.definition import Injector
from commonrail.injector.variants import Variant
from commonrail.parts.plunger_needle import SeatContact

STEP = 1e-6  # [s]
TIGHT = {
    "feed_pipe.friction_factor": 0.0,
    "plunger_needle.plunger_gap": 0.0,
    "plunger_needle.needle_gap": 0.0,
    "control_chamber.z_hole_from_inlet": 1.0,
    "return_line.length": 0.0,
}


class Check(NamedTuple):
    """A claim: its figure must not exceed its limit in size."""

    name: str
    value: float
    limit: float
    unit: str
    passed: bool
    detail: str

    @property
    def margin(self) -> float:
        """Share of the limit that is left [1]; negative beyond it."""
        return 1.0 - abs(self.value) / self.limit


def check(name: str, value: float, limit: float, unit: str, detail: str) -> Check:
    """Check that passes if |value| ≤ limit; NaN does not.

    Parameters
    ----------
    name : str
    value, limit : float
        [unit].
    unit, detail : str
        Unit, and what was compared.
    """
    return Check(name, float(value), limit, unit, bool(abs(value) <= limit), detail)


def joukowsky(injector: Injector) -> list[Check]:
    """A needle that opens at the end of a long pipe: Δp = ρ a Δu there, until the rail answers after 2 L/a."""
    length = 1.5
    case = _case(injector, {"feed_pipe.length": length})
    rows = traced(case, OperatingPoint(RAIL, 700e-6, horizon=3.5e-3), STEP)
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
            f"pipe of 1.5 m, drop of {largest * 1e-6:.1f} MPa; limit: fuel polynomials and means over a step",
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
    """A pipe, open at the rail, closed by a volume: cot θ = (a/A) C ω with θ = ω L/a and C = V ρ/K; V → 0: 4 L/a."""
    from scipy.optimize import brentq  # slow to import

    length = 0.3
    checks = []
    for volume, name in ((150e-9, "with a volume of 150 mm3"), (3e-9, "with 3 mm3, almost 4 L/a")):
        # a shoulder of next to no area: the chain's own compliance would add 0.1 % to the pipe's
        slim = {
            "plunger_needle.guide_diameter": 2.72e-3,
            "plunger_needle.stem_diameter": 2.71e-3,
            "needle_seat.diameter": 2.70e-3,
        }
        case = _case(injector, {"feed_pipe.length": length, "accumulation.volume": volume} | slim)
        step = Trace.of([0.0, 100e-6, 101e-6, 1.0], [RAIL, RAIL, RAIL + 1e6, RAIL + 1e6])
        rows = traced(case, OperatingPoint(step, (), horizon=15e-3), STEP)
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
                "angle; limit: interpolated delays",
            )
        )
    return checks


def chain_modes(injector: Injector) -> list[Check]:
    """Plunger and needle pressed on the seat ring at the roots of the generalised eigenproblem."""
    from scipy.linalg import eigh  # slow to import

    p = injector.parameters.plunger_needle._replace(damping_ratio=0.0, spring_stiffness=0.0)
    seat = SeatContact(injector.parameters.needle_seat.contact_stiffness, 0.0)
    k = np.array([p.k1, p.k2, p.k3, p.k4, p.k5, p.k6, p.k7])
    masses = np.array([p.m1, p.m2, p.m3, p.m4, p.m5, p.m6, p.m7])
    stiffness, nodes = chain_matrices(k, masses, p.joint_stiffness)
    stiffness[8, 8] += seat.stiffness
    squares, shapes = eigh(stiffness, np.diag(nodes))
    omega = np.sqrt(squares)
    found = [chain_frequency(p, seat, shapes[:, i], nodes, omega[i]) for i in range(9)]
    worst = float(np.max(np.abs(np.array(found) / omega - 1.0)))
    detail = (
        f"nine modes, {omega[0] / 2e3 / math.pi:.1f} to {omega[8] / 2e3 / math.pi:.0f} kHz; limit: 200 steps a period"
    )
    return [check("modes of the chain against the eigenproblem", 100.0 * worst, 0.1, "%", detail)]


def steady_flow(injector: Injector) -> list[Check]:
    """Held open for 4 ms behind a short pipe: seat and nozzle in series; Z-hole, and A-hole with valve, in series."""
    wide = _steady(injector, {}, "")
    narrow = _steady(injector, {"valve.lift": 15e-6}, ", valve as the narrowest section")
    return wide + narrow[1:]


def _steady(injector: Injector, values: dict[str, float], name: str) -> list[Check]:
    case = _case(injector, {"feed_pipe.length": 0.01} | values)
    rows = traced(case, OperatingPoint(RAIL, 4e-3, horizon=4e-3), STEP)
    late = slice(3000, None)
    lift, valve_lift = (float(np.mean(rows[key][late])) for key in ("body.z.i9", "valve.lift"))
    span = rows["time"][-1] - rows["time"][3000]
    injected = (rows["nozzle.injected"][-1] - rows["nozzle.injected"][3000]) / span
    returned = (rows["cumulative_flows.returned"][-1] - rows["cumulative_flows.returned"][3000]) / span
    chamber = float(np.mean(rows["control_chamber.fuel.pressure"][late]))
    nozzle_flow, _ = nozzle_by_hand(case, lift)
    drain_flow, drain_pressure = drain_by_hand(case, valve_lift)
    detail = f"needle {lift * 1e6:.0f} um open; limit: the chain still rings a little, fuel polynomials"
    ratios = {
        "steady flow of seat and nozzle": injected / nozzle_flow,
        "steady flow of Z-hole, A-hole and valve": returned / drain_flow,
        "steady control pressure": chamber / drain_pressure,
    }
    return [check(what + name, 100.0 * (ratio - 1.0), 0.1, "%", detail) for what, ratio in ratios.items()]


def books(injector: Injector) -> list[Check]:
    """Fuel in, less fuel out, less fuel stored, over the fuel injected."""
    worst = 0.0
    for boundary in (Boundary.IDEAL, Boundary.VOLUME):
        wired = replace(injector, variant=Variant(boundary=boundary))
        for pressure in (40e6, 100e6, 180e6):
            pulses = (Energising(0.0, 300e-6), Energising(1.2e-3, 500e-6))
            worst = max(worst, abs(simulate(wired, OperatingPoint(pressure, pulses)).balance))
    detail = "40, 100, 180 MPa, two injections, ideal rail and rail volume; limit: rounding of 4000 steps, with room"
    return [check("books of mass", worst, 1e-9, "1", detail)]


def _case(injector: Injector, values: dict[str, float]) -> Injector:
    wired = replace(injector, variant=Variant(Body.FLEXIBLE, Boundary.IDEAL, Drive.REGULATED))
    return wired.with_values(TIGHT | values)


ALL: tuple[Callable[[Injector], list[Check]], ...] = (joukowsky, pipe_period, chain_modes, steady_flow, books)

__all__ = ["ALL", "Check", "books", "chain_modes", "check", "joukowsky", "pipe_period", "steady_flow"]
