"""Sentences and tables that judge a fit."""

from __future__ import annotations

import copy
import re
from typing import Any

import pytest

from commonrail.report.data.quantities import MapView
from commonrail.report.data.view import Plotted
from commonrail.report.fit.diagnostics import loading_matrix
from commonrail.report.fit.verdict import judgement_lines, judgement_tables
from commonrail.report.page import report_html
from tests.report.samples import fit_of, map_record, rate_record

KNOWN = {"name": "nozzle.z", "value": 1.0, "lower": 0.0}
FIGURES = {"rms_large_percent": 3.5, "rms_small": 0.2e-9, "dead_time_rms": 8e-6, "limit_quantity": 3e-9}


def seed(number: int, objective: float, position: float) -> dict[str, Any]:
    heads = {"map": "rms %"}
    positions = {"valve.mass": position, "valve.damping": 0.5}
    return {
        "seed": number,
        "objective": objective,
        "errors": {"map": 1.23},
        "error_heads": heads,
        "positions": positions,
    }


@pytest.fixture
def record() -> dict[str, Any]:
    """A map's record with all that judges a fit."""
    found = copy.deepcopy(map_record())
    fitted = found["data"][0]
    halves = [None if row["dead_time"] else 0.05 * row["measured"] for row in fitted["rows"]]
    fitted["band"] = {
        "level": 0.9,
        "estimator": "Laplace",
        "half_widths": halves,
        "values": 14,
        "covered": 13,
        "covered_by_parameters_alone": 9,
        "median_half_width_percent": 4.25,
    }
    weights = {"plunger_needle.k1": 0.9, "plunger_needle.k2": -0.4}
    combinations = [{"singular_value": v, "weights": w} for v, w in ((40.0, weights), (4.0, {}), (0.5, weights))]
    found["identifiability"] = {
        "residuals": 17,
        "effective_parameters": 2.4,
        "scatter": 2.0,
        "combinations": combinations,
    }
    found["refits"] = {
        "seeds": [seed(7, 10.0, 0.2), seed(8, 10.5, 0.45), {"seed": 9, "failed": True}],
        "left_out": [
            {
                "by": "rail_pressure",
                "name": "map",
                "searches": 2,
                "values": 14,
                "failed": ["80 MPa"],
                "figures": FIGURES,
            }
            | {"baselines": [{"text": "interpolating the other points", "beaten": False, "figures": FIGURES}]}
        ],
    }
    return found


def test_every_judgement_is_a_sentence(record: dict[str, Any]) -> None:
    told = [
        ("13 of 14", "90 % band", "4.2 %"),
        ("17 residuals", "2.4 effective parameters of 3", "2 tolerances"),
        ("10 and 10.5", "valve.mass", "25 %"),
        ("rail pressure of map", "2 searches", "3.50 % rms above 3 mm³", "0.200 mm³ rms up to 3 mm³"),
        ("80 MPa",),
        ("does not beat interpolating the other points", "3.50 %", "0.200 mm³"),
    ]
    for line, words in zip(judgement_lines(fit_of(record)), told, strict=True):
        assert all(word in line for word in words), line


def test_the_other_way(record: dict[str, Any]) -> None:
    refits = record["refits"]
    refits["left_out"][0]["baselines"][0]["beaten"] = True
    refits["seeds"] = [seed(7, 10.0, 0.2), seed(8, 10.0, 0.2)]
    refits["interrupted"] = True
    lines = "\n".join(judgement_lines(fit_of(record)))
    assert "model beats" in lines
    assert re.search(r"2 seeds .*same values", lines)
    assert "not run" in lines


def test_tables_of_seeds_and_of_what_was_left_out(record: dict[str, Any]) -> None:
    seeds, left_out = judgement_tables(fit_of(record))
    assert [[cell.text for cell in row] for row in seeds.rows] == [
        ["7", "10", "1.23"],
        ["8", "10.5", "1.23"],
        ["9", "–", "–"],
    ]
    assert [row[2].text for row in left_out.rows] == ["model", "interpolating the other points"]
    assert [cell.text for cell in left_out.rows[0]][3:] == ["2", "14", "3.50", "0.200", "8.0"]


def test_the_mean_of_the_members_follows_the_model(record: dict[str, Any]) -> None:
    record["refits"]["left_out"][0]["mean"] = FIGURES | {"rms_large_percent": 2.25}
    _, left_out = judgement_tables(fit_of(record))
    assert [(row[2].text, row[5].text) for row in left_out.rows][:2] == [
        ("model", "3.50"),
        ("mean of the members", "2.25"),
    ]
    assert any(
        line.startswith("The mean of the members of each search gives 2.25 % rms")
        for line in judgement_lines(fit_of(record))
    )


def test_combinations_are_rows_of_a_matrix_the_best_known_on_top(record: dict[str, Any]) -> None:
    matrix = loading_matrix(fit_of(record))
    assert matrix is not None
    # below the scatter of 2 nothing is held; the standard error is 2/40 and 2/4 of the bounds; rows go up from the last
    assert matrix.y == ("50", "5")
    assert (matrix.x, matrix.values) == (("k1", "k2"), ((None, None), (0.9, -0.4)))
    assert "1 further combinations" in matrix.caption


def test_a_fit_that_was_not_judged_has_none() -> None:
    record = map_record()
    assert judgement_lines(fit_of(record)) == []
    assert judgement_tables(fit_of(record)) == []
    assert loading_matrix(fit_of(record)) is None


@pytest.mark.parametrize("upper", [None, 2.0])
def test_a_fit_without_any_interval_says_that_it_has_no_bands(upper: float | None) -> None:
    """An end at what a quantity can be, such as zero, is no interval; a profile's is one."""
    parameters = [KNOWN | {"upper": None}, KNOWN | {"upper": upper}]
    lines = judgement_lines(fit_of(map_record() | {"certainty": {"level": 0.95, "parameters": parameters}}))
    assert [line for line in lines if line.startswith("There are no bands")] == lines[: upper is None]


def test_a_fit_with_bands_does_not_say_that_it_has_none(record: dict[str, Any]) -> None:
    unknown = {"certainty": {"level": 0.95, "parameters": [KNOWN | {"upper": None}]}}
    assert not any(line.startswith("There are no bands") for line in judgement_lines(fit_of(record | unknown)))
    assert judgement_lines(fit_of(map_record() | {"certainty": None})) == []


def test_the_page_shows_them(record: dict[str, Any]) -> None:
    page = report_html(record, {})
    for text in ("Combinations that the data determine", "Other seeds", "lie in the 90 % band"):
        assert text in page


def test_a_table_of_quantities_says_which_lie_in_the_band(record: dict[str, Any]) -> None:
    table = MapView().tables(record["data"], {"start": "start values", "best": "calibrated"})[1]
    column = table.columns.index("90 % band, ±")
    rows = [row for row in record["data"][0]["rows"] if not row["dead_time"]]
    signs = [row[column].text[-1] for row in table.rows]
    inside = [abs(row["best"] - row["measured"]) <= 0.05 * row["measured"] for row in rows]
    assert signs == ["✓" if yes else "✗" for yes in inside]
    assert set(signs) == {"✓", "✗"}


def test_figures_shade_the_band(record: dict[str, Any]) -> None:
    data = record["data"][0]
    figure = MapView().figures(data, Plotted({}, {}))[0]  # dead times come after
    assert "90 % band" in figure.caption
    band = figure.panels[1].bands[0]
    assert band.high == pytest.approx([5.0] * len(band.x))
    assert band.low == pytest.approx([-5.0] * len(band.x))


def test_the_scatter_of_curves_is_in_their_unit(record: dict[str, Any]) -> None:
    curves = rate_record()
    curves["identifiability"] = copy.deepcopy(record["identifiability"]) | {"scatter": 0.125}
    (line,) = judgement_lines(fit_of(curves))
    assert line.endswith("their scatter about the fit is 0.125 mm³/ms.")
    matrix = loading_matrix(fit_of(curves))
    assert matrix is not None
    assert len(matrix.y) == 3  # singular values of 0.5 mm3/ms and more are above that scatter; of a map two are
    both = curves | {"data": [curves["data"][0], record["data"][0]]}
    assert judgement_lines(fit_of(both))[-1].endswith("0.125 of their weighted units.")
