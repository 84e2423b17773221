"""Figures by matplotlib hold the numbers and units of the charts; corner plots and traces those of the draws."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.chart import Bars, Boxes, Figure, HeatMap, Panel, Series
from commonrail.plugins.certainty.file import Certainty
from commonrail.report.notebook import charts_of
from tests.plugins.certainty.test_fit_faces import plan, prediction
from tests.report.test_notebook import made_sweep
from tests.report.test_simulation import trapezium

matplotlib = pytest.importorskip("matplotlib", reason="matplotlib comes with the extra notebook")
matplotlib.use("Agg")
pytest.importorskip("matplotlib.pyplot")


@pytest.fixture(autouse=True)
def _close() -> Any:
    yield
    matplotlib.pyplot.close("all")


def lines_of(axes: Any) -> list[np.ndarray]:
    return [line.get_xydata() for line in axes.get_lines() if len(line.get_xydata())]


@pytest.mark.parametrize("result", [trapezium(), made_sweep(), prediction(), plan()], ids=lambda r: type(r).__name__)
def test_every_panel_has_the_points_and_titles_of_its_chart(result: Any) -> None:
    for number, chart in enumerate(charts_of(result)):
        axes = np.atleast_1d(result.plot(figure=number))
        assert axes[-1].get_xlabel() == chart.x_title
        for one, panel in zip(axes, chart.panels if isinstance(chart, Figure) else [chart], strict=True):
            assert one.get_ylabel() == panel.y_title
            drawn = lines_of(one)
            for series in panel.series if isinstance(panel, Panel) else ():
                points = np.array([series.x, series.y], dtype=float).T
                assert any(len(d) == len(points) and np.array_equal(d, points, equal_nan=True) for d in drawn)


def test_axes_are_drawn_into_from_the_first_panel() -> None:
    injection = trapezium()
    _, ax = matplotlib.pyplot.subplots()
    assert injection.plot(ax) is ax
    assert ax.get_ylabel() == charts_of(injection)[0].panels[0].y_title
    _, many = matplotlib.pyplot.subplots(20)
    for wrong in ({"ax": many}, {"figure": 1}):
        with pytest.raises(cr.errors.ConfigurationError):
            injection.plot(**wrong)


BARS = Bars("b", "best", (0.0, 1.0), (2.0, None), (1.5, None), (2.5, None))
BOXES = Boxes("b", "best", ((1.0, 2.0, 3.0, 4.0, 5.0),))
LINES = Series("s", "best", (1.0, 2.0), (1.0, 9.0)), Series("", "level", (1.0,), (500.0,))
PANELS = [
    Panel("y", (), bars=(BARS,), rows=("p", "q")),
    Panel("y", (), boxes=(BOXES,), categories=("k",)),
    Panel("y", LINES, scaled_by="best"),
]
CHARTS = [
    HeatMap("t", "", "x", "y", ("a", "b"), ("c",), ((1.0, None),), (("1", ""),), "mm³"),
    *(Figure("t", "", "x", (panel,)) for panel in PANELS),
]


def test_each_kind_of_chart_is_drawn() -> None:
    from commonrail.report.plot import draw

    cells, bars, boxes, scaled = map(draw, CHARTS)
    assert cells.images[0].get_array().tolist() == [[1.0, None]]
    assert cells.figure.axes[1].get_ylabel() == "mm³"
    assert (bars.patches[0].get_x(), bars.patches[0].get_width()) == (0.0, 2.0)
    assert [text.get_text() for text in bars.get_yticklabels()] == ["p", "q"]
    assert any(3.0 in line.get_ydata() for line in boxes.get_lines())
    assert scaled.get_ylim()[1] < 10.0


def test_without_matplotlib_a_sentence_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(cr.errors.ConfigurationError, match=r"matplotlib.*'commonrail\[notebook\]'"):
        trapezium().plot()


# --- Draws of a posterior -------------------------------------------------------------------------------------------


class Drawn(Certainty):
    """Certainty of two parameters of which the draws alone are known."""

    names = ("valve.lift", "valve.mass")  # type: ignore[assignment]
    points = np.random.default_rng(1).normal([4e-5, 4e-3], [1e-6, 1e-4], (200, 2))  # type: ignore[assignment]

    def __init__(self) -> None:
        self.__dict__.update(d=2, point=np.array([4e-5, 4e-3]))
        self.__dict__["estimate"] = SimpleNamespace(likelihood=SimpleNamespace(units=("m", "kg")))


def test_a_corner_plot_has_pairs_of_parameters_with_units() -> None:
    axes = Drawn().plot()
    assert axes.shape == (2, 2)
    assert [one.get_xlabel() for one in axes[-1]] == ["valve.lift [m]", "valve.mass [kg]"]
    np.testing.assert_array_equal(lines_of(axes[1, 0])[0], Drawn.points)
    assert sum(patch.get_height() for patch in axes[0, 0].patches) == 200


def test_traces_have_a_draw_for_each_number() -> None:
    _, own = matplotlib.pyplot.subplots(2)
    axes = Drawn().plot(own, kind="trace")
    assert axes[0] is own[0]
    np.testing.assert_array_equal(lines_of(axes[1])[0][:, 1], Drawn.points[:, 1])
    for wrong in ({"kind": "pairs"}, {"ax": own}):
        with pytest.raises(cr.errors.ConfigurationError):
            Drawn().plot(**wrong)


def test_arviz_gets_the_draws_as_one_chain() -> None:
    pytest.importorskip("arviz_base", reason="arviz-base comes with the extra posterior")
    posterior = Drawn().to_arviz()["posterior"]
    assert posterior["valve.mass"].dims == ("chain", "draw")
    np.testing.assert_array_equal(posterior["valve.mass"].values[0], Drawn.points[:, 1])


def test_without_arviz_a_sentence_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "arviz_base", None)
    with pytest.raises(cr.errors.ConfigurationError, match=r"'commonrail\[posterior\]'"):
        Drawn().to_arviz()
