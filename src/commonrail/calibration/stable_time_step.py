"""Time step of a study: short enough for every candidate within its bounds."""

from __future__ import annotations

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.space import Space
from commonrail.engine.time_step import DEFAULT_STEP, TIME_STEPS, longest, medium_of, nice_step, stiffest_corner
from commonrail.physics.injector import Injector
from commonrail.physics.meters import is_of_meter


def longest_for_all(injector: Injector, space: Space) -> float:
    """Longest step [s] that every candidate within the bounds bears, at any pressure of the fuel's range."""
    lower, upper = (
        {name: value for name, value in zip(space.names, bound.tolist(), strict=True) if not is_of_meter(name)}
        for bound in (space.lower, space.upper)
    )
    corner = stiffest_corner(injector.values, lower, upper)
    return longest(injector.variant, corner, medium_of(injector, injector.fuel.pressure_range[1]))


def step_for_all(injector: Injector, space: Space) -> float:
    """Default step [s], or the largest round one that the stiffest corner of the bounds bears if that is shorter.

    Raises `ConfigurationError` if no step that the engines accept is short enough.
    """
    step = min(DEFAULT_STEP, nice_step(longest_for_all(injector, space)))
    if step < TIME_STEPS.low:
        raise ConfigurationError(
            "No time step is short enough for the stiffest parameters within the bounds; narrow the bounds of "
            "stiffnesses, masses, volumes and lengths, or check their units."
        )
    return step
