"""A run folder of the paper's study, as a calibration would leave it: its study, its data, and the best values."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

import commonrail as cr
from commonrail.report import page

ROOT = Path(__file__).parents[3]
LIVE = page._live  # before `still_reports` of tests/conftest.py takes its place


@pytest.fixture(scope="package", autouse=True)
def live_reports() -> Iterator[None]:
    """Reports have charts that simulate."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "_live", LIVE)
        yield


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Start values of the study but for two stiffnesses, which differ from them."""
    folder = tmp_path_factory.mktemp("runs") / "paper"
    shutil.copytree(ROOT / "cases" / "paper", folder)
    space = cr.load_study(folder / "study.toml").space
    best = dict(zip(space.names, space.reference.tolist(), strict=True))
    best["plunger_needle.k1"] *= 1.1
    best["plunger_needle.k6"] *= 1.2
    parameters = [{"name": name, "best": value} for name, value in best.items()]
    (folder / "result.json").write_text(
        json.dumps({"kind": "calibration", "schema": 1, "parameters": parameters}), encoding="utf-8"
    )
    return folder
