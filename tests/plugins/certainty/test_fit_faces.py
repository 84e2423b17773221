"""Judgements of a fit in a notebook: a short line, the tables of the report, and frames with a row for each value."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.record import from_record
from commonrail.plugins.next.run import Measurement
from commonrail.plugins.next.settings import DesignSettings
from commonrail.plugins.next.study import Candidate
from commonrail.plugins.prediction.band import Band
from commonrail.plugins.sensitivity.file import Sensitivity
from commonrail.plugins.sensitivity.page import sensitivity_figures
from commonrail.plugins.tolerance.file import ToleranceResult
from commonrail.plugins.tolerance.page import tolerance_figures
from tests.report.analysis_samples import sensitivity_record, tolerance_record

POINTS = (cr.OperatingPoint(80e6, 300e-6), cr.OperatingPoint(120e6, 500e-6))


def prediction(measured: bool = True) -> cr.fit.Prediction:
    """Prediction of a map of two values, made up."""
    quantity = np.array([2e-9, 30e-9])
    role, nothing = cr.data.Role.VALIDATION, np.zeros(2, bool)
    data = cr.QuantityData("map", role, POINTS, quantity, 0.1e-9, 0.02, nothing, 1.0, "made up", "")
    values = np.array([2.1e-9, 28e-9])
    edges = {0.5: (values - 0.05e-9, values + 0.05e-9), 0.9: (values - 1e-9, values + 1e-9)}
    return cr.fit.Prediction([Band(data, values, edges, measured, edges)], (0.5, 0.9), "made up", {})


def plan() -> cr.design.MeasurementPlan:
    """Plan of two measurements, made up."""
    ones = tuple(
        Measurement(Candidate("quantities", point, 1.0), 5e-9 * (i + 1), 0.2e-9, 0.8 - 0.1 * i, 0.9)
        for i, point in enumerate(POINTS)
    )
    errors = {"valve.lift": 2e-6}, {"valve.lift": 1e-6}
    return cr.design.MeasurementPlan(ones, 2.0, DesignSettings(), 40, *errors, 0)


@pytest.mark.parametrize(
    ("result", "words", "table"),
    [
        (prediction(), "hold 1 of 2", "the bands"),
        (prediction(measured=False), "2 values of map", "28.95 to 30.95|27 to 29"),
        (plan(), "2 measurements", "Standard errors"),
    ],
)
def test_a_line_and_tables_say_what_it_is(result: Any, words: str, table: str) -> None:
    assert words in repr(result)
    assert len(repr(result)) < 300
    html = result._repr_html_()
    assert any(one in html for one in table.split("|"))
    assert len(html) < 10_000


def test_frames_have_a_row_for_each_value_with_units() -> None:
    pytest.importorskip("pandas", reason="pandas comes with the extra notebook")
    frame = prediction().to_pandas()
    assert frame["rail_pressure [MPa]"].tolist() == pytest.approx([80.0, 120.0])
    assert frame["upper_90 [mm3]"].tolist() == pytest.approx([3.1, 29.0])
    assert frame["measured [mm3]"].tolist() == pytest.approx([2.0, 30.0])
    assert prediction(measured=False).to_pandas()["measured [mm3]"].isna().all()
    measurements = plan().to_pandas()
    assert measurements["energising_time [us]"].tolist() == pytest.approx([300.0, 500.0])
    assert measurements["expected [mm3]"].tolist() == pytest.approx([5.0, 10.0])


def test_data_of_unlike_units_name_theirs_in_a_column() -> None:
    pytest.importorskip("pandas", reason="pandas comes with the extra notebook")
    one = prediction().bands[0]

    class Rates(cr.QuantityData):
        unit = "m3/s"

    data = Rates("rates", cr.data.Role.FIT, POINTS, np.ones(2), 1e-9, 0.02, np.zeros(2, bool), 1.0, "made up", "")
    both = cr.fit.Prediction([one, one._replace(data=data)], (0.5, 0.9), "made up", {})
    frame = both.to_pandas()
    assert frame["unit"].tolist() == ["m3", "m3", "m3/s", "m3/s"]
    assert frame["predicted"].tolist() == pytest.approx([2.1e-9, 28e-9] * 2)  # SI: no unit is that of all


def test_figures_of_analyses_name_their_output_or_point() -> None:
    titles = [figure.title for figure in sensitivity_figures(from_record(Sensitivity, sensitivity_record()))]
    assert titles == [
        "Share of the variance: Quantity, 160 MPa, 700 µs",
        "Tornado: Quantity, 160 MPa, 700 µs",
    ]
    assert "Quantity of the parts: full load" in [
        figure.title for figure in tolerance_figures(from_record(ToleranceResult, tolerance_record()))
    ]
