"""A study in single precision: another study, whose result is as good and goes on to the same bytes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.base.choices import Precision
from commonrail.base.errors import StudyError
from commonrail.calibration.objective import Objective
from commonrail.calibration.study_file import load_study
from commonrail.data.curves.data import RateScore
from commonrail.runs.fingerprint import hash_study
from commonrail.runs.fit import calibrate_into, resume
from tests.plugins.fleet.conftest import edited
from tests.runs.conftest import GENERATIONS, Whole, stopped_run, timeless, write_small


def chopped(folder: Path, precision: str) -> Whole:
    """The small study with the PWM drive that other tests compute in single precision, and its run."""
    study = write_small(folder / "small")
    edited(study, 'time_step = "auto"', f'time_step = "1 us"\nprecision = "{precision}"')
    edited(study.with_name("injector.toml"), 'drive_kind = "regulated"', 'drive_kind = "pwm"')
    calibrate_into(folder / "run", load_study(study), threads=1)
    return Whole(study, folder / "run")


@pytest.fixture(scope="module")
def single(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """In single precision, never stopped."""
    return chopped(tmp_path_factory.mktemp("single"), "f32")


@pytest.fixture(scope="module")
def double(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """Its twin in double precision."""
    return chopped(tmp_path_factory.mktemp("double"), "f64")


def result(run: Path) -> Any:
    return json.loads((run / "result.json").read_text(encoding="utf-8"))


def test_it_ends_where_the_double_one_ends(single: Whole, double: Whole) -> None:
    one, other = result(single.run), result(double.run)
    assert (one["precision"], other["precision"]) == ("f32", "f64")
    assert one["objective"]["best"] != other["objective"]["best"]
    # 2e-4 was seen: J sums errors that carry the rounding of a rate, 1e-5 to 6e-5 of it
    assert one["objective"]["best"] == pytest.approx(other["objective"]["best"], rel=1e-3)


def test_its_scores_are_double(single: Whole) -> None:
    """Results are simulated in f64: they are those of a simulation of the calibrated injector."""
    calibration = resume(single.run, threads=1)
    study, itself = calibration.study, np.empty((1, 0))
    assert study.precision is Precision.F32
    j = {p: Objective(calibration.injector, (), study.data, study.time_step, 1, p).costs(itself) for p in Precision}
    (score,) = calibration.scores["best"]
    assert isinstance(score, RateScore)
    # rounding of the calibrated values' sum over the samples, taken in the loop or after it
    assert score.j == pytest.approx(j[Precision.F64].costs[0], rel=1e-9)
    assert score.j != pytest.approx(j[Precision.F32].costs[0], rel=1e-7)
    assert calibration.cost == j[Precision.F32].costs[0]  # the search's own


@pytest.mark.parametrize("steps", [1, GENERATIONS, GENERATIONS + 2])
def test_killed_and_resumed_it_ends_in_the_same_bytes(single: Whole, tmp_path: Path, steps: int) -> None:
    run = stopped_run(tmp_path / "run", load_study(single.study), steps)
    resume(run, threads=2)
    assert timeless(run) == timeless(single.run)
    assert (run / "calibrated.toml").read_bytes() == (single.run / "calibrated.toml").read_bytes()
    assert (run / "traces.csv").read_bytes() == (single.run / "traces.csv").read_bytes()


def test_a_run_is_not_gone_on_with_in_another_precision(double: Whole, tmp_path: Path) -> None:
    study = load_study(double.study)
    run = stopped_run(tmp_path / "run", replace(study, precision=Precision.F32), 2)
    with pytest.raises(StudyError, match="reads differently"):
        resume(run, study=study)


def test_the_precision_makes_another_study(whole: Whole) -> None:
    double = load_study(whole.study)
    assert hash_study(double) != hash_study(replace(double, precision=Precision.F32))
