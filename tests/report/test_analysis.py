"""Pages of sensitivity and tolerance studies: sentences, tables, figures; records that are not theirs."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from commonrail.base.chart import Bars, Figure, Panel
from commonrail.base.errors import InputError
from commonrail.base.record import from_record
from commonrail.plugins.sensitivity.file import Sensitivity
from commonrail.plugins.sensitivity.page import sensitivity_html, sensitivity_lines, sensitivity_tables
from commonrail.plugins.tolerance.file import ToleranceResult
from commonrail.plugins.tolerance.page import tolerance_html, tolerance_lines, tolerance_tables
from commonrail.report.figure import figure_svg
from commonrail.report.page import write_report
from tests.report.analysis_samples import sensitivity_record, tolerance_record

HOSTILE = "<script>alert(1)</script>"


def result(record: dict[str, Any]) -> Sensitivity:
    return from_record(Sensitivity, record)


def spread() -> ToleranceResult:
    return from_record(ToleranceResult, tolerance_record())


def cells(rows: Any) -> list[list[str]]:
    return [[cell.text for cell in row] for row in rows]


def test_parameters_are_ranked_in_the_units_of_the_field() -> None:
    table, missing = sensitivity_tables(result(sensitivity_record()))
    assert table.columns == ("parameter", "total, %", "alone, %", "at lower bound, mm³", "at upper bound, mm³")
    assert cells(table.rows) == [
        ["nozzle.hole_diameter", "90.0 (80.0 to 100.0)", "89.0 (79.0 to 99.0)", "45", "56"],
        ["valve.spring_preload", "0.5 (−9.5 to 10.5)", "−0.5 (−10.5 to 9.5)", "50.5", "49.6"],
    ]
    assert cells(missing.rows)[0] == ["nozzle.hole_diameter", "–", "–"]


def test_missing_simulations_are_told_with_their_reason() -> None:
    page = sensitivity_html(sensitivity_record())
    assert re.search(r"200 simulations \(78\.1 %\) .*high valve\.spring_preload", page)
    assert "200 × The needle" in page
    assert re.search(r"78\.1% .*10%", page)
    assert "1 output" in sensitivity_lines(result(sensitivity_record()))[-1]


def test_a_morris_study_shows_sizes_in_units() -> None:
    record = sensitivity_record() | {"design": "morris"}
    row = record["outputs"][0]["parameters"][0]
    row |= {"effect": row["first"], "magnitude": {"value": 11e-9, "low": 9e-9, "high": 12e-9}, "spread": 1e-9}
    row["effect"] = {"value": -11e-9, "low": -12e-9, "high": -9e-9}
    record["outputs"][0]["parameters"] = [row]
    table = sensitivity_tables(result(record))[0]
    assert cells(table.rows) == [["nozzle.hole_diameter", "11 (9 to 12)", "−11 (−12 to −9)", "1", "45", "56"]]
    assert "(Morris) of 2" in sensitivity_html(record)


def test_capability_shares_and_trim_are_tables() -> None:
    capability, shares, trim = tolerance_tables(spread())
    assert cells(capability.rows) == [
        ["full load", "50", "50.1", "0.7", "47.9 to 52.1", "48 to –", "0.60 % (0.58 to 0.62)", "3", "–", "1.05"]
    ]
    assert cells(shares.rows) == [
        ["nozzle.hole_diameter", "90.0 (89.0 to 91.0)", "2", "0.4"],
        ["valve.lift", "–", "–", "–"],
    ]
    assert cells(trim.rows)[0][1:4] == ["0.7", "0.1", "14"]
    assert cells(trim.rows)[0][5] == "300 ppm (100 to 500)"  # below a thousandth


def test_failures_and_limits_of_the_trim_are_reported() -> None:
    page = tolerance_html(tolerance_record())
    for text in (
        "3 simulations failed",
        "3 parts failed: A made-up reason.",
        "2 parts could",
        "1 corrections",
        "nozzle.hole_diameter and valve.lift: 0.3",
        "Synthetic, not",
    ):
        assert text in page
    assert "hole 90 %" in tolerance_lines(spread())[1]


def test_a_study_that_was_stopped_says_so() -> None:
    page = tolerance_html(tolerance_record() | {"status": "interrupted", "asked": 20_000})
    assert "10000 of 20000" in page


@pytest.mark.parametrize("make", [sensitivity_html, tolerance_html])
def test_texts_from_outside_are_escaped(make: Any) -> None:
    record = json.loads(
        json.dumps(sensitivity_record() if make is sensitivity_html else tolerance_record()).replace("made up", HOSTILE)
    )
    assert HOSTILE not in make(record | {"title": HOSTILE})


def test_bars_lie_in_rows_from_top_to_bottom_with_their_intervals() -> None:
    bars = Bars("b", "best", (1.0, 1.0), (3.0, None), (2.5, 0.0), (4.0, 0.0), slot=1)
    figure = Figure("f", "", "x", (Panel("", (), bars=(bars,), rows=("first", "second")),))
    svg = figure_svg(figure, height=200)
    (bar,) = re.findall(r'<rect x="(\d+)" y="\d+" width="(\d+)" height="(\d+)"', svg)
    ends = re.findall(r'data-x="(\S+) (\S+)"', svg)[0]
    width = 10.0 * float(re.findall(r'class="pane" width="([\d.]+)"', svg)[0])
    low, high = map(float, ends)
    start, length = (float(v) / width * (high - low) for v in bar[:2])
    assert low + start == pytest.approx(1.0, abs=1e-3)  # a tenth of a pixel of 700
    assert length == pytest.approx(2.0, abs=2e-3)
    assert svg.index(">first<") < svg.index(">second<")
    heights = [float(y) for y in re.findall(r'y="([\d.]+)" text-anchor="end">(?:first|second)<', svg)]
    assert heights[0] < heights[1]
    interval = re.findall(r'stroke="#1d2733" stroke-width="1.2"', svg)
    assert len(interval) == 1  # of the one bar that is there


@pytest.mark.parametrize("kind", ["sensitivity", "tolerance"])
def test_a_record_that_is_broken_is_refused(tmp_path: Path, kind: str) -> None:
    record = sensitivity_record() if kind == "sensitivity" else tolerance_record()
    file = tmp_path / f"{kind}.json"
    file.write_text(json.dumps(record), encoding="utf-8")
    assert write_report(tmp_path) == tmp_path / "report.html"
    for changed, words in (
        ({"schema": 2}, "another version"),
        ({"kind": "calibration"}, f"result of commonrail {kind}"),
        ({"clock": {}}, r"clock\.seconds: this key is missing"),
    ):
        file.write_text(json.dumps(record | changed), encoding="utf-8")
        with pytest.raises(InputError, match=words):
            write_report(tmp_path)
