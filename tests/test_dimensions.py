"""Dimensions of every law: what goes in with its documented unit comes out with its documented unit."""

from __future__ import annotations

import functools
import inspect
import itertools
import textwrap
from collections.abc import Iterator
from typing import Any, NamedTuple, get_args, get_type_hints

import pint
import pytest

from commonrail.base.choices import Actuation, Body, Boundary, Drive, Laws
from commonrail.physics import direct_acting, flow, fuel_kernel
from commonrail.physics import model as servo_model
from commonrail.physics.components import (
    contact,
    direct_needle,
    drive,
    feed_pipe,
    guide_friction,
    needle_seat,
    nozzle,
    plunger_needle,
    return_line,
    rigid_body,
    solenoid,
    valve,
)
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.physics.injector import FUEL_TEMPERATURE
from commonrail.physics.model import Inputs, Setting, Waves
from commonrail.physics.variants import EXTENDING, Variant, connections_of, wiring
from commonrail.readers.injector import load_injector
from tests.dimensions import (
    UNIFORM,
    Law,
    carried,
    check_returned,
    documented,
    laws,
    quantity,
    same_dimension,
    si,
    with_units,
)
from tests.every import check_every

LAWS = laws()

# Laws that have no units of their own, and why.
WITHOUT = {
    "flow.square": "squares a number of any unit",
    "components.drive.clamp": "limits a number of any unit",
    "components.plunger_needle.across": "subtracts numbers of any unit",
    "components.plunger_needle.around": "adds numbers of any unit",
}

# A plausible value in each documented unit. The trials multiply them, so that laws with branches take both.
VALUES = {
    "1": 0.7, "s": 1e-6, "m": 3e-5, "m²": 1e-6, "m³": 1e-8, "m⁴": 3e-16, "1/m³": 1e8, "m/s": 1.5, "kg": 8.6e-6,
    "1/kg": 300.0, "kg/m³": 850.0, "kg/m3": 850.0, "kg/s": 0.02, "N": 100.0, "N/m": 1e8, "s/m": 0.2, "Pa": 9e7,
    "Pa s": 2e-3, "kg/(s Pa)": 1e-9, "Pa m³/kg": 2e6, "m⁴ Pa": 1e-8, "s/m²": 5e5, "V": 14.0, "A": 10.0, "V/A": 100.0,
    "Wb": 5e-5, "s/kg": 1e-4, "N s/m": 2.0, "m/Pa": 2e-14, "1/Pa": 9e-9,
}  # fmt: skip
TRIALS = (1.0, 1e-3, 1e2)

TUPLES: dict[type, tuple[float, ...]] = {
    valve.State: (2e-5, 0.5),
    rigid_body.State: (2e-5, 0.5),
    feed_pipe.State: (0.02, 0.01),
    drive.State: (1.0,),
    return_line.State: (60.0, 2e-9),
    drive.Schedule: (1.0, 0.4),
    flow.Restriction: (3e-8, 3e-16),
    drive.Rate: (40.0, 30.0, 2e4),
    drive.Backward: (3.0, 0.7),
    solenoid.Circuit: (10.0, 3e5, 0.01),
}
AT = Setting(160e6, 5e6, 0.5e6, 1e-6)


class Model(NamedTuple):
    """Parameters, fuel, boundary values and coefficients of the virtual injector, all of them quantities."""

    p: Any
    f: Any
    at: Any
    c: Any
    load: Any


class DirectModel(NamedTuple):
    """Parameters, boundary values and coefficients of the direct-acting injector, all of them quantities."""

    p: Any
    at: Any
    c: Any


@functools.cache
def direct_model() -> DirectModel:
    injector = load_injector("direct-acting-kr")
    f = with_units(fuel_kernel.FuelCoefficients, fuel_coefficients(injector.fuel, injector.values[FUEL_TEMPERATURE]))
    plain = injector.with_values({"armature.spring_stiffness": 1e3}).parameters
    p = plain._make(with_units(type(room), room) for room in plain)
    at = Setting._make(map(quantity, (20e6, 0.1e6, 0.1e6, 1e-6), ("Pa", "Pa", "Pa", "s")))
    with carried():
        return DirectModel(p, at, direct_acting.coefficients(p, f, at))


@functools.cache
def model() -> Model:
    injector = load_injector("virtual-lino-2016")
    f = with_units(fuel_kernel.FuelCoefficients, fuel_coefficients(injector.fuel, injector.values[FUEL_TEMPERATURE]))
    further = dict.fromkeys(EXTENDING, 1e-6) | {"nozzle.discharge_growth": 1e-10, "nozzle.knot_6": 500e-6}
    further |= {"plunger_needle.gap_widening": 2e-14, "plunger_needle.eccentricity": 0.3}
    plain = injector.with_values({"solenoid.eddy_lag": 20e-6, "return_line.length": 0.5, **further}).parameters
    p = plain._make(with_units(type(room), room) for room in plain)
    at = Setting._make(map(quantity, AT, ("Pa", "Pa", "Pa", "s")))
    with carried():
        c = servo_model.coefficients(p, f, at)
        still = plunger_needle.loads(c.plunger_needle.guides, c.needle_seat.area, at.rail, at.rail, at.cylinder, at.low)
        return Model(p, f, at, c, still)


def uniform(kind: Any, unit: str, factor: float) -> Any:
    """NamedTuple of numbers of one unit, all different; small ones are negative, so that each contact closes once."""
    value = VALUES[unit] * (factor if factor >= 1.0 else -factor)
    return kind._make(quantity(value * (1.0 + 0.3 * i), unit) for i, _ in enumerate(kind._fields))


def nested(parts: Any) -> Iterator[Any]:
    for each in parts:
        if isinstance(each, tuple):
            yield each
            yield from nested(each)


def flat(value: Any) -> list[float]:
    return [number for each in value for number in flat(each)] if isinstance(value, tuple) else [value]


def known() -> dict[type, Any]:
    """NamedTuples of quantities that a law may take."""
    m = model()
    made = {kind: with_units(kind, values) for kind, values in TUPLES.items()}
    made[plunger_needle.State] = plunger_needle.State(
        *(uniform(plunger_needle.Nine, unit, 1.0) for unit in ("m", "m/s", "m/s"))
    )
    d = direct_model()
    masses, load = direct_acting.moving_masses(d.c), with_units(direct_needle.Loads, (60.0, -30.0))
    made[direct_needle.State] = direct_needle.State(
        *(uniform(direct_needle.Pair, unit, 1.0) for unit in ("m", "m/s", "N"))
    )
    made[direct_needle.Contacts] = direct_needle.Contacts(*4 * (with_units(contact.Contact, (40.0, 5.0)),))
    made |= {type(each): each for each in (load, masses, *nested(d.p), *nested(d.c))}
    return made | {
        type(each): each for each in (m.f, m.load, servo_model.seat_contact(m.c), *nested(m.p), *nested(m.c))
    }


def arguments(law: Law, factor: float) -> Iterator[Any]:
    """Quantities for the parameters of a law, with the units that it documents."""
    units, hints, made = documented(law), get_type_hints(law), known()
    made[drive.Supply] = drive.Supply(made[drive.Schedule], quantity(12.0, "A" if "current" in law.__name__ else "V"))
    for name in inspect.signature(law).parameters:
        if hints[name] in UNIFORM:
            yield uniform(hints[name], *units[name], factor)
            continue
        if hints[name] in made:
            yield made[hints[name]]
            continue
        stated, expected = units.get(name, []), get_args(hints[name])
        assert len(stated) == max(len(expected), 1), f"{name}: units {stated} documented in the section Parameters"
        values = tuple(quantity(VALUES[unit] * factor, unit) for unit in stated)
        yield values if expected else values[0]


def check(law: Law) -> None:
    for factor in TRIALS:
        taken = tuple(arguments(law, factor))
        with carried():
            found = law(*taken)
        check_returned(law, found)
        # a test with stand-ins shows nothing unless they compute the same
        numbers = law(*si(taken))
        assert flat(si(found)) == pytest.approx(flat(numbers), rel=1e-9, abs=1e-30)


def test_a_law_keeps_its_units() -> None:
    check_every([name for name in LAWS if name not in WITHOUT], lambda name: check(LAWS[name]))


def test_laws_without_units_exist_and_are_few() -> None:
    assert set(WITHOUT) <= set(LAWS)
    assert len(WITHOUT) < 0.1 * len(LAWS)


# --- The test can fail ----------------------------------------------------------------------------------------------


def spoilt(law: Law, was: str, becomes: str) -> Law:
    """A law with a piece of its text replaced."""
    text = textwrap.dedent(inspect.getsource(law))
    assert was in text
    names: dict[str, Any] = dict(law.__globals__)
    exec("from __future__ import annotations\n" + text.replace(was, becomes).replace("@physics\n", ""), names)
    return names[law.__name__]  # type: ignore[no-any-return]


FOUND = (AssertionError, pint.DimensionalityError, ValueError)  # the last of a comparison


@pytest.mark.parametrize(
    ("law", "was", "becomes"),
    [
        (fuel_kernel.stiffness, " * f.inverse_reference_density\n", "\n"),
        (contact.contact, "elastic * damping_factor", "elastic"),
        (contact.contact_over_step, "dt * dt * per_mass", "dt * per_mass"),
        (flow.gap_conductance, "/ (12.0 * length)", "/ 12.0"),
        (flow.gap_conductance, "gap * gap * gap", "gap * gap"),
        (flow.guide_of, "widening / gap", "widening"),
        (flow.jet, "2.0 * density * abs(cda2_dp)", "2.0 * abs(cda2_dp)"),
        (flow.orifice, "density * through.cda2", "through.cda2"),
        (flow.mean_departure, "3.0 * volume", "3.0"),
        (flow.impedance, " / area", ""),
        (flow.friction_resistance, "density * area * area", "density * area"),
        (nozzle.discharge, "z * c.per_lift_transition", "z"),
        (needle_seat.gap_cda2, "c.gap_curvature * z", "c.gap_curvature"),
        (solenoid.circuit, "flux * flux * c.per_knee_squared", "flux * c.per_knee_squared"),
        (solenoid.magnetic_force, "c.force * pulling_flux * pulling_flux", "c.force * pulling_flux"),
        (valve.free_force, "c.spring_stiffness * lift", "c.spring_stiffness"),
        (drive.apply_voltage, "resistance * now.drift", "now.drift"),
        (feed_pipe.middle_loss, "0.5 * c.admittance", "0.5"),
        (valve.at_rest, " / (c.contact_stiffness + c.spring_stiffness)", ""),
        (valve.rates, "c.per_mass * (force", "(force"),
        (valve.film_damping, "h * h * h", "h * h"),
        (rigid_body.accelerations, " / c.total_mass", ""),
        (plunger_needle.cylinder_stiffness, " / length", ""),
        (plunger_needle.loads, "low * g.plunger_area", "low"),
        (plunger_needle.forces, "c.guides.spring_stiffness * z.i7", "c.guides.spring_stiffness"),
        (plunger_needle.numerov_correction, "c.numerov", "c.impulse"),
        (plunger_needle.accelerations, "rest.damping * v.i9", "rest.damping"),
        (guide_friction.guide_damping, "g.friction * per_speed", "g.friction"),
        (guide_friction.accelerate_body, " / c.total_mass", ""),
        (guide_friction.advance_chain, "0.5 * m.i7 * guide", "0.5 * guide"),
        (nozzle.change, "turn.i3 * max", "max"),
        (guide_friction.bench_friction, "viscous * v", "viscous"),
        (feed_pipe.leave, "z * ends.inlet_flow", "ends.inlet_flow"),
        (valve.land_resistance, "h * h * h", "h * h"),
    ],
)
def test_a_law_without_one_of_its_factors_is_found(law: Law, was: str, becomes: str) -> None:
    with pytest.raises(FOUND):
        check(spoilt(law, was, becomes))


def test_a_law_without_documented_units_is_found() -> None:
    def undocumented(drive: float) -> float:
        """Flow."""
        return drive

    with pytest.raises(AssertionError, match="documented"):
        check(undocumented)


# --- The whole injector ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "variant",
    [
        Variant(),
        Variant(Body.RIGID, Boundary.VOLUME, Drive.PWM),
        Variant(drive=Drive.VOLTAGE),
        Variant(drive=Drive.CURRENT),
        Variant(drive=Drive.FREE_WHEEL, laws=Laws.EXTENDED),
        Variant(Body.RIGID, laws=Laws.EXTENDED),
        Variant(drive=Drive.CURRENT, actuation=Actuation.DIRECT),
        Variant(actuation=Actuation.DIRECT, laws=Laws.EXTENDED),
    ],
    ids=lambda variant: variant.label,
)
def test_a_step_of_the_injector_keeps_the_units_of_its_state(variant: Variant) -> None:
    """Three steps of 1 us with the coil energised: each number has after every step the unit that it had before."""
    m: Any = model() if variant.actuation is Actuation.SERVO else direct_model()
    wired = wiring(variant)
    at = m.at._replace(dt=quantity(1e-6, "s"))
    trace = quantity(12.0, "A" if variant.drive is Drive.CURRENT else "V")
    with carried():
        s = connections_of(variant).rest(m.c, at)
        # the flux to its eighth power, the lift remembered times a share
        s = s._replace(solenoid=with_units(solenoid.State, s.solenoid), nozzle=with_units(nozzle.State, s.nozzle))
        u = Inputs(at.rail, at.cylinder, at.low, trace, quantity(20e-6, "s"), quantity(-1e-3, "s"))
        waves = Waves(at.rail, at.rail, at.low)
        states = [s]
        for _ in range(3):
            s, waves = connections_of(variant).step(m.c, s, u, waves, at.dt)
            states.append(s)
    for path in wired.state.paths:
        values = [functools.reduce(getattr, path.split("."), state) for state in states]
        # A zero may be the product of a literal one, without the unit; whether a force is exactly zero is rounding.
        for was, now in itertools.pairwise(value for value in values if si(value) != 0.0):
            assert same_dimension(was, now), f"{path}: {was} before a step, {now} after it"
    assert all(same_dimension(wave, at.rail) for wave in waves)
