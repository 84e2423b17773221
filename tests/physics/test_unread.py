"""Inputs and parameters of each variant, by its laws as plain Python: one changes the result or is declared unread."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace

import pytest

import commonrail as cr
from commonrail.base.choices import Actuation, Body, Boundary, Drive, Laws
from commonrail.engine.plan import coefficients_at
from commonrail.physics.model import Inputs, Setting, Waves
from commonrail.physics.variants import (
    COMMAND,
    DRIVE,
    RAIL,
    RETURN,
    Variant,
    connections_of,
    unread_inputs,
    unread_parameters,
)

DT, STEPS, CHANGED = 2e-6, 200, 50
ON, OFF = 20e-6, 280e-6  # of the energising, or of the measured drive [s]
DRIVEN = 14.0  # measured voltage [V] or current [A]
FACTOR = 1.03

SERVO = [Variant(body, rail, drive, laws) for body in Body for rail in Boundary for drive in Drive for laws in Laws]
DIRECT = [Variant(drive=drive, laws=laws, actuation=Actuation.DIRECT) for drive in Drive for laws in Laws]
VARIANTS = pytest.mark.parametrize("variant", [*SERVO, *DIRECT], ids=lambda v: v.label)
FIELDS: dict[str, tuple[str, ...]] = {
    RAIL: ("rail",),
    "cylinder_pressure": ("cylinder",),
    RETURN: ("low",),
    DRIVE: ("trace",),
}
FIELDS[COMMAND] = ("since_start", "since_end")


@functools.cache
def base(actuation: Actuation) -> cr.Injector:
    """Injector whose currents reach all levels of their drive in the time that is simulated, and no zero among them."""
    injector = cr.load_injector("direct-acting-kr" if actuation is Actuation.DIRECT else "cri2-16")
    drive = {
        "drive.boost_voltage": 65.0,
        "drive.quench_voltage": 30.0,
        "drive.diode_voltage": 30.0,
        "drive.peak_duration": 60e-6,
    }
    return replace(injector, values={**injector.values, **drive, "drive.peak_current": 10.0, "drive.hold_current": 5.0})


def marched(variant: Variant, factors: Mapping[str, float] = {}, changed: tuple[str, ...] = ()) -> object:
    """State at the end, with parameters multiplied, or with inputs changed by 3 % or 30 us from a step on.

    The pipes are one step long, so that no ring is needed; the state is without the contents of an ideal rail, which
    nothing reads.
    """
    own = base(variant.actuation)
    scaled = {name: f * own.values[name] for name, f in factors.items()}
    injector = replace(own, variant=variant, values={**own.values, **scaled})
    rail = 20e6 if variant.actuation is Actuation.DIRECT else 100e6
    at = Setting(rail, 5e6, 0.5e6, DT)
    c = coefficients_at(injector, cr.OperatingPoint(*at[:1], "400 us", *at[1:3]), DT)
    state, waves = connections_of(variant).rest(c, at), Waves(rail, rail, at.low)
    for step in range(STEPS):
        now = step * DT
        trace = DRIVEN if ON <= now < OFF else 0.0
        inputs = Inputs(rail, at.cylinder, at.low, trace, now - ON, now - OFF)
        if step >= CHANGED:
            inputs = inputs._replace(**{name: _other(name, getattr(inputs, name)) for name in changed})
        state, waves = connections_of(variant).step(c, state, inputs, waves, DT)
    ideal = variant.boundary is Boundary.IDEAL and hasattr(state, "rail")
    return state._replace(rail=None) if ideal else state


@functools.cache
def unchanged(variant: Variant) -> object:
    """State at the end with the injector's own parameters and inputs."""
    return marched(variant)


def _other(name: str, value: float) -> float:
    return value + 30e-6 if name.startswith("since") else FACTOR * value


@VARIANTS
def test_an_input_changes_the_result_or_is_unread(variant: Variant) -> None:
    expected = unchanged(variant)
    without_effect = {name for name, fields in FIELDS.items() if marched(variant, changed=fields) == expected}
    assert without_effect == set(unread_inputs(variant))


@VARIANTS
def test_unread_parameters_change_nothing(variant: Variant) -> None:
    factors = dict.fromkeys(unread_parameters(variant), FACTOR)
    assert marched(variant, factors) == unchanged(variant)


@pytest.mark.parametrize("drive", list(Drive), ids=lambda d: d.value)
@pytest.mark.parametrize(("body", "rail"), [(Body.FLEXIBLE, Boundary.IDEAL), (Body.RIGID, Boundary.VOLUME)])
def test_the_other_parameters_of_rail_drive_and_chain_change_the_result(
    body: Body, rail: Boundary, drive: Drive
) -> None:
    variant = Variant(body, rail, drive)
    expected, unread = unchanged(variant), unread_parameters(variant)
    chain = [f"plunger_needle.{name}" for name in ("k1", "k4", "k7", "joint_stiffness", "damping_ratio")]
    names = [name for name in base(Actuation.SERVO).values if name.startswith(("rail.", "drive."))] + chain
    assert {name for name in names if marched(variant, {name: FACTOR}) == expected} == unread.intersection(names)
