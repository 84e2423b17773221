"""Lines of equal quantity on the page of a map."""

from __future__ import annotations

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.maps.difference import Comparison, MeasuredMap
from commonrail.plugins.maps.page import map_figures
from commonrail.plugins.maps.run import InjectionMap, injection_map


@pytest.fixture(scope="module")
def found() -> InjectionMap:
    injector = cr.load_injector("virtual-lino-2016")
    axes = cr.maps.MapAxes(np.array([80e6, 160e6]), np.array([5e-9, 20e-9]), np.array([300e-6, 700e-6, 1000e-6]))
    return injection_map(injector, axes)


def test_a_line_of_equal_quantity_injects_that_quantity_at_every_rail_pressure(found: InjectionMap) -> None:
    panel = map_figures({"model": found})[1][0].panels[0]
    lines = {s.label: s for s in panel.series if s.label.endswith("mm³")}
    assert list(lines) == ["5 mm³", "20 mm³"]
    injector = cr.load_injector("virtual-lino-2016")
    for rail, time in zip(lines["20 mm³"].x, lines["20 mm³"].y, strict=True):
        assert rail is not None
        assert time is not None
        solution = cr.simulate(injector, cr.OperatingPoint(rail * 1e6, time * 1e-6))
        assert solution.injected_volume * 1e9 == pytest.approx(20.0, abs=0.05)  # ten times the inverse's tolerance


def test_measured_points_are_sorted_by_their_relative_error(found: InjectionMap) -> None:
    rail, time, volume = np.full(4, 160e6), np.array([4e-4, 5e-4, 6e-4, 1e-4]), np.array([1e-8, 1e-8, 1e-8, 0.0])
    measured = MeasuredMap(rail, time, volume)  # the last has no relative error
    compared = Comparison(measured, "bench.csv", volume * np.array([1.01, 0.9, 2.0, 1.0]))
    panel = map_figures({"model": found}, compared)[1][0].panels[0]
    marks = {s.label: s.x and s.y for s in panel.series if s.look == "measured"}
    assert marks == {
        "error 0 to 5 %": (pytest.approx(400.0),),
        "error 5 to 15 %": (pytest.approx(500.0),),
        "error above 15 %": (pytest.approx(600.0),),
    }
