"""Figure data of a comparison: one family for each model, in every figure the same."""

from __future__ import annotations

from typing import Any

import pytest

from commonrail.base.chart import Figure
from commonrail.plugins.compare.page import comparison_figures
from commonrail.report.figure import figure_svg
from commonrail.report.fit.record import shown_of
from tests.plugins.compare.samples import NEW, OLD, STIFF, compared_maps, compared_rates, compared_traces, typed


def of_map(record: dict[str, Any]) -> list[Figure]:
    """Figures of the first map: quantities, errors, dead times."""
    return comparison_figures(typed(record | {"data": record["data"][:1]}), {})


def test_every_figure_can_be_drawn_and_names_no_role() -> None:
    record = compared_rates()
    figures = comparison_figures(typed(record), compared_traces(record))
    figures += comparison_figures(typed(compared_maps()), {})
    assert len(figures) == 3 + 5  # dead times of one map only
    for figure in figures:
        figure_svg(figure, height=300)
        assert "fit" not in figure.title
    assert figures[0].title == "EVI 160 MPa, 700 µs"  # its rail pressure is in its name


def test_curves_and_errors_of_a_model_share_a_family_and_a_dash() -> None:
    record = compared_rates()
    rate, error = comparison_figures(typed(record), compared_traces(record))[0].panels
    looks = [(s.look, s.family) for s in rate.series]
    assert looks == [("measured", None), ("solid", 0), ("dash", 1), ("dot", 2)]
    assert [(s.look, s.family) for s in error.series] == looks[1:]
    assert [s.label for s in rate.series] == ["synthetic", OLD, NEW, STIFF]


@pytest.mark.parametrize("name", ["rigid", "best"])
def test_a_label_that_a_calibration_also_uses_gets_a_family_too(name: str) -> None:
    record = compared_rates()
    record["labels"] = {name: name}
    assert shown_of(record["labels"], compared=True)[name].family == 0


def test_eight_models_can_be_told_apart_by_colour_and_marker_or_dash() -> None:
    shown = shown_of({str(i): str(i) for i in range(8)}, compared=True)
    assert len({model.family for model in shown.values()}) == 8
    assert {model.look for model in shown.values()} == {"solid", "dash", "dot", "dashdot"}


def test_a_map_has_a_gap_between_rail_pressures() -> None:
    record = compared_maps()
    (panel,) = of_map(record)[0].panels
    old, new, measured = panel.series
    assert [i for i, y in enumerate(old.y) if y is None] == [7]  # after 40 MPa
    assert old.x[7] is None
    assert measured.mode == "markers"
    assert measured.y[-1] == pytest.approx(148.31)
    assert new.y[-1] == pytest.approx(148.31 * (1.0 + 0.15 / 7) + 0.1)  # as samples.py makes it


def test_a_model_without_any_number_is_not_in_the_legend() -> None:
    record = compared_maps()
    for row in record["data"][0]["rows"]:
        row[OLD] = None
    figures = of_map(record)
    assert len(figures) == 3
    for figure in figures:
        assert OLD not in [s.label for panel in figure.panels for s in panel.series]


def test_a_curve_that_failed_is_left_out() -> None:
    record = compared_rates()
    traces = compared_traces(record)
    del traces["EVI 160 MPa"][OLD]
    (rate, _) = comparison_figures(typed(record), traces)[0].panels
    assert [s.label for s in rate.series] == ["synthetic", NEW, STIFF]


def test_a_map_of_large_quantities_only_has_one_panel_of_errors() -> None:
    record = compared_maps()
    data = record["data"][0]
    data["rows"] = [row for row in data["rows"] if row["measured"] > 3e-9 and not row["dead_time"]]
    (panel,) = of_map(record)[1].panels
    assert panel.y_title == "error, %"
