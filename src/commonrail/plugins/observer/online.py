"""Observer without Python: its filter as C around the injector's own code, in a library or an FMU."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.errors import ConfigurationError, InputError
from commonrail.cli.options import check_file, check_folder
from commonrail.engine.job import make_rows
from commonrail.engine.operating_point import OperatingPoint
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_paths
from commonrail.physics.variants import wiring
from commonrail.plugins.export.description import RAIL, Kind, Variable
from commonrail.plugins.export.entry_points import LANES
from commonrail.plugins.export.fmu import Instance, find_tools, write_instance
from commonrail.plugins.export.library import Library, write_library_with
from commonrail.plugins.export.object_files import Target, compiler_for, find_target, own_platform
from commonrail.plugins.export.sources import Model, make_model
from commonrail.plugins.observer import kalman, response, run, study
from commonrail.plugins.observer.disturbance import MEAN, TREND, Disturbance
from commonrail.plugins.observer.file import Observation
from commonrail.plugins.observer.study import DriftState, ObserverSettings
from commonrail.report.html import render

INJECTIONS = 5  # most in a shot
SPAN = 6e-3  # most from a shot's first energising to the end of its last [s]
WORK = 5.0  # block steps per sample, per block and 10 µs of the sampling interval; chosen
BEGIN = 20.0  # units of work to start a lane


# Shots are simulated at states on a grid, in multiples of the initial deviations. Slopes are differences, and rounding
# grows a hundredfold per iteration: C and Python would differ after some shots. On a grid they agree.
GRID = 0.05
# Half the work of 4 at the same accuracy: median quantity error 2.4 % against 2.3 % on 6 injectors with 16 shots each
# of studies/observer_trial.py (seed 1).
ITERATIONS = 2


class Online(NamedTuple):
    """Model and settings of an online observer; `sampling`: time between its samples [s].

    `settings` must have the disturbance, which is not estimated online.
    """

    injector: Injector
    settings: ObserverSettings
    sampling: float

    @classmethod
    def after(cls, observation: Observation, sampling: float) -> Online:
        """Observer with the settings of an observation and the disturbance of its log."""
        settings = replace(
            observation.settings, disturbance=observation.disturbance, grid=GRID, iterations=ITERATIONS, horizon=1
        )
        return cls(observation.injector, settings, sampling)


def check_online(place: Path) -> list[Target]:
    """Refuse a place that `write_online` could not write, or that holds other files; return the platform.

    `InputError` or `ConfigurationError`.
    """
    names = own_platform()
    if not names:
        raise ConfigurationError("An observer cannot be written for this kind of machine; see `commonrail export`.")
    targets = [find_target(names[0])]
    if place.suffix.lower() == ".fmu":
        check_file(place, "--online")
        find_tools(targets, 2)
        return targets
    check_folder(place)
    compiler_for(targets[0])
    if place.suffix[1:2].isalpha() and not place.exists():
        raise InputError(f"--online: {place} has the ending of a file; name a new folder without one, or FILE.fmu.")
    if place.exists() and any(place.iterdir()) and not any(place.glob("*_observer.h")):
        raise InputError(f"--online: {place} has other files than an observer's; name a new folder, or FILE.fmu.")
    return targets


def write_online(online: Online, place: Path) -> None:
    """Write the observer for this machine: as an FMU if `place` ends with .fmu, else as a library in that folder.

    Errors as in `check_online` and `write_observer_library`.
    """
    write = write_observer_fmu if place.suffix.lower() == ".fmu" else write_observer_library
    write(online, place, check_online(place))


def write_observer_library(online: Online, folder: Path, targets: Sequence[Target]) -> Library:
    """Write the injector's C library with the observer in it; errors as in `export.library.write_library`.

    `ConfigurationError` also if the model has no rail volume, or the settings no disturbance.
    """
    texts = observer_texts(online)
    return write_library_with(partial(_model, online.injector), texts, folder, targets)


def _model(injector: Injector) -> Model:
    """Sources of the library, with the fuel at all temperatures at which shots are simulated."""
    steps = injector.values[FUEL_TEMPERATURE] + response.warm_steps(injector)
    return make_model(injector, [float(t + more) for t in steps for more in (0.0, 1.0)])


def write_observer_fmu(online: Online, out: Path, targets: Sequence[Target], fmi: int = 2) -> tuple[str, ...]:
    """Write the observer as an FMU for co-simulation; return the names of its files.

    Errors as in `write_observer_library`, and if version `fmi` of the standard, 2 or 3, has no such platform.
    """
    find_tools(targets, fmi)
    texts = observer_texts(online)
    model, listed = _model(online.injector), online_variables(online)
    stamp = hashlib.sha256("".join([model.stamp, *texts.values()]).encode()).hexdigest()
    titled = replace(online.injector, title=f"Injected quantities of {online.injector.title} from a measured pressure")
    texts |= {
        "fmu.h": _template("observer_fmu.h").replace("/*START*/", f"/*START*/\n#define CR_FMU_RAIL {RAIL!r}"),
        "fmu.c": _template("observer_fmu.c"),
    }
    numbers = {"sampling": 1e6 * online.sampling, "pause": 1e3 * online.settings.gap, "version": version("commonrail")}
    about: dict[str, Any] = {"title": titled.title, "injector": online.injector, "variables": listed}
    page = render("online.html", package=__package__, **about, **numbers)
    instance = Instance(model._replace(injector=titled, stamp=stamp), listed, texts, page, blocks=True)
    return write_instance(instance, out, targets, fmi)


def online_variables(online: Online) -> list[Variable]:
    """Variables of the observer's FMU, in the order of the fields of ``cr_observed`` after the inputs."""
    real = partial(Kind, "Real")
    states = study.resolve_states(online.injector, online.settings)
    work = "inner work of a sample at most, in time steps of a block of injectors"
    energised = "share of the time in which the coil is energised, 0 to 1"
    low, high = online.injector.fuel.pressure_range
    figures = [("quantity", "m3", "volume of injection {}")]
    figures += [(name, "s", f"{name} of injection {{}}, {{since}}") for name in ("opening", "closing")]
    since = "from the start of the first energising of the shot on"
    outputs = [
        ("shots", "1", "shots evaluated so far; the other outputs are those of the last one"),
        ("valid", "1", "1 if that one has figures; 0 if it could not be simulated, and before the first shot"),
        ("start", "s", "start of its first energising, after the start of the simulation"),
        ("rail_pressure", "Pa", "pressure that the sensor showed before it"),
        ("injections", "1", "injections of the shot"),
        ("consistency", "1", f"squared innovation over its expectation; beyond {kalman.TRUSTED:g} nothing was learnt"),
        ("missed", "1", "shots without figures so far: too long, or too early after the previous shot"),
        ("failed", "1", "shots so far that could not be simulated"),
        ("alarms", "1", "alarms so far"),
        ("alarm", "1", "state that drifted, counted from 1 in the order of drift; 0 without an alarm at this shot"),
        ("alarm_ago", "1", "shots since its step"),
        ("alarm_size", "1", "its step, in the unit of the state"),
        ("alarm_deviation", "1", "standard deviation of the step"),
        ("longest", "1", "inner work of the longest step so far"),
    ]
    for i in range(1, INJECTIONS + 1):
        outputs += [(f"injection[{i}].{name}", unit, text.format(i, since=since)) for name, unit, text in figures]
        outputs += [
            (f"injection[{i}].{name}_deviation", unit, f"standard deviation of the {name} of injection {i}")
            for name, unit, _ in figures
        ]
    for kind, text in (("drift", "drift state: {}"), ("drift_deviation", "standard deviation of the drift state: {}")):
        outputs += [(f"{kind}.{re.sub('[ -]', '_', s.name)}", s.unit, text.format(s.name)) for s in states]
    shown = real("output", "continuous")
    return [
        Variable("pressure", 0, real("input", "continuous"), "Pa", "measured pressure", RAIL, low, high),
        Variable("command", 1, real("input", "continuous"), "1", energised, 0.0, 0.0, 1.0),
        Variable("work", 2, real("parameter", "fixed"), "1", work, _work(states, online.sampling), 0.0),
        *(Variable(name, 100 + i, shown, unit, text) for i, (name, unit, text) in enumerate(outputs)),
    ]


def _lanes(states: Sequence[DriftState]) -> int:
    """Number of simulations: at the states, with each parameter state changed, and with a lower pressure at rest."""
    return 2 + sum(bool(state.parameter) for state in states)


def _work(states: Sequence[DriftState], sampling: float) -> float:
    return WORK * -(-_lanes(states) // LANES) * max(sampling / 1e-5, 1.0)


def observer_texts(online: Online) -> dict[str, str]:
    """Headers and source of the observer by name, with ``cr`` in place of the model's name."""
    injector = online.injector
    study.check_model(injector)
    settings = replace(online.settings, states=study.resolve_states(injector, online.settings))
    names = tuple(state.parameter for state in settings.states if state.parameter)
    if settings.disturbance is None:
        raise ConfigurationError(
            "An observer without Python does not estimate the disturbance; give its figures, such as from `observe`."
        )
    if settings.further:
        raise ConfigurationError("An observer without Python reads one pressure; leave `further` empty.")
    if not settings.grid:
        raise ConfigurationError(
            f"An observer without Python simulates on a grid of states; give `grid`, such as {GRID}."
        )
    if injector.wired(names) != injector.wired():
        raise ConfigurationError(
            f"{injector.name}: a drift state scales a parameter that is zero; leave the state out."
        )
    if settings.after > settings.gap - 50e-6:
        raise ConfigurationError(
            "The time after a shot must end 50 µs before its next energising may begin; shorten `after` or lengthen "
            "`gap`."
        )
    sizes = _sizes(settings, online.sampling)
    public = {
        name: sizes.pop(name) for name in ("STATES", "MOST_INJECTIONS", "SAMPLING", "PAUSE", "WORK_OF_STEP", "TRUSTED")
    }
    constants = sizes | _constants(injector, settings, settings.disturbance)
    private = (
        "/* Generated: states and figures of an observer. */\n#ifndef CR_OBSERVER_MODEL\n#define CR_OBSERVER_MODEL\n"
        + _defines({f"O_{name}": value for name, value in constants.items()})
        + f"{_tables(injector, settings)}#endif\n"
    )
    return {
        "observer.h": _template("observer.h").replace("/*SIZES*/\n", _defines(public)),
        "observer.c": _template("observer.c"),
        "observer_model.h": private,
    }


def _template(name: str) -> str:
    return resources.files("commonrail.plugins.observer").joinpath("c", name).read_text(encoding="utf-8")


def _defines(values: Mapping[str, Any]) -> str:
    texts = {name: f"({value!r})" if value < 0 else repr(value) for name, value in values.items()}
    return "".join(f"#define CR_{name} {text}\n" for name, text in texts.items())


def _sizes(settings: ObserverSettings, sampling: float) -> dict[str, float]:
    """Numbers of states, lanes, samples and steps, and the settings behind them."""
    many = settings.count_averaged_samples(np.array([0.0, sampling]))
    lanes = _lanes(settings.states)
    dt = settings.time_step
    return {
        "STATES": len(settings.states),
        "MOST_INJECTIONS": INJECTIONS,
        "SAMPLING": sampling,
        "PAUSE": settings.gap,
        "WORK_OF_STEP": _work(settings.states, sampling),
        "TRUSTED": kalman.TRUSTED,
        "EXTRA": sum(state.scatter > 0.0 for state in settings.states),
        "LANES": lanes,
        "BLOCKS": -(-lanes // LANES),
        "MANY": many,
        "QUIET": max(int(settings.before / sampling / many + 1e-6) - 1, 1),
        "SAMPLES": math.ceil((settings.before + SPAN + settings.after) / sampling / many) + 1,
        "RING": math.ceil((settings.before + SPAN + settings.gap) / sampling) + 4,
        "STEPS": math.ceil((SPAN + settings.after + 20e-6) / dt) + 1,
        "WINDOW": settings.window,
        "LEARNING": settings.learning,
        "ITERATIONS": settings.iterations,
    }


def _constants(injector: Injector, settings: ObserverSettings, disturbance: Disturbance) -> dict[str, float]:
    wired = injector.wired()
    rows, paths = make_rows(wired, 1), wiring(wired).state.paths
    point = OperatingPoint(100e6, (), settings.cylinder_pressure, settings.return_pressure, horizon=1e-3)
    names = [state.name for state in settings.states]
    sensor = {"GAIN": study.GAIN, "OFFSET": study.OFFSET, "DELAY": study.DELAY}
    place = {key: names.index(name) if name in names else -1 for key, name in sensor.items()}
    parameters = [state.parameter for state in settings.states]
    warm = parameters.index(FUEL_TEMPERATURE) if FUEL_TEMPERATURE in parameters else -1
    return {
        **place,
        "TEMPERATURE": warm,
        "WARMER": 1 + sum(bool(parameter) for parameter in parameters[:warm]) if warm >= 0 else -1,
        "ROW_PRESSURE": rows.state + paths.index(study.SENSORS[settings.sensor]),
        "ROW_INJECTED": rows.state + paths.index("nozzle.injected"),
        "STEP": settings.time_step,
        "BEFORE": settings.before,
        "AFTER": settings.after,
        "CYLINDER": settings.cylinder_pressure,
        "RETURN": settings.return_pressure,
        "USUAL": point.rail_pressure,
        "DISCREPANCY": settings.discrepancy,
        "DISCREPANCY_MEMORY": run.MEMORY,
        "FLOOR": run.FLOOR,
        "MEAN": MEAN,
        "TREND": TREND,
        **{f"DISTURBANCE_{name.upper()}": value for name, value in disturbance._asdict().items()},
        "TURN": 2.0 * math.pi,
        **{name: getattr(response, name) for name in ("LATER", "LOWER", "OPEN", "BODY", "LATEST")},
        "TIMES": kalman.TIMES,
        "CONVERGED": kalman.CONVERGED,
        "SIGNIFICANCE": settings.significance,
        "GRID": settings.grid,
        "BEGIN": BEGIN,
    }


def _tables(injector: Injector, settings: ObserverSettings) -> str:
    states = settings.states
    paths = (*parameter_paths(injector.variant.actuation), FUEL_TEMPERATURE)
    rows = []
    for state in states:
        value = injector.values[state.parameter] if state.parameter else 0.0
        change = 1.0 if state.parameter == FUEL_TEMPERATURE else response.STEP * state.deviation
        numbers = (state.power, value, change, state.deviation, state.walk, state.scatter, state.limit)
        index = paths.index(state.parameter) if state.parameter else -1
        texts = json.dumps(state.name), json.dumps(state.unit), str(index), *(repr(float(number)) for number in numbers)
        rows.append(f"    {{{', '.join(texts)}}},\n")
    extra = ", ".join(str(i) for i, state in enumerate(states) if state.scatter > 0.0)
    learnt = FUEL_TEMPERATURE in [state.parameter for state in states]
    steps = response.warm_steps(injector) if learnt else np.zeros(1)
    here = injector.values[FUEL_TEMPERATURE] + steps
    both = [injector.fuel.density(settings.cylinder_pressure, here + more).tolist() for more in (0.0, 1.0)]
    densities = ", ".join(f"{{{cold!r}, {warmer!r}}}" for cold, warmer in zip(*both, strict=True))
    return (
        "typedef struct {\n    const char *name, *unit;\n    int parameter;\n"
        "    double power, value, change, deviation, walk, scatter, limit;\n} cr_drift;\n"
        f"static const cr_drift cr_states[] = {{\n{''.join(rows)}}};\n"
        f"static const int cr_o_extra[] = {{{extra or '0'}}};\n"
        f"static const double cr_o_warmth[] = {{{', '.join(map(repr, steps.tolist()))}}};\n"
        f"static const double cr_o_density[][2] = {{{densities}}}; /* at cylinder pressure, and 1 K warmer [kg/m3] */\n"
    )
