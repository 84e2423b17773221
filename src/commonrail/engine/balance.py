"""Mass balance of a whole simulation, from the traced state."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from commonrail.arrays import Floats
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import coefficients_at
from commonrail.injector.definition import Injector
from commonrail.parts import feed_pipe

SMALL = 1e-6  # a small pilot's mass [kg]: without an injection there is nothing to be relative to

_VOLUMES = ("control_chamber.fuel.mass", "accumulation.fuel.mass", "sac.mass")


def relative_balance(injector: Injector, point: OperatingPoint, states: Mapping[str, Floats], dt: float) -> float:
    """Balance of `relative_to_injected`.

    In: drawn from the rail. Out: injected, returned. Stored: the volumes that the injector has and the feed pipe.

    Parameters
    ----------
    injector : Injector
    point : OperatingPoint
    states : mapping of str to (steps + 1,)
        State after every step, by the names of `lanes.trace_paths`.
    dt : float
        Time step [s].
    """
    c = coefficients_at(injector, point, dt)
    stored = sum(float(states[name][-1] - states[name][0]) for name in _VOLUMES if name in states)
    stored += _pipe(states["waves.down"], c.delays.feed, dt * c.feed_pipe.admittance / 2)
    stored += _pipe(states["waves.up"], c.delays.feed, dt * c.feed_pipe.admittance / 2)
    inlet, end = states["feed_pipe.inlet_flow"][-1], states["feed_pipe.end_flow"][-1]
    # the ends' friction of the last step, taken off when a wave leaves and when it arrives, is still on its way
    late = feed_pipe.end_loss(c.feed_pipe, float(inlet)) - feed_pipe.end_loss(c.feed_pipe, float(end))
    stored += dt * c.feed_pipe.admittance / 2 * late
    injected = float(states["nozzle.injected"][-1])
    put_in = float(states["cumulative_flows.supplied"][-1])
    taken_out = injected + float(states["cumulative_flows.returned"][-1])
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
