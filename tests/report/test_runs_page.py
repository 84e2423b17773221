"""The page of all runs below a folder."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urljoin

import pytest

from commonrail.report.runs_page import runs_html
from commonrail.runs.listing import Run
from tests.report.samples import rate_record, rate_traces


@pytest.fixture
def two(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Run]:
    """Two runs of one study, the second with another seed and another value of the first parameter."""
    records = {}
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        records[tmp_path / name] = json.loads(json.dumps(rate_record()))
    records[tmp_path / "b"]["seed"] = 4711
    records[tmp_path / "b"]["parameters"][0]["position"] = 0.99
    (tmp_path / "a" / "report.html").write_text("", encoding="utf-8")

    def read(folder: Path) -> tuple[dict[str, Any], Any]:
        return records[folder], rate_traces(records[folder])

    monkeypatch.setattr("commonrail.report.runs_page.read_run", read)
    return [Run(tmp_path / name, "finished", "A <study>", best=12.5) for name in ("a", "b")]


def test_the_page_links_reports_and_says_what_differs(two: list[Run], tmp_path: Path) -> None:
    page = runs_html(tmp_path, two, tmp_path / "runs.html")
    assert '<a href="./a/report.html">' in page
    assert 'href="b/report.html"' not in page  # it has none
    assert "A &lt;study&gt;" in page
    assert page.count('class="spark"') == 2
    differences = page.partition("What the studies differ in")[2]
    assert "4711" in differences
    assert "time_step" not in differences  # it is the same


def test_parameters_and_curves_of_both_runs_are_drawn(two: list[Run], tmp_path: Path) -> None:
    page = runs_html(tmp_path, two, tmp_path / "runs.html")
    titles = re.findall(r"<figure aria-label=\"([^\"]*)\"", page)
    assert titles[0].startswith("Parameters")
    assert set(rate_traces(rate_record())) <= set(titles)


def test_a_single_run_has_nothing_to_be_compared_with(two: list[Run], tmp_path: Path) -> None:
    page = runs_html(tmp_path, two[:1], tmp_path / "runs.html")
    assert "<figure" not in page
    assert "differ in" not in page


def test_a_folder_named_like_a_script_is_linked_as_a_folder(
    two: list[Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "javascript:alert(1)"
    folder.mkdir()
    (folder / "report.html").write_text("", encoding="utf-8")
    monkeypatch.setattr("commonrail.report.runs_page.read_run", lambda _: (rate_record(), rate_traces(rate_record())))
    page = runs_html(tmp_path, [replace(two[0], folder=folder)], tmp_path / "runs.html")
    (link,) = re.findall(r'href="([^"]*report.html)"', page)
    assert urljoin("file:///runs/", link).startswith("file:///runs/javascript")


@pytest.mark.parametrize("key", ["parameters", "data", "generations"])
def test_a_result_that_cannot_be_read_is_told_and_stops_no_other(
    two: list[Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str
) -> None:
    broken = {**rate_record(), key: "x"}

    def read(folder: Path) -> tuple[dict[str, Any], Any]:
        return (broken if folder.name == "b" else rate_record()), rate_traces(rate_record())

    monkeypatch.setattr("commonrail.report.runs_page.read_run", read)
    page = runs_html(tmp_path, two, tmp_path / "runs.html")
    assert "results of 1" in page
    assert f"{tmp_path / 'b' / 'result.json'} is not as a calibration writes it" in page
    assert page.count('class="spark"') == 1
