"""Checks of an operating point against the injector that is simulated at it."""

from __future__ import annotations

from commonrail.choices import Boundary
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.errors import ConfigurationError
from commonrail.injector.definition import Injector
from commonrail.injector.reads import DRIVE, RETURN, reader_of, unread_inputs

__all__ = ["check_inputs", "check_point"]

ROUNDING = 1e-9  # of a pressure: a conversion of units must not lie outside a range


def check_inputs(injector: Injector, point: OperatingPoint) -> None:
    """Refuse measured courses that the injector does not read, which would be ignored in silence.

    Raises
    ------
    ConfigurationError
        If the point has a measured drive and the injector another kind of drive, or a course of the return pressure
        and the injector no return.
    """
    unread = unread_inputs(injector.variant)
    if DRIVE in unread and point.drive is not None:
        raise ConfigurationError(
            f"{injector.name} has a {injector.variant.drive.value} drive and does not read the measured drive of the "
            f"operating point; take {reader_of(DRIVE)}, or omit it."
        )
    if RETURN in unread and isinstance(point.return_pressure, Trace):
        raise ConfigurationError(
            f"{injector.name} is a {injector.variant.actuation.value} injector, without a return: it does not read the "
            "measured return pressure of the operating point; give a number."
        )


def check_point(injector: Injector, point: OperatingPoint) -> None:
    """Refuse a point that the injector's model or its fuel does not cover.

    Pressure waves inside the injector may pass the fuel's range; its polynomials are fitted beyond it for that.

    Raises
    ------
    ConfigurationError
        If a boundary pressure lies outside the fuel's range, or a rail that is a volume is given a pressure trace.
    """
    if injector.variant.boundary is Boundary.VOLUME and isinstance(point.rail_pressure, Trace):
        raise ConfigurationError(
            f"{injector.name} is fed from a rail volume, whose pressure is simulated from its value at the start, but "
            'the operating point gives a measured trace of it; set rail_boundary to "ideal", so that the trace is the '
            "pressure at the inlet, or give the rail pressure as one number."
        )
    low, high = injector.fuel.pressure_range
    for name, course in point.pressures.items():
        values = course.value if isinstance(course, Trace) else (course,)
        for value in (min(values), max(values)):
            if not low * (1.0 - ROUNDING) <= value <= high * (1.0 + ROUNDING):
                raise ConfigurationError(
                    f"The {name} reaches {value * 1e-6:g} MPa, but the fuel {injector.fuel.name} is declared from "
                    f"{low * 1e-6:g} to {high * 1e-6:g} MPa; give a pressure inside this range, or another fuel."
                )
