"""Mass balance of a whole simulation, from the traced state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from commonrail.engine.operating_point import OperatingPoint
from commonrail.fuel.coefficients import fuel_coefficients
from commonrail.injector import setup
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector
from commonrail.injector.model import Setting
from commonrail.parts import feed_pipe

Floats = NDArray[np.float64]

SMALL = 1e-6  # a small pilot's mass [kg]: without an injection there is nothing to be relative to

_VOLUMES = ("control_chamber.fuel.mass", "accumulation.fuel.mass", "sac.mass")


def relative_balance(injector: Injector, point: OperatingPoint, names: Sequence[str], rows: Floats, dt: float) -> float:
    """Balance of `relative_to_injected` from the state after every step, (steps + 1, rows).

    In: drawn from the rail. Out: injected, returned. Stored: the three volumes and the feed pipe.
    """
    at = Setting(*point.initial_pressures(), dt)
    fuel = fuel_coefficients(injector.fuel, injector.values[FUEL_TEMPERATURE])
    c = setup.coefficients(injector.parameters, fuel, at)

    def column(name: str) -> Floats:
        return np.asarray(rows[:, names.index(name)])

    stored = sum(float(column(name)[-1] - column(name)[0]) for name in _VOLUMES)
    stored += _pipe(column("waves.down"), c.delays.feed, dt * c.feed_pipe.admittance / 2)
    stored += _pipe(column("waves.up"), c.delays.feed, dt * c.feed_pipe.admittance / 2)
    inlet, end = column("feed_pipe.inlet_flow")[-1], column("feed_pipe.end_flow")[-1]
    # the ends' friction of the last step, taken off when a wave leaves and when it arrives, is still on its way
    late = feed_pipe.end_loss(c.feed_pipe, float(inlet)) - feed_pipe.end_loss(c.feed_pipe, float(end))
    stored += dt * c.feed_pipe.admittance / 2 * late
    injected = float(column("nozzle.injected")[-1])
    put_in = float(column("books.supplied")[-1])
    taken_out = injected + float(column("books.returned")[-1])
    left = put_in - taken_out - stored
    return relative_to_injected(left, injected)


def relative_to_injected(left: float, injected: float) -> float:
    """Mass that the books miss [kg] relative to what was injected, and to `SMALL` where less was [1]."""
    return float(left / max(injected, SMALL))


def _pipe(wave: Floats, delay: float, share: float) -> float:
    """Gain in fuel under way [kg]: the waves that have left but not arrived, less those at the start."""
    whole = int(min(max(delay, 1.0), len(wave)))  # a wave under way longer than the simulation has not left yet
    part = max(delay, 1.0) - whole
    weights = np.concatenate((np.ones(whole), [part]))
    recent = wave[::-1][: whole + 1]
    return float(share * np.sum(weights[: len(recent)] * (recent - wave[0])))
