"""The example package, put on the path: each of its parts works as one that ships."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

import commonrail
from commonrail.base import registry
from commonrail.calibration.study_file.file import load_study
from commonrail.report.page import write_report
from commonrail.runs.fit import calibrate_into, resume
from commonrail.runs.listing import list_runs
from tests.cli.conftest import run_command, small_study
from tests.distribution import package
from tests.runs.conftest import stopped_run, timeless

ROOT = Path(__file__).parents[2] / "examples" / "commonrail-example"
SEARCH = '[optimiser]\nmethod = "random search"\nmembers = 6\ngenerations = 3\n'


@pytest.fixture(autouse=True)
def example(tmp_path: Path) -> Iterator[None]:
    """The package, installed."""
    with package(ROOT, tmp_path / "site"):
        yield


def test_all_its_parts_are_found() -> None:
    found = {entry.distribution for group in registry.GROUPS for entry in registry.installed(group).values()}
    assert "commonrail-example" in found


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Small study with its optimiser."""
    study = small_study(tmp_path / "small")
    head, _, _ = study.read_text(encoding="utf-8").partition("[optimiser]")
    study.write_text(head + SEARCH, encoding="utf-8")
    return study


def test_a_study_is_calibrated_by_its_optimiser(study: Path, tmp_path: Path) -> None:
    calibrate_into(tmp_path / "run", load_study(study), threads=1)
    result = json.loads((tmp_path / "run" / "result.json").read_text(encoding="utf-8"))
    assert (result["optimiser"]["method"], result["optimiser"]["members"]) == ("random search", 6)
    assert len(result["generations"]) == 4
    page = write_report(tmp_path / "run").read_text(encoding="utf-8")
    assert "random search, 3 generations of 6 members" in page
    (found,) = list_runs(tmp_path / "run")
    assert found.generation == found.generations == 4
    run = stopped_run(tmp_path / "again", load_study(study), 2)
    resume(run, threads=1)
    assert timeless(run) == timeless(tmp_path / "run")
