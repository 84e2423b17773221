"""Page of a joint fit: what sets the parts apart, tables and sentences."""

from __future__ import annotations

from typing import Any

from commonrail.base.chart import MARKERS
from commonrail.plugins.family.page import family_figures, family_tables


def parameter(name: str, value: float, spread: float, **parts: float) -> dict[str, Any]:
    """Record of a parameter of the type with each part's value."""
    own = {"name": name, "unit": "N", "relation": "around", "value": value, "spread": spread}
    return own | {"lower": 0.0, "upper": 2.0 * value, "parts": parts}


def record() -> dict[str, Any]:
    parts = [{"name": name, "flow_factor": flow} for name, flow in (("a", 0.97), ("b", None))]
    parameters = [
        parameter("valve.spring_preload", 60.0, 4.0, a=62.0, b=56.0),
        parameter("plunger_needle.spring_preload", 30.0, 2.0, a=30.0, b=31.0),
        parameter("valve.lift", 50.0, 1.0, a=50.0, b=50.0),
    ]
    return {"parts": parts, "parameters": parameters}


def test_distances_are_in_spreads_and_common_parameters_are_left_out() -> None:
    (figure,) = family_figures(record())
    (panel,) = figure.panels
    assert panel.rows == ("valve.spring_preload", "plunger_needle.spring_preload")  # the short names are the same
    assert [series.x for series in panel.series] == [(0.5, 0.0), (-1.0, 0.5)]
    assert {series.mode for series in panel.series} == {MARKERS}  # parameters have no order


def test_no_figure_where_all_parameters_are_common() -> None:
    common = record()
    common["parameters"] = common["parameters"][2:]
    assert family_figures(common) == []


def test_the_tables_hold_type_parts_and_the_flows_that_were_fitted() -> None:
    known, flows = family_tables(record())
    assert known.columns[-2:] == ("part a", "part b")
    assert [cell.plain for cell in known.rows[0]][2:4] == ["60 N", "4 N"]
    assert [[cell.plain for cell in row] for row in flows.rows] == [["a", "0.9700"]]
