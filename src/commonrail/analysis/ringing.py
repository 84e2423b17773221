"""Traces of the lanes, and what is read off them: an echo's delay, a frequency, the ringing of the chain."""

from __future__ import annotations

import math

import numpy as np

from commonrail.arrays import Floats
from commonrail.engine import lanes, plan
from commonrail.engine.operating_point import OperatingPoint
from commonrail.injector.definition import Injector
from commonrail.parts import plunger_needle
from commonrail.parts.chain import Nine
from commonrail.parts.plunger_needle import Loads, SeatContact, State


def traced(injector: Injector, point: OperatingPoint, dt: float) -> dict[str, Floats]:
    """State after every step by dotted name, leaving waves, and "time" [s]: each (steps + 1,).

    Parameters
    ----------
    injector : Injector
    point : OperatingPoint
    dt : float
        Time step [s].
    """
    prepared = plan.prepare(injector, [point], dt)
    _, trace = lanes.run(plan.make_job(prepared, prepared.row[None], False), injector.wired(), traced=True)
    rows = dict(zip(lanes.trace_paths(injector.variant), trace[0, :, :, 0].T.copy(), strict=True))
    return rows | {"time": point.start + dt * np.arange(trace.shape[1])}


def echo(time: Floats, arriving: Floats, leaving: Floats, near: float) -> float:
    """Delay [s] after which what left comes back with its sign changed.

    Parameters
    ----------
    time : (n,)
        [s].
    arriving, leaving : (n,)
        Waves.
    near : float
        Expected delay [s].
    """
    from scipy.optimize import minimize_scalar  # slow to import

    def miss(delay: float) -> float:
        return float(np.sum((arriving + np.interp(time - delay, time, leaving, left=0.0)) ** 2))

    coarse = np.linspace(0.8, 1.2, 401) * near
    best = float(coarse[np.argmin([miss(delay) for delay in coarse])])
    step = float(coarse[1] - coarse[0])
    return float(minimize_scalar(miss, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-10}).x)


def frequency(signal: Floats, dt: float, near: float) -> float:
    """Strongest frequency [1/s] of a signal, from a windowed Fourier integral.

    Parameters
    ----------
    signal : (n,)
    dt : float
        Time between values [s].
    near : float
        Expected frequency [1/s]; looked for between 0.3 and 1.3 times it.
    """
    from scipy.optimize import minimize_scalar  # slow to import

    shaped, time = signal * np.hanning(len(signal)), dt * np.arange(len(signal))

    def weakness(f: float) -> float:
        return -float(abs(np.sum(shaped * np.exp(-2j * np.pi * f * time))))

    coarse = np.linspace(0.3, 1.3, 501) * near
    best = float(coarse[np.argmin([weakness(f) for f in coarse])])
    return float(minimize_scalar(weakness, bounds=(0.99 * best, 1.01 * best), method="bounded").x)


def chain_matrices(k: Floats, masses: Floats, joint: float) -> tuple[Floats, Floats]:
    """Stiffness matrix [N/m] and nodal masses [kg] of the nine-mass chain in contact, Eq. (10).

    Parameters
    ----------
    k, masses : (7,)
        Stiffness and mass of the cylinders.
    joint : float
        Contact stiffness between masses 6 and 7.
    """
    springs = np.array([*k[:5], joint, *k[5:]])
    matrix = np.diag(np.append(springs, 0.0) + np.append(0.0, springs))
    matrix -= np.diag(springs, 1) + np.diag(springs, -1)
    plunger, needle = masses[:5], masses[5:]
    half = [np.append(part, 0.0) / 2 + np.append(0.0, part) / 2 for part in (plunger, needle)]
    return matrix, np.concatenate(half)


def chain_frequency(
    p: plunger_needle.Parameters, seat: SeatContact, shape: Floats, mass: Floats, omega: float, periods: int = 10
) -> float:
    """Angular frequency [1/s] of a small modal amplitude of the pressed chain, from its zero crossings.

    Parameters
    ----------
    p, seat
        Chain and seat.
    shape, mass : (9,)
        Mode, and nodal masses [kg].
    omega : float
        Expected angular frequency [1/s].
    periods : int
        Simulated.
    """
    dt = 2.0 * math.pi / omega / 200.0
    c = plunger_needle.coefficients(p, dt)
    load = Loads(-2000.0, 0.0, 0.0, 0.0, 0.0)
    rest = np.array(plunger_needle.at_rest(c, seat, load).z)
    away = 1e-8 * shape / np.abs(shape).max()
    before = Nine(*(0.5 * dt * omega**2 * away))
    state = State(Nine(*(rest + away)), before, before)
    course = np.empty(200 * periods)
    for i in range(len(course)):
        course[i] = (np.array(state.z) - rest) @ (mass * shape)
        state = plunger_needle.advance(c, seat, state, load, dt)
    at = np.flatnonzero(course[:-1] * course[1:] < 0.0)
    crossings = at + course[at] / (course[at] - course[at + 1])
    return float(math.pi * (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * dt))
