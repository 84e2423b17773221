"""Time step of a study: short enough for the whole box, said where it is not."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.objective import Objective
from commonrail.calibration.plausibility import of_settings
from commonrail.calibration.study import longest_for_all, step_for_all
from commonrail.calibration.study_file import load_study
from commonrail.data.base import Role
from commonrail.data.registry import of_role
from commonrail.engine.status import Status
from commonrail.engine.time_step import DEFAULT_STEP

CASES = Path(__file__).resolve().parents[2] / "cases"


def paper(folder: Path, *changes: tuple[str, str]) -> Path:
    """The paper's study with some text replaced."""
    shutil.copytree(CASES / "paper", folder)
    path = folder / "study.toml"
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


STEP = 'time_step = "1 us"'


def test_the_shipped_boxes_bear_the_default_step() -> None:
    for case in ("paper", "cri2-16"):
        study = load_study(CASES / case / "study.toml")
        assert step_for_all(study.injector, study.space) == study.time_step == DEFAULT_STEP


@pytest.mark.parametrize("text", [(STEP, 'time_step = "auto"'), (STEP, "")])
def test_a_stiffer_box_gets_a_shorter_step(tmp_path: Path, text: tuple[str, str]) -> None:
    study = load_study(paper(tmp_path / "case", text))
    assert study.time_step == DEFAULT_STEP
    light = study.injector.with_values({"plunger_needle.m1": 0.1 * study.injector.values["plunger_needle.m1"]})
    step = step_for_all(light, study.space)
    assert step < longest_for_all(light, study.space) < DEFAULT_STEP
    # no candidate fails for its step, not even the corners
    short = replace(study, injector=light, time_step=step)
    fit = of_role(short.data, Role.FIT)
    corners = np.array([short.space.upper, short.space.lower, short.space.reference])
    at = Objective(light, short.space.names, fit, step).costs(corners)
    assert Status.STEP_UNSTABLE not in at.statuses
    before = Objective(light, short.space.names, fit, DEFAULT_STEP).costs(corners)
    assert before.statuses[0] == Status.STEP_UNSTABLE
    assert before.costs[0] == np.inf


def test_a_step_of_ones_own_that_is_too_long_is_told(tmp_path: Path) -> None:
    study = load_study(paper(tmp_path / "case", (STEP, 'time_step = "1.8 us"')))
    (finding,) = (f for f in of_settings(study) if f.code == "time_step")
    assert "1.8 µs" in finding.sentence
    assert "1.25 us" in finding.sentence
    assert not [f for f in of_settings(replace(study, time_step=1.25e-6)) if f.code == "time_step"]


def test_a_box_that_no_step_bears_is_refused(tmp_path: Path) -> None:
    study = load_study(paper(tmp_path / "case"))
    massless = study.injector.with_values({"plunger_needle.m1": 1e-15})
    with pytest.raises(ConfigurationError, match=r"time step .*stiffnesses"):
        step_for_all(massless, study.space)
