"""Variants of the injector: the same rooms, wired differently."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.arguments import chosen
from commonrail.choices import Body, Boundary, Drive
from commonrail.injector import boundary
from commonrail.injector.layout import Layout, layout_of
from commonrail.injector.model import Coefficients, State
from commonrail.injector.setup import make_rest
from commonrail.injector.step import make_step
from commonrail.parts import drive, plunger_needle, rigid_body


class _Wired(NamedTuple):
    body: Body
    boundary: Boundary
    drive: Drive


class Variant(_Wired):
    """One wiring.

    Parameters
    ----------
    body : Body or str
        "flexible" or "rigid".
    boundary : Boundary or str
        "ideal" or "volume".
    drive : Drive or str
        "regulated", "pwm", "voltage trace" or "current trace".

    Raises
    ------
    ConfigurationError
        If one is no such word.
    """

    __slots__ = ()

    def __new__(
        cls,
        body: Body | str = Body.FLEXIBLE,
        boundary: Boundary | str = Boundary.IDEAL,
        drive: Drive | str = Drive.REGULATED,
    ) -> Variant:
        return super().__new__(
            cls, chosen(body, Body, "body"), chosen(boundary, Boundary, "boundary"), chosen(drive, Drive, "drive")
        )

    @property
    def label(self) -> str:
        """Text that names it."""
        return f"{self.body.value} body, {self.boundary.value} rail, {self.drive.value} drive"


class Wiring(NamedTuple):
    """Laws of a variant, and the layouts of its lane and of its body's positions."""

    body: Any
    rest: Callable[..., Any]
    step: Callable[..., Any]
    state: Layout
    coefficients: Layout
    positions: Layout


_BODIES = {Body.FLEXIBLE: plunger_needle, Body.RIGID: rigid_body}
_DRIVES = {
    Drive.REGULATED: drive.regulated,
    Drive.PWM: drive.pwm,
    Drive.VOLTAGE: drive.voltage_trace,
    Drive.CURRENT: drive.current_trace,
}


@functools.cache
def wiring(variant: Variant) -> Wiring:
    """Laws and layouts of a variant."""
    ideal = variant.boundary is Boundary.IDEAL
    body = _BODIES[variant.body]
    return Wiring(
        body,
        make_rest(body),
        make_step(
            body,
            _DRIVES[variant.drive],
            boundary.ideal_rail if ideal else boundary.rail_volume,
            boundary.draw_nothing if ideal else boundary.draw_from_rail,
        ),
        layout_of(State, (("body", body.State),)),
        layout_of(Coefficients),
        layout_of(body.Positions),
    )
