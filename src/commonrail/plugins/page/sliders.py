"""Sliders of a page: their ends, narrowed where the time step would not bear a corner of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import candidate_matrix
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.time_step import longest_step, medium_of, stiffest_corner
from commonrail.physics.variants import Variant
from commonrail.plugins.page.subject import Slid, Subject, is_traced

ONE = np.empty((1, 0))  # the candidate that is the injector as it is
RAIL = (25e6, 200e6)  # ends of the sliders as far as the fuel's range reaches [Pa]
CYLINDER, RETURN = (0.1e6, 20e6), (0.05e6, 3e6)
ENERGISING, DWELL = (50e-6, 3e-3), (20e-6, 4e-3)  # [s]
LONG = 1.5e-3  # energising after which the needle has risen as far as it will [s]
LIFTED = 1.25  # margin on the largest lift, which takes room from the control chamber
SHRUNK = 24  # halvings of the share of the sliders' ranges that the time step bears


def variant_of(subject: Subject) -> Variant:
    """Wiring that a page simulates, with the laws that a moved slider may need."""
    return subject.injector.wired([s.name for s in subject.sliders])


def limits_of(subject: Subject, point: OperatingPoint) -> dict[str, tuple[float, float]]:
    """Ends of the sliders of an operating point [SI]; they hold the data's points and the first one's."""
    low, high = subject.injector.fuel.pressure_range
    points = [point, *subject.points]
    rails, cylinders, returns = np.array([p.initial_pressures() for p in points]).T

    def ends(usual: tuple[float, float], used: Floats) -> tuple[float, float]:
        return max(min(usual[0], used.min()), low), min(max(usual[1], used.max()), high)

    found = {"rail": ends(RAIL, rails), "cylinder": ends(CYLINDER, cylinders), "low": ends(RETURN, returns)}
    below = 0.9 * found["rail"][0]  # no other pressure reaches the rail's
    for name in ("cylinder", "low"):
        found[name] = found[name][0], min(found[name][1], below)
    return {name: (float(a), float(b)) for name, (a, b) in found.items()} | {"energising": ENERGISING, "dwell": DWELL}


def borne(subject: Subject, rail: float) -> tuple[tuple[Slid, ...], float]:
    """Sliders whose ranges the time step bears in every corner, and the share of the ranges that is left."""
    injector, variant = subject.injector, variant_of(subject)
    medium, lift = medium_of(injector, rail), LIFTED * _reached(subject, rail)

    def narrowed(share: float) -> tuple[Slid, ...]:
        return tuple(
            Slid(
                s.name, *(injector.values[s.name] + share * (end - injector.values[s.name]) for end in (s.low, s.high))
            )
            for s in subject.sliders
        )

    def bears(share: float) -> bool:
        sliders = narrowed(share)
        lower, upper = ({s.name: getattr(s, end) for s in sliders} for end in ("low", "high"))
        corner = replace(injector, values=stiffest_corner(injector.values, lower, upper), variant=variant)
        return subject.time_step <= longest_step(corner, candidate_matrix(corner, (), ONE)[0], medium, lift)

    if not bears(0.0):
        raise ConfigurationError(
            f"{injector.name}: the time step of {subject.time_step * 1e6:g} us is too long for it at "
            f"{rail * 1e-6:g} MPa, the highest rail pressure of the page; calibrate with a shorter time_step."
        )
    low, high = 0.0, 1.0
    if bears(high):
        return narrowed(high), high
    for _ in range(SHRUNK):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if bears(middle) else (low, middle)
    return narrowed(low), low


def _reached(subject: Subject, rail: float) -> float:
    """Largest lift [m] of the injector as it is, at the highest rail pressure."""
    points = [d.point for d in subject.data] if is_traced(subject.injector) else [OperatingPoint(rail, LONG)]
    return float(np.nanmax(simulate_batch(subject.injector, points, time_step=subject.time_step).greatest_lift))
