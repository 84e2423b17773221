"""Drawing keeps the numbers and adds no way out of the page."""

from __future__ import annotations

import json

import pytest

from commonrail.display.chart import Figure, Panel, Series
from commonrail.report.draw import draw, figure_html
from commonrail.report.figures import figures_of
from tests.report.samples import map_record, rate_record, rate_traces


def test_every_figure_can_be_drawn() -> None:
    record = rate_record()
    figures = [*figures_of(record, rate_traces(record)), *figures_of(map_record(), {})]
    assert all(figure_html(figure, f"f{i}") for i, figure in enumerate(figures))


def test_the_series_arrive_on_their_panels() -> None:
    record = rate_record()
    figure = figures_of(record, rate_traces(record))[0]
    drawn = json.loads(draw(figure, 400).to_json())
    assert [trace["yaxis"] for trace in drawn["data"]] == ["y"] * 4 + ["y2"] * 3
    assert [trace["name"] for trace in drawn["data"][:2]] == ["synthetic", "rigid body"]


@pytest.mark.parametrize("looks", [("measured", "rigid", "start", "best")])
def test_curves_differ_in_more_than_colour(looks: tuple[str, ...]) -> None:
    series = tuple(Series(look, look, (0.0,), (0.0,)) for look in looks)
    traces = draw(Figure("", "", "", (Panel("", series),)), 300).data
    assert len({(trace.line.dash, trace.line.width) for trace in traces}) == len(looks)


def test_no_button_sends_the_data_away() -> None:
    figure = Figure("", "", "", (Panel("", (Series("", "best", (0.0,), (0.0,)),)),))
    fragment = figure_html(figure, "f")
    assert '"modeBarButtons": [["toImage", "zoom2d", "pan2d", "resetScale2d"]]' in fragment
    assert '"showSendToCloud": false' in fragment


def test_a_name_cannot_become_markup_in_a_legend() -> None:
    series = Series('<a href="https://example.org">x</a>', "best", (0.0,), (0.0,))
    (trace,) = draw(Figure("", "", "", (Panel("", (series,)),)), 300).data
    assert trace.name.startswith("&lt;a")


def test_a_logarithmic_axis_writes_its_numbers_in_full() -> None:
    series = Series("", "best", (0.0, 1.0), (2000.0, 170.0))
    axis = draw(Figure("", "", "", (Panel("", (series,), logarithmic=True),)), 300).layout.yaxis
    assert {200, 500, 1000, 2000} <= set(axis.tickvals)


def test_a_constant_line_has_an_axis_that_is_wider_than_its_rounding() -> None:
    constant = Series("", "best", (0.0, 1.0), (10830.5, 10830.5 * (1.0 + 1e-15)))
    falling = Series("", "best", (0.0, 1.0), (10830.5, 10830.0))
    low, high = draw(Figure("", "", "", (Panel("", (constant,)),)), 300).layout.yaxis.range
    assert low < 10300.0
    assert high > 11300.0
    assert draw(Figure("", "", "", (Panel("", (falling,)),)), 300).layout.yaxis.range is None
