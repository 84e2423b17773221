"""Anatomy of one injection: its course with delays, and an animated section of the injector."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from commonrail.base.arrays import Floats
from commonrail.base.chart import Bars, Figure, Panel, Points, Series, points
from commonrail.base.text import MISSING, to_fixed
from commonrail.data.records import MICROSECOND, MM3, MM3_PER_MS
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.solution import Solution
from commonrail.plugins.features.result import Features, Injection
from commonrail.plugins.features.run import find_features
from commonrail.plugins.features.settings import FeatureSettings
from commonrail.report.data.curves import RATE
from commonrail.report.figure import svg
from commonrail.report.fit.rules import Tile
from commonrail.report.html import render

# Title, factor from SI, and the channels with their names and colours as on the page with sliders, from cause to
# effect.
_PANELS: tuple[tuple[str, float, dict[str, tuple[str, int]]], ...] = (
    ("current, A", 1.0, {"coil_current": ("current", 3)}),
    ("valve, µm", 1e6, {"valve_lift": ("valve lift", 2)}),
    ("armature, µm", 1e6, {"armature_lift": ("armature lift", 2)}),
    (
        "pressure, MPa",
        1e-6,
        {
            "rail_pressure": ("rail", 4),
            "accumulation_pressure": ("accumulation volume", 5),
            "control_pressure": ("control chamber", 6),
            "sac_pressure": ("SAC", 7),
        },
    ),
    ("needle, µm", 1e6, {"needle_lift": ("needle lift", 1)}),
    (RATE, MM3_PER_MS, {"rate": ("rate", 0)}),
)
SCALES = {key: scale for _, scale, channels in _PANELS for key in channels}  # from SI to the unit that is shown
_SHARES = {"pressure, MPa": 1.5, RATE: 1.5}
_ROWS = ("energised", "opening", "closing")
AFTER, LEAST = 0.08, 100e-6  # time shown after the end of all motion: share of the time before it, and at least [s]
STILL = 0.01  # share of the largest rate, lift or current below which all motion has ended
FRAMES = 400  # of the slow motion
SECONDS = 8  # duration of the slow motion
NEEDLE_STROKE, VALVE_STROKE = 14.0, 8.0  # of the section, at the largest lift [px]


class Ramp(NamedTuple):
    """Times [s] of an injection in the rate: opening and closing, and the ramps between shares of its largest rate."""

    opening: tuple[float, float]  # from the start of energising to where the rate begins
    rise: tuple[float, float]
    closing: tuple[float, float]  # from the end of energising to where the rate ends
    fall: tuple[float, float]


def end_of_motion(solution: Solution, pulses: tuple[Energising, ...] = ()) -> float:
    """Time at which an injection, its valve and its current have come to rest, plus some time [s]."""
    ends = [pulse.start + pulse.duration for pulse in pulses]
    courses = [(solution.rate_time, solution.rate)]
    moving = {"valve_lift", "armature_lift", "needle_lift"} & set(solution.channels)
    courses += [(solution.time, solution.channels[k]) for k in moving | {"coil_current"}]
    for time, values in courses:
        above = np.flatnonzero(values > STILL * np.nanmax(values, initial=0.0))
        ends.append(float(time[above[-1]]) if len(above) else float(time[0]))
    begin = float(solution.time[0])
    return min(max(ends) + max(LEAST, AFTER * (max(ends) - begin)), float(solution.time[-1]))


def _features(solution: Solution, point: OperatingPoint | None) -> Features:
    """Features of a solution; without injections if the simulation failed."""
    if not np.isfinite(solution.mass_rate).all():
        solution = replace(solution, mass_rate=np.zeros_like(solution.mass_rate))
    return find_features(solution, point)


def _ramp(solution: Solution, injection: Injection) -> Ramp:
    """Ramps of an injection of a solution, from its features; NaN if one is missing."""
    shares, peak = FeatureSettings().ramp, injection["peak_rate"]
    time, rate = solution.rate_time, solution.rate
    opening, closing = injection["opening"], injection["closing"]
    inside = (time >= opening) & (time <= closing)
    risen = time[inside & (rate > shares[0] * peak)]
    falling = time[inside & (rate > shares[1] * peak)]
    rise = float(risen[0]) if len(risen) else np.nan
    fall = float(falling[-1]) if len(falling) else np.nan
    return Ramp(
        (opening - injection["opening_delay"], opening),
        (rise, rise + injection["rise_time"]),
        (closing - injection["closing_delay"], closing),
        (fall, fall + injection["fall_time"]),
    )


def anatomy_figure(
    solution: Solution,
    point: OperatingPoint | None = None,
    shown: Mapping[str, Floats] = MappingProxyType({}),
) -> Figure:
    """Current, valve, pressures, needle and rate above one another, below a bar of energisings and delays.

    Without an operating point energising and delays are unknown. `shown` are rates (samples,) [m³/s]
    as meters show them, by meter. The course ends with all motion.
    """
    pulses = () if point is None else point.pulses
    end = end_of_motion(solution, pulses)
    found_ramps = [_ramp(solution, injection) for injection in _features(solution, point).injections]
    instants = [t for ramp in found_ramps for t in (ramp.opening[1], ramp.closing[1])]
    instants += [t for pulse in pulses for t in (pulse.start, pulse.start + pulse.duration)]
    panels = [_delays(pulses, found_ramps)] if found_ramps or pulses else []
    for title, scale, channels in _PANELS:
        series = list(_series(solution, scale, channels, end))
        if title == RATE:
            series += [
                _line(solution.rate_time, rate * scale, f"rate by meter {name}", 5 + i, end, "dash")
                for i, (name, rate) in enumerate(shown.items())
            ]
        if series:
            is_keyed = len(series) > 1
            if is_keyed and title != RATE:  # the legend is above all panels
                series[0] = replace(series[0], label=f"{title.partition(',')[0]}: {series[0].label}")
            values = [v for line in series for v in line.y if v is not None] or [0.0]
            ends = (min(values), max(values))
            times = sorted({t for t in instants if t <= end})
            lines = [Series("", "level", (t * MICROSECOND,) * 2, ends) for t in times]
            panels.append(Panel(title, (*series, *lines), _SHARES.get(title, 1.0), has_legend=is_keyed))
    low, high = FeatureSettings().ramp
    caption = (
        "Dotted: start and end of energising and of injection. Bars: opening delay, from the start of energising to "
        f"the rate, its rise from {100 * low:.0f} to {100 * high:.0f} % of the largest; closing delay, from the end "
        "of energising to the end of the rate, and its fall."
    )
    return Figure("Anatomy of the injection", caption, "time, µs", tuple(panels))


def _delays(pulses: tuple[Energising, ...], ramps: Sequence[Ramp]) -> Panel:
    bars = [_bar(0, "rigid", pulse.start, pulse.start + pulse.duration) for pulse in pulses]
    for ramp in ramps:
        for row, delay, course in ((1, ramp.opening, ramp.rise), (2, ramp.closing, ramp.fall)):
            for look, ends in (("start", delay), ("paper", course)):
                bars += [_bar(row, look, *ends)] if np.isfinite(ends).all() else []
    return Panel("", (), 0.6, bars=tuple(bars), rows=_ROWS)


def _bar(row: int, look: str, start: float, end: float) -> Bars:
    above: Points = (None,) * row
    return Bars("", look, (*above, start * MICROSECOND), (*above, end * MICROSECOND))


def _series(solution: Solution, scale: float, channels: Mapping[str, tuple[str, int]], end: float) -> Iterator[Series]:
    for key, (words, colour) in channels.items():
        # the rate belongs to the middles of the samples, a channel to their bounds
        if key == "rate":
            yield _line(solution.rate_time, solution.rate * scale, words, colour, end)
        elif key in solution.channels:
            yield _line(solution.time, solution.channels[key] * scale, words, colour, end)


def _line(time: Floats, values: Floats, words: str, colour: int, end: float, dash: str = "solid") -> Series:
    inside = time <= end
    return Series(words, dash, points(time[inside] * MICROSECOND), points(values[inside]), family=colour)


def anatomy_tiles(solution: Solution, point: OperatingPoint | None) -> list[Tile]:
    """Figures of an injection: quantity, delays, ramps, largest rate and lift, returned quantity."""
    injections = _features(solution, point).injections
    mg = 1e6 * solution.injected_mass
    several = len(injections) > 1

    def time(name: str) -> str:
        texts = [to_fixed(injection[name], 0, MICROSECOND) for injection in injections]
        return f"{' · '.join(texts)} µs" if texts and set(texts) != {MISSING} else MISSING

    largest = solution.channels["needle_lift"].max()
    return [
        Tile(
            "injected",
            f"{to_fixed(solution.injected_volume, 2, MM3)} mm³",
            f"{mg:.2f} mg{', all together' * several}",
        ),
        Tile("opening delay", time("opening_delay"), f"of the rate, which rises within {time('rise_time')}"),
        Tile("closing delay", time("closing_delay"), f"falls within {time('fall_time')}"),
        Tile(
            "largest rate",
            f"{np.nanmax(solution.rate) * MM3_PER_MS:.1f} mm³/ms",
            f"needle up to {largest * 1e6:.0f} µm",
        ),
        Tile("returned", f"{to_fixed(solution.returned_volume, 2, MM3)} mm³", "with leakage"),
    ]


class Section:
    """Section of an injector whose parts follow the frames of a slow motion; called by its template.

    The still shows the frame of the largest needle lift. The attributes of each element tell the script of the page
    which course moves it.
    """

    def __init__(self, values: Mapping[str, Floats], is_moving: bool = True) -> None:
        self.values, self.is_moving = values, is_moving
        self.is_direct = "valve_lift" not in values
        self.still = int(self.values["needle_lift"].argmax())
        self.full = max(float(v.max()) for k, v in self.values.items() if k.endswith("pressure"))

    def largest(self, name: str) -> float:
        """Largest value of a course, in the unit of its axis."""
        return float(self.values[name].max()) if name in self.values else 0.0

    def move(self, name: str, stroke: float, by: str = "") -> Markup:
        """Attributes of a part that moves with a lift, up by a stroke [px] at the largest lift (of `by` if given)."""
        if name not in self.values:
            return Markup("")
        scale = -stroke / max(self.largest(by or name), 1e-9)
        shift = scale * float(self.values[name][self.still])
        return Markup('data-move="{}" data-scale="{:.4g}" transform="translate(0 {:.2f})"').format(name, scale, shift)

    def fill(self, name: str) -> Markup:
        """Attributes of a volume filled by its pressure; zero pressure if its pressure is not simulated."""
        value = float(self.values[name][self.still]) if name in self.values else 0.0
        key = Markup('data-fill="{}" data-full="{:.4g}"').format(name, self.full) if name in self.values else ""
        return Markup('class="fuel" {} fill-opacity="{:.3f}"').format(key, 0.08 + 0.9 * max(value, 0.0) / self.full)

    def glow(self, name: str) -> Markup:
        """Attributes of an element whose opacity follows a course above zero: spray, energised coil."""
        full = max(self.largest(name), 1e-9)
        value = max(float(self.values[name][self.still]), 0.0) / full
        return Markup('data-glow="{}" data-full="{:.4g}" opacity="{:.3f}"').format(name, full, value)

    def say(self, name: str, unit: str, digits: int = 0) -> Markup:
        """Text of a course at the time shown."""
        if name not in self.values:
            return Markup("")
        value = float(self.values[name][self.still])
        said = f"{value:.{digits}f} {unit}".replace("-", "−")
        return Markup('<tspan data-say="{}" data-unit="{}" data-digits="{}">{}</tspan>').format(
            name, unit, digits, said
        )

    @property
    def slowed(self) -> int:
        """Slow-motion factor, with one digit."""
        time = self.values["time"]
        return int(float(f"{SECONDS * 1e6 / (time[-1] - time[0]):.1g}"))

    @property
    def data(self) -> Markup:
        """Frames for the script of the page, as JSON."""
        frames = {name: [float(f"{v:.4g}") for v in values] for name, values in self.values.items()}
        record = {"seconds": SECONDS, "still": self.still, "frames": frames}
        return Markup(json.dumps(record, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def make_section(solution: Solution, pulses: tuple[Energising, ...]) -> Section:
    """Section that follows a simulation until all motion has ended."""
    time = np.linspace(float(solution.time[0]), end_of_motion(solution, pulses), FRAMES)
    values = {"time": time * MICROSECOND}
    for key, scale in SCALES.items():
        if key in solution.channels:
            values[key] = np.interp(time, solution.time, solution.channels[key]) * scale
    values["rate"] = np.interp(time, solution.rate_time, np.nan_to_num(solution.rate)) * MM3_PER_MS
    top = solution.channels.get("plunger_lift", solution.channels["needle_lift"])
    values["plunger"] = np.interp(time, solution.time, top - top[0]) * 1e6
    on = [(time >= p.start) & (time < p.start + p.duration) for p in pulses]
    values["energised"] = np.any(on, axis=0).astype(float) if on else np.zeros(FRAMES)
    return Section(values)


def still_section(solution: Solution, point: OperatingPoint | None = None) -> Markup:
    """Section at the largest needle lift, with its styles, for a notebook."""
    section = make_section(solution, () if point is None else point.pulses)
    return Markup(render("still.html", __package__, section=section, strokes=(NEEDLE_STROKE, VALVE_STROKE)))


def moving_section(channels: Iterable[str]) -> Markup:
    """Section with its player, styles and script, for a page that simulates; courses are shares of the maximum."""
    names = [*(SCALES.keys() & set(channels)), "rail_pressure", "rate", "plunger", "energised", "needle_lift"]
    section = Section({name: np.array([0.0, 1.0]) for name in ["time", *names]}, is_moving=False)
    strokes, scales = (NEEDLE_STROKE, VALVE_STROKE), json.dumps(SCALES)
    return Markup(render("moving.html", __package__, section=section, strokes=strokes, scales=scales))


def anatomy_html(
    solution: Solution,
    title: str,
    point: OperatingPoint | None = None,
    shown: Mapping[str, Floats] = MappingProxyType({}),
    synthetic: str = "",
) -> str:
    """Report of one injection; `synthetic` states what is made up or estimated."""
    figure = anatomy_figure(solution, point, shown)
    drawing = Markup('<div class="drawing" id="course">{}{}</div>').format(
        svg(figure, 700, 640, "wide"), svg(figure, 420, 620, "narrow")
    )
    pulses = () if point is None else point.pulses
    return render(
        "anatomy.html",
        package=__package__,
        title=title,
        figure=figure,
        drawing=drawing,
        tiles=anatomy_tiles(solution, point),
        statuses=[solution.sentence],
        synthetic=synthetic,
        section=make_section(solution, pulses),
        strokes=(NEEDLE_STROKE, VALVE_STROKE),
    )
