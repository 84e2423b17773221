"""The page of a simulation."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status
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


def test_the_course_is_in_the_units_of_its_axes() -> None:
    rate, lift, pressure, current = course_figure({"": solution()}).panels
    assert rate.series[0].y == (0.0, pytest.approx(10.0), pytest.approx(20.0), None)  # mm³/ms
    assert rate.series[0].x[0] == pytest.approx(0.5)  # middle of the first microsecond
    assert lift.series[0].y[0] == pytest.approx(200.0)
    assert [s.label for s in pressure.series] == ["rail", "accumulation", "control chamber", "SAC"]
    assert current.series[0].y[0] == 19.0


def test_channels_of_one_solution_have_colours_of_their_own() -> None:
    series = [s for panel in course_figure({"": solution()}).panels for s in panel.series]
    assert len({s.family for s in series}) == len(series) == 8


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
    rate, *_ = course_figure({"": solution()}, {"bench": np.array([0.0, 1e-5, 2e-5, 1e-5])}).panels
    assert [s.label for s in rate.series] == ["rate", "rate by meter bench"]
    assert rate.series[1].y == pytest.approx((0.0, 10.0, 20.0, 10.0))
    assert rate.series[0].family != rate.series[1].family
    assert "rate by meter bench" in simulation_figure(solution(), "", {"bench": np.zeros(4)})
    for solutions, samples in (({"a": solution()}, 4), (solution(), 3)):
        with pytest.raises(ConfigurationError, match="single solution"):
            simulation_figure(solutions, "", {"bench": np.zeros(samples)})
