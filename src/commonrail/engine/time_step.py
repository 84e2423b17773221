"""Time steps of the fast engines: limits, round values, advice."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import TIME_STEPS as TIME_STEPS
from commonrail.base.arguments import Quantity, amount
from commonrail.base.arrays import Bools, Floats
from commonrail.base.choices import Actuation, Body, Boundary
from commonrail.physics.components.plunger_needle import Seven, around
from commonrail.physics.flow import pipe_area
from commonrail.physics.fuel import Fuel
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_paths
from commonrail.physics.variants import Variant

# Longest time step of the fast engines for an injector: stability of the moving masses, travel times of the waves.
#
# Leapfrog with dampers at the extrapolated velocity (3 v_{n−1/2} − v_{n−3/2})/2 is stable for M z̈ + C ż + K z = 0 as
# long as 4 M − dt² K − 4 dt C is positive definite; where it is not, the mode of period 2 dt grows. Numerov's
# correction does not shorten that limit. The needle chain is judged in contact with seat and stop and pressed on by
# the fuel enclosed in its chambers, whose stiffness is K_f A²/V each. The matrix has three diagonals: its pivots
# decide. A volume that is drawn on before its own pressure answers must hold more than a wave draws from it in a step.

Values = Mapping[str, Any]

# Largest ω dt of the valve on its seat or stop: leapfrog's correction of third order (`contact_over_step`) needs it
# well below one. The contact's damping counts at this speed of impact [m/s].
RESOLVED, IMPACT = 0.35, 1.0
RIGID = 0.7  # largest ω dt of one rigid mass on its seat and stop: of second order, and all its energy in that mode
# Share of the accumulation volume that a wave may draw through the seat's bore in a step. With a SAC as large as the
# volume the flow through the seat begins to alternate at about one.
DRAWN = 0.5
STOP = "plunger_needle.stop_lift"  # limits the volume that the plunger displaces from the control chamber
_DIGITS = 60  # bisections for the longest step

# Parameters that shorten the longest step as they grow, and those that do as they shrink.
SHORTENS = (
    *(f"plunger_needle.k{i}" for i in range(1, 8)),
    "plunger_needle.joint_stiffness",
    "plunger_needle.stop_stiffness",
    "plunger_needle.damping_ratio",
    "plunger_needle.plunger_diameter",
    "plunger_needle.guide_diameter",
    "plunger_needle.stem_diameter",
    "needle_seat.contact_stiffness",
    "needle_seat.diameter",
    "feed_pipe.diameter",
    "valve.contact_stiffness",
    "valve.contact_damping",
)
LENGTHENS = (
    *(f"plunger_needle.m{i}" for i in range(1, 8)),
    "control_chamber.volume",
    "accumulation.volume",
    "sac.volume",
    "valve.mass",
    "feed_pipe.length",
    "return_line.length",
    "rail.volume",
)

# The same for a direct-acting injector.
DIRECT_SHORTENS = (
    "armature.contact_stiffness",
    "armature.spring_stiffness",
    "needle.spring_stiffness",
    "needle_seat.contact_stiffness",
    "needle_seat.diameter",
)
DIRECT_LENGTHENS = ("armature.mass", "needle.mass", "accumulation.volume", "sac.volume", "feed_pipe.length")


_OF_BOTH_ACTUATIONS = (  # union over both actuations; parameters an injector lacks are ignored
    {*SHORTENS, *DIRECT_SHORTENS},
    {*LENGTHENS, *DIRECT_LENGTHENS},
)


_RETURN = 0.5e6  # usual return pressure [Pa], at which the speed of sound in the line is taken


class Medium(NamedTuple):
    """Fuel at the largest rail pressure: bulk modulus [Pa], sound speed there and in the return line [m/s]."""

    modulus: Any
    speed: Any
    return_speed: float


def medium_of(injector: Injector, rail_pressure: Floats | float) -> Medium:
    """Fuel of an injector at its own temperature; modulus and speed have the shape of the rail pressure [Pa]."""
    fuel, temperature = injector.fuel, injector.values[FUEL_TEMPERATURE]
    if np.ndim(rail_pressure):
        modulus, speed = fuel.bulk_modulus(rail_pressure, temperature), fuel.sound_speed(rail_pressure, temperature)
        return Medium(modulus, speed, float(fuel.sound_speed(_RETURN, temperature)))
    return _medium_at(fuel, temperature, float(rail_pressure))


@functools.lru_cache(maxsize=64)
def _medium_at(fuel: Fuel, temperature: float, rail_pressure: float) -> Medium:
    """`medium_of` at one pressure."""
    speed, return_speed = (sound_speed(fuel, temperature, pressure) for pressure in (rail_pressure, _RETURN))
    return Medium(float(fuel.bulk_modulus(rail_pressure, temperature)), speed, return_speed)


@functools.lru_cache(maxsize=128)
def sound_speed(fuel: Fuel, temperature: float, pressure: float) -> float:
    """Speed of sound [m/s], cached: it takes a millisecond."""
    return float(fuel.sound_speed(pressure, temperature))


def is_stable(variant: Variant, values: Values, medium: Medium, dt: float) -> Any:
    """True for a stable step.

    Parameters
    ----------
    variant : Variant
    values : mapping of str to float or (n,)
        SI values of `limiting` by dotted name.
    medium : Medium
    dt : float
        Step [s].

    Returns
    -------
    bool or (n,) bool
        NaN anywhere counts as too long.
    """
    if variant.actuation is Actuation.DIRECT:
        return _pair_is_stable(values, medium, dt)
    moves = _chain_is_stable if variant.body is Body.FLEXIBLE else _rigid_is_stable
    fluid = _waves_are_resolved(values, medium, dt) & _volumes_are_stable(variant.boundary, values, medium, dt)
    return moves(values, medium, dt) & _valve_is_stable(values, dt) & fluid


def _chain_is_stable(values: Values, medium: Medium, dt: float) -> Any:
    k, m = ([values[f"plunger_needle.{name}{i}"] for i in range(1, 8)] for name in "km")
    ratio = values["plunger_needle.damping_ratio"]
    links = [
        dt * (dt * stiffness + 8.0 * ratio * (stiffness * mass) ** 0.5) for stiffness, mass in zip(k, m, strict=True)
    ]
    links.insert(5, dt * dt * values["plunger_needle.joint_stiffness"])
    top, shoulder, tip = _enclosed_fuel_stiffness(values, medium)
    ground_stiffness = {
        0: values["plunger_needle.stop_stiffness"] + top,
        7: shoulder,
        8: values["needle_seat.contact_stiffness"] + tip,
    }
    pivot, before = None, 0.0
    stable: Any = True
    for i, node in enumerate(around(Seven(*m))):
        after = links[i] if i < 8 else 0.0
        diagonal = 2.0 * node - before - after - dt * dt * ground_stiffness.get(i, 0.0)
        pivot = diagonal if pivot is None else diagonal - before * before / pivot
        stable = stable & (pivot > 0.0)
        pivot = abs(pivot) + 1e-300  # an unstable candidate stays unstable; no division by zero
        before = after
    return stable


def _rigid_is_stable(values: Values, medium: Medium, dt: float) -> Any:
    mass = sum(values[f"plunger_needle.m{i}"] for i in range(1, 8))
    contact = values["plunger_needle.stop_stiffness"] + values["needle_seat.contact_stiffness"]
    return dt * dt * (contact + sum(_enclosed_fuel_stiffness(values, medium))) < RIGID * RIGID * mass


def _enclosed_fuel_stiffness(values: Values, medium: Medium) -> tuple[Any, Any, Any]:
    """Stiffness [N/m] of the enclosed fuel on the plunger's top, the needle's shoulder and its tip.

    Shoulder and tip share the accumulation volume: twice their individual stiffnesses bounds the pair.
    """
    top = pipe_area(values["plunger_needle.plunger_diameter"])
    guide, stem = (pipe_area(values[f"plunger_needle.{name}_diameter"]) for name in ("guide", "stem"))
    seat = pipe_area(values["needle_seat.diameter"])
    around = 2.0 * medium.modulus / values["accumulation.volume"]
    return (
        medium.modulus * top * top / values["control_chamber.volume"],
        around * guide * guide,
        around * stem * stem + medium.modulus * seat * seat / values["sac.volume"],
    )


def _valve_is_stable(values: Values, dt: float) -> Any:
    frequency = (values["valve.contact_stiffness"] / values["valve.mass"]) ** 0.5
    damped = values["valve.contact_damping"] * IMPACT
    return (dt * frequency <= RESOLVED) & (dt * frequency * damped <= 2.0 * RESOLVED)


def _waves_are_resolved(values: Values, medium: Medium, dt: float) -> Any:
    feed, line = values["feed_pipe.length"], values["return_line.length"]
    return (feed >= medium.speed * dt) & ((line == 0.0) | (2.0 * line >= medium.return_speed * dt))


def _volumes_are_stable(boundary: Boundary, values: Values, medium: Medium, dt: float) -> Any:
    way = medium.speed * dt
    seat = way * pipe_area(values["needle_seat.diameter"]) <= DRAWN * values["accumulation.volume"]
    if boundary is not Boundary.VOLUME:
        return seat
    return seat & (way * pipe_area(values["feed_pipe.diameter"]) <= values["rail.volume"])


# Of a direct-acting injector armature and needle are judged as two masses with all contacts closed that can be at once:
# the armature on its stop and on the needle, the needle on its seat and on the fuel enclosed in the SAC. Leapfrog is
# stable for the largest eigenvalue λ of that pair as long as dt² λ < 4; `RIGID` is stricter, to resolve contacts.


def _pair_is_stable(values: Values, medium: Medium, dt: float) -> Any:
    seat = pipe_area(values["needle_seat.diameter"])
    way = medium.speed * dt
    moves = dt * dt * _stiffest(values, medium.modulus * seat * seat) < RIGID * RIGID
    waves = (values["feed_pipe.length"] >= way) & (way * seat <= DRAWN * values["accumulation.volume"])
    return moves & waves


def _stiffest(values: Values, enclosed: Any) -> Any:
    """Largest eigenvalue [1/s²] of the pair of masses, `enclosed` being K A² of the needle's tip [N m²]."""
    push = values["armature.contact_stiffness"]
    fuel = enclosed / values["sac.volume"] + enclosed / values["accumulation.volume"]
    a = (2.0 * push + values["armature.spring_stiffness"]) / values["armature.mass"]
    needle_stiffness = values["needle_seat.contact_stiffness"] + values["needle.spring_stiffness"] + fuel
    n = (push + needle_stiffness) / values["needle.mass"]
    coupling = push * push / (values["armature.mass"] * values["needle.mass"])
    return 0.5 * (a + n) + (0.25 * (a - n) * (a - n) + coupling) ** 0.5


def limiting(actuation: Actuation) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Parameters that shorten the longest step as they grow, and parameters that do so as they shrink."""
    if actuation is Actuation.DIRECT:
        return DIRECT_SHORTENS, DIRECT_LENGTHENS
    return SHORTENS, LENGTHENS


@functools.cache
def _columns(actuation: Actuation) -> dict[str, int]:
    """Indices in a flat parameter vector of the parameters that affect the longest step."""
    paths = parameter_paths(actuation)
    stop = () if actuation is Actuation.DIRECT else (STOP,)
    return {name: paths.index(name) for group in (*limiting(actuation), stop) for name in group}


def _volumes_at_lift(actuation: Actuation, values: Values, lift: Any) -> Values:
    """Volumes at plunger lift `lift`; empty for a direct-acting injector."""
    return {} if actuation is Actuation.DIRECT else {"control_chamber.volume": room_left(values, lift)}


def room_left(values: Values, lift: Any) -> Any:
    """Control chamber [m³] after the plunger has risen by `lift` [m], at most to its stop; never exactly zero."""
    risen = np.clip(lift, 0.0, values[STOP])
    with np.errstate(all="ignore"):  # an infinite area gives NaN, for which no step is stable
        taken = pipe_area(values["plunger_needle.plunger_diameter"]) * risen
        return np.maximum(values["control_chamber.volume"] - taken, 1e-30)


def longest_step(injector: Injector, theta: Floats, medium: Medium, lift: float = 0.0) -> float:
    """Longest stable time step of a candidate [s]; 0 if none is stable.

    Parameters
    ----------
    injector : Injector
    theta : (parameters, …)
        Flat parameter vector of one candidate.
    medium : Medium
    lift : float
        As in `too_long`.
    """
    acts = injector.variant.actuation
    values = dict(zip(parameter_paths(acts), theta.tolist(), strict=False))
    risen = {name: float(value) for name, value in _volumes_at_lift(acts, values, lift).items()}
    return longest(injector.variant, values | risen, medium)


def longest(variant: Variant, values: Values, medium: Medium) -> float:
    """Longest stable step [s] for an injector's values by dotted name, 0 if there is none."""
    with np.errstate(all="ignore"):
        try:
            if not is_stable(variant, values, medium, 1e-15):
                return 0.0
        except (OverflowError, ZeroDivisionError):
            return 0.0
        low, high = 1e-15, 1.0
        for _ in range(_DIGITS):
            middle = (low * high) ** 0.5
            low, high = (middle, high) if is_stable(variant, values, medium, middle) else (low, middle)
    return low


def too_long(
    injector: Injector, names: Sequence[str], theta: Floats, medium: Medium, dt: float, lift: Floats | float = 0.0
) -> Bools:
    """Candidates (n,) for which a step is too long.

    Parameters
    ----------
    injector : Injector
    names : sequence of str
        Parameters in which the candidates differ.
    theta : (n, parameters, …)
        Flat parameter vectors.
    medium : Medium
        The same for all candidates, or its modulus and speed (n,).
    dt : float
        [s].
    lift : float or (n,)
        Greatest lift of the needle [m]: the plunger reduces the control chamber by it, and a nearly
        vanished chamber is a stiff spring.
    """
    acts = injector.variant.actuation
    columns, shortens = _columns(acts), (*limiting(acts)[0], STOP)
    values: dict[str, Any] = {name: theta[0, column] for name, column in columns.items()}
    varied = {name: theta[:, columns[name]] for name in names if name in columns}
    # if the stiffest combination is stable, so is every candidate
    corner = values | {
        name: varied_values.max() if name in shortens else varied_values.min() for name, varied_values in varied.items()
    }
    with np.errstate(all="ignore"):
        if np.all(is_stable(injector.variant, {**corner, **_volumes_at_lift(acts, corner, np.max(lift))}, medium, dt)):
            return np.zeros(len(theta), bool)
        each = values | varied
        return ~np.broadcast_to(
            is_stable(injector.variant, {**each, **_volumes_at_lift(acts, each, lift)}, medium, dt), len(theta)
        )


def stiffest_corner(values: Mapping[str, float], lower: Mapping[str, float], upper: Mapping[str, float]) -> Values:
    """Values within bounds that need the shortest step, other values unchanged."""
    return {
        **values,
        **{name: upper[name] for name in upper if name in _OF_BOTH_ACTUATIONS[0]},
        **{name: lower[name] for name in lower if name in _OF_BOTH_ACTUATIONS[1]},
    }


DEFAULT_STEP = 1e-6  # [s]; its error is measured by `commonrail lab verify`
ROUND_STEPS = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.5)  # times a power of ten


def check_step(time_step: Quantity) -> float:
    """Read a time step [s], from 1 ns to 100 us."""
    return amount(time_step, "s", "time step", TIME_STEPS)


def step_advice(longest: float) -> str:
    """Sentence that recommends a time step below the longest one [s]."""
    step = nice_step(longest)
    return f"A step of {step * 1e6:g} us would do." if step >= TIME_STEPS.low else "No step is short enough."


def nice_step(longest: float) -> float:
    """Largest round time step [s] at least five per cent below the longest, 0 if there is no such step."""
    if not longest > 0.0:
        return 0.0
    decade = 10.0 ** math.floor(math.log10(0.95 * longest))
    return max(round(multiple * decade, 15) for multiple in ROUND_STEPS if multiple * decade <= 0.95 * longest)
