"""Numbers and texts of a page, as one JSON-able mapping."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from commonrail.base import registry
from commonrail.base.arguments import file_path, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.chart import Figure, Panel, Series
from commonrail.base.hooks import ALL_ENTRIES, lasting
from commonrail.base.output import write_text
from commonrail.base.text import in_print, number
from commonrail.base.units import convert, to_text
from commonrail.calibration.space import Space
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.quantities.dead_times import FLATTEST, neighbours
from commonrail.data.records import origin_word
from commonrail.data.simulator import Simulator
from commonrail.engine import plan
from commonrail.engine.courses import CHECK_AFTER
from commonrail.engine.job import Outcome
from commonrail.engine.loop import CoursePlan
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.plan import candidate_matrix, columns
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.meters import Meter, given_values, is_of_meter, low_pass
from commonrail.plugins.export.entry_points import channels, sizes
from commonrail.plugins.page.module import MOST_ROWS, MOST_STEPS, wasm_module
from commonrail.plugins.page.subject import ONE, Slider, Subject, limits_of, read_subject, stable_sliders, variant_of
from commonrail.readers.injector_writer import injector_text
from commonrail.report.axis import INK
from commonrail.report.data.curves import RATE
from commonrail.report.figure import DASHES, LOOKS, colour_of, figure_html, line_of, small_html
from commonrail.report.html import render
from commonrail.report.simulation import DASHES as CHANNEL_DASHES
from commonrail.report.simulation import ORDER

TAIL = 2.5e-3  # simulated after the end of the last energising, unless needle and valve rest before [s]
RESTING = 3.0 * plan.RESTING  # time of rest at which a simulation ends [s]: only needle and valve are checked
SAMPLE = 3e-6  # between the channels that are kept [s]
KELVIN = 1.0  # between the nodes of the fuel's temperature
CYLINDERS = 41  # nodes of the density over the cylinder's pressure
NEGLIGIBLE = 1e-13  # share of the largest value of a response; smaller values at its ends are left out
RATE_HEIGHT = 330  # of the drawing of the rate [px]
MAP_PRESSURES, MAP_TIMES, LONGEST = 5, 12, 1.5e-3


def content(subject: Subject, first: OperatingPoint, version: str) -> dict[str, Any]:
    """Mapping that the page's script reads; arrays are base64 of little-endian doubles.

    `first`: operating point of a page without data; a page with maps only uses the measured point nearest to it.
    `version`: version of the program.
    """
    injector = subject.injector
    first = _first_measured(subject, first)
    limits = limits_of(subject, first)
    sliders, share = stable_sliders(subject, limits["rail"][1])
    nodes, at = _nodes(injector)
    simulator = Simulator(injector, (), subject.time_step)
    data = [curve_numbers(d, simulator, nodes) for d in subject.data]
    pressures = np.linspace(*limits["cylinder"], CYLINDERS)
    densities = injector.fuel.density(pressures, np.array(nodes)[:, None])
    return {
        **bench_numbers(subject, sliders, first),
        "title": subject.title,
        "injector": injector.name,
        "variant": variant_of(subject).label,
        "version": version,
        "every": max(round(SAMPLE / subject.time_step), 1),
        "temperature": {
            "nodes": nodes,
            "at": at,
            "coefficients": [pack(fuel_coefficients(injector.fuel, t)) for t in nodes],
        },
        "density": {"cylinders": pressures.tolist(), "rows": np.round(densities, 9).tolist()},
        "limits": limits,
        "narrowed": share,
        "data": data,
        "looks": {look: _drawn_as(*LOOKS[look]) for look in LOOKS} | {"ink": INK},
        "lines": _lines(),
        "reference": {"label": "J of the fit" if subject.start else ""},
        "fan": None if subject.fan is None else {**vars(subject.fan), "members": subject.fan.members.tolist()},
        "presets": _presets(subject, first, data),
        "traced": subject.injector.variant.drive.is_trace,
        "map": None if subject.injector.variant.drive.is_trace else _map(subject, limits["rail"]),
        "maps": [map_numbers(d, simulator, nodes) for d in subject.maps],
        "toml": injector_text(injector, {}, "Made by a bench page of commonrail."),
        "present": dict(injector.values),
        "units": {name: q.unit for name, q in injector.quantities.items()},
    }


def bench_numbers(subject: Subject, sliders: tuple[Slider, ...], first: OperatingPoint) -> dict[str, Any]:
    """Numbers that the script simulates with, its parameters, and the run's constraints between them."""
    variant = variant_of(subject)
    size = sizes(variant)
    return {
        "dt": subject.time_step,
        "tail": TAIL,
        "quiet": CHECK_AFTER,
        "resting": RESTING,
        "columns": size.parameters + size.fuel,
        "parameters": size.parameters,
        "mostSteps": MOST_STEPS,
        "mostRows": MOST_ROWS,
        "ring": _ring(subject, sliders, first),
        "channels": [c.name for c in channels(variant.actuation)],
        "figures": list(Outcome._fields),
        "theta": pack(candidate_matrix(subject.injector, (), ONE)[0]),
        "sliders": [{**_slider(subject.injector, s), "effect": subject.effects.get(s.name)} for s in sliders],
        "constraints": [] if subject.space is None else _constraints(subject.space),
        "columnOf": _columns(subject.injector, subject, sliders),
    }


def _first_measured(subject: Subject, first: OperatingPoint) -> OperatingPoint:
    """Measured map point nearest to a point, by ratios of pressure and time; the point itself without maps."""
    judged = [p for d in subject.maps for p, dead in zip(d.points, d.dead_time, strict=True) if not dead]
    if subject.data or not judged:
        return first
    rail, time = first.initial_pressures()[0], first.pulses[0].duration

    def away(point: OperatingPoint) -> float:
        ratios = point.initial_pressures()[0] / rail, max(point.pulses[0].duration, 1e-9) / time
        return math.hypot(*map(math.log, ratios))

    return min(judged, key=away)


def _nodes(injector: Injector) -> tuple[list[float], int]:
    """Temperatures [K] of the slider, including the injector's temperature, and the index of the latter."""
    low, high = injector.fuel.temperature_range
    temperature = injector.values[FUEL_TEMPERATURE]
    below, above = int((temperature - low) / KELVIN), int((high - temperature) / KELVIN)
    return [temperature + KELVIN * i for i in range(-below, above + 1)], below


def _slider(injector: Injector, s: Slider) -> dict[str, Any]:
    q = injector.quantities[s.name]
    unit = to_text(max(abs(s.low), abs(s.high)), q.unit).partition(" ")[2]
    return {
        "name": s.name,
        "meaning": q.meaning,
        "unit": in_print(unit),
        "factor": convert(1.0, q.unit, unit) if unit else 1.0,
        "low": s.low,
        "high": s.high,
        "value": injector.values[s.name],
    }


def _constraints(space: Space) -> list[dict[str, Any]]:
    """Linear constraints of a run on injector parameters: coefficients by name, and least sum [SI]."""
    floor = space.rows.floor(space.lower, space.upper)
    constraints = []
    for row, least, label in zip(space.rows.matrix, floor, space.rows.labels, strict=True):
        terms = {name: float(share) for name, share in zip(space.names, row, strict=True) if share}
        if not any(map(is_of_meter, terms)):
            constraints.append({"terms": terms, "floor": float(least), "label": label})
    return constraints


def _columns(injector: Injector, subject: Subject, sliders: Iterable[Slider]) -> dict[str, int]:
    """Columns of all parameters that the page may set."""
    names = dict.fromkeys([*(s.name for s in sliders), *subject.start, *(subject.fan.names if subject.fan else ())])
    names.pop(FUEL_TEMPERATURE, None)
    settable = tuple(names)
    return dict(zip(settable, map(int, columns(settable, injector.variant.actuation)), strict=True))


def _ring(subject: Subject, sliders: tuple[Slider, ...], first: OperatingPoint) -> int:
    """Slots of the wave ring buffer that suffice for all slider positions."""
    injector = subject.injector
    longest_ways = {s.name: max(s.high, injector.values[s.name]) for s in sliders if s.name.endswith(".length")}
    longer = replace(injector, values={**injector.values, **longest_ways})
    return CoursePlan(longer, first, subject.time_step).ring


def curve_numbers(d: RateData, simulator: Simulator, nodes: Sequence[float]) -> dict[str, Any]:
    """Injection curve as the script compares it, with its operating point and meter."""
    point, injector = d.point, simulator.injector
    cylinder = point.at_start(point.cylinder_pressure)
    traced = (point.rail_pressure, point.cylinder_pressure, point.return_pressure, point.drive)
    return {
        "name": d.name,
        "role": d.role.value,
        "origin": origin_word({"synthetic": d.synthetic}),
        "point": _point(point),
        "courses": [_course(course, point, simulator.time_step) for course in traced],
        "bounds": pack(d.bounds),
        "rate": pack(d.rate),
        "density": _densities_of(d.mass_density, d.meter, cylinder, injector, nodes),
        "meter": _meter(d, simulator.time_step),
        "reference": number(d.score(simulator).j),
    }


def map_numbers(d: QuantityData, simulator: Simulator, nodes: Sequence[float]) -> dict[str, Any]:
    """Rows of a map, each with its simulated points: the point itself, or three points around a dead time.

    Densities [kg/m³] that convert masses to volumes are given once per cylinder pressure.
    """
    stated = np.broadcast_to(d.mass_density, d.quantity.shape).tolist()
    densities: dict[tuple[float, float], int] = {}
    rows = []
    for i, point in enumerate(d.points):
        key = (point.initial_pressures()[1], stated[i] if math.isfinite(stated[i]) else -1.0)
        timed = bool(d.dead_time[i]) and d.dead_time_tolerance is not None
        before, after = neighbours(point) if timed else (None, None)
        rows.append(
            {
                "points": [_point(p) for p in (before, point, after) if p is not None],
                "dead": bool(d.dead_time[i]),
                "timed": timed,
                "quantity": float(d.quantity[i]),
                "target": float(d.measured[i]),
                "tolerance": float(1.0 / (d.errors(d.measured + 1.0)[i])),
                "density": densities.setdefault(key, len(densities)),
            }
        )
    meter_values = None if d.meter is None else {key: float(v[0]) for key, v in given_values(d.meter, {}, 1).items()}
    misfit = d.misfit(d.simulated(simulator, np.empty((1, 0)))[0])
    return {
        "name": d.name,
        "role": d.role.value,
        "origin": origin_word({"synthetic": d.synthetic}),
        "rows": rows,
        "densities": [
            _densities_of(stated_one if stated_one > 0.0 else math.nan, d.meter, cylinder, simulator.injector, nodes)
            for cylinder, stated_one in densities
        ],
        "gain": 1.0 if meter_values is None else meter_values["gain"],
        "offset": 0.0 if meter_values is None else meter_values["quantity_offset"],
        "flattest": FLATTEST,
        "reference": number(float(misfit)),
    }


def _densities_of(
    mass_density: float, meter: Meter | None, pressure: float, injector: Injector, nodes: Sequence[float]
) -> list[float]:
    """Densities [kg/m³] that convert masses to volumes, one for each temperature [K] of `nodes`, or one for all.

    `mass_density` is stated by the data [kg/m³], or NaN; `pressure` is the cylinder pressure [Pa].
    """
    meter_values = {} if meter is None else meter.values
    if np.isfinite(mass_density):
        return [mass_density]
    if "density" in meter_values:
        return [meter_values["density"]]
    if "temperature" in meter_values:
        return [float(injector.fuel.density(pressure, meter_values["temperature"]))]
    return [float(injector.fuel.density(pressure, t)) for t in nodes]


def _course(course: float | Trace | None, point: OperatingPoint, dt: float) -> str | None:
    """Means of a trace over the time steps, up to the end of the trace or point; later, the last mean holds."""
    if not isinstance(course, Trace):
        return None
    end = max(course.time[-1] - point.start, point.duration)
    begin: Floats = np.asarray(point.start + dt * np.arange(math.ceil(end / dt) + 1), float)
    return pack(course.mean(begin, np.asarray(begin + dt, float)))


def _point(point: OperatingPoint) -> dict[str, Any]:
    rail, cylinder, low = point.initial_pressures()
    return {
        "rail": rail,
        "cylinder": cylinder,
        "low": low,
        "start": point.start,
        "pulses": [list(p) for p in point.pulses],
        "duration": point.duration,
    }


def _presets(subject: Subject, point: OperatingPoint, data: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Initial state of the page and alternatives; a preset without values or point keeps the present ones."""
    present = "calibrated" if subject.start else "values of the file"
    at = {"point": data[0]["point"], "data": 0} if data else {"point": _point(point)}
    presets: list[dict[str, Any]] = [{"name": present, "values": {}, **at}]
    if subject.start:
        presets.append({"name": "start values", "values": subject.start, **at})
    presets += [{"name": f"at {d['name']}", "point": d["point"], "data": i} for i, d in enumerate(data) if i]
    main = _point(point)
    pilot = [[0.0, 250e-6], [1000e-6, 600e-6]]
    if not subject.injector.variant.drive.is_trace:
        presets.append({"name": "pilot and main", "point": main | {"pulses": pilot, "start": 0.0}})
    return presets


def _map(subject: Subject, rail: tuple[float, float]) -> dict[str, Any]:
    """Pressures [Pa] and energising times [s] of the small quantity map: the measured ones, if any."""
    measured = np.unique([p.initial_pressures()[0] for d in subject.maps for p in d.points])
    longest = max([LONGEST, *(p.pulses[0].duration for d in subject.maps for p in d.points)])
    pressures = np.round(np.linspace(rail[0], rail[1], MAP_PRESSURES) / 1e6) * 1e6
    if len(measured):
        pressures = measured[np.unique(np.linspace(0, len(measured) - 1, MAP_PRESSURES).round().astype(int))]
    colours = [colour_of("best", i, len(pressures)) for i in range(len(pressures))]
    return {
        "colours": colours,
        "pressures": pressures.tolist(),
        "times": np.linspace(100e-6, longest, MAP_TIMES).tolist(),
    }


# Meters of the data: the responses of their filters, and their quantities, for the page's script.


def pack(values: ArrayLike) -> str:
    """Base64 of little-endian doubles."""
    return base64.b64encode(np.asarray(values, "<f8").tobytes()).decode()


def _meter(d: RateData, dt: float) -> dict[str, Any] | None:
    """Meter of an injection curve for steps of `dt` [s], None without a meter or for a neutral one."""
    if d.meter is None or d.meter.neutral:
        return None
    values = {key: float(value[0]) for key, value in given_values(d.meter, {}, 1).items()}
    steps = max(round((d.point.duration + d.meter.ahead) / dt), 1)
    echoes = [{key: values[f"{echo}_{key}"] for key in ("share", "delay", "lag")} for echo in ("echo", "second_echo")]
    return {
        "name": d.meter.name,
        "ahead": d.meter.ahead,
        **{key: values[key] for key in ("delay", "gain", "offset", "blend", "zeroing")},
        "echoes": [echo for echo in echoes if echo["share"]],
        "early": _filter(d.meter, values["cutoff"], steps, dt),
        "late": _filter(d.meter, values.get("late_cutoff", np.inf), steps, dt),
    }


def _filter(meter: Meter, cutoff: float, steps: int, dt: float) -> dict[str, Any] | None:
    """Response to a unit signal of one time step, from its first significant step; None without a filter."""
    if np.isinf(cutoff):
        return None
    impulse = np.zeros(2 * steps - 1)
    impulse[steps - 1] = 1.0
    response = low_pass(impulse, dt, meter.law, meter.order, cutoff)
    used = np.flatnonzero(np.abs(response) > NEGLIGIBLE * np.max(np.abs(response)))
    return {"first": int(used[0]) - (steps - 1), "response": pack(response[used[0] : used[-1] + 1])}


# The page itself: styles, scripts, numbers and the compiled module in one HTML file.

FIRST_POINT = OperatingPoint(100e6, 700e-6)  # of a page whose subject has no data


@lasting(ALL_ENTRIES)
def page_html(subject: Subject, point: OperatingPoint = FIRST_POINT) -> str:
    """Page of a subject, one self-contained HTML document; `point`: initial operating point if there are no data.

    ConfigurationError if the module cannot be made, as in `wasm_module`, or the fuel does not cover the point.
    """
    program = version("commonrail")
    numbers = content(subject, point, program)
    module = wasm_module(variant_of(subject))
    return render(
        "bench.html",
        package=__package__,
        title=subject.title,
        drawings=_drawings(subject),
        section=registry.find_shipped("simulations")["moving section"].load()(numbers["channels"]),
        lead=_lead(subject, numbers),
        synthetic=subject.synthetic,
        model=embed_json(numbers),
        wasm=base64.b64encode(module).decode(),
        version=program,
    )


def page(
    model: str | Path,
    out: str | Path = "bench.html",
    *,
    sliders: Sequence[str] = (),
    point: OperatingPoint = FIRST_POINT,
    threads: int | None = None,
) -> Path:
    """Write a page that simulates an injector in the browser, one HTML file without server or network.

    Parameters
    ----------
    model : str or path
        Run folder of `calibrate`, injector file or name of the catalogue.
    out : str or path
        Page to be written.
    sliders : list of str
        Further parameters on sliders.
    point : OperatingPoint
        First point of a page without data.
    threads : int, optional
        Threads that simulate fits near the best one; all usable processors by default.

    Returns
    -------
    path
        The page.

    Raises
    ------
    InputError
        If the model cannot be read, or there is no such parameter.
    ConfigurationError
        If the injector follows a measured voltage or current that the model does not hold.
    """
    path = file_path(out, "page")
    write_text(path, page_html(read_subject(str(model), tuple(sliders), thread_count(threads)), point))
    return path


def page_of_run(folder: Path) -> str:
    """Page of a calibration's run folder, next to its report."""
    return page_html(read_subject(str(folder)))


# Drawings of the page, and the styles of the curves that the script draws.

_TIME, _ENERGISING = "time, µs", "energising time, µs"
_PANELS = {
    "lift": ("lift, µm", 1e6, {"needle_lift": "needle", "valve_lift": "valve", "armature_lift": "armature"}),
    "pressure": (
        "pressure, MPa",
        1e-6,
        {
            "accumulation_pressure": "accumulation",
            "control_pressure": "control chamber",
            "sac_pressure": "SAC",
            "return_pressure": "return",
        },
    ),
    "current": ("current, A", 1.0, {"coil_current": "coil"}),
}


def _drawn_as(colour: str, width: float, dash: str) -> dict[str, Any]:
    return {"colour": colour, "width": width, "dash": DASHES.get(dash, "")}


def _lines() -> dict[str, list[dict[str, Any]]]:
    """Channels of each drawing, with the looks of `commonrail simulate --report`."""
    lines: dict[str, list[dict[str, Any]]] = {}
    for key, (_, scale, names) in _PANELS.items():
        for i, (channel, name) in enumerate(names.items()):
            family = ORDER.index(channel) if channel in ORDER else len(ORDER)
            look = _drawn_as(*line_of(Series(name, CHANNEL_DASHES[i], (), (), family=family)))
            lines.setdefault(key, []).append({"channel": channel, "name": name, "scale": scale, **look})
    return lines


def _drawings(subject: Subject) -> dict[str, tuple[str, Markup]]:
    """Title and empty drawing of each chart, with room for the entries of its legend and for numbers of four digits."""

    def empty(y_title: str, x_title: str, names: Iterable[str]) -> Figure:
        room = Series("", "level", (0.0, 1.0), (0.0, 1000.0))
        return Figure(y_title, "", x_title, (Panel(y_title, (room, *(Series(n, "best", (), ()) for n in names))),))

    rate = ["simulated", "held", "members of the fan", "opening delay", "closing delay"]
    rate += ["measured, with the name"] if subject.data else []
    drawings = {"rate": ("Rate of injection", figure_html(empty(RATE, _TIME, rate), "drawing-rate", RATE_HEIGHT))}
    for key, (y_title, _, names) in _PANELS.items():
        title = f"{y_title.partition(',')[0].capitalize()}"
        drawings[key] = title, small_html(empty(y_title, _TIME, [*names.values(), "energised"]), f"drawing-{key}")
    rails = ["200 MPa"] * MAP_PRESSURES + ["points: synthetic"] * bool(subject.maps)
    numbered = [f"{name} {i}" for i, name in enumerate(rails)]
    for key, title, y_title in (
        ("map", "Quantity over energising time", "quantity, mm³"),
        ("residual", "Residual of the quantity", "residual, mm³"),
    ):
        drawings[key] = title, small_html(empty(y_title, _ENERGISING, numbered), f"drawing-{key}")
    return drawings


def embed_json(numbers: dict[str, Any]) -> Markup:
    """JSON for embedding in a script, which no text in it can terminate."""
    return Markup(json.dumps(numbers, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))


def _lead(subject: Subject, numbers: dict[str, Any]) -> str:
    step = f"{subject.time_step * 1e6:g} µs"
    lead = f"{subject.injector.name}: {numbers['variant']}, simulated in this page in steps of {step}."
    if subject.start:
        lead += " The first values are the calibrated ones; sliders are the free parameters between their bounds."
    if numbers["narrowed"] < 1.0:
        lead += f" The sliders' ranges are narrowed to {numbers['narrowed']:.0%}, for which steps of {step} are stable."
    return lead
