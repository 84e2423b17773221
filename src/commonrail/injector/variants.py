"""Variants of the injector: the same rooms, wired differently."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.arguments import chosen
from commonrail.choices import Body, Boundary, Drive, Laws
from commonrail.injector import boundary
from commonrail.injector.layout import Layout, layout_of
from commonrail.injector.model import Coefficients, State
from commonrail.injector.setup import make_rest
from commonrail.injector.step import StepLaws, make_step
from commonrail.parts import drive, guide_friction, nozzle, plunger_needle, rigid_body, valve


class _Wired(NamedTuple):
    body: Body
    boundary: Boundary
    drive: Drive
    laws: Laws


class Variant(_Wired):
    """One wiring.

    Parameters
    ----------
    body : Body or str
        "flexible" or "rigid".
    boundary : Boundary or str
        "ideal" or "volume".
    drive : Drive or str
        "regulated", "pwm", "voltage trace", "current trace" or "free-wheel".
    laws : Laws or str
        "paper" or "extended"; an injector whose parameters need the extended laws is simulated with them in any case
        (`Injector.wired`).

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
        laws: Laws | str = Laws.PAPER,
    ) -> Variant:
        return super().__new__(
            cls,
            chosen(body, Body, "body"),
            chosen(boundary, Boundary, "boundary"),
            chosen(drive, Drive, "drive"),
            chosen(laws, Laws, "laws"),
        )

    @property
    def label(self) -> str:
        """Text that names it."""
        words = f"{self.body.value} body, {self.boundary.value} rail, {self.drive.value} drive"
        return words if self.laws is Laws.PAPER else f"{words}, {self.laws.value} laws"


class Wiring(NamedTuple):
    """Laws of a variant, and the layouts of its lane and of its body's positions.

    Attributes
    ----------
    body : module
        `plunger_needle` or `rigid_body`.
    laws : StepLaws
    accelerations : law
        Right-hand side of the body's motion.
    rest, step : law
        State at rest, and one time step.
    state, coefficients, positions : Layout
    """

    body: Any
    laws: StepLaws
    accelerations: Callable[..., Any]
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
    Drive.FREE_WHEEL: drive.free_wheel,
}
_Law = Callable[..., Any]
_MOTIONS: dict[tuple[Body, Laws], tuple[_Law, _Law]] = {
    (Body.FLEXIBLE, Laws.PAPER): (plunger_needle.advance, plunger_needle.accelerations),
    (Body.FLEXIBLE, Laws.EXTENDED): (guide_friction.advance_chain, guide_friction.accelerate_chain),
    (Body.RIGID, Laws.PAPER): (rigid_body.advance, rigid_body.accelerations),
    (Body.RIGID, Laws.EXTENDED): (guide_friction.advance_body, guide_friction.accelerate_body),
}
_FLOWS: dict[Laws, tuple[_Law, _Law]] = {
    Laws.PAPER: (nozzle.discharge, valve.gap_drive),
    Laws.EXTENDED: (nozzle.shaped_discharge, valve.laminar_gap_drive),
}

# Parameters that only the extended laws know: at zero the laws are the paper's.
EXTENDING = (
    *(f"nozzle.shape_{i}" for i in range(1, 9)),
    "valve.laminar_gap",
    "plunger_needle.viscous",
    "plunger_needle.friction",
)


@functools.cache
def wiring(variant: Variant) -> Wiring:
    """Laws and layouts of a variant."""
    ideal = variant.boundary is Boundary.IDEAL
    body, (advance, accelerations) = _BODIES[variant.body], _MOTIONS[variant.body, variant.laws]
    laws = StepLaws(
        advance,
        body.lifts,
        _DRIVES[variant.drive],
        boundary.ideal_rail if ideal else boundary.rail_volume,
        boundary.draw_nothing if ideal else boundary.draw_from_rail,
        *_FLOWS[variant.laws],
    )
    return Wiring(
        body,
        laws,
        accelerations,
        make_rest(body),
        make_step(laws),
        layout_of(State, (("body", body.State),)),
        layout_of(Coefficients),
        layout_of(body.Positions),
    )
