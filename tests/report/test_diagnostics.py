"""Charts that say how far a calibration can be trusted: the numbers that they show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.report.fit.diagnostics import (
    LAGS,
    autocorrelation_figure,
    course_panel,
    pair_figures,
    parity_figure,
    profile_figures,
)
from commonrail.report.page import report_html, write_report
from tests.report.conftest import WriteRun
from tests.report.samples import map_record, rate_record, rate_traces


def test_quantities_stand_over_those_of_the_data() -> None:
    figure = parity_figure(map_record())
    assert figure is not None
    fit, *_ = figure.panels[0].series
    assert len(fit.x) == 14  # of two pressures; dead times are no quantities
    assert (fit.x[-1], fit.y[-1]) == pytest.approx((148.31, 148.31 * (1 + 0.15 / 7) + 0.1))  # as samples.py makes it
    assert figure.x_title == "measured, mm³"
    assert parity_figure(rate_record()).x_title == "synthetic, mm³"  # type: ignore[union-attr]


def test_the_autocorrelation_of_residuals_of_first_order_falls_as_their_coefficient() -> None:
    """Of a long AR(1) course the correlation at lag k is φ^k; its standard error at lag 1 is √((1 − φ²)/n)."""
    rng, phi, n = np.random.default_rng(3), 0.6, 40_000
    residuals = np.zeros(n)
    for i, shock in enumerate(rng.normal(size=n)):
        residuals[i] = phi * residuals[i - 1] + shock if i else shock
    name = rate_record()["data"][0]["name"]
    trace = {"time_s": 3e-6 * np.arange(n), "measured": np.zeros(n), "best": residuals}
    figure = autocorrelation_figure(rate_record(), {name: trace})
    assert figure is not None
    (series,) = figure.panels[0].series
    assert series.x[1] == pytest.approx(3.0)  # µs
    assert series.y[:4] == pytest.approx([1.0, phi, phi**2, phi**3], abs=0.03)
    assert figure.panels[0].bands[0].high[0] == pytest.approx(1.96 / np.sqrt(n))


def test_a_course_too_short_has_no_autocorrelation() -> None:
    short = {"time_s": np.arange(2.0 * LAGS - 1), "measured": np.zeros(2 * LAGS - 1), "best": np.ones(2 * LAGS - 1)}
    assert autocorrelation_figure(rate_record(), {rate_record()["data"][0]["name"]: short}) is None


def profiled(finished: bool) -> dict[str, Any]:
    """A record with the profile of a normal likelihood about 80 N/µm, of a standard error of 2 N/µm."""
    record = rate_record()
    values = [80e6 + 2e6 * k for k in (-2.5, -1.0, 1.0, 2.5, 4.0)]
    ends = {side: {"value": 1.0, "finished": finished, "wall": False} for side in ("low", "high")}
    points = [[v, ((v - 80e6) / 2e6) ** 2] for v in values]
    profile = {"name": "plunger_needle.k2", "points": points, **ends}
    record["certainty"] = {
        "level": 0.95,
        "profiles": [profile],
        "parameters": [{"name": "plunger_needle.k2", "value": 80e6}],
    }
    return record


def test_a_profile_is_a_parabola_where_the_likelihood_is_normal() -> None:
    (figure,) = profile_figures(profiled(True))
    line, computed, level, best = figure.panels[0].series
    assert computed.x == pytest.approx([75.0, 78.0, 80.0, 82.0, 85.0])  # N/µm; a fall of 16 is beyond the chart
    assert line.y == pytest.approx([((x - 80.0) / 2.0) ** 2 for x in line.x if x is not None], abs=1e-9)
    assert level.y[0] == pytest.approx(3.8415, abs=1e-3)  # chi-squared with one degree of freedom
    assert best.x[0] == pytest.approx(82.6)
    assert profile_figures(profiled(False)) == []  # neither end was reached


def test_draws_of_a_posterior_stand_in_pairs() -> None:
    record = rate_record()
    draws = {p["name"]: np.linspace(0.9, 1.1, 900) * p["best"] for p in record["parameters"][:3]}
    figures = pair_figures(record, draws)
    assert [figure.title for figure in figures] == ["k1 and k2", "k1 and k3", "k2 and k3"]
    first = figures[0].panels[0].series[0]
    assert len(first.x) == 300
    assert first.x[0] == pytest.approx(0.9 * 303.0)  # N/µm
    assert "k1 and k2" in report_html(record, rate_traces(record), draws=draws)


def test_draws_of_chains_that_do_not_agree_are_not_drawn(write_run: WriteRun) -> None:
    record = rate_record()
    folder: Path = write_run(record, rate_traces(record))
    names = [p["name"] for p in record["parameters"]]
    points = np.full((2, 50, 7), 1e8)
    for refused, shown in (("R-hat of k1 is 4", False), ("", True)):
        np.savez(folder / "posterior.npz", points=points, names=np.array(names), refused=np.array(refused))
        assert ("Draws of the posterior" in write_report(folder).read_text(encoding="utf-8")) is shown


def test_the_course_of_the_best_is_between_the_bounds() -> None:
    record = rate_record()
    ends = np.array([[p["lower"] for p in record["parameters"]], [p["upper"] for p in record["parameters"]]])
    (panel,) = course_panel(record, ends)
    assert [series.label for series in panel.series] == ["k1", "k2", "k3", "k4", "k5", "k6", "k7"]
    assert panel.series[3].y == pytest.approx((0.0, 100.0))
    assert list(course_panel(record, ends[:, :3])) == []  # of another study
