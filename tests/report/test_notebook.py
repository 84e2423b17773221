"""Results in a notebook: short lines, tables, figures, frames and named arrays."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.maps.response import Conditions
from commonrail.plugins.maps.sweep import Base, Sweep, Variable
from commonrail.report.notebook import MOST_ROWS, Picture, picture_of
from tests.report.test_simulation import solution, trapezium

TEMPLATE = Path(cr.__file__).parent / "plugins" / "new" / "template" / "study.toml"


def made_sweep() -> Sweep:
    """Sweep of two dwells and three rail pressures, made up."""
    variables = (
        Variable("dwell", "s", np.array([5e-4, 1e-3])),
        Variable("rail_pressure", "Pa", np.array([80e6, 120e6, 160e6])),
    )
    base = Base(100e6, 5e-4, 3e-4, 1e-3, Conditions())
    volume = 1e-9 * np.arange(6.0).reshape(2, 3)
    fused = np.zeros((2, 3), bool)
    well, named = np.zeros((2, 3), np.int64), cr.load_injector("virtual-lino-2016")
    return Sweep(named, base, variables, volume, 0.5 * volume, fused, volume * 1e5, well, well)


def test_a_line_says_what_it_is_and_stays_short() -> None:
    study = cr.load_study(TEMPLATE)
    for result, words in (
        (solution(), "mm³ injected"),
        (study.injector, "my-injector"),
        (study, "3 parameters of my-injector; data 160 MPa"),
        (made_sweep(), "6 combinations of dwell (2 values), rail pressure (3 values)"),
    ):
        assert words in repr(result)
        assert len(repr(result)) < 300


def test_a_result_that_is_half_made_still_has_a_line() -> None:
    assert repr(object.__new__(cr.Study)) == "<Study>"


def test_the_html_holds_tables_and_escapes_names() -> None:
    study = cr.load_study(TEMPLATE)
    html = study._repr_html_()
    assert "control_chamber.z_hole_diameter" in html
    assert len(html) < 20_000
    hostile = cr.Study(
        "<script>", *(getattr(study, key) for key in ("injector", "data", "space", "method", "seed", "time_step"))
    )
    assert "<script>" not in hostile._repr_html_()


def test_frames_have_a_row_for_each_place_and_units_behind_the_names() -> None:
    pytest.importorskip("pandas", reason="pandas comes with the extra notebook")
    frame = made_sweep().to_pandas()
    assert list(frame.columns[:3]) == ["dwell [us]", "rail_pressure [MPa]", "injected_volume [mm3]"]
    assert len(frame) == 6
    row = frame[(frame["dwell [us]"] == 1000.0) & (frame["rail_pressure [MPa]"] == 80.0)]
    assert row["injected_volume [mm3]"].item() == pytest.approx(3.0)
    assert row["second_volume [mm3]"].item() == pytest.approx(1.5)


def test_arrays_have_named_axes_and_units() -> None:
    pytest.importorskip("xarray", reason="xarray comes with the extra notebook")
    found = made_sweep().to_xarray()
    assert found.injected_volume.dims == ("dwell", "rail_pressure")
    assert found.injected_volume.sel(dwell=500.0, rail_pressure=160.0).item() == pytest.approx(2.0)
    assert found.rail_pressure.attrs["units"] == "MPa"
    course = solution().to_xarray()
    assert course.needle_lift.attrs["units"] == "um"
    assert course.needle_lift.values == pytest.approx([200.0] * 4)
    assert course.rate.values[:3] == pytest.approx([0.0, 10.0, 20.0])  # mm³/ms at 800 kg/m³
    assert course.time.values == pytest.approx([0.5, 1.5, 2.5, 3.5])


def test_without_the_library_there_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(cr.errors.ConfigurationError, match=r"pandas, .*'commonrail\[notebook\]'"):
        made_sweep().to_pandas()


def test_figures_are_drawn_and_saved_as_a_page(tmp_path: Path) -> None:
    picture = made_sweep().figures()
    assert isinstance(picture, Picture)
    assert repr(picture).endswith("2 figures>")
    assert picture._repr_html_().count('<svg class="figure') == 2
    page = picture.save(tmp_path / "sweep.html").read_text(encoding="utf-8")
    assert "second injection" in page


def test_a_simulation_is_drawn_with_its_delays_beside_a_section_of_the_injector(tmp_path: Path) -> None:
    picture = picture_of(trapezium(), cr.OperatingPoint(1e8, 700e-6))
    shown = picture._repr_html_()
    assert (shown.count('<svg class="figure'), shown.count('<svg class="section"')) == (1, 1)
    bars = [len(one.figures[0].panels[0].bars) for one in (picture_of(trapezium()), picture)]
    assert bars[0] < bars[1]
    assert '<svg class="section"' in picture.save(tmp_path / "one.html").read_text(encoding="utf-8")
    with pytest.raises(cr.errors.ConfigurationError, match="no point"):
        made_sweep().figures(cr.OperatingPoint(1e8, 700e-6))


def test_what_has_no_figure_or_values_says_so() -> None:
    study = cr.load_study(TEMPLATE)
    with pytest.raises(cr.errors.ConfigurationError, match=r"nothing .*HTML"):
        study.figures()
    assert list(study.to_pandas()["parameter"]) == list(study.space.names)


def test_a_long_table_is_cut_with_a_note() -> None:
    from commonrail.base.table import Cell, Table
    from commonrail.report.notebook import _table_html

    table = Table("t", ("a",), tuple((Cell(f"row {i}"),) for i in range(MOST_ROWS + 5)))
    html = _table_html(table)
    assert f"row {MOST_ROWS - 1}<" in html
    assert f"row {MOST_ROWS}<" not in html
    assert "5 more rows" in html
