"""Run an observer over a log, shot after shot, each with the states estimated so far."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import toeplitz

from commonrail.base.arguments import array, function, instance, mapping, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.hooks import hold_interrupts, note
from commonrail.base.text import quantity
from commonrail.data.currents import LIMIT
from commonrail.engine.operating_point import RAIL_PRESSURES, Energising, read_pulses
from commonrail.physics.injector import Injector
from commonrail.plugins.observer import study
from commonrail.plugins.observer.disturbance import Disturbance, learn
from commonrail.plugins.observer.file import SLOWEST, Memory, Observation, ObservedShot
from commonrail.plugins.observer.further import (
    check_further_sensors,
    find_current_noise,
    join_covariances,
    select_current_samples,
)
from commonrail.plugins.observer.horizon import Horizon, Measured
from commonrail.plugins.observer.kalman import TRUSTED, Belief, StepTest, Update, innovation, update
from commonrail.plugins.observer.response import Response, Simulator
from commonrail.plugins.observer.study import ObserverSettings, ShotRecord

UNEVEN = 0.01  # largest deviation of a sampling interval from the median one
MEMORY = 0.1e-3  # correlation time of the model's pressure error: about a period of the waves in a line [s]
SHORTEST = 1e-6  # least energising time: the step of the simulations; no injector answers a shorter one [s]
FLOOR = 1e3  # standard deviation that keeps the covariance definite [Pa]
# Largest mean square innovation of another sensor: with many samples the limit of a shot, with one 3 deviations.
FITTING = {"current": TRUSTED, "return": 9.0}
FREE = 1.0  # initial deviation of an unknown meter gain


class Progress(NamedTuple):
    """Number of finished shots and total number."""

    done: int
    total: int


def observe(
    injector: Injector,
    time: ArrayLike,
    pressure: ArrayLike,
    energisings: Sequence[tuple[float, float]],
    settings: ObserverSettings | None = None,
    *,
    errors: Sequence[float] = (),
    further: Mapping[str, ArrayLike] | None = None,
    previous: Observation | None = None,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Observation:
    """Estimate injected quantity, opening and closing of every shot of a log, and the drift of the injector.

    Ctrl-C ends with the shots that are done.

    Parameters
    ----------
    injector : Injector
        With a rail volume (`rail_boundary = "volume"`), such as a calibrated one.
    time : (samples,)
        Evenly spaced, in the clock of the energisings [s].
    pressure : (samples,)
        Measured by the sensor `settings.sensor` [Pa].
    energisings : sequence of (start, duration)
        In order [s].
    settings : ObserverSettings, optional
    errors : sequence of float, optional
        Largest error of the duration of each energising, as read from a current [s]. Shots with an error above
        `data.currents.LIMIT` are refused: they have no figures and raise no alarm.
    further : mapping of str to (samples,), optional
        Samples of further sensors at the same times: "current", of the coil [A]; "return", flow through the return line
        [kg/s], whose mean from each shot to the next counts.
    previous : Observation, optional
        Of an earlier log of the same injector and sensor, whose states, disturbance and drift test continue.
    threads : int, optional
        Default: all usable processors; the result does not depend on it.
    progress : function of Progress, optional

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong type, times are not evenly spaced, the injector has an ideal rail, or the log
        holds no whole shot.
    """
    study.check_model(instance(injector, Injector, "injector"))
    samples_by_sensor = mapping(further or {}, "further", '{"current": amperes}')
    settings = _settings(injector, settings, previous, tuple(samples_by_sensor))
    study.check_model(injector, settings.further)
    report = function(progress, "progress") or (lambda _: None)
    clock, shown = array(time, "s", "time", 1), array(pressure, "Pa", "pressure", 1)
    pulses = read_pulses(energisings)
    _check_log(clock, shown, pulses)
    more = {name: array(samples_by_sensor[name], study.FURTHER[name], name, 1) for name in settings.further}
    for name, samples in more.items():
        if len(samples) != len(clock):
            raise ConfigurationError(f'The log has {len(clock)} times, but {len(samples)} samples of "{name}".')
    shots = study.cut_log(clock, shown, tuple(pulses), settings, more)
    if not shots:
        raise ConfigurationError(
            "The log holds no whole shot: each needs pressure from before its first energising to after its last; "
            "check that time and energisings have one clock and the right units."
        )
    doubtful = [pulse.start for pulse, error in zip(pulses, errors, strict=True) if error > LIMIT] if errors else []
    sure = [shot for shot in shots if not any(-1e-9 < at - shot.start < shot.time[-1] for at in doubtful)]
    if len(sure) < len(shots):
        text = (
            f"{len(shots) - len(sure)} of {len(shots)} shots are refused: their current does not give their energising "
            f"times to {quantity(LIMIT, 's')}"
        )
        if not sure:
            raise ConfigurationError(f"{text}; sample it at 200 kHz, or give the times of the command.")
        note(f"{text}, and they have no figures.")
    check_further_sensors(sure, settings.further)
    return _Run(injector, settings, sure, thread_count(threads), previous).observe_all(report)


def _settings(
    injector: Injector, settings: ObserverSettings | None, previous: Observation | None, further: tuple[str, ...]
) -> ObserverSettings:
    if previous is None:
        settings = ObserverSettings() if settings is None else instance(settings, ObserverSettings, "settings")
        settings = replace(settings, further=settings.further or further)
        complete = replace(settings, states=study.resolve_states(injector, settings))
    else:
        complete = instance(previous, Observation, "previous").settings
        if settings is not None or injector is not previous.injector:
            raise ConfigurationError(
                "An observation continues with its own injector and settings; give `previous.injector`, no settings."
            )
    if set(complete.further) != set(further):
        named_sensors, given_names = (", ".join(names) or "none" for names in (complete.further, further))
        raise ConfigurationError(
            f"The further sensors of the settings are {named_sensors}, but samples were given of {given_names}; give "
            "both for the same sensors."
        )
    return complete


def _check_log(clock: Floats, shown: Floats, pulses: Sequence[Energising]) -> None:
    if len(clock) != len(shown) or len(clock) < 100:
        raise ConfigurationError(
            f"A log needs 100 samples or more, and as many times as pressures, not {len(clock)} and {len(shown)}."
        )
    steps = np.diff(clock)
    middle = float(np.median(steps))
    uneven = np.flatnonzero(~(np.abs(steps - middle) <= UNEVEN * middle))
    if len(uneven):
        i = int(uneven[0])
        gap, usual = quantity(float(steps[i]), "s", 3), quantity(middle, "s", 3)
        raise ConfigurationError(
            f"The times of a log must be evenly spaced, and sample {i + 2} at {clock[i + 1]:.9g} s lies {gap} after "
            f"the one before it, where {usual} are usual; resample the log, or cut it there."
        )
    if np.any(far := np.abs(shown) > RAIL_PRESSURES.high):
        at = f"{shown[far][0]:.3g} Pa at {clock[far][0]:.9g} s"
        raise ConfigurationError(f"The log has a pressure of {at}, beyond any sensor; correct it or its unit.")
    if SLOWEST * middle > 1.0 + UNEVEN:
        raise ConfigurationError(
            f"The log has {1e-3 / middle:.3g} samples per millisecond, and an observer needs {1e-3 * SLOWEST:g}; "
            "sample the pressure faster, or check the unit of the time."
        )
    ends = [pulse.start + pulse.duration for pulse in pulses]
    for pulse, end in zip(pulses[1:], ends, strict=False):
        if pulse.start < end:
            raise ConfigurationError(f"The energising at {pulse.start:g} s begins before the one before it ends.")
    for pulse in pulses:
        if pulse.duration < SHORTEST:
            raise ConfigurationError(
                f"The energising at {pulse.start:g} s lasts {quantity(pulse.duration, 's', 3)}, less than "
                f"{quantity(SHORTEST, 's', 3)}; check the unit of its duration."
            )


def make_covariance(
    disturbance: Disturbance, settings: ObserverSettings, at: Floats, shot: ShotRecord
) -> Callable[[Response], Floats]:
    """Covariance (rows, rows) of disturbance and discrepancy at times (samples,) [s] of a shot, from a response."""
    before = disturbance.covariance(at) + FLOOR**2 * np.eye(len(at))
    alike = toeplitz(np.exp(-(at - at[0]) / MEMORY))

    def covariance(response: Response) -> Floats:
        after = np.where(at > 0.0, settings.discrepancy * np.abs(response.shown[: len(at)]), 0.0)
        of_pressure = np.asarray(before + np.outer(after, after) * alike)
        return join_covariances(of_pressure, alike, settings, shot, response.shown, at) if shot.further else of_pressure

    return covariance


class _Run:
    def __init__(
        self,
        injector: Injector,
        settings: ObserverSettings,
        shots: list[ShotRecord],
        threads: int | None,
        previous: Observation | None,
    ) -> None:
        self.injector, self.settings = injector, settings
        self.shots = shots
        self.simulator = Simulator(injector, settings, threads or 1)
        if previous is not None:
            self.memory, self.disturbance = copy.deepcopy(previous.memory), previous.disturbance
            return
        test = StepTest(settings.states, settings.window, settings.significance)
        free = [
            state._replace(deviation=FREE if state.name == study.METER_GAIN else state.deviation)
            for state in settings.states
        ]
        self.memory = Memory(Belief.before(settings.states), test, 0, Belief.before(tuple(free)))
        clock = shots[0].time
        many = settings.count_averaged_samples(clock)
        quiet = [self.simulator.average(shot.quiet, shot.time) for shot in shots]
        noise = None if settings.noise is None else settings.noise / many**0.5
        self.disturbance = settings.disturbance or learn(quiet, many * float(clock[1] - clock[0]), noise)
        if "current" in settings.further and settings.current_noise is None:
            self.settings = replace(settings, current_noise=find_current_noise(shots))

    def observe_all(self, report: Callable[[Progress], None]) -> Observation:
        begin = time.perf_counter()
        states, observed_shots = self.settings.states, list[ObservedShot]()
        belief, test, earlier, self.alone = self.memory
        horizon = Horizon(states, self.settings.horizon, self.settings.iterations)
        with hold_interrupts() as request:
            for k, shot in enumerate(self.shots):
                if request.asked:
                    break
                before = belief.walk(states)
                self.alone = self.alone.walk(states)
                observed, measured, done = self._observe(shot, before)
                alarm = None
                if done is not None:
                    belief = done.belief
                    if earlier + k >= self.settings.learning and done.consistency <= TRUSTED:
                        test.add(before, belief)
                        alarm = test.alarm()
                    observed = _correct(observed._replace(consistency=done.consistency, alarm=alarm), done)
                    horizon.add(k, measured, done, before)
                observed_shots.append(observed)
                if alarm is not None:  # restart the changed state from its initial deviation
                    changed = np.array([(state.name == alarm.state) * state.deviation**2 for state in states])
                    horizon.change(alarm.ago, changed)
                    belief, self.alone = belief.spread(changed), self.alone.spread(changed)
                    test.reset()
                if self.settings.horizon > 1 and done is not None:
                    belief = horizon.solve()
                    for i, better in horizon.updates():
                        observed_shots[i] = _correct(observed_shots[i], better)
                report(Progress(k + 1, len(self.shots)))
            if not observed_shots:
                request.check()
        failed = sum(shot.figures is None for shot in observed_shots)
        if failed:
            refused = self.simulator.refused
            if refused is not None and failed == len(observed_shots):
                raise refused
            reason = "" if refused is None else f" The first of them: {refused}"
            note(f"{failed} of {len(observed_shots)} shots could not be simulated and have no figures.{reason}")
        return Observation(
            injector=self.injector,
            settings=self.settings,
            disturbance=self.disturbance,
            memory=Memory(belief, test, earlier + len(observed_shots), self.alone if self.settings.further else belief),
            shots=tuple(observed_shots),
            asked=len(self.shots),
            injections=self.simulator.simulations,
            seconds=time.perf_counter() - begin,
        )

    def _observe(self, shot: ShotRecord, belief: Belief) -> tuple[ObservedShot, Measured, Update | None]:
        """Observe a shot: open-loop figures with the sensors in use, measurements, and update."""
        at = self.simulator.average(shot.time, shot.time)
        at = np.where(np.abs(at) < 1e-6 * (at[1] - at[0]), 0.0, at)  # removes rounding of a sample at the start
        samples = self.simulator.average(shot.pressure, shot.time)
        rest = float(samples[at < 0.0].mean())
        rows, further = {"": samples - rest}, dict[str, bool]()
        if "current" in shot.further:
            amperes = self.simulator.average(shot.further["current"], shot.time)
            rows["current"] = (amperes - amperes[at < 0.0].mean())[select_current_samples(shot, at)]
        if "return" in shot.further:
            rows["return"] = shot.further["return"]
        first = self.simulator.at(shot, rest, belief.mean) if self.settings.further else None
        if first is not None:
            further = self._find_agreeing(shot, at, rows, first, belief.mean)
            if not all(further.values()):
                rows = {name: row for name, row in rows.items() if further.get(name, True)}
                shot, first = shot._replace(further={name: shot.further[name] for name in rows if name}), None

        def simulate(x: Floats) -> Response | None:
            return self.simulator.at(shot, rest, x) if first is None or np.any(x != belief.mean) else first

        covariance = make_covariance(self.disturbance, self.settings, at, shot)
        measured = Measured(np.concatenate(list(rows.values())), covariance, simulate)
        done = update(belief, self.settings.states, *measured, self.settings.iterations)
        open_loop, rate = self.simulator.figures(shot, rest) or (None, None)
        observed = ObservedShot(shot.start, rest, shot.energisings, open_loop, rate_open_loop=rate, further=further)
        return observed, measured, done

    def _find_agreeing(
        self, shot: ShotRecord, at: Floats, rows: dict[str, Floats], first: Response, x: Floats
    ) -> dict[str, bool]:
        """True for each further sensor that agrees with the pressures so far; the shot also updates `alone`.

        In `alone` the return meter's gain is free: its readings estimate the gain, which must be plausible.
        `first`: response at states `x`, from which it is linear.
        """
        states, alone = self.settings.states, self.alone
        spread = make_covariance(self.disturbance, self.settings, at, shot)(first)
        measured = np.concatenate(list(rows.values()))
        names = np.repeat(list(rows), [len(row) for row in rows.values()])
        residual, fits = measured - first.shift(alone.mean - x).shown, dict[str, bool]()
        for name in rows.keys() - {""}:
            both = np.flatnonzero((names == "") | (names == name))
            white = innovation(alone, states, residual[both], first.slopes[both], spread[np.ix_(both, both)])
            fits[name] = bool(np.mean(white[len(at) :] ** 2) <= FITTING[name])
        gains = [i for i, state in enumerate(states) if state.name == study.METER_GAIN]
        counts = bool(gains) and fits.get("return", False)
        rows_that_teach = np.flatnonzero((names == "") | ((names == "return") & counts))
        cut = first._replace(shown=first.shown[rows_that_teach], slopes=first.slopes[rows_that_teach])
        covariance = spread[np.ix_(rows_that_teach, rows_that_teach)]
        taught = update(alone, states, measured[rows_that_teach], lambda _: covariance, lambda y: cut.shift(y - x), 1)
        assert taught is not None  # no simulation can fail here
        if counts:
            variance = taught.belief.covariance[gains[0], gains[0]] + states[gains[0]].deviation ** 2
            fits["return"] = bool(taught.belief.mean[gains[0]] ** 2 <= FITTING["return"] * variance)
        if taught.consistency > TRUSTED:
            fits = dict.fromkeys(fits, True)
        self.alone = taught.belief
        return fits


def _correct(shot: ObservedShot, done: Update) -> ObservedShot:
    """Shot with the figures of an update."""
    is_known = np.isfinite(done.figures) & np.isfinite(done.figures[1])  # without an opening its slopes are useless
    return shot._replace(
        figures=done.figures,
        deviations=np.where(is_known, done.deviations, np.nan),
        drift=done.belief.mean,
        drift_deviations=np.sqrt(np.diag(done.belief.covariance)),
        rate=done.rate,
        rate_deviation=done.rate_deviation,
    )
