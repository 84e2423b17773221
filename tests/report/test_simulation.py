"""The page of a simulation."""

from __future__ import annotations

import json

import numpy as np
import pytest

from commonrail.base.chart import Panel
from commonrail.base.errors import ConfigurationError
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status
from commonrail.plugins.features.anatomy import anatomy_figure, make_section
from commonrail.plugins.features.run import find_features
from commonrail.report.simulation import course_figure, simulation_figure


def solution() -> Solution:
    """Four samples, 1 us apart, of a made-up injection."""
    time = 1e-6 * np.arange(5)
    channels = {
        name: np.full(5, value)
        for name, value in {
            "needle_lift": 2e-4,
            "valve_lift": 5e-5,
            "rail_pressure": 160e6,
            "accumulation_pressure": 158e6,
            "control_pressure": 100e6,
            "sac_pressure": 120e6,
            "coil_current": 19.0,
        }.items()
    }
    rate = np.array([0.0, 8e-3, 16e-3, np.nan])
    injected = np.zeros(5)
    return Solution(time, rate, injected, channels, 4e-5, 1e-5, 1e-6, 4e-6, 4e-6, 800.0, Status.OK, "lanes", 0.0)


POINT = OperatingPoint(160e6, 2e-6)


def by_title(panels: tuple[Panel, ...]) -> dict[str, Panel]:
    return {panel.y_title.partition(",")[0]: panel for panel in panels}


def test_the_anatomy_is_in_the_units_of_its_axes_from_the_cause_to_the_effect() -> None:
    panels = anatomy_figure(solution(), POINT).panels
    assert [p.y_title.partition(",")[0] for p in panels[1:]] == ["current", "valve", "pressure", "needle", "rate"]
    found = by_title(panels)
    assert found["rate"].series[0].y == (0.0, pytest.approx(10.0), pytest.approx(20.0), None)  # mm³/ms
    assert found["rate"].series[0].x[0] == pytest.approx(0.5)  # middle of the first microsecond
    assert found["needle"].series[0].y[0] == pytest.approx(200.0)
    assert [s.label for s in found["pressure"].series if s.label] == [
        "pressure: rail",
        "accumulation volume",
        "control chamber",
        "SAC",
    ]
    assert found["current"].series[0].y[0] == 19.0


def test_channels_of_one_solution_have_colours_of_their_own() -> None:
    series = [s for panel in anatomy_figure(solution(), POINT).panels for s in panel.series if s.label]
    assert len({s.family for s in series}) == len(series) == 8


def trapezium() -> Solution:
    """Rate that rises from 300 to 400 us after the start, and falls from 900 to 1000 us, of 3 ms."""
    time = 5e-6 * np.arange(601)
    rate = np.interp(time[1:] - 2.5e-6, [300e-6, 400e-6, 900e-6, 1000e-6], [0.0, 50e-6, 50e-6, 0.0])
    lift = np.interp(time, [280e-6, 500e-6, 800e-6, 1010e-6], [0.0, 2e-4, 2e-4, 0.0])
    channels = {
        "needle_lift": lift,
        "coil_current": np.where(time < 700e-6, 19.0, 0.0),
        "rail_pressure": 1e8 + 0 * time,
    }
    mass = 800.0 * rate
    injected = np.concatenate([[0.0], np.cumsum(mass * 5e-6)])
    return Solution(time, mass, injected, channels, injected[-1], 0.0, 0.0, 0.0, 0.0, 800.0, Status.OK, "lanes", 0.0)


def test_bars_show_energising_delays_and_ramps_and_the_rest_is_cut() -> None:
    point = OperatingPoint(1e8, 700e-6)
    figure = anatomy_figure(trapezium(), point)
    bars = [(row, bar.start[row], bar.end[row]) for bar in figure.panels[0].bars for row in (len(bar.start) - 1,)]
    found = find_features(trapezium(), point)
    opening, closing = (1e6 * found.value(name) for name in ("opening_delay", "closing_delay"))
    assert (0, 0.0, 700.0) in [(row, pytest.approx(a), pytest.approx(b)) for row, a, b in bars]
    assert [bar[2] for bar in bars if bar[0] == 1] == pytest.approx([opening, 380.0], abs=5.0)  # 80 % of the plateau
    assert [bar[1] for bar in bars if bar[0] == 2] == pytest.approx([700.0, 920.0], abs=5.0)
    assert bars[3][2] == pytest.approx(700.0 + closing, abs=0.1)
    last = max(x for panel in figure.panels for s in panel.series for x in s.x if x is not None)
    assert 1010.0 < last < 1200.0  # of 3000 us


def test_the_section_stands_at_the_largest_needle_lift_and_tells_what_moves_it() -> None:
    section = make_section(trapezium(), ())
    assert 500.0 <= section.values["time"][section.still] <= 800.0
    assert section.is_direct  # no valve lift
    assert "translate(0 -14.00)" in section.move("needle_lift", 14.0)
    frames = json.loads(section.data)["frames"]
    assert len({len(values) for values in frames.values()}) == 1
    page = simulation_figure(trapezium(), "", point=OperatingPoint(1e8, 700e-6))
    assert "control chamber" not in page.partition('<svg class="section"')[2]


def test_several_solutions_share_a_colour_each_and_are_named() -> None:
    figure = course_figure({"flexible": solution(), "rigid": solution()})
    rate = figure.panels[0].series
    assert [(s.label, s.family) for s in rate] == [("rate, flexible", 0), ("rate, rigid", 1)]
    dashes = {s.look for s in figure.panels[2].series if s.family == 1}
    assert len(dashes) == 4


def test_the_page_is_titled_escaped_and_says_how_the_simulation_ended() -> None:
    page = simulation_figure(solution(), "<b>160 MPa</b>")
    assert "<h1>&lt;b&gt;160 MPa&lt;/b&gt;</h1>" in page
    assert Status.OK.sentence in page
    assert "not measured" in page


def test_the_rate_by_a_meter_stands_beside_the_true_one() -> None:
    shown = {"bench": np.array([0.0, 1e-5, 2e-5, 1e-5])}
    rate = by_title(anatomy_figure(solution(), POINT, shown).panels)["rate"]
    assert [s.label for s in rate.series if s.label] == ["rate", "rate by meter bench"]
    assert rate.series[1].y == pytest.approx((0.0, 10.0, 20.0, 10.0))
    assert rate.series[0].family != rate.series[1].family
    assert "meter bench" in simulation_figure(solution(), "", {"bench": np.zeros(4)})
    for solutions, samples in (({"a": solution()}, 4), (solution(), 3)):
        with pytest.raises(ConfigurationError, match="single solution"):
            simulation_figure(solutions, "", {"bench": np.zeros(samples)})
