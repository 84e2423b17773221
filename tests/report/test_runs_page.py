"""The page of all runs below a folder."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

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
    assert '<a href="a/report.html">' in page
    assert 'href="b/report.html"' not in page  # it has none
    assert "A &lt;study&gt;" in page
    assert page.count('class="spark"') == 2
    differences = page.partition("What the studies differ in")[2]
    assert "4711" in differences
    assert "time_step" not in differences  # it is the same


def test_parameters_and_curves_of_both_runs_are_drawn(two: list[Run], tmp_path: Path) -> None:
    page = runs_html(tmp_path, two, tmp_path / "runs.html")
    titles = re.findall(r"<figure aria-label=\"([^\"]*)\"", page)
    assert titles[0] == "Parameters of the runs"
    assert set(rate_traces(rate_record())) <= set(titles)


def test_a_single_run_has_nothing_to_be_compared_with(two: list[Run], tmp_path: Path) -> None:
    page = runs_html(tmp_path, two[:1], tmp_path / "runs.html")
    assert "<figure" not in page
    assert "differ in" not in page
