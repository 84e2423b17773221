"""Names, command lines and captions in a page."""

import functools
from pathlib import Path

import pytest
from jinja2 import DictLoader, Environment

from commonrail.report import html
from commonrail.report.build import MANY, report_html
from commonrail.report.foreign import fmu_figures, fmu_lines
from commonrail.report.html import breakable
from tests.report.samples import rate_record, rate_traces


def test_a_long_name_may_be_broken_at_its_joints_and_stays_escaped() -> None:
    assert breakable("seat.cone_angle") == "seat.<wbr>cone_<wbr>angle"
    assert breakable("<b>.x") == "&lt;b&gt;.<wbr>x"


def test_small_figures_say_their_energising_times_and_share_a_caption() -> None:
    """A caption for each of forty would fill a page and a half; three of them would speak of three curves only."""
    record = rate_record()
    first = record["data"][0]
    record["data"] = [first | {"name": f"curve {i}", "energising_time": (300 + i) * 1e-6} for i in range(MANY + 1)]
    page = report_html(record, rate_traces(record))
    for i in range(MANY + 1):
        assert f"<h3>curve {i} (fit), 160 MPa, {300 + i} µs</h3>" in page
    assert page.count("Rate of injection; below") == 1


def test_small_figures_of_many_captions_have_their_own() -> None:
    record = rate_record()
    first = record["data"][0]
    record["data"] = [first | {"name": f"curve {i}", "meter": f"meter {i}"} for i in range(MANY + 1)]
    page = report_html(record, rate_traces(record))
    for i in range(MANY + 1):
        assert page.count(f"as the meter “meter {i}” shows it") == 1


def test_an_fmu_that_failed_with_the_start_values_is_told() -> None:
    data = {"name": "decay", "role": "fit", "values": 20, "rms": {"best": 0.5, "start": None}}
    record = {"data": [data], "convergence": None, "evaluations": {"failed": 0}, "notes": [], "parameters": []}
    errors, failed = fmu_lines(record)
    assert "20 values" in errors
    assert "0.5 tolerances" in errors
    assert "the FMU failed with the start values" in failed


def test_figures_of_an_fmu_call_synthetic_data_so_and_leave_out_what_failed() -> None:
    output = {"variable": "x", "unit": "m", "axis": "time", "at": [0.0, 1.0], "measured": [1.0, 2.0]}
    output |= {"start": [None, None], "best": [1.1, 2.1]}
    record = {"data": [{"name": "decay", "role": "fit", "synthetic": "the solution", "outputs": [output]}]}
    (figure,) = fmu_figures(record)
    assert [series.label for series in figure.panels[0].series] == ["synthetic", "calibrated"]


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Empty folder of compiled templates, and an environment that has seen none."""
    folder = tmp_path / "kernels"
    folder.mkdir(mode=0o700)
    monkeypatch.setattr(html, "cache_folder", lambda: folder)
    monkeypatch.setattr(html, "_environment", functools.cache(html._environment.__wrapped__))
    return folder


def page() -> str:
    """A report as a new process makes it."""
    html._environment.cache_clear()
    record = rate_record()
    return report_html(record, rate_traces(record))


def test_a_template_is_compiled_once(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = page()
    names = {path.name for path in kept.glob("*.template")}
    assert len(names) >= 2
    monkeypatch.setattr(Environment, "compile", lambda *_: pytest.fail("the template was compiled again"))
    assert page() == first
    assert {path.name for path in kept.glob("*.template")} == names


def test_a_changed_template_is_compiled_again(kept: Path) -> None:
    def filled(text: str) -> str:
        html._environment.cache_clear()
        environment = html._environment()
        environment.loader = DictLoader({"a.html": text})
        return environment.get_template("a.html").render(x=3)

    assert filled("{{ x }}") == "3"
    assert filled("{{ x + 1 }}") == "4"
    assert len(list(kept.glob("*.template"))) == 1


@pytest.mark.parametrize("damage", [b"", b"x"])
def test_a_damaged_template_is_compiled_again(kept: Path, damage: bytes) -> None:
    first = page()
    for path in kept.glob("*.template"):
        path.write_bytes(damage)
    assert page() == first
