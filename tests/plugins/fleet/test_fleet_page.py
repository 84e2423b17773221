"""The page of a fleet: sentences, tables and figures from its record."""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import pytest

from commonrail.base.errors import OutputError
from commonrail.calibration.record import read_as
from commonrail.plugins.fleet.file import FleetRecord
from commonrail.plugins.fleet.page import fleet_figures, fleet_html, fleet_lines, fleet_tables, write_fleet_report

COMMAND = "commonrail fleet f.toml --out runs/f"


def read(record: dict[str, Any]) -> FleetRecord:
    return read_as(FleetRecord, record)


def spread(*values: float) -> dict[str, float]:
    return dict(zip(("minimum", "q1", "median", "q3", "maximum"), values, strict=True)) | {"count": 3}


def parameter(name: str, at_bound: int) -> dict[str, Any]:
    return {
        "name": name,
        "unit": "N",
        "meaning": "preload",
        "lower": 50.0,
        "upper": 120.0,
        "best": spread(50.0, 60.0, 80.0, 100.0, 120.0),
        "position": spread(0.0, 0.25, 0.5, 0.75, 1.0),
        "at_bound": at_bound,
        "verdicts": {"determined": 2, "insensitive": 1},
        "prior": None,
    }


@pytest.fixture
def record() -> dict[str, Any]:
    """Record of a fleet of five: three calibrated, one failed, one not done yet."""
    return copy.deepcopy(
        {
            "software": {"commonrail": "1"},
            "title": "Line <3>",
            "note": "A & B",
            "synthetic": "",
            "seed": 4,
            "study": {"title": "Template", "file": "study.toml"},
            "table": "injectors.csv",
            "status": "interrupted",
            "counts": {"injectors": 5, "finished": 3, "failed": 1, "pending": 1},
            "J": {"start": spread(90, 95, 100, 110, 120), "best": spread(8, 9, 10, 11, 30)},
            "curve": {"start": [90.0, 100.0, 120.0], "best": [8.0, 10.0, 30.0]},
            "data": [
                {
                    "name": "160 MPa",
                    "role": "fit",
                    "measure": "J",
                    "unit": "mm3/ms",
                    "start": spread(90, 95, 100, 110, 120),
                    "best": None,
                    "injectors": 3,
                }
            ],
            "fixed": [],
            "parameters": [parameter("valve.spring_preload", 0), parameter("plunger_needle.spring_preload", 2)],
            "estimator": "curvature",
            "worst": [
                {"injector": "<W>", "J": {"start": 120.0, "best": 30.0}, "at_bound": ["valve.lift"], "seed": 1},
                {"injector": "V", "J": {"start": 100.0, "best": 10.0}, "at_bound": [], "seed": 2},
            ],
            "warnings": [{"code": "sign", "injectors": 2, "first": "<A>", "sentence": "160 MPa: the rate is <neg>."}],
            "failures": [{"injector": "F", "reason": "f.csv, line 3: not <a> number."}],
            "clock": {
                "seconds": 10.0,
                "first": 1.0,
                "calibrated_now": 4,
                "workers": 2,
                "injectors_per_second": 0.4,
                "after_the_first": None,
                "core_seconds_of_an_injector": spread(1, 2, 3, 4, 5),
                "core_seconds": 9.0,
            },
        }
    )


def test_the_sentences_say_how_far_it_is(record: dict[str, Any]) -> None:
    done, left, fell, bounds = fleet_lines(read(record))
    assert re.findall(r"\d+", done) == ["3", "5", "1"]
    assert re.findall(r"\d+", left) == ["1"]
    assert re.findall(r"\d+", fell) == ["100", "10", "9", "11"]
    assert "plunger_needle.spring_preload" in bounds


def test_warnings_stand_on_top_of_the_page(record: dict[str, Any]) -> None:
    text = fleet_html(record, COMMAND)
    warning = "160 MPa: the rate is &lt;neg&gt;."
    assert text.index(warning) < text.index(fleet_lines(read(record))[0])
    assert "&lt;A&gt;" in text
    assert warning not in fleet_html(record | {"warnings": []}, COMMAND)


def test_the_tables(record: dict[str, Any]) -> None:
    errors, parameters, verdicts, worst, failures = (
        [[cell.text for cell in row] for row in table.rows] for table in fleet_tables(read(record))
    )
    assert errors[0][3:] == ["3", "100", *"–––––"]
    assert parameters[1][1:] == [*("50 N", "60 N", "80 N", "100 N", "120 N"), *("50.0", "2")]
    assert verdicts == [["valve.spring_preload", "2", "1"], ["plunger_needle.spring_preload", "2", "1"]]
    assert worst == [["<W>", "120", "30", "3.00", "valve.lift"], ["V", "100", "10", "1.00", "none"]]
    assert failures == [["F", "f.csv, line 3: not <a> number."]]


def test_many_failures_are_cut_short_and_counted(record: dict[str, Any]) -> None:
    record["failures"] *= 130
    table = fleet_tables(read(record))[-1]
    assert (len(table.rows), re.findall(r"\d+", table.note)) == (100, ["30"])


def test_the_figures(record: dict[str, Any]) -> None:
    cost, position = fleet_figures(read(record))
    assert [series.look for series in cost.panels[0].series] == ["start", "best"]
    assert cost.panels[0].series[1].x == (0.0, 50.0, 100.0)
    assert cost.panels[0].series[1].y == (8.0, 10.0, 30.0)
    # one name would stand for two parameters
    assert position.panels[0].categories == ("valve.spring_preload", "plunger_needle.spring_preload")
    assert position.panels[0].boxes[0].boxes[0] == (0.0, 25.0, 50.0, 75.0, 100.0)


def test_texts_from_outside_are_escaped(record: dict[str, Any]) -> None:
    page = fleet_html(record, COMMAND)
    assert "Line &lt;3&gt;" in page
    assert "not &lt;a&gt; number" in page
    assert "&lt;W&gt;" in page
    assert "Line <3>" not in page
    assert COMMAND in re.sub("</?span[^>]*>", "", page)


def test_what_is_synthetic_is_said_on_top(record: dict[str, Any]) -> None:
    assert "Synthetic, not" not in fleet_html(record, COMMAND)
    record["synthetic"] = "All made up."
    page = fleet_html(record, COMMAND)
    assert page.index("synthetic, not measured</span>") < page.index(fleet_lines(read(record))[0])
    assert "All made up." in page


def test_a_fleet_without_a_calibrated_injector_has_a_page(record: dict[str, Any]) -> None:
    record |= {"parameters": [], "worst": [], "data": [], "J": {"start": None, "best": None}}
    record["counts"] |= {"finished": 0, "failed": 4}
    record["curve"] = {"start": [], "best": []}
    record["clock"] |= {"core_seconds_of_an_injector": None, "injectors_per_second": None}
    line, *_ = fleet_lines(read(record))
    assert re.findall(r"\d+", line) == ["0", "5", "4"]
    assert line in fleet_html(record, COMMAND)


def test_the_last_run_is_told(record: dict[str, Any]) -> None:
    assert "0.4 injectors/s" in fleet_html(record, COMMAND)
    record["clock"] |= {"calibrated_now": 0, "workers": 0}
    assert "injectors/s" not in fleet_html(record, COMMAND)


def test_a_page_that_cannot_be_written(record: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"report\.html"):
        write_fleet_report(tmp_path / "nowhere", record, COMMAND)


def test_classes_correlations_outliers_and_each_injector_are_on_the_page(record: dict[str, Any]) -> None:
    names = [p["name"] for p in record["parameters"]]
    plain = fleet_html(record, COMMAND)
    assert 'id="injector"' not in plain
    record["population"] = {
        "histograms": {name: {"edges": [0.0, 0.5, 1.0], "counts": [1, 2]} for name in names},
        "correlations": [[1.0, -0.42, None], [-0.42, 1.0, 0.5], [None, 0.5, 1.0]],
        "outliers": [{"injector": "<W>", "name": names[0], "value": 9.0, "median": 3.0, "deviations": -4.2}],
        "each": [{"injector": "</script><b>", "J": [90.0, 8.0], "values": [51.0, 52.0]}],
        "more": 7,
    }
    page = fleet_html(record, COMMAND)
    for words in ("−0.42", "−4.2", 'id="injector"', " 7 "):
        assert words in page
    assert "</script><b>" not in page  # JSON within a script is escaped
    assert page.count('<figure class="small"') == 2
