"""Figure of one simulation, or of several to be compared."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from commonrail.engine.solution import Solution
from commonrail.report.draw import figure_html
from commonrail.report.figures import RATE, Figure, Panel, Points, Series
from commonrail.report.html import render

__all__ = ["course_figure", "simulation_figure"]

Floats = NDArray[np.float64]

MICRO = 1e6
MPA = 1e-6

# Panels below the rate: title, factor from SI, and the channels with their names.
_PANELS = (
    ("lift, µm", MICRO, {"needle_lift": "needle", "valve_lift": "valve"}),
    (
        "pressure, MPa",
        MPA,
        {
            "rail_pressure": "rail",
            "accumulation_pressure": "accumulation",
            "control_pressure": "control chamber",
            "sac_pressure": "SAC",
        },
    ),
    ("current, A", 1.0, {"coil_current": "coil"}),
)


def simulation_figure(solutions: Solution | Mapping[str, Solution], title: str = "") -> str:
    """Page that shows rate, lifts, pressures and current against time.

    Parameters
    ----------
    solutions : Solution or mapping of str to Solution
        One, or several by the name that the legend gives them.
    title : str
        What was simulated.

    Returns
    -------
    str
        HTML that needs nothing from outside.
    """
    named = {"": solutions} if isinstance(solutions, Solution) else dict(solutions)
    figure = course_figure(named)
    statuses = [f"{f'{name}: ' if name else ''}{s.status.sentence}" for name, s in named.items()]
    return render(
        "simulation.html",
        title=title or "Simulation",
        figure=figure,
        drawing=figure_html(figure, "course", height=900),
        statuses=statuses,
    )


def course_figure(solutions: Mapping[str, Solution]) -> Figure:
    """Figure data of solutions by name ("" for a single one)."""
    rate = [_series(n, "rate", s.sample_time, s.rate_mm3_per_ms) for n, s in solutions.items()]
    panels = [Panel(RATE, tuple(rate), 0.34)]
    for y_title, scale, channels in _PANELS:
        series = [
            _series(name, words, s.time, s.channels[key] * scale)
            for name, s in solutions.items()
            for key, words in channels.items()
            if key in s.channels
        ]
        panels.append(Panel(y_title, tuple(series), 0.22))
    return Figure("Course of the injection", "", "time, µs", tuple(panels))


def _series(name: str, words: str, time: Floats, values: Floats) -> Series:
    label = f"{words}, {name}" if name else words
    return Series(label, "", _points(time * MICRO), _points(values))


def _points(values: Floats) -> Points:
    return tuple(float(v) if np.isfinite(v) else None for v in values)
