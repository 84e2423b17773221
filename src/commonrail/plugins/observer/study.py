"""States and assumptions of an observer: drift states with their priors, sensor, time windows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from commonrail.base.arguments import (
    TIME_STEPS,
    Limits,
    Quantity,
    amount,
    array,
    instance,
    instances,
    known_names,
    mapping,
    sequence,
    settle,
)
from commonrail.base.arrays import Floats
from commonrail.base.choices import Actuation, Boundary
from commonrail.base.declare import Choice, Number, OptionalNumber, Setting, setting, settings
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.base.hooks import note
from commonrail.base.text import quantity
from commonrail.base.units import to_text
from commonrail.engine.operating_point import OTHER_PRESSURES, RAIL_PRESSURES, Energising
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.physics.injector import Injector
from commonrail.physics.variants import unread_parameters
from commonrail.plugins.observer.disturbance import Disturbance

GAIN, OFFSET = "sensor gain", "sensor offset"
DELAY = "sensor delay"
# Largest initial deviation of a state by unit, and the reason. Chosen [E].
WIDEST = {
    "1": (1.0, "a value several times as large is another part's"),
    "K": (100.0, "no fuel properties cover such a range"),
    "Pa": (20e6, "a sensor so far off is defect"),
    "s": (1e-3, "the signal would come after the shot"),
}


class Sensor(StrEnum):
    """Place of the pressure sensor: the rail, or the injector's end of the line."""

    RAIL = "rail"
    LINE = "line"


SENSORS = {Sensor.RAIL: "rail.pressure", Sensor.LINE: "accumulation.fuel.pressure"}  # state that each one shows
METER_GAIN, CURRENT_DELAY = "return meter gain", "current delay"
SENSOR_STATES = (GAIN, OFFSET, DELAY, METER_GAIN, CURRENT_DELAY)  # without a parameter
FURTHER = {"current": "A", "return": "kg/s"}  # sensors in addition to the pressure, with their units


class DriftState(NamedTuple):
    """One drift state.

    Attributes
    ----------
    name : str
    parameter : str
        Parameter of the injector; empty for a state of the sensor.
    power : float
        The parameter is multiplied by exp(power × state); 0 adds the state to it.
    deviation : float
        Standard deviation before the first shot, in `unit`.
    walk : float
        Standard deviation of its change from one shot to the next.
    scatter : float
        Standard deviation of the per-shot offset: shot-to-shot scatter, and model error.
    limit : float
        Step that raises an alarm, if it is significant; 0 raises none.
    unit : str
        "1" for a relative change, or an SI unit.
    of : str
        Further sensor that the state needs; empty for none.
    """

    name: str
    parameter: str
    power: float
    deviation: float
    walk: float
    scatter: float
    limit: float
    unit: str = "1"
    of: str = ""


# Deviations, walks, scatters and limits are engineering estimates [E]; the deviations are close to the tolerances of
# cases/tolerance. Sensor states cover its gain and the rail's volume, its zero, and 5 µs of delay. The nine states from
# feed pipe length on prevent bias: without them, other states absorbed their effect on the pressure (mainly the fuel
# temperature for the pipe length), and quantities had a lasting error. 23 parameters and the states themselves fill
# three blocks of lanes. The last four states belong to further sensors. The deviation of the return meter's gain covers
# 1 % of the meter and 3 % of model error in the return quantity: at the true states of studies/observer_trial.py the
# model was 3.4 % low per injector, and 0.8 % from shot to shot.
STATES = (
    DriftState("nozzle flow", "nozzle.hole_diameter", 0.5, 0.05, 1e-3, 5e-3, 0.03),
    DriftState("valve preload", "valve.spring_preload", 1.0, 0.04, 1e-3, 3e-3, 0.05),
    DriftState("A-hole flow", "control_chamber.a_hole_diameter", 0.5, 0.03, 1e-3, 3e-3, 0.05),
    DriftState("Z-hole flow", "control_chamber.z_hole_diameter", 0.5, 0.03, 1e-3, 3e-3, 0.05),
    DriftState("valve lift", "valve.lift", 1.0, 0.03, 5e-4, 0.0, 0.1),
    DriftState("residual gap", "solenoid.residual_gap", 1.0, 0.10, 1e-3, 0.0, 0.2),
    DriftState("needle preload", "plunger_needle.spring_preload", 1.0, 0.05, 1e-3, 0.0, 0.1),
    DriftState("needle seat", "needle_seat.diameter", 1.0, 0.01, 1e-4, 0.0, 0.0),
    DriftState("plunger diameter", "plunger_needle.plunger_diameter", 1.0, 0.003, 1e-5, 0.0, 0.0),
    DriftState("eddy currents", "solenoid.eddy_lag", 1.0, 0.20, 1e-3, 0.0, 0.0),
    DriftState("valve seat", "valve.seat_diameter", 1.0, 0.005, 1e-4, 0.0, 0.0),
    DriftState("coil resistance", "solenoid.resistance", 1.0, 0.04, 1e-3, 0.0, 0.0),
    DriftState("low-lift flow", "nozzle.discharge_transition", 1.0, 0.03, 1e-3, 0.0, 0.0),
    DriftState("feed pipe length", "feed_pipe.length", 1.0, 0.005, 0.0, 0.0, 0.0),
    DriftState("line volume", "accumulation.volume", 1.0, 0.03, 0.0, 0.0, 0.0),
    DriftState("control chamber volume", "control_chamber.volume", 1.0, 0.03, 0.0, 0.0, 0.0),
    DriftState("valve mass", "valve.mass", 1.0, 0.02, 0.0, 0.0, 0.0),
    DriftState("lift offset", "nozzle.lift_transition_offset", 1.0, 0.02, 0.0, 0.0, 0.0),
    DriftState("boost voltage", "drive.boost_voltage", 1.0, 0.02, 0.0, 0.0, 0.0),
    DriftState("needle seat flow", "needle_seat.discharge", 1.0, 0.02, 0.0, 0.0, 0.0),
    DriftState("rail throttle", "rail.throttle_diameter", 1.0, 0.01, 0.0, 0.0, 0.0),
    DriftState("plunger gap", "plunger_needle.plunger_gap", 1.0, 0.10, 0.0, 0.0, 0.0),
    DriftState("fuel temperature", "fuel.temperature", 0.0, 10.0, 0.2, 0.0, 0.0, "K"),
    DriftState(GAIN, "", 0.0, 0.011, 1e-5, 0.0, 0.02),
    DriftState(OFFSET, "", 0.0, 0.7e6, 1e3, 0.0, 4e6, "Pa"),
    DriftState(DELAY, "", 0.0, 3e-6, 1e-8, 0.0, 10e-6, "s"),
    DriftState("peak current", "drive.peak_current", 1.0, 0.03, 1e-4, 0.0, 0.0, of="current"),
    DriftState("hold current", "drive.hold_current", 1.0, 0.03, 1e-4, 0.0, 0.0, of="current"),
    DriftState(METER_GAIN, "", 0.0, 0.032, 1e-5, 0.0, 0.0, of="return"),
    DriftState(CURRENT_DELAY, "", 0.0, 1e-6, 1e-8, 0.0, 0.0, "s", of="current"),  # after the energisings as read
)


def _read_further(names: object, words: str) -> tuple[str, ...]:
    further = known_names(names, FURTHER, words, "current")
    return tuple(name for name in FURTHER if name in further)


def _read_disturbance(disturbance: object, words: str) -> Disturbance:
    """Disturbance with a valid covariance: noise and times above zero, all else non-negative."""
    figures = instance(disturbance, Disturbance, words)._asdict()
    for (name, value), unit in zip(figures.items(), ("Pa", "Pa/s", "s", "Pa", "Hz", "s"), strict=True):
        least = 1e-9 if name in ("noise", "memory", "decay") else 0.0
        figures[name] = amount(value, unit, f"{name} of the disturbance", Limits(least, 1e15))
    return Disturbance(**figures)


_TIMES, _SHARES = Limits(1e-6, 20e-3), Limits(0.0, 1.0)
_FROM_ONE = Limits(1, math.inf)


@settings
class ObserverSettings:
    """Settings of an observer; SI numbers, or texts with their unit.

    `states` are its drift states (`DriftState`). `deviations` replace the standard deviations of some before the first
    shot, by the name of the state; 0 leaves a state out. `ConfigurationError` for a value of the wrong type or beyond
    its limits, or an unknown name.
    """

    sensor: Choice[Sensor] = setting(
        default=Sensor.RAIL, text="Place of the pressure sensor; line is the injector's end of the line."
    )
    further: Setting[tuple[str, ...], Sequence[str]] = setting(
        words="further sensors", default=(), read=_read_further, text='"current" of the coil, "return" flow.'
    )
    cylinder_pressure: Number = setting(unit="Pa", default=5e6, limits=OTHER_PRESSURES)
    return_pressure: Number = setting(unit="Pa", default=0.5e6, limits=OTHER_PRESSURES)
    before: Number = setting(
        words="time before a shot",
        unit="s",
        default=2e-3,
        limits=_TIMES,
        text="Time before the first energising that counts.",
    )
    after: Number = setting(
        words="time after a shot",
        unit="s",
        default=2e-3,
        limits=_TIMES,
        text="Time after the end of the last energising that counts.",
    )
    gap: Number = setting(
        words="pause between shots",
        unit="s",
        default=3e-3,
        limits=_TIMES,
        text="Least pause between energisings of different shots.",
    )
    averaged: Number = setting(
        words="averaging", unit="s", default=20e-6, limits=_TIMES, text="Time over which samples are averaged."
    )
    noise: OptionalNumber = setting(
        unit="Pa",
        default=None,
        limits=Limits(1.0, 10e6),
        text="Standard deviation of a sample; by default estimated from the quiet pressure before the shots.",
    )
    disturbance: Setting[Disturbance | None, Disturbance | None] = setting(
        default=None,
        read=_read_disturbance,
        text="Pump, neighbours and noise of an averaged sample; by default estimated from the pressure before shots.",
    )
    discrepancy: Number = setting(
        default=0.005,
        limits=_SHARES,
        text="Standard deviation of the model's pressure error, as a share of the pressure drop.",
    )
    current_noise: OptionalNumber = setting(
        words="noise of the current",
        unit="A",
        default=None,
        limits=Limits(1e-6, 100.0),
        text="Standard deviation of a sample; by default estimated from the current before the shots.",
    )
    # The defaults from here to the return discrepancy are estimates [E].
    current_discrepancy: Number = setting(
        words="discrepancy of the current",
        default=0.02,
        limits=_SHARES,
        text="Standard deviation of the model error, as a share of the current.",
    )
    current_timing: Number = setting(
        words="timing of the current",
        unit="s",
        default=1e-6,
        limits=Limits(0.0, 1e-3),
        text="Standard deviation of the edges of the energisings.",
    )
    return_deviation: Number = setting(
        words="deviation of the return quantity",
        default=0.02,
        limits=Limits(1e-4, 1.0),
        text="Standard deviation of the metered quantity, as a share of it.",
    )
    return_shots: int = setting(
        words="cycles of the meter",
        default=1,
        limits=_FROM_ONE,
        text="Cycles over which the meter averages; the variance of each shot is multiplied by it.",
    )
    return_discrepancy: Number = setting(
        words="discrepancy of the return quantity",
        default=0.01,
        limits=_SHARES,
        text="Standard deviation of the model error, as a share of the return quantity of a shot; its lasting error is "
        'the state "return meter gain".',
    )
    learning: int = setting(default=10, text="Shots without alarms at the beginning.")
    window: int = setting(default=20, limits=_FROM_ONE, text="Number of past shots searched for a drift.")
    significance: Number = setting(
        default=4.0, limits=Limits(1.0, 20.0), text="Standard deviations of a step needed for an alarm."
    )
    iterations: int = setting(default=4, limits=_FROM_ONE, text="Largest number of linearisations of a shot.")
    horizon: int = setting(
        default=10,
        limits=_FROM_ONE,
        text="Shots estimated together, in which later shots correct earlier ones; 1 is the plain filter.",
    )
    grid: Number = setting(
        default=0.0,
        limits=Limits(0.0, 10.0),
        text="Shots are simulated at states rounded to multiples of so many standard deviations before the first shot, "
        "and to whole pascals and nanoseconds, with the same bits on all machines; from there they are linear. 0 does "
        "not round.",
    )
    time_step: Number = setting(unit="s", default=DEFAULT_STEP, limits=TIME_STEPS)
    states: tuple[DriftState, ...] = STATES
    deviations: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        states = [_state(state) for state in instances(self.states, DriftState, "states")]
        names = [state.name for state in states]
        if len({*names}) < len(names):
            raise ConfigurationError(f"Each drift state may occur once, but {len(names) - len({*names})} are repeated.")
        for name, value in mapping(self.deviations, "deviations", '{"nozzle flow": 0.03}').items():
            if name not in names:
                raise ConfigurationError(f'Unknown drift state "{name}"{nearest(name, names)}.')
            state = states[names.index(name)]
            states[names.index(name)] = _state(state._replace(deviation=value))
        settle(self, states=tuple(state for state in states if state.deviation > 0.0), deviations={})
        if not self.states:
            raise ConfigurationError("An observer needs a drift state whose deviation is above zero; leave some free.")

    def count_averaged_samples(self, time: Floats) -> int:
        """Number of samples that are averaged to one, at evenly spaced times (samples,) [s].

        `ConfigurationError` unless the time before a shot holds two averaged samples; their mean is the pressure at
        rest.
        """
        interval = float(time[1] - time[0])
        many = max(round(self.averaged / interval), 1)
        if 2.0 * many * interval > self.before * (1.0 + 1e-6):
            raise ConfigurationError(
                f"The time before a shot, {quantity(self.before, 's', 3)}, is too short for two averaged samples of "
                f"{quantity(many * interval, 's', 3)} each; give a longer `before`, or average over a shorter time."
            )
        return many


def _state(state: DriftState) -> DriftState:
    """Drift state with texts and numbers within their limits."""
    name, unit = (instance(text, str, "name and unit of a drift state") for text in (state.name, state.unit))
    instance(state.parameter, str, f"parameter of {name}")
    if unit not in WIDEST:
        raise ConfigurationError(f'The unit of drift state "{name}" must be one of {", ".join(WIDEST)}, not {unit}.')
    numbers = {"power": amount(state.power, "1", f"power of {name}", Limits(-10.0, 10.0))}
    for key in ("deviation", "walk", "scatter", "limit"):
        numbers[key] = amount(getattr(state, key), unit, f"{key} of {name}", Limits(0.0, 1e9))
    widest, beyond = WIDEST[unit]
    if numbers["deviation"] > widest:
        read, most = (to_text(value, unit) for value in (numbers["deviation"], widest))
        raise ConfigurationError(f"The deviation of {name} must be at most {most}, not {read}: {beyond}.")
    return DriftState._make((state._asdict() | numbers).values())


def check_model(injector: Injector, further: tuple[str, ...] = ()) -> None:
    """Refuse an injector without a rail volume, or without the parts of a further sensor.

    `further`: as in `ObserverSettings`.
    """
    if injector.variant.boundary is not Boundary.VOLUME:
        raise ConfigurationError(
            f"{injector.name} is fed from an ideal rail, whose pressure does not react to the injection; take a model "
            "with a rail volume (@volume), and give its rail.volume."
        )
    if injector.variant.actuation is Actuation.DIRECT and set(further) & {"current", "return"}:
        raise ConfigurationError(
            f"{injector.name} has no control valve, which current and return flow need; leave them out."
        )


def resolve_states(injector: Injector, settings: ObserverSettings) -> tuple[DriftState, ...]:
    """States whose parameter the injector reads; a scaled parameter must not be zero.

    States of missing further sensors are left out.
    """
    unread = unread_parameters(injector.variant)
    for state in settings.states:
        if (path := state.parameter) not in injector.values and (path or state.name not in SENSOR_STATES):
            like = nearest(path, injector.values)
            raise ConfigurationError(f'Drift state "{state.name}" changes the unknown parameter "{path}"{like}.')

    def applies(state: DriftState) -> bool:
        if state.of and state.of not in settings.further:
            return False
        path = state.parameter
        return not path or (path not in unread and (state.power == 0.0 or injector.values[path] > 0.0))

    states = tuple(filter(applies, settings.states))
    if not states:
        raise ConfigurationError(f"{injector.name} reads no parameter of a drift state; leave other states free.")
    return states


class ShotRecord(NamedTuple):
    """Measured pressure around one shot.

    Attributes
    ----------
    start : float
        Start of the first energising in the time of the log [s].
    energisings : tuple of Energising
        From `start` on [s].
    time, pressure : (samples,)
        From `start` on [s], and measured [Pa].
    quiet : (samples,)
        Pressure before the shot while this injector is closed [Pa], at the same spacing.
    further : mapping of str to (samples,) or (1,)
        Readings of further sensors: coil current [A] at `time`, and the mass through the return line from `start`
        to the next shot [kg], absent if that lies beyond the log.
    period : float
        From `start` to the next shot [s].
    """

    start: float
    energisings: tuple[Energising, ...]
    time: Floats
    pressure: Floats
    quiet: Floats
    further: Mapping[str, Floats] = MappingProxyType({})
    period: float = np.inf


def cut_log(
    time: Floats,
    pressure: Floats,
    energisings: tuple[Energising, ...],
    settings: ObserverSettings,
    further: Mapping[str, Floats] = MappingProxyType({}),
) -> list[ShotRecord]:
    """Cut complete shots out of a log, half a sample earlier; a note states the number of incomplete shots.

    `time` (samples,): evenly spaced [s]; `pressure` (samples,): [Pa]; `energisings`: in order, in the time of the log;
    `further`: samples (samples,) of further sensors by name, in the units of `FURTHER`.
    """
    groups: list[list[Energising]] = []
    for pulse in energisings:
        last = groups[-1][-1] if groups else None
        if last is not None and pulse.start - last.start - last.duration < settings.gap:
            groups[-1].append(pulse)
        else:
            groups.append([pulse])
    shots, free = [], float(time[0])
    for i, group in enumerate(groups):
        start, end = group[0].start, group[-1].start + group[-1].duration
        following = groups[i + 1][0].start if i + 1 < len(groups) else np.inf
        stop = min(end + settings.after, following - 50e-6)
        slack = 1e-6 * float(time[1] - time[0])  # rounding of an edge that falls on a sample
        first, zero, last = np.searchsorted(time, np.array([start - settings.before, start, stop]) - slack)
        if start - settings.before >= time[0] - 0.5 * (time[1] - time[0]) and stop <= time[-1]:
            pulses = tuple(Energising(pulse.start - start, pulse.duration) for pulse in group)
            quiet = pressure[np.searchsorted(time, max(free, start - 2.0 * settings.before)) : zero]
            samples_of_shot = {name: samples[first:last] for name, samples in further.items() if name != "return"}
            if "return" in further and following <= time[-1]:
                flow = float(further["return"][(time >= start) & (time < following)].mean())
                if flow <= 0.0:
                    raise ConfigurationError(
                        f"The return flow has a mean of {flow:.3g} kg/s from {start:.9g} s to the next shot, and some "
                        "fuel returns in each cycle; check its column (--return-flow), its sign and its zero."
                    )
                samples_of_shot["return"] = np.array([flow * (following - start)])
            shown = time[first:last] - start, pressure[first:last]
            shots.append(ShotRecord(start, pulses, *shown, quiet, samples_of_shot, following - start))
        free = stop
    if 0 < len(shots) < len(groups):
        before, after = (quantity(span, "s", 3) for span in (settings.before, settings.after))
        note(
            f"{len(groups) - len(shots)} of {len(groups)} shots are incomplete in the log and have no figures: each "
            f"needs the pressure from {before} before to {after} after it."
        )
    return shots


_VOLUMES = Limits(1e-11, 1e-6, (1e-10, 1e-6), ("mm3",))
_PAUSES = Limits(0.0, 0.1, (50e-6, 20e-3), ("us", "ms"))


def _read_quantities(values: object, words: str) -> tuple[float, ...]:
    volumes = array(sequence(values, words, '("2.4 mm3", "24 mm3")'), "m3", words, 1)
    return tuple(amount(value, "m3", "target quantity", _VOLUMES) for value in volumes.tolist())


def _read_dwells(values: object, words: str) -> tuple[float, ...]:
    pauses = array(sequence(values, words, '("0.7 ms",)'), "s", words, 1)
    return tuple(amount(value, "s", "dwell", _PAUSES) for value in pauses.tolist())


@settings(kw_only=False)
class InjectionTrain:
    """Target injections in sequence; SI numbers, or texts with their units.

    `ConfigurationError` if a value is of the wrong type or beyond its limits, or the numbers of quantities and dwells
    do not match.
    """

    rail_pressure: Number = setting(
        unit="Pa", limits=RAIL_PRESSURES, text="Before the first injection, as the sensor shows it."
    )
    quantities: Setting[tuple[float, ...], Sequence[Quantity]] = setting(
        words="target quantities", read=_read_quantities, text="Volumes at cylinder pressure [m³]."
    )
    dwells: Setting[tuple[float, ...], Sequence[Quantity]] = setting(
        default=(),
        read=_read_dwells,
        text="From the end of each energising to the start of the next [s], one less than quantities.",
    )

    def __post_init__(self) -> None:
        if len(self.dwells) + 1 != len(self.quantities):
            raise ConfigurationError(
                f"A train needs one or more quantities and a dwell between each two, not {len(self.quantities)} "
                f"quantities and {len(self.dwells)} dwells."
            )

    def energisings(self, times: Floats) -> tuple[Energising, ...]:
        """Energisings with times (injections,) [s], the first one at zero."""
        starts = np.cumsum([0.0, *(times[:-1] + self.dwells)])
        return tuple(Energising(*pair) for pair in zip(starts.tolist(), times.tolist(), strict=True))
