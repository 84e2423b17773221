"""Inputs and parameters that a variant does not read, so that none is ignored in silence."""

from __future__ import annotations

import functools

from commonrail.base.choices import Actuation, Body, Boundary, Drive
from commonrail.physics.components import drive, rail
from commonrail.physics.variants import Variant

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
_TRACED = (Drive.VOLTAGE, Drive.CURRENT)
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

    Returns tuple of str: of "rail_pressure" (that at rest is always read), "return_pressure", "drive" (a measured
    voltage or current) and "command" (energisings; with a measured drive they only say where an injection begins).
    """
    traced = variant.drive in _TRACED
    unread = {
        RAIL: variant.boundary is Boundary.VOLUME,
        RETURN: variant.actuation is Actuation.DIRECT,
        DRIVE: not traced,
        COMMAND: traced,
    }
    return tuple(name for name, is_unread in unread.items() if is_unread)


@functools.cache
def unread_parameters(variant: Variant) -> frozenset[str]:
    """Dotted names of the parameters that a variant does not read."""
    servo = variant.actuation is Actuation.SERVO
    unread = {"drive": {*drive.Parameters._fields}.difference(_READ_OF_DRIVE[variant.drive])}
    if servo and variant.boundary is Boundary.IDEAL:
        unread["rail"] = {*rail.Parameters._fields}
    if servo and variant.body is Body.RIGID:
        unread["plunger_needle"] = {*_CHAIN}
    return frozenset(f"{part}.{name}" for part, names in unread.items() for name in names)


def reader_of(name: str) -> str:
    """Words for the variants that read an input or a parameter, with their suffix of a model's name.

    `name`: input, or dotted name of a parameter.
    """
    if name in _READERS:
        return _READERS[name]
    part, _, key = name.partition(".")
    if part == "drive":
        kinds = [kind for kind, names in _READ_OF_DRIVE.items() if key in names]
        return " or ".join(f'drive_kind = "{kind.value}" (@{kind.value.replace(" ", "-")})' for kind in kinds)
    return _READERS[RAIL_TABLE] if part == "rail" else _READERS[CHAIN]
