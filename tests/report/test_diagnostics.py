"""Charts that say how far a calibration can be trusted: the numbers that they show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commonrail.report.fit.diagnostics import (
    LAGS,
    autocorrelation_figure,
    course_panel,
    pair_figures,
    parity_figure,
)
from commonrail.report.page import report_html, write_report
from tests.report.conftest import WriteRun
from tests.report.samples import fit_of, map_record, rate_record, rate_traces


def test_quantities_stand_over_those_of_the_data() -> None:
    figure = parity_figure(map_record()["data"])
    assert figure is not None
    fit, *_ = figure.panels[0].series
    assert len(fit.x) == 14  # of two pressures; dead times are no quantities
    assert (fit.x[-1], fit.y[-1]) == pytest.approx((148.31, 148.31 * (1 + 0.15 / 7) + 0.1))  # as samples.py makes it
    assert figure.x_title == "measured, mm³"
    assert parity_figure(rate_record()["data"]).x_title == "synthetic, mm³"  # type: ignore[union-attr]


def test_the_autocorrelation_of_residuals_of_first_order_falls_as_their_coefficient() -> None:
    """Of a long AR(1) course the correlation at lag k is φ^k; its standard error at lag 1 is √((1 − φ²)/n)."""
    rng, phi, n = np.random.default_rng(3), 0.6, 40_000
    residuals = np.zeros(n)
    for i, shock in enumerate(rng.normal(size=n)):
        residuals[i] = phi * residuals[i - 1] + shock if i else shock
    name = rate_record()["data"][0]["name"]
    trace = {"time_s": 3e-6 * np.arange(n), "measured": np.zeros(n), "best": residuals}
    figure = autocorrelation_figure(rate_record()["data"], {name: trace})
    assert figure is not None
    (series,) = figure.panels[0].series
    assert series.x[1] == pytest.approx(3.0)  # µs
    assert series.y[:4] == pytest.approx([1.0, phi, phi**2, phi**3], abs=0.03)
    assert figure.panels[0].bands[0].high[0] == pytest.approx(1.96 / np.sqrt(n))


def test_a_course_too_short_has_no_autocorrelation() -> None:
    short = {"time_s": np.arange(2.0 * LAGS - 1), "measured": np.zeros(2 * LAGS - 1), "best": np.ones(2 * LAGS - 1)}
    assert autocorrelation_figure(rate_record()["data"], {rate_record()["data"][0]["name"]: short}) is None


def test_draws_of_a_posterior_stand_in_pairs() -> None:
    record = rate_record()
    draws = {p["name"]: np.linspace(0.9, 1.1, 900) * p["best"] for p in record["parameters"][:3]}
    figures = pair_figures(fit_of(record).parameters, draws)
    assert [figure.title for figure in figures] == ["k1 and k2", "k1 and k3", "k2 and k3"]
    first = figures[0].panels[0].series[0]
    assert len(first.x) == 300
    assert first.x[0] == pytest.approx(0.9 * 303.0)  # N/µm
    assert "k1 and k2" in report_html(record, rate_traces(record), draws=draws)


def test_the_draws_of_a_run_are_on_its_page(write_run: WriteRun) -> None:
    record = rate_record()
    folder: Path = write_run(record, rate_traces(record))
    names = np.array([p["name"] for p in record["parameters"]])
    np.savez(folder / "draws.npz", points=np.full((100, 7), 1e8), names=names)
    assert "the posterior" in write_report(folder).read_text(encoding="utf-8")


def test_the_course_of_the_best_is_between_the_bounds() -> None:
    record = rate_record()
    ends = np.array([[p["lower"] for p in record["parameters"]], [p["upper"] for p in record["parameters"]]])
    (panel,) = course_panel(fit_of(record).parameters, ends)
    assert [series.label for series in panel.series] == ["k1", "k2", "k3", "k4", "k5", "k6", "k7"]
    assert panel.series[3].y == pytest.approx((0.0, 100.0))
    assert list(course_panel(fit_of(record).parameters, ends[:, :3])) == []  # of another study
