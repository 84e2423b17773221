"""Judgement of each fit: parts of other packages add to it, and without those that ship it is left out."""

from __future__ import annotations

from pathlib import Path

import pytest

from commonrail.base import registry
from commonrail.calibration.identifiability import identify
from commonrail.calibration.result import result_record
from commonrail.calibration.run import Calibration, calibrate
from commonrail.calibration.study_file import load_study
from commonrail.plugins import SHIPPED
from commonrail.report.page import write_report
from commonrail.runs.folder import read_run, write_run
from tests.distribution import distribution
from tests.map_study import map_study

TABLE = """rail_pressure [MPa],energising_time [us],quantity [mm3]
60,400,4
60,700,20
80,400,7
80,700,28
120,400,10
120,700,42
"""
PART = """
def judge(fit):
    fit.identified.sections["spray"] = {"angle": 14, "starts": fit.starts}


def fails(fit):
    raise ZeroDivisionError
"""


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    """Fit of a small map."""
    folder = tmp_path_factory.mktemp("map")
    (folder / "map.csv").write_text(TABLE, encoding="utf-8")
    (folder / "study.toml").write_text(map_study(), encoding="utf-8")
    return calibrate(load_study(folder / "study.toml"), threads=1)


def test_without_certainty_a_fit_keeps_its_effects_and_has_a_report(
    fit: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SHIPPED, "after_fit", {})
    registry.find_shipped.cache_clear()
    try:
        found = identify(fit, 1)
    finally:
        monkeypatch.undo()
        registry.find_shipped.cache_clear()
    write_run(tmp_path, fit, found)
    record, _ = read_run(tmp_path)
    assert "certainty" not in record
    assert all("band" not in data for data in record["data"])
    assert record["parameters"][0]["effect"] > 0.0
    assert record["parameters"][0]["standard_error"] > 0.0
    assert write_report(tmp_path).is_file()


def test_a_part_of_another_package_adds_a_section(fit: Calibration, tmp_path: Path) -> None:
    parts = "[commonrail.after_fit]\nspray = example_judge:judge\n"
    with distribution(tmp_path, {"example_judge": PART}, parts):
        record = result_record(fit, identify(fit, 1))
    assert record["spray"] == {"angle": 14, "starts": 1}
    assert record["certainty"]["parameters"]


@pytest.mark.parametrize("name", ["absent", "fails"])
def test_a_broken_part_is_named_and_the_others_judge(fit: Calibration, tmp_path: Path, name: str) -> None:
    parts = f"[commonrail.after_fit]\nspray = example_judge:{name}\n"
    with (
        distribution(tmp_path, {"example_judge": PART}, parts),
        pytest.warns(RuntimeWarning, match=r'example-plugin 1\.2: "spray" of commonrail\.after_fit'),
    ):
        found = identify(fit, 1)
    assert "certainty" in found.sections
    assert found.bands
