"""Verdicts on convergence in runs: kept, shown in the report, and a search that stops by itself resumed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from commonrail.calibration import search
from commonrail.calibration.study_file import load_study
from commonrail.report.page import write_report
from commonrail.runs.fit import calibrate_into, resume
from tests.runs.conftest import stopped_run, timeless

MULTI_START = 'method = "multi-start least squares"\nmembers = 8\nstarts = 2\ngenerations = 3'


def with_optimiser(study: Path, settings: str) -> Path:
    head, _, _ = study.read_text(encoding="utf-8").partition("[optimiser]")
    study.write_text(f"{head}[optimiser]\n{settings}\n", encoding="utf-8")
    return study


def test_a_multi_start_run_resumes_to_the_same_bytes_and_says_that_it_has_not_converged(
    study_file: Path, tmp_path: Path
) -> None:
    study = load_study(with_optimiser(study_file, MULTI_START))
    calibrate_into(tmp_path / "whole", study, threads=1)
    run = stopped_run(tmp_path / "run", study, 2)
    resume(run, threads=2)
    assert timeless(run) == timeless(tmp_path / "whole")
    result = json.loads((run / "result.json").read_text(encoding="utf-8"))
    assert result["convergence"]["converged"] is False
    assert result["convergence"]["starts"] == 2
    page = write_report(run).read_text(encoding="utf-8")
    assert re.search(r"\bend\b.*not converged", page)
    assert f"Search {result['convergence']['sentence']}." in page
    assert re.search(r"2 starts of 8 draws, 3 iterations", page)


def test_an_evolution_stops_where_it_has_converged_and_is_not_begun_again(
    study_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # any population has collapsed by these limits as soon as three generations are known
    for name, value in {"ALIKE": 1e9, "SMALL_GAIN": 1e9, "LATEST": 2}.items():
        monkeypatch.setattr(search, name, value)
    settings = "members = 8\ngenerations = 6\n"
    whole = load_study(with_optimiser(study_file, settings))
    assert len(calibrate_into(tmp_path / "whole", whole, threads=1).history) == 7
    study = load_study(with_optimiser(study_file, f"{settings}stop_when_converged = true"))
    found = calibrate_into(tmp_path / "run", study, threads=1)
    assert len(found.history) == 3
    assert found.reason.startswith("converged: ")
    assert found.convergence is not None
    assert found.convergence.converged
    before = timeless(tmp_path / "run")
    resume(tmp_path / "run", threads=1)
    assert timeless(tmp_path / "run") == before


def test_refinements_are_judged_by_their_ends_and_keep_them(study_file: Path, tmp_path: Path) -> None:
    study = load_study(study_file)
    calibrate_into(tmp_path / "whole", study, threads=1)
    run = stopped_run(tmp_path / "run", study, 8)  # six steps of the evolution, two refinements
    resume(run, threads=1)
    assert timeless(run) == timeless(tmp_path / "whole")
    result = json.loads((run / "result.json").read_text(encoding="utf-8"))
    assert result["convergence"]["starts"] == 3
    assert re.search(r"3 refinements .*0\.5 of", result["convergence"]["sentence"])
