"""Figure of one simulation, or of several to be compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from numpy.typing import ArrayLike

from commonrail.base import registry
from commonrail.base.arguments import array, instance, mapping, plain_text
from commonrail.base.chart import Figure, Panel, Series, points
from commonrail.base.errors import ConfigurationError
from commonrail.data.records import MICROSECOND, MM3_PER_MS
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Solution
from commonrail.report.data.curves import RATE
from commonrail.report.figure import figure_html
from commonrail.report.html import render

# Title, factor from SI, and the channels with their names.
_RATE = (RATE, MM3_PER_MS, {"rate": "rate"})
_PANELS = (
    ("lift, µm", 1e6, {"needle_lift": "needle", "valve_lift": "valve", "armature_lift": "armature"}),
    (
        "pressure, MPa",
        1e-6,
        {
            "rail_pressure": "rail",
            "accumulation_pressure": "accumulation",
            "control_pressure": "control chamber",
            "sac_pressure": "SAC",
        },
    ),
    ("current, A", 1.0, {"coil_current": "coil"}),
)

ORDER = [key for panel in (_RATE, *_PANELS) for key in panel[2]]  # of the colours of channels
DASHES = ("solid", "dash", "dot", "dashdot")


def simulation_figure(
    solutions: Solution | Mapping[str, Solution],
    title: str = "",
    shown: Mapping[str, ArrayLike] = MappingProxyType({}),
    point: OperatingPoint | None = None,
    synthetic: str = "",
) -> str:
    """Page that shows rate, lifts, pressures and current against time.

    That of a single solution has a section of an injector, whose valve and needle move in slow motion.

    Parameters
    ----------
    solutions : Solution or mapping of str to Solution
        One, or several by the name that the legend gives them.
    title : str
        What was simulated.
    shown : mapping of str to (samples,)
        Rates [m³/s] as meters show them, by the meters' names; of a single solution only.
    point : OperatingPoint, optional
        That of a single solution: its energisings are drawn, and delays counted from them.
    synthetic : str
        What of it is made up or estimated, in words.

    Returns
    -------
    str
        HTML that needs nothing from outside.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, there is no solution, or rates by meters do not belong to a single one.
    """
    plain_text(title, "title")
    if isinstance(solutions, Solution):
        by_name = {"": solutions}
    else:
        by_name = dict(mapping(solutions, "solutions", '{"first": solution}, or a single Solution'))
    if not by_name:
        raise ConfigurationError("The solutions must be at least one.")
    for name, solution in by_name.items():
        instance(solution, Solution, f'solution "{name}" of the solutions')
    seen = {name: array(rate, "m3/s", f"rate by meter {name}", 1) for name, rate in shown.items()}
    if seen and (list(by_name) != [""] or any(len(rate) != len(by_name[""].rate) for rate in seen.values())):
        raise ConfigurationError("What meters show must belong to a single solution, with one rate for each sample.")
    if point is not None:
        instance(point, OperatingPoint, "point")
    if list(by_name) == [""] and (page := registry.find("simulations", "page")):
        return str(page.call(by_name[""], title or "Simulation", point, seen, synthetic))
    figure = course_figure(by_name)
    statuses = [f"{f'{name}: ' if name else ''}{s.sentence}" for name, s in by_name.items()]
    return render(
        "simulation.html",
        title=title or "Simulation",
        figure=figure,
        drawing=figure_html(figure, "course", height=900),
        statuses=statuses,
    )


def course_figure(solutions: Mapping[str, Solution]) -> Figure:
    """Figure of solutions by name: they have a colour each, and a dash for each channel of a panel."""
    panels = []
    for y_title, scale, channels in (_RATE, *_PANELS):
        share = 0.34 if y_title == RATE else 0.22
        series = tuple(_series(solutions, scale, channels))
        panels.append(Panel(y_title, series, share))
    return Figure("Course of the injection", "", "time, µs", tuple(panels))


def _series(solutions: Mapping[str, Solution], scale: float, channels: Mapping[str, str]) -> Iterator[Series]:
    for family, (name, solution) in enumerate(solutions.items()):
        for index, (key, words) in enumerate(channels.items()):
            if key != "rate" and key not in solution.channels:
                continue
            # the rate belongs to the middles of the samples, a channel to their bounds
            time, values = (
                (solution.rate_time, solution.rate) if key == "rate" else (solution.time, solution.channels[key])
            )
            yield Series(
                f"{words}, {name}" if name else words,
                DASHES[index % len(DASHES)],
                points(time * MICROSECOND),
                points(values * scale),
                family=family,
            )
