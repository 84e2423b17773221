"""Simulate a shot at the drift states and with a small change of each: pressure, quantities, opening, closing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.hooks import naming
from commonrail.engine import lanes, plan
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.status import which_failed
from commonrail.physics.components.solenoid import Parameters
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_paths
from commonrail.plugins.observer import study
from commonrail.plugins.observer.further import PATHS, coil_current, read_meter, select_current_samples
from commonrail.plugins.observer.study import ObserverSettings, ShotRecord

# Temperature steps of the fuel properties [K], linear in between; computing them takes as long as a shot.
WARMTH = 5.0
STEP = 0.1  # difference of a state, in initial standard deviations
LATER, LOWER = 1e-6, 0.1e6  # differences of the delay [s] and of the initial pressure [Pa]
OPEN = 0.02  # share of an injection's largest rate at which it opens and closes, where the slope is steep
BODY = 0.25  # share that an injection exceeds; a bounce of the needle stays below it
RATE_STEP = 10e-6  # over which a rate is averaged [s]
LATEST = 0.5e-3  # longest opening delay [s]


class Response(NamedTuple):
    """Simulated shot and its derivatives by the states.

    Attributes
    ----------
    shown : (rows,)
        Pressure as the sensor shows it, minus its value at rest [Pa]; then readings of further sensors, in SI units.
    slopes : (rows, states)
    figures : (3, injections)
        Quantity [m³], opening and closing [s] of each injection; NaN without an injection.
    figure_slopes : (3, injections, states)
    rate : (times,)
        Mean injection rate over each `RATE_STEP` from the first energising on [m³/s].
    rate_slopes : (times, states)
    """

    shown: Floats
    slopes: Floats
    figures: Floats
    figure_slopes: Floats
    rate: Floats
    rate_slopes: Floats

    def shift(self, by: Floats) -> Response:
        """Response at states changed by `by` (states,), linear."""
        return self._replace(
            shown=self.shown + self.slopes @ by,
            figures=self.figures + self.figure_slopes @ by,
            rate=self.rate + self.rate_slopes @ by,
        )


class Traced(NamedTuple):
    """Times (samples,) [s], pressures [Pa], injected masses [kg] (candidates, samples).

    `further`: currents [A] and returned masses [kg], of the same shape, by sensor.
    """

    time: Floats
    pressure: Floats
    injected: Floats
    further: dict[str, Floats]


class Simulator:
    """Simulates shots of one injector.

    Parameters
    ----------
    injector : Injector
    settings : ObserverSettings
    threads : int
        The result does not depend on it.
    """

    def __init__(self, injector: Injector, settings: ObserverSettings, threads: int = 1) -> None:
        self.injector, self.settings = injector, settings
        self.threads = threads
        self.states = settings.states
        self.names = tuple(state.parameter for state in self.states if state.parameter)
        self._variant = injector.wired(self.names)
        paths = lanes.trace_paths(self._variant)
        more = [path for name in settings.further for path in PATHS[name]]
        self._rows = {path: paths.index(path) for path in (study.SENSORS[settings.sensor], "nozzle.injected", *more)}
        self.simulations = 0
        self.refused: ConfigurationError | None = None  # error of the first shot that cannot be simulated at any state

    def at(self, shot: ShotRecord, rest: float, x: Floats) -> Response | None:
        """Response at states `x` (states,), None if the simulation fails; `rest`: reading at rest [Pa]."""
        grid_states = self._at_grid(x)
        try:
            response = self._at(shot, rest, grid_states)
        except ConfigurationError:  # the fuel is not defined at the pressure of these states or this shot
            return None
        if response is None or not np.isfinite(response.shown).all():
            return None
        return response if np.array_equal(grid_states, x) else response.shift(x - grid_states)

    def _at_grid(self, x: Floats) -> Floats:
        """Round states to the grid of the settings, and the fuel temperature to the nearest step in its range."""
        fine, x = x, x.copy()
        for i, state in enumerate(self.states):
            if self.settings.grid:
                cell = self.settings.grid * state.deviation
                x[i] = np.round(fine[i] / cell) * cell
            if state.parameter == FUEL_TEMPERATURE:
                steps = warm_steps(self.injector)
                x[i] = steps[np.argmin(np.abs(steps - fine[i]))]
        return x

    def _at(self, shot: ShotRecord, rest: float, x: Floats) -> Response | None:
        n, by_name = len(self.states), {state.name: i for i, state in enumerate(self.states)}
        sensor = {name: x[by_name[name]] if name in by_name else 0.0 for name in study.SENSOR_STATES}
        steps = np.array([1.0 if s.parameter == FUEL_TEMPERATURE else STEP * s.deviation for s in self.states])
        changed = [x + steps[i] * np.eye(n)[i] for i, state in enumerate(self.states) if state.parameter]
        scale = 1.0 + sensor[study.GAIN]
        true = (rest - sensor[study.OFFSET]) / scale
        true = float(np.round(true)) if self.settings.grid else true
        traces = self._traces(shot, true, np.array([x, *changed]))
        if traces is None:
            return None
        time, injected = traces.time, traces.injected
        shown = self._readings(shot, traces, sensor)
        cuts = find_cuts(time, injected[0], shot.energisings)
        density = self._densities(np.array([x, *changed]))
        figures = np.array([find_figures(time, row, cuts) for row in injected])
        figures[:, 0] /= density
        rates = mean_rate(time, injected) / density
        slopes, figure_slopes = np.zeros((len(shown[0]), n)), np.zeros((*figures[0].shape, n))
        rate_slopes = np.zeros((len(rates[0]), n))
        lane = 0
        for i, state in enumerate(self.states):
            if state.parameter:
                lane += 1
                slopes[:, i] = (shown[lane] - shown[0]) / steps[i]
                figure_slopes[..., i] = (figures[lane] - figures[0]) / steps[i]
                rate_slopes[:, i] = (rates[lane] - rates[0]) / steps[i]
            elif state.name not in (study.GAIN, study.OFFSET):
                by = LATER if state.unit == "s" else STEP * state.deviation
                other = self._readings(shot, traces, {**sensor, state.name: sensor[state.name] + by})[0]
                slopes[:, i] = (other - shown[0]) / by
        lower = self._traces(shot, true - LOWER, x[None])
        if lower is not None:  # both errors of the sensor also move the true pressure at rest
            by_rest = (self._readings(shot, lower, sensor)[0] - shown[0]) / LOWER
            lowered = find_figures(time, lower.injected[0], cuts)
            lowered[0] /= density[0]
            figures_by_rest = (lowered - figures[0]) / LOWER
            rate_by_rest = (mean_rate(time, lower.injected)[0] / density[0] - rates[0]) / LOWER
            pressure_rows = np.where(np.arange(len(shown[0])) < len(self.average(shot.time, shot.time)), shown[0], 0.0)
            for name, drop, error in ((study.OFFSET, 0.0, 1.0 / scale), (study.GAIN, 1.0 / scale, true / scale)):
                if name in by_name:
                    slopes[:, by_name[name]] = drop * pressure_rows + error * by_rest
                    figure_slopes[..., by_name[name]] = error * figures_by_rest
                    rate_slopes[:, by_name[name]] = error * rate_by_rest
        sound = np.isfinite(slopes).all(axis=0)  # a change that cannot be simulated gives no slope
        pressure_rows, of_figures, of_rate = (
            np.where(sound, table, 0.0) for table in (slopes, np.nan_to_num(figure_slopes), rate_slopes)
        )
        return Response(shown[0], pressure_rows, figures[0], of_figures, rates[0], of_rate)

    def figures(self, shot: ShotRecord, rest: float) -> tuple[Floats, Floats] | None:
        """Figures (3, injections) and rate (times,) at zero states, as in `Response`; None if that fails."""
        x = np.zeros((1, len(self.states)))
        try:
            traces = self._traces(shot, rest, x)
        except ConfigurationError as error:  # such as a pressure at rest below the cylinder pressure
            self.refused = self.refused or error
            return None
        if traces is None:
            return None
        time, injected = traces.time, traces.injected
        density = self._densities(x)[0]
        figures = find_figures(time, injected[0], find_cuts(time, injected[0], shot.energisings))
        figures[0] /= density
        return figures, mean_rate(time, injected)[0] / density

    def values(self, x: Floats) -> Floats:
        """Values (candidates, names) of the parameters at states (candidates, states), SI."""
        columns = []
        for i, state in enumerate(self.states):
            if state.parameter:
                value = self.injector.values[state.parameter]
                change = [
                    math.exp(state.power * value_of_state) for value_of_state in x[:, i].tolist()
                ]  # powers by C's function, from which NumPy's may differ
                columns.append(value * np.array(change) if state.power else value + x[:, i])
        return np.array(columns).T

    def _densities(self, x: Floats) -> Floats:
        """Densities in the cylinder (candidates or 1, 1) at the fuel temperatures of states (candidates, states)."""
        point = self._point(100e6, (), 1e-3)  # at any rail pressure
        return plan.reference_densities(self.injector, [point], self.names, self.values(x))

    def _point(self, rail: float, pulses: tuple[Energising, ...], horizon: float) -> OperatingPoint:
        settings = self.settings
        return OperatingPoint(rail, pulses, settings.cylinder_pressure, settings.return_pressure, horizon=horizon)

    def _traces(self, shot: ShotRecord, rail: float, x: Floats) -> Traced | None:
        """Traces at states (candidates, states); None if the first fails."""
        dt = self.settings.time_step
        steps = int(np.ceil((float(shot.time[-1]) + 20e-6) / dt))
        fixed = self.settings.grid > 0.0
        pulses = tuple(Energising(*np.round(1e9 * np.array(p)) / 1e9) for p in shot.energisings) if fixed else None
        prepared = plan.prepare(self.injector, [self._point(rail, pulses or shot.energisings, steps * dt)], dt)
        values = self.values(x)
        inside = plan.admissible(self.names, values, self.injector.fuel)
        values = np.where(inside[:, None], values, values[0])
        theta = plan.candidate_matrix(self.injector, self.names, values, prepared.row)
        job = plan.make_job(prepared, theta, False)
        with naming(f"{self._variant.label}, f64"):
            outcome, trace = lanes.run(job, self._variant, traced=True, threads=self.threads, same_bits=fixed)
        self.simulations += len(x)
        failed = which_failed(plan.statuses_of(self.names, theta, prepared, outcome))[:, 0] | ~inside
        if failed[0]:
            return None
        rows = {}
        for name, row in self._rows.items():
            samples = np.moveaxis(trace[:, :, row, :], 1, 2).reshape(-1, trace.shape[1])[: len(x)]
            rows[name] = np.where(failed[:, None], np.nan, samples)
        further = {name: rows[PATHS[name][0]] for name in self.settings.further}
        if "current" in further:
            column = parameter_paths(self.injector.variant.actuation).index
            names = ("valve.lift", *(f"solenoid.{name}" for name in Parameters._fields))
            coil = {name: theta[:, column(name), None] for name in names}
            further["current"] = coil_current(coil, *(rows[path] for path in PATHS["current"]))
        time = np.asarray(dt * np.arange(trace.shape[1]))
        return Traced(time, rows[study.SENSORS[self.settings.sensor]], rows["nozzle.injected"], further)

    def _readings(self, shot: ShotRecord, traced: Traced, sensor: Mapping[str, float]) -> Floats:
        """Readings of the sensors (candidates, rows), as `Response.shown`, with errors of the sensors by name."""
        time, pressure = traced.time, traced.pressure
        parts = [
            (1.0 + sensor[study.GAIN]) * (self._sample(shot, time, pressure, sensor[study.DELAY]) - pressure[:, :1])
        ]
        if "current" in shot.further:
            flows = select_current_samples(shot, self.average(shot.time, shot.time))
            parts.append(self._sample(shot, time, traced.further["current"], sensor[study.CURRENT_DELAY])[:, flows])
        if "return" in shot.further:
            parts.append(read_meter(traced.further["return"], time, shot.period, sensor[study.METER_GAIN]))
        return np.hstack(parts)

    def _sample(self, shot: ShotRecord, time: Floats, pressure: Floats, delay: float) -> Floats:
        """Averaged samples (candidates, samples) of pressures that the sensor shows after a delay [s]."""
        return np.array([self.average(np.interp(shot.time - delay, time, row), shot.time) for row in pressure])

    def average(self, samples: Floats, time: Floats) -> Floats:
        """Means of as many samples as cover the averaging time."""
        many = self.settings.count_averaged_samples(time)
        used = len(samples) // many * many
        return np.asarray(samples[:used].reshape(-1, many).mean(axis=1))


def mean_rate(time: Floats, injected: Floats) -> Floats:
    """Mean rates (candidates, times) [kg/s] over each `RATE_STEP` of injected masses (candidates, samples) [kg]."""
    grid = RATE_STEP * np.arange(int(time[-1] / RATE_STEP) + 1)
    return np.asarray(np.diff([np.interp(grid, time, row) for row in injected]) / RATE_STEP)


def warm_steps(injector: Injector) -> Floats:
    """Changes of the fuel temperature (steps,) [K] at which the fuel is defined, also at 1 K above."""
    here, steps = injector.values[FUEL_TEMPERATURE], WARMTH * np.arange(-40, 41)
    both = injector.fuel.is_defined_at(here + steps) & injector.fuel.is_defined_at(here + steps + 1.0)
    return np.asarray(steps[both])


def find_cuts(time: Floats, injected: Floats, pulses: tuple[Energising, ...]) -> list[int]:
    """Indices that separate the injections: the smallest rate at the beginning of the next energising."""
    rate = np.diff(injected)
    cuts = [0]
    for pulse in pulses[1:]:
        first, last = np.searchsorted(time, [pulse.start, pulse.start + min(LATEST, pulse.duration)])
        cuts.append(int(first) + int(np.argmin(rate[first : max(last, first + 1)])))
    return [*cuts, len(time) - 1]


def find_figures(time: Floats, injected: Floats, cuts: list[int]) -> Floats:
    """Injected mass [kg], opening and closing [s] between the cuts, (3, injections).

    An injection opens and closes at the crossings of `OPEN` of its largest rate next to the part above `BODY`. `time`,
    `injected` (samples,): [s], [kg].
    """
    rate = np.diff(injected)
    figures = np.full((3, len(cuts) - 1), np.nan)
    for k, (first, last) in enumerate(pairwise(cuts)):
        figures[0, k] = injected[last] - injected[first]
        level = OPEN * rate[first:last].max()
        if level > 0.0:
            body = np.flatnonzero(rate[first:last] > BODY / OPEN * level) + first
            below = np.flatnonzero(rate <= level)
            i = np.searchsorted(below, [body[0], body[-1]])
            if i[0] > 0:
                figures[1, k] = _crossing(time, rate, level, int(below[i[0] - 1]))
            if i[1] < len(below):
                figures[2, k] = _crossing(time, rate, level, int(below[i[1]]) - 1)
    return figures


def _crossing(time: Floats, rate: Floats, level: float, i: int) -> float:
    """Time at which the rate passes a level after the middle of step `i` and before the middle of the next step [s]."""
    if not 0 <= i < len(rate) - 1:
        return np.nan
    share = (level - rate[i]) / (rate[i + 1] - rate[i])
    return float(time[i] + (0.5 + share) * (time[1] - time[0]))
