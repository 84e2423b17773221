"""Bands of injection curves in figures and sentences."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from commonrail.data.records import JUDGED, MICROSECOND
from commonrail.report.data.bands import band_sentence
from commonrail.report.data.curves import CurveView
from commonrail.report.data.view import Plotted
from commonrail.report.fit.record import shown_of
from tests.report.samples import rate_record, rate_traces

MM3_PER_MS = 1e6  # of 1 m³/s


@pytest.fixture
def record() -> dict[str, Any]:
    """Record of curves whose first one has a band of 2 mm³/ms to both sides, its first sample without."""
    found = copy.deepcopy(rate_record())
    data = found["data"][0]
    best = rate_traces(found)[data["name"]][JUDGED]
    edges = {key: [None, *(best[1:] + sign * 2e-6).tolist()] for key, sign in (("lower", -1.0), ("upper", 1.0))}
    data["band"] = {
        "level": 0.9,
        "estimator": "Laplace",
        **edges,
        "values": len(best),
        "covered": len(best) - 3,
        "covered_by_parameters_alone": 4,
        "median_half_width_percent": 4.0,
    }
    return found


def test_figures_shade_the_band_of_a_curve_and_of_its_errors(record: dict[str, Any]) -> None:
    data, traces = record["data"][0], rate_traces(record)
    (figure,) = CurveView().figures(data, Plotted(shown_of(record["labels"]), traces))
    assert "90 % band" in figure.caption
    shown = np.isin(traces[data["name"]]["time_s"] * MICROSECOND, figure.panels[0].series[0].x)
    assert shown[0]
    trace = {label: values[shown] for label, values in traces[data["name"]].items()}
    for panel, about in zip(figure.panels, (np.zeros(len(trace["measured"])), trace["measured"]), strict=True):
        (band,) = panel.bands
        assert band.low[0] is None
        expected = (trace[JUDGED] - about)[1:] * MM3_PER_MS
        np.testing.assert_allclose(np.array(band.low[1:], float), expected - 2.0, atol=1e-9)
        np.testing.assert_allclose(np.array(band.high[1:], float), expected + 2.0, atol=1e-9)


def test_a_curve_without_a_band_has_none(record: dict[str, Any]) -> None:
    del record["data"][0]["band"]
    (figure,) = CurveView().figures(record["data"][0], Plotted(shown_of(record["labels"]), rate_traces(record)))
    assert "Shaded" not in figure.caption
    assert all(panel.bands == () for panel in figure.panels)


def test_the_sentence_counts_samples(record: dict[str, Any]) -> None:
    data = record["data"][0]
    count = data["band"]["values"]
    for synthetic, origin in (("made by the tests", "synthetic"), ("", "measured")):
        sentence = band_sentence(data | {"synthetic": synthetic})
        assert sentence.startswith(f"{count - 3} of {count} {origin} samples of {data['name']}")
    assert "4.0 %" in band_sentence(data)
