"""Variants of the injector: the same components, connected differently."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.base.arguments import chosen
from commonrail.base.choices import Actuation, Body, Boundary, Drive, Laws
from commonrail.base.errors import ConfigurationError
from commonrail.physics import boundary, connections, model, protocols, setup
from commonrail.physics.components import direct_needle, drive, guide_friction, nozzle, plunger_needle, rigid_body
from commonrail.physics.direct import model as direct_model
from commonrail.physics.direct import model as direct_setup
from commonrail.physics.direct import step as direct_step
from commonrail.physics.layout import Layout, layout_of
from commonrail.physics.step import StepLaws, make_step


class _Wired(NamedTuple):
    body: Body
    boundary: Boundary
    drive: Drive
    laws: Laws
    actuation: Actuation


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
    actuation : Actuation or str
        "servo" or "direct". A direct-acting injector has a rigid body, whatever is given, and an ideal rail.

    Raises
    ------
    ConfigurationError
        If one is no such word, or a direct-acting injector is to be fed from a rail volume.
    """

    __slots__ = ()

    def __new__(
        cls,
        body: Body | str = Body.FLEXIBLE,
        boundary: Boundary | str = Boundary.IDEAL,
        drive: Drive | str = Drive.REGULATED,
        laws: Laws | str = Laws.PAPER,
        actuation: Actuation | str = Actuation.SERVO,
    ) -> Variant:
        acts, fed = chosen(actuation, Actuation, "actuation"), chosen(boundary, Boundary, "boundary")
        given = chosen(body, Body, "body")
        if acts is Actuation.DIRECT and fed is Boundary.VOLUME:
            raise ConfigurationError(
                'A direct-acting injector is fed from an ideal rail; set rail_boundary to "ideal", and give a measured '
                "rail pressure as a time series if it varies."
            )
        return super().__new__(
            cls,
            Body.RIGID if acts is Actuation.DIRECT else given,
            fed,
            chosen(drive, Drive, "drive"),
            chosen(laws, Laws, "laws"),
            acts,
        )

    @property
    def label(self) -> str:
        """Text that names it."""
        body = "direct-acting needle" if self.actuation is Actuation.DIRECT else f"{self.body.value} body"
        words = f"{body}, {self.boundary.value} rail, {self.drive.value} drive"
        return words if self.laws is Laws.PAPER else f"{words}, {self.laws.value} laws"


class Wiring(NamedTuple):
    """Laws of a variant, and the layouts of its parameters, its lane and its body's positions.

    Attributes
    ----------
    body : module
        `plunger_needle`, `rigid_body` or `direct_needle`.
    laws : StepLaws or DirectLaws
    accelerations : law
        Right-hand side of the body's motion.
    setup, rest, step : law
        Coefficients from parameters, state at rest, and one time step.
    volumes : law
        Volumes that moving masses leave to the fuel, from their lifts.
    longest_contact : law
        Longest time for which what has closed may touch and yet leave its seat again.
    farthest : law
        Lift beyond which the body has passed its stop.
    parameters, state, coefficients, positions : Layout
    """

    body: protocols.Body
    laws: Any
    accelerations: protocols.Accelerations
    setup: Callable[..., Any]
    rest: Callable[..., Any]
    step: Callable[..., Any]
    volumes: Callable[..., Any]
    longest_contact: Callable[..., Any]
    farthest: Callable[..., Any]
    parameters: Layout
    state: Layout
    coefficients: Layout
    positions: Layout


_BODIES: dict[Body, protocols.Body] = {Body.FLEXIBLE: plunger_needle, Body.RIGID: rigid_body}
_DRIVES: dict[Drive, protocols.DriveLaw] = {
    Drive.REGULATED: drive.regulated,
    Drive.PWM: drive.pwm,
    Drive.VOLTAGE: drive.voltage_trace,
    Drive.CURRENT: drive.current_trace,
    Drive.FREE_WHEEL: drive.free_wheel,
}
_MOTIONS: dict[tuple[Body, Laws], tuple[protocols.Advance, protocols.Accelerations]] = {
    (Body.FLEXIBLE, Laws.PAPER): (plunger_needle.advance, plunger_needle.accelerations),
    (Body.FLEXIBLE, Laws.EXTENDED): (guide_friction.advance_chain, guide_friction.accelerate_chain),
    (Body.RIGID, Laws.PAPER): (rigid_body.advance, rigid_body.accelerations),
    (Body.RIGID, Laws.EXTENDED): (guide_friction.advance_body, guide_friction.accelerate_body),
}
_FLOWS: dict[Laws, tuple[protocols.Discharge, protocols.ValveGap]] = {
    Laws.PAPER: (nozzle.discharge, connections.plain_gap_cda2),
    Laws.EXTENDED: (nozzle.shaped_discharge, connections.land_gap_cda2),
}

# Parameters that only the extended laws know: at zero the laws are the paper's.
EXTENDING = (
    *(f"nozzle.shape_{i}" for i in range(1, 9)),
    "valve.seat_land",
    "plunger_needle.viscous",
    "plunger_needle.friction",
)


# Modules that hold `Parameters`, `Coefficients` and `State` of each actuation.
MODELS: dict[Actuation, Any] = {Actuation.SERVO: model, Actuation.DIRECT: direct_model}


@functools.cache
def wiring(variant: Variant) -> Wiring:
    """Laws and layouts of a variant."""
    return _direct(variant) if variant.actuation is Actuation.DIRECT else _servo(variant)


def _servo(variant: Variant) -> Wiring:
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
        body=body,
        laws=laws,
        accelerations=accelerations,
        setup=setup.coefficients,
        rest=setup.make_rest(body),
        step=make_step(laws),
        volumes=connections.volumes_of,
        longest_contact=setup.longest_contact,
        farthest=setup.farthest_lift,
        parameters=layout_of(model.Parameters),
        state=layout_of(model.State, (("body", body.State),)),
        coefficients=layout_of(model.Coefficients),
        positions=layout_of(body.Positions),
    )


def _direct(variant: Variant) -> Wiring:
    discharge, _ = _FLOWS[variant.laws]
    laws = direct_step.DirectLaws(_DRIVES[variant.drive], boundary.ideal_rail, discharge)
    return Wiring(
        body=direct_needle,
        laws=laws,
        accelerations=direct_needle.accelerations,
        setup=direct_setup.coefficients,
        rest=direct_setup.rest,
        step=direct_step.make_step(laws),
        volumes=direct_step.volumes_of,
        longest_contact=direct_setup.longest_contact,
        farthest=direct_setup.farthest_lift,
        parameters=layout_of(direct_model.Parameters),
        state=layout_of(direct_model.State),
        coefficients=layout_of(direct_model.Coefficients),
        positions=layout_of(direct_needle.Positions),
    )
