"""Variants of the injector: connections of its components, and the inputs and parameters that a variant ignores."""

from __future__ import annotations

import functools
import hashlib
import inspect
import sys
from collections.abc import Callable
from enum import Enum
from typing import Any, NamedTuple

from commonrail.base import registry
from commonrail.base.arguments import enum_member, plain_text
from commonrail.base.choices import Actuation, Body, Boundary, Drive, Laws
from commonrail.base.errors import ConfigurationError, InputError, nearest
from commonrail.physics import model
from commonrail.physics.components import drive, feed_pipe, nozzle, plunger_needle, valve
from commonrail.physics.law import Layout, layout_of, physics


class _Wired(NamedTuple):
    body: Body
    boundary: Boundary
    drive: Drive
    laws: Laws
    actuation: Actuation
    nozzle_law: str
    a_hole_law: str


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
    nozzle_law : str
        Law of c_d that an installed package registers under that name; "" for Eq. (9).
    a_hole_law : str
        Law of the A-hole that an installed package registers under that name; "" for the paper's.

    Raises
    ------
    ConfigurationError
        If a word is unknown, or a direct-acting injector has a rail volume or a law of the A-hole.
    """

    __slots__ = ()

    def __new__(
        cls,
        body: Body | str = Body.FLEXIBLE,
        boundary: Boundary | str = Boundary.IDEAL,
        drive: Drive | str = Drive.REGULATED,
        laws: Laws | str = Laws.PAPER,
        actuation: Actuation | str = Actuation.SERVO,
        nozzle_law: str = "",
        a_hole_law: str = "",
    ) -> Variant:
        acts, fed = enum_member(actuation, Actuation, "actuation"), enum_member(boundary, Boundary, "boundary")
        stated_body = enum_member(body, Body, "body")
        if acts is Actuation.DIRECT and fed is Boundary.VOLUME:
            raise ConfigurationError(
                'A direct-acting injector is fed from an ideal rail; set rail_boundary to "ideal", and give a measured '
                "rail pressure as a time series if it varies."
            )
        if acts is Actuation.DIRECT and a_hole_law:
            raise ConfigurationError("A direct-acting injector has no A-hole; omit a_hole_law.")
        for field, name in (("nozzle_law", nozzle_law), ("a_hole_law", a_hole_law)):
            group, what = INSTALLED_LAWS[field]
            if plain_text(name, field) and registry.find(group, name) is None:
                raise ConfigurationError(
                    f'There is no {what} "{name}"{nearest(name, registry.find_installed(group))}: no installed package '
                    f"registers it in commonrail.{group}."
                )
        return super().__new__(
            cls,
            Body.RIGID if acts is Actuation.DIRECT else stated_body,
            fed,
            enum_member(drive, Drive, "drive"),
            enum_member(laws, Laws, "laws"),
            acts,
            nozzle_law,
            a_hole_law,
        )

    _make = classmethod(lambda cls, values: cls(*values))  # type: ignore[assignment]  # `_replace` checks too

    @property
    def words(self) -> tuple[str, ...]:
        """Arguments that make this variant, as text."""
        return tuple(str(getattr(choice, "value", choice)) for choice in self)

    @property
    def label(self) -> str:
        """Text that names it."""
        body = "direct-acting needle" if self.actuation is Actuation.DIRECT else f"{self.body.value} body"
        words = f"{body}, {self.boundary.value} rail, {self.drive.value} drive"
        words += "" if self.laws is Laws.PAPER else f", {self.laws.value} laws"
        installed_laws = {what: getattr(self, field) for field, (_, what) in INSTALLED_LAWS.items()}
        return ", ".join((words, *(f"{what} {name}" for what, name in installed_laws.items() if name)))


class Wiring(NamedTuple):
    """Laws of a variant's components, and layouts of its parameters, state, coefficients and positions."""

    body: model.Body
    accelerations: model.Accelerations
    drive: model.DriveLaw
    discharge: model.DischargeLaw
    setup: Callable[..., Any]  # coefficients from parameters
    longest_contact: Callable[..., Any]  # longest contact of a bounce on a seat
    farthest: Callable[..., Any]  # lift beyond which the body has passed its stop
    parameters: Layout
    state: Layout
    coefficients: Layout
    positions: Layout


_DRIVES: dict[Drive, model.DriveLaw] = {
    Drive.REGULATED: drive.current_regulator,
    Drive.PWM: drive.pwm,
    Drive.VOLTAGE: drive.voltage_trace,
    Drive.CURRENT: drive.current_trace,
    Drive.FREE_WHEEL: drive.free_wheel,
}
_DISCHARGES: dict[Laws, model.DischargeLaw] = {Laws.PAPER: nozzle.discharge, Laws.EXTENDED: nozzle.shaped_discharge}

# Parameters that only the extended laws know: at zero the laws are the paper's.
EXTENDING = (
    *(f"nozzle.shape_{i}" for i in range(1, 9)),
    "valve.seat_land",
    "plunger_needle.viscous",
    "plunger_needle.friction",
    "plunger_needle.gap_widening",
    "valve.stop_disc",
    "valve.seat_disc",
)

# Laws of installed packages by field of a variant: group of the registry, and description.
INSTALLED_LAWS = {"nozzle_law": ("nozzle_laws", "nozzle law"), "a_hole_law": ("a_hole_laws", "law of the A-hole")}


# Modules that only one variant needs are imported with it.


def model_of(actuation: Actuation) -> Any:
    """Module that holds `Parameters`, `Coefficients` and `State` of an actuation."""
    if actuation is Actuation.SERVO:
        return model
    from commonrail.physics import direct_acting

    return direct_acting


def _body_of(variant: Variant) -> tuple[model.Body, model.Advance, model.Accelerations]:
    """Body of a servo injector, and its motion under the laws."""
    body: model.Body = plunger_needle
    if rigid := variant.body is Body.RIGID:
        from commonrail.physics.components import rigid_body

        body = rigid_body
    if variant.laws is Laws.PAPER:
        return body, body.advance, body.accelerations
    from commonrail.physics.components import guide_friction as friction

    if rigid:
        return body, friction.advance_body, friction.accelerate_body
    return body, friction.advance_chain, friction.accelerate_chain


@functools.cache
def _load_law(field: str, name: str) -> Any:
    """Law of another package, which kernels may inline from now on; `field`: of `INSTALLED_LAWS`."""
    group, what = INSTALLED_LAWS[field]
    entry = registry.find(group, name)
    law = None if entry is None else entry.load()
    if entry is None or not inspect.isfunction(law):
        raise ConfigurationError(f'The {what} "{name}" is no function; update or uninstall its package.')
    return physics(law)


def _discharge(variant: Variant) -> model.DischargeLaw:
    if variant.nozzle_law:
        return _load_law("nozzle_law", variant.nozzle_law)  # type: ignore[no-any-return]
    return _DISCHARGES[variant.laws]


def kernel_name(variant: Variant) -> str:
    """Text by which kernels of variants differ: the label, and a digest of each module of a law from elsewhere."""
    laws = [_load_law(field, name) for field in INSTALLED_LAWS if (name := getattr(variant, field))]
    sources = [inspect.getsource(sys.modules[law.__module__]) for law in laws]
    return " ".join((variant.label, *(hashlib.sha256(source.encode()).hexdigest() for source in sources)))


@functools.cache
def wiring(variant: Variant) -> Wiring:
    """Laws of a variant's components, and its layouts."""
    return _direct(variant) if variant.actuation is Actuation.DIRECT else _servo(variant)


def _servo(variant: Variant) -> Wiring:
    body, _, accelerations = _body_of(variant)
    return Wiring(
        body=body,
        accelerations=accelerations,
        drive=_DRIVES[variant.drive],
        discharge=_discharge(variant),
        setup=model.coefficients,
        longest_contact=model.longest_contact,
        farthest=model.farthest_lift,
        parameters=layout_of(model.Parameters),
        state=layout_of(model.State, (("body", body.State),)),
        coefficients=layout_of(model.Coefficients),
        positions=layout_of(body.Positions),
    )


def _direct(variant: Variant) -> Wiring:
    from commonrail.physics import direct_acting
    from commonrail.physics.components import direct_needle

    return Wiring(
        body=direct_needle,
        accelerations=direct_needle.accelerations,
        drive=_DRIVES[variant.drive],
        discharge=_discharge(variant),
        setup=direct_acting.coefficients,
        longest_contact=direct_acting.longest_contact,
        farthest=direct_acting.farthest_lift,
        parameters=layout_of(direct_acting.Parameters),
        state=layout_of(direct_acting.State),
        coefficients=layout_of(direct_acting.Coefficients),
        positions=layout_of(direct_needle.Positions),
    )


class Connections(NamedTuple):
    """Laws between the components of a variant."""

    step: Callable[..., Any]  # one time step
    rest: Callable[..., Any]  # state before energising: function (coefficients, setting)
    volumes: Callable[..., Any]  # volumes that moving masses leave to the fuel, from their lifts
    laws: Any  # `StepLaws`; None for a direct-acting injector, which has laws of its own


@functools.cache
def connections_of(variant: Variant) -> Connections:
    """Laws between the components of a variant; imported on demand: a compiled kernel needs none of them."""
    from commonrail.physics import connections, rest, step

    wired = wiring(variant)
    if variant.actuation is Actuation.DIRECT:
        from commonrail.physics import direct_acting

        direct = direct_acting.DirectLaws(wired.drive, step.ideal_rail, wired.discharge)
        return Connections(direct_acting.make_step(direct), direct_acting.rest, direct_acting.volumes_of, None)
    ideal = variant.boundary is Boundary.IDEAL
    chosen_laws: dict[Laws, tuple[model.GapLaw, model.LeakLaw, model.FilmLaw]] = {
        Laws.PAPER: (connections.plain_gap_cda2, connections.guide_leak, valve.no_film),
        Laws.EXTENDED: (connections.land_gap_cda2, connections.widening_leak, valve.film_damping),
    }
    gap_cda2, leak, film = chosen_laws[variant.laws]
    laws = step.StepLaws(
        advance=_body_of(variant)[1],
        lifts=wired.body.lifts,
        drive=wired.drive,
        inlet=step.ideal_rail if ideal else step.rail_volume,
        draw=step.draw_nothing if ideal else step.draw_from_rail,
        discharge=wired.discharge,
        gap_cda2=gap_cda2,
        leak=leak,
        film=film,
        a_hole=_load_law("a_hole_law", variant.a_hole_law) if variant.a_hole_law else connections.a_hole,
    )
    at_rest = rest.make_rest(wired.body, leak, variant.boundary)
    return Connections(step.make_step(laws), at_rest, connections.volumes_of, laws)


# Inputs and parameters that a variant does not read; they are refused instead of being ignored.

# Inputs of a step; cylinder pressure is read by all variants.
RAIL, RETURN, DRIVE, COMMAND = "rail_pressure", "return_pressure", "drive", "command"

RAIL_TABLE, CHAIN = "rail", "chain"

_READERS = {
    RAIL: 'rail_boundary = "ideal" (@ideal)',
    RETURN: 'actuation = "servo"',
    DRIVE: 'drive_kind = "current trace" (@current-trace) or "voltage trace" (@voltage-trace)',
    COMMAND: 'drive_kind = "regulated" (@regulated), "pwm" (@pwm) or "free-wheel" (@free-wheel)',
    RAIL_TABLE: 'rail_boundary = "volume" (@volume)',
    CHAIN: 'variant = "flexible" (@flexible)',
}
_CHAIN = (*(f"k{i}" for i in range(1, 8)), "joint_stiffness", "damping_ratio")  # deformation of plunger and needle
_REGULATED = ("boost_voltage", "peak_current", "peak_duration", "hold_current", "regulator_gain")
_READ_OF_DRIVE = {  # fields of `drive.Parameters` that each law of the drive reads
    Drive.REGULATED: (*_REGULATED, "quench_voltage"),
    Drive.FREE_WHEEL: (*_REGULATED, "diode_voltage"),
    Drive.PWM: (*_REGULATED, "quench_voltage", "supply_voltage", "peak_band", "hold_band"),
    Drive.VOLTAGE: (),
    Drive.CURRENT: ("regulator_gain",),
}


def unread_inputs(variant: Variant) -> tuple[str, ...]:
    """Inputs that a variant does not read while it is simulated.

    Returns a tuple with some of "rail_pressure" (its value at rest is always read), "return_pressure", "drive" (a
    measured voltage or current) and "command" (energisings; with a measured drive they only mark the start).
    """
    unread = {
        RAIL: variant.boundary is Boundary.VOLUME,
        RETURN: variant.actuation is Actuation.DIRECT,
        DRIVE: not variant.drive.is_trace,
        COMMAND: variant.drive.is_trace,
    }
    return tuple(name for name, is_unread in unread.items() if is_unread)


@functools.cache
def unread_parameters(variant: Variant) -> frozenset[str]:
    """Dotted names of the parameters that a variant does not read."""
    servo = variant.actuation is Actuation.SERVO
    unread = {"drive": {*drive.Parameters._fields}.difference(_READ_OF_DRIVE[variant.drive])}
    if servo and variant.boundary is Boundary.IDEAL:
        unread["rail"] = {*feed_pipe.RailParameters._fields}
    if servo and variant.body is Body.RIGID:
        unread["plunger_needle"] = {*_CHAIN}
    return frozenset(f"{component}.{name}" for component, names in unread.items() for name in names)


def reader_of(name: str) -> str:
    """Words for the variants that read an input or a parameter, with their suffix in model names.

    `name`: input, or dotted name of a parameter.
    """
    if name in _READERS:
        return _READERS[name]
    component, _, key = name.partition(".")
    if component == "drive":
        kinds = [kind for kind, names in _READ_OF_DRIVE.items() if key in names]
        return " or ".join(f'drive_kind = "{kind.value}" (@{kind.value.replace(" ", "-")})' for kind in kinds)
    return _READERS[RAIL_TABLE] if component == "rail" else _READERS[CHAIN]


# Words that change a variant, as in "cri2-16@rigid,pwm".

_CHANGED: dict[str, type[Enum]] = {"body": Body, "boundary": Boundary, "drive": Drive}
_WORDS = {str(word.value).replace(" ", "-"): (field, word) for field, kind in _CHANGED.items() for word in kind}


def apply_words(variant: Variant, words: str) -> Variant:
    """Variant changed by words that commas separate; `InputError` if one is unknown or contradicts the rest."""
    changes: dict[str, Enum] = {}
    for word in (item.strip().replace(" ", "-") for item in words.split(",")):
        if word not in _WORDS:
            raise InputError(f'"{word}" is no variant{nearest(word, _WORDS)}; choose from {", ".join(_WORDS)}.')
        field, member = _WORDS[word]
        if changes.setdefault(field, member) is not member:
            raise InputError(f'"{changes[field].value}" and "{word}" contradict each other; keep one.')
    if variant.actuation is Actuation.DIRECT and changes.get("body") is Body.FLEXIBLE:
        raise InputError('a direct-acting injector has a rigid body; omit "flexible".')
    return Variant(**{**variant._asdict(), **changes})
