"""Names, command lines and captions in a page."""

import re
from itertools import combinations
from pathlib import Path

from commonrail.base.table import table_from_columns
from commonrail.plugins.foreign_fmu.page import fmu_figures, fmu_lines
from commonrail.report import html
from commonrail.report.html import breakable, print_size, unbroken
from commonrail.report.page import report_html
from tests.report.samples import rate_record, rate_traces


def test_a_long_name_may_be_broken_at_its_joints_and_stays_escaped() -> None:
    assert breakable("seat.cone_angle") == "seat.<wbr>cone_<wbr>angle"
    assert breakable("<b>.x") == "&lt;b&gt;.<wbr>x"


def test_small_figures_say_their_energising_times_and_share_a_caption() -> None:
    """A caption for each of forty would fill a page and a half; three of them would speak of three curves only."""
    record = rate_record()
    first = record["data"][0]
    record["data"] = [first | {"name": f"curve {i}", "energising_time": (300 + i) * 1e-6} for i in range(7)]
    page = report_html(record, rate_traces(record))
    for i in range(7):
        assert f"<h3>curve {i} (fit), 160 MPa, {300 + i} µs</h3>" in page
    assert page.count("Rate of injection; below") == 1


def test_small_figures_of_many_captions_have_their_own() -> None:
    record = rate_record()
    first = record["data"][0]
    record["data"] = [first | {"name": f"curve {i}", "meter": f"meter {i}"} for i in range(7)]
    page = report_html(record, rate_traces(record))
    for i in range(7):
        assert page.count(f"as the meter “meter {i}” shows it") == 1


def test_an_fmu_that_failed_with_the_start_values_is_told() -> None:
    data = {"name": "decay", "role": "fit", "values": 20, "rms": {"best": 0.5, "start": None}}
    record = {"data": [data], "convergence": None, "evaluations": {"failed": 0}, "notes": [], "parameters": []}
    errors, failed = fmu_lines(record)
    assert "20 values" in errors
    assert "0.5 tolerances" in errors
    assert "FMU failed" in failed


def test_figures_of_an_fmu_call_synthetic_data_so_and_leave_out_what_failed() -> None:
    output = {"variable": "x", "unit": "m", "axis": "time", "at": [0.0, 1.0], "measured": [1.0, 2.0]}
    output |= {"start": [None, None], "best": [1.1, 2.1]}
    record = {"data": [{"name": "decay", "role": "fit", "synthetic": "the solution", "outputs": [output]}]}
    (figure,) = fmu_figures(record)
    assert [series.label for series in figure.panels[0].series] == ["synthetic", "calibrated"]


def test_a_number_stays_on_a_line_with_its_unit_and_a_range_is_broken_at_its_to() -> None:
    assert unbroken("+13.8 ○") == "+13.8 ○"
    assert unbroken("-137.76 N/µm to 281.33 N/µm") == (
        '<span class="word">-137.76 N/µm</span> to <span class="word">281.33 N/µm</span>'
    )
    assert unbroken("a reason <b> of many words and no number") == "a reason &lt;b&gt; of many words and no number"


def test_letters_in_print_are_small_enough_for_what_is_not_broken() -> None:
    cells = [("parameter", "name"), *((f"c{i}", "range") for i in range(12))]
    wide = table_from_columns("", [{"name": "a", "range": "-137.76 N/µm to 281.33 N/µm"}], cells)
    narrow = table_from_columns("", [{"name": "a", "range": "1 to 2"}], cells)
    assert float(print_size(wide)[:-2]) < float(print_size(narrow)[:-2])


def test_no_two_templates_style_the_same_class() -> None:
    """All styles of a page are one sheet: a class that two templates style gets both, whatever each means by it."""
    styles = {}
    for path in Path(html.__file__).parents[1].rglob("templates/*.html"):
        found = re.findall(r"{% block (?:css|style) %}.*?{% endblock %}", path.read_text("utf-8"), re.S)
        # selectors stand before braces; a number such as .8rem is no class
        selectors = [before for sheet in found for before in re.findall(r"([^{}]+){", sheet)]
        styles[path.name] = {name for text in selectors for name in re.findall(r"\.([a-z][\w-]*)", text)}
    assert {"base.html", "reproduction.html"} <= {name for name, classes in styles.items() if classes}
    shared = {(a, b): styles[a] & styles[b] for a, b in combinations(sorted(styles), 2)}
    assert {pair: names for pair, names in shared.items() if names} == {}
