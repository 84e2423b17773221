"""Figure data: the numbers that a figure shows, in its units."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from commonrail.base.chart import Figure
from commonrail.calibration.record import GenerationRecord
from commonrail.data.records import LABELS
from commonrail.report.figure import figure_svg
from commonrail.report.fit.figures import convergence_figure, figures_of
from tests.report.samples import map_record, rate_record, rate_traces

TRACE = {
    "time_s": np.array([1.5e-6, 4.5e-6]),
    "measured": np.array([10e-6, 20e-6]),
    "start": np.array([11e-6, np.nan]),
    "best": np.array([10.5e-6, 19e-6]),
}


def rate_figure(data: dict[str, Any]) -> Figure:
    """The figure of one curve."""
    (figure,) = figures_of([data], LABELS, {data["name"]: TRACE})
    return figure


def map_figures() -> list[Figure]:
    """Figures of a map: quantities with their errors, dead times."""
    return figures_of(map_record()["data"][:1], LABELS, {})


def test_the_error_of_the_calibrated_model_fills_its_panel() -> None:
    """The rigid body is off by the whole rate; drawn to its scale the calibrated error is a flat line."""
    record = rate_record()
    traces = rate_traces(record)
    trace = next(iter(traces.values()))
    largest = {name: float(np.max(np.abs(trace[name] - trace["measured"]))) for name in ("best", "rigid")}
    assert largest["rigid"] > 5.0 * largest["best"]
    svg = figure_svg(figures_of(record["data"], LABELS, traces)[0])
    low, high = (float(v) for v in re.findall(r'data-y="(\S+) (\S+)"', svg)[1])
    assert high - low < 2.2 * 1e6 * largest["best"]  # from −largest to +largest, a twentieth to either side
    assert "cut at" in figures_of(record["data"], LABELS, traces)[0].caption


def test_a_rate_is_shown_in_its_units_with_its_error_below() -> None:
    rate, error = rate_figure(rate_record()["data"][0]).panels
    assert [series.look for series in rate.series] == ["measured", "start", "best"]
    assert rate.series[0].x == pytest.approx((1.5, 4.5))  # us
    assert rate.series[0].y == pytest.approx((10.0, 20.0))  # mm³/ms
    assert error.series[1].y == pytest.approx((0.5, -1.0))  # calibrated − measured


def test_a_synthetic_curve_is_not_called_measured() -> None:
    data = rate_record()["data"][0]
    assert rate_figure(data).panels[0].series[0].label == "synthetic"
    assert "measured" not in rate_figure(data).caption
    assert rate_figure(data | {"synthetic": ""}).panels[0].series[0].label == "measured"


def test_what_is_not_finite_leaves_a_gap() -> None:
    rate, error = rate_figure(rate_record()["data"][0]).panels
    assert rate.series[1].y[1] is None
    assert error.series[0].y[1] is None


def test_a_map_has_one_family_for_each_rail_pressure() -> None:
    panel = map_figures()[0].panels[0]
    assert [s.label for s in panel.series if s.label] == ["40 MPa", "160 MPa"]
    assert {s.family for s in panel.series} == {0, 1}
    measured = panel.series[-1]
    assert measured.mode == "markers"
    assert measured.y[-1] == pytest.approx(148.31)


def test_map_errors_are_relative_above_the_limit_and_absolute_below() -> None:
    _, large, small = map_figures()[0].panels
    # 40 MPa: four quantities above 3 mm³ (4.20 … 45.12), three below
    assert len(large.series[0].y) == 4
    assert len(small.series[0].y) == 3
    assert small.series[0].y[0] == pytest.approx(0.24 * 0.15 + 0.1)  # as samples.py makes it
    assert large.series[0].y[0] == pytest.approx(100.0 * (-0.15 / 4 + 0.1 / 4.20))


def test_dead_times_stand_against_rail_pressure() -> None:
    (panel,) = map_figures()[1].panels
    marks = panel.series[-1]
    assert marks.x == pytest.approx((40.0, 160.0))
    assert marks.y == pytest.approx((282.0, 228.0))


@pytest.mark.parametrize(("worst", "logarithmic"), [(1000.0, True), (300.0, False)])
def test_convergence_is_logarithmic_where_it_spans_much(worst: float, logarithmic: bool) -> None:
    generations = [
        GenerationRecord(generation=0, best=worst, mean=None),
        GenerationRecord(generation=1, best=100.0, mean=150.0),
    ]
    (panel,) = convergence_figure(generations).panels
    assert panel.logarithmic is logarithmic
    assert panel.series[0].y == (None, 150.0)


def test_a_map_without_dead_times_has_no_figure_of_them() -> None:
    record = map_record()
    count = len(figures_of(record["data"], LABELS, {}))
    for d in record["data"]:
        d["rows"] = [row for row in d["rows"] if not row["dead_time"]]
    assert len(figures_of(record["data"], LABELS, {})) == count - 1


def test_a_single_dead_time_needs_no_figure() -> None:
    titles = [figure.title for figure in figures_of(map_record()["data"], LABELS, {})]
    assert "Dead times of map" in titles
    assert "Dead times of map at 80 MPa" not in titles
