"""Drive of the solenoid: boost, peak, hold and off, by an ideal regulator, PWM or free-wheel, or a measured trace.

Each law returns the mean over a step of the coil's flux rate, N dφ/dt = v − R i (Eq. 11). A phase that lasts for a
share of the step relaxes over this share only: it does not damp the phase that follows within the step.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from commonrail.physics.components import solenoid
from commonrail.physics.law import Domain, Q, physics

TINY_CURRENT = 1e-12  # current that counts as zero [A]
TINY_GAIN = 1e-12  # current per volt over a step that counts as zero [A/V]
UNLIMITED = 1e9  # voltage of a regulator that follows a measured current [V]


class Parameters(NamedTuple):
    """Current profile of the output stage."""

    boost_voltage: Annotated[
        float, Q("V", "boost voltage of the first rise, also applied backwards to switch off", usual=(10.0, 500.0))
    ]
    supply_voltage: Annotated[
        float, Q("V", "voltage of the PWM after the first rise", Domain.POSITIVE, 14.0, usual=(5.0, 100.0))
    ]
    peak_current: Annotated[float, Q("A", "mean current of the peak phase", usual=(1.0, 100.0))]
    peak_duration: Annotated[float, Q("s", "end of the peak phase after the start of energising", usual=(20e-6, 10e-3))]
    hold_current: Annotated[float, Q("A", "mean current of the hold phase", usual=(0.5, 60.0))]
    quench_voltage: Annotated[
        float,
        Q(
            "V",
            "voltage applied backwards while the current must fall during energising",
            Domain.NON_NEGATIVE,
            0.0,
            usual=(1.0, 500.0),
        ),
    ]
    peak_band: Annotated[
        float, Q("A", "width of the PWM's current band, peak phase", Domain.POSITIVE, 2.0, usual=(0.05, 20.0))
    ]
    hold_band: Annotated[
        float, Q("A", "width of the PWM's current band, hold phase", Domain.POSITIVE, 2.0, usual=(0.05, 20.0))
    ]
    regulator_gain: Annotated[
        float, Q("V/A", "gain of the ideal regulator and of a measured current", Domain.POSITIVE, 100.0)
    ]
    diode_voltage: Annotated[
        float,
        Q("V", "forward voltage of the free-wheel diode", Domain.NON_NEGATIVE, 0.7, usual=(0.1, 5.0)),
    ]


class State(NamedTuple):
    """Voltage of the PWM: 2 +boost (first rise), 1 +supply, 0 −quench."""

    conducting: float


class Schedule(NamedTuple):
    """Share of the step in which the coil is energised, and in which it is in the peak phase [1]."""

    on: float
    peak: float


class Rate(NamedTuple):
    """dφ/dt at one voltage [V], for the air gap at mid-step and at the end of the step; decay −∂(dφ/dt)/∂φ [1/s]."""

    flux_rate: float
    at_end: float
    decay: float


class Change(NamedTuple):
    """Mean of dφ/dt over the step [V], and state of the PWM's transistor at its end."""

    flux_rate: float
    conducting: float


class Backward(NamedTuple):
    """Voltages that reduce the current while energising goes on, and after its end [V]."""

    falling: float
    after_end: float


class Supply(NamedTuple):
    """Inputs of a drive: its schedule, and a measured trace (mean voltage [V] or current [A])."""

    schedule: Schedule
    trace: float


@physics
def clamp(x: float, low: float, high: float) -> float:
    """Value nearest to x between two limits.

    `x`: in any unit; `low`, `high`: limits in the same unit; `high` prevails where they contradict.
    """
    return min(max(x, low), high)


@physics
def schedule(p: Parameters, since_start: float, since_end: float, dt: float) -> Schedule:
    """Mean of the schedule over a step.

    `since_start`, `since_end`: start of the step after start and end of energising [s]; negative before them.
    """
    per_step = 1.0 / dt
    begun = clamp(since_start * per_step + 1.0, 0.0, 1.0)
    ended = clamp(since_end * per_step + 1.0, 0.0, 1.0)
    past_peak = clamp((since_start - p.peak_duration) * per_step + 1.0, 0.0, 1.0)
    return Schedule(begun - ended, max(begun - max(past_peak, ended), 0.0))


@physics
def during(share: float, rate: Rate) -> Rate:
    """Rate that holds for a share of the step, as a mean over the step.

    `share`: share of the step [1], from 0 to 1; `rate`: rate during that share.
    """
    return Rate(share * rate.flux_rate, share * rate.at_end, share * rate.decay)


@physics
def relaxed_rate(rate: Rate, dt: float) -> float:
    """Mean over the step of dφ/dt [V] while the flux relaxes and the gap keeps closing.

    With y = dt · decay: (6 r + y r_end)/(6 + 4y + y²); with a gap at rest, r (6 + y)/(6 + 4y + y²). A rate that changes
    linearly by 2 (r_end − r) adds (r_end − r) ((1 − e^(−y))/y − 2 (1 − e^(−y)(1 + y))/y²) = (r_end − r) (y/6 − y²/12 +
    …). It is approximated by (r_end − r) y/(6 + 4y + y²), with this denominator and the limit 1/y for large y.

    `rate`: rates for the flux at the start of the step, with the gap at mid-step and at the end, and the decay.
    """
    return relaxation_numerator(rate, dt) / relaxation_denominator(rate, dt)


@physics
def sum_of_relaxed_rates(first: Rate, second: Rate, dt: float) -> float:
    """Sum of `relaxed_rate` of two parts of a step [V], over their common denominator.

    `first`, `second`: as the argument of `relaxed_rate`.
    """
    first_damping, second_damping = relaxation_denominator(first, dt), relaxation_denominator(second, dt)
    return (relaxation_numerator(first, dt) * second_damping + relaxation_numerator(second, dt) * first_damping) / (
        first_damping * second_damping
    )


@physics
def relaxation_numerator(rate: Rate, dt: float) -> float:
    """Numerator of `relaxed_rate` [V]: 6 r + y r_end."""
    return 6.0 * rate.flux_rate + dt * rate.decay * rate.at_end


@physics
def relaxation_denominator(rate: Rate, dt: float) -> float:
    """Denominator of `relaxed_rate` [1]: 6 + 4y + y²."""
    y = dt * rate.decay
    return 6.0 + y * (4.0 + y)


@physics
def apply_voltage(c: solenoid.Coefficients, voltage: float, now: solenoid.Circuit) -> Rate:
    """Flux rate under a given voltage, Eq. (11).

    `voltage`: v at the coil [V]; `now`: current with the gap of mid-step.
    """
    resistance = c.resistance * c.per_turn
    rate = voltage * c.per_turn - resistance * now.current
    return Rate(rate, rate + resistance * now.drift, resistance * now.slope)


@physics
def current_regulator(
    p: Parameters, c: solenoid.Coefficients, s: State, supply: Supply, now: solenoid.Circuit, dt: float
) -> Change:
    """Ideal regulator: v = R i* + G (i* − i) between −quench and +boost; after the end −boost until i = 0.

    Peak, hold and off count by their shares of the step, so a switching may fall anywhere inside it: the
    current is a smooth function of the parameters, as a fit needs it.

    `supply`: schedule, and measured trace; `now`: current with the gap of mid-step.
    """
    return regulate_current(p, c, Backward(p.quench_voltage, p.boost_voltage), supply, now, dt)


@physics
def free_wheel(
    p: Parameters, c: solenoid.Coefficients, s: State, supply: Supply, now: solenoid.Circuit, dt: float
) -> Change:
    """Ideal regulator without a voltage backwards: a current that must fall decays through a diode.

    It does so from the peak to the hold current and after the end of energising: N dφ/dt = −R i − V_d until i = 0.
    """
    return regulate_current(p, c, Backward(p.diode_voltage, p.diode_voltage), supply, now, dt)


@physics
def regulate_current(
    p: Parameters, c: solenoid.Coefficients, backward: Backward, supply: Supply, now: solenoid.Circuit, dt: float
) -> Change:
    """Mean flux rate of an ideal regulator with given voltages backwards.

    `backward`: voltages that reduce the current.
    """
    plan = supply.schedule
    peak = _towards(c, p.peak_current, p.regulator_gain, -backward.falling, p.boost_voltage, now)
    hold = _towards(c, p.hold_current, p.regulator_gain, -backward.falling, p.boost_voltage, now)
    hold_share = plan.on - plan.peak
    live = Rate(
        plan.peak * peak.flux_rate + hold_share * hold.flux_rate,
        plan.peak * peak.at_end + hold_share * hold.at_end,
        plan.peak * peak.decay + hold_share * hold.decay,
    )
    quenching = during(1.0 - plan.on, _towards(c, 0.0, p.regulator_gain, -backward.after_end, 0.0, now))
    return Change(sum_of_relaxed_rates(live, quenching, dt), 1.0)


@physics
def _towards(
    c: solenoid.Coefficients, target: float, gain: float, low: float, high: float, now: solenoid.Circuit
) -> Rate:
    """Flux rate of a regulator with limits of voltage.

    `target`: wanted current i* [A]; `gain`: gain G [V/A], > 0; `low`, `high`: limits of the voltage [V]; `now`: current
    with the gap of mid-step.
    """
    stiff = c.resistance + gain
    free = stiff * (target - now.current) * c.per_turn
    lowest = (low - c.resistance * now.current) * c.per_turn
    highest = (high - c.resistance * now.current) * c.per_turn
    rate = clamp(free, lowest, highest)
    resistance = (stiff if rate == free else c.resistance) * c.per_turn
    return Rate(rate, rate + resistance * now.drift, resistance * now.slope)


@physics
def quench(p: Parameters, c: solenoid.Coefficients, now: solenoid.Circuit) -> Rate:
    """Flux rate after the end of energising: −boost until the current has gone.

    `now`: current with the gap of mid-step.
    """
    return _towards(c, 0.0, p.regulator_gain, -p.boost_voltage, 0.0, now)


@physics
def pwm_voltage(p: Parameters, conducting: float) -> float:
    """Voltage that a state of the PWM applies [V]; `conducting`: state of the PWM [1]: 2 boost, 1 supply, 0 off."""
    return p.boost_voltage if conducting > 1.5 else (p.supply_voltage if conducting > 0.5 else -p.quench_voltage)


@physics
def toggle_conduction(conducting: float) -> float:
    """State of the PWM after its current has met a limit [1]; `conducting`: state before [1]."""
    return 0.0 if conducting > 0.5 else 1.0


@physics
def pwm(p: Parameters, c: solenoid.Coefficients, s: State, supply: Supply, now: solenoid.Circuit, dt: float) -> Change:
    """Two-point current control: first rise by +boost, then +supply and −quench in turn, switching inside the step.

    `now` is taken at the gap at mid-step; corrected for the armature's motion, it gives the current at the start of the
    step and at the end of energising or of the step. The instant at which the current reaches its limit is interpolated
    in between, and the voltage is averaged. If the rest of the step would carry the current past the other limit too,
    the transistor switches there repeatedly: the mean current stays at this limit.
    """
    plan = supply.schedule
    in_peak = plan.peak >= 0.5 * plan.on
    mean = p.peak_current if in_peak else p.hold_current
    half_band = 0.5 * (p.peak_band if in_peak else p.hold_band)
    conducting = s.conducting > 0.5
    voltage = pwm_voltage(p, s.conducting)
    upwards = 1.0 if conducting else -1.0
    limit = mean + upwards * half_band
    trial = during(plan.on, apply_voltage(c, voltage, now))
    # change of the current and its distance to the limit, both multiplied by the denominator of `relaxed_rate`; the
    # distance is negative if the step begins beyond the limit, because the band has moved
    per_change = relaxation_denominator(trial, dt)
    change = upwards * (dt * relaxation_numerator(trial, dt) * now.slope - 2.0 * now.drift * per_change)
    left = upwards * (limit - now.current - now.drift) * per_change
    crossed = change > left
    before = clamp(left / max(abs(change), TINY_CURRENT), 0.0, 1.0) if crossed else 1.0
    other = pwm_voltage(p, 0.0 if conducting else 1.0)
    # voltages at the limit, and across the band
    hold, band = c.resistance * limit, 2.0 * half_band / max(dt * plan.on * c.per_turn * now.slope, TINY_GAIN)
    swing = clamp((1.0 - before) * (other - hold), -band, band)
    live = during(plan.on, apply_voltage(c, before * voltage + (1.0 - before) * hold + swing, now))
    quenching = during(1.0 - plan.on, quench(p, c, now))
    flag = (toggle_conduction(s.conducting) if crossed else s.conducting) if plan.on > 0.0 else 2.0
    return Change(sum_of_relaxed_rates(live, quenching, dt), flag)


@physics
def voltage_trace(
    p: Parameters, c: solenoid.Coefficients, s: State, supply: Supply, now: solenoid.Circuit, dt: float
) -> Change:
    """Mean flux rate under a measured coil voltage v(t)."""
    return Change(relaxed_rate(apply_voltage(c, supply.trace, now), dt), 1.0)


@physics
def current_trace(
    p: Parameters, c: solenoid.Coefficients, s: State, supply: Supply, now: solenoid.Circuit, dt: float
) -> Change:
    """Mean flux rate that follows a measured coil current i(t), by the regulator without limits of voltage."""
    return Change(relaxed_rate(_towards(c, supply.trace, p.regulator_gain, -UNLIMITED, UNLIMITED, now), dt), 1.0)
