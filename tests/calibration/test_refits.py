"""Further searches of a study: other seeds, and rows that are held out in turn."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.base.errors import InputError, SimulationError
from commonrail.calibration import refits, scoring
from commonrail.calibration.refits import refits_of
from commonrail.calibration.run import Calibration, calibrate
from commonrail.calibration.study import Judgement, LeaveOut, Study
from commonrail.calibration.study_file import load_study
from commonrail.data.base import Role
from commonrail.data.quantities.baselines import interpolate
from commonrail.data.quantities.data import QuantityData
from commonrail.runs.fingerprint import hash_study
from commonrail.runs.fit import Listener, calibrate_into
from commonrail.runs.folder import read_run
from tests.map_study import map_study

TABLE = """rail_pressure [MPa],energising_time [us],quantity [mm3]
60,400,4
60,700,20
80,400,7
80,700,28
120,400,10
120,700,42
"""
JUDGED = '[judgement]\nseeds = 1\nleave_out = ["rail_pressure"]\n'


def load(folder: Path, hold_out: str = "", judgement: str = "") -> Study:
    (folder / "map.csv").write_text(TABLE, encoding="utf-8")
    (folder / "study.toml").write_text(map_study(hold_out) + judgement, encoding="utf-8")
    return load_study(folder / "study.toml")


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> tuple[Calibration, dict[str, Any]]:
    """A calibration and its further searches."""
    found = calibrate(load(tmp_path_factory.mktemp("judged"), judgement=JUDGED), threads=1)
    return found, refits_of(found, threads=1)


def test_a_study_without_a_judgement_has_no_further_search(tmp_path: Path) -> None:
    study = load(tmp_path)
    assert study.judgement == Judgement()
    assert refits_of(calibrate(study, threads=1), threads=1) == {}


def test_the_next_seed_is_searched_too(judged: tuple[Calibration, dict[str, Any]], tmp_path: Path) -> None:
    own, record = judged
    first, second = record["seeds"]
    assert (first["seed"], second["seed"]) == (1, 2)
    assert first["objective"] == own.cost
    assert second["objective"] != own.cost
    assert set(second["positions"]) == {"control_chamber.a_hole_diameter"}


def test_every_row_is_predicted_by_the_fit_that_does_not_see_it(
    judged: tuple[Calibration, dict[str, Any]], tmp_path: Path
) -> None:
    (found,) = judged[1]["left_out"]
    assert (found["by"], found["name"], found["searches"], found["values"]) == ("rail_pressure", "map", 3, 6)
    # by hand: three studies whose files hold the rows out
    model, baseline = [], []
    rows = np.array([[60e6, 4e-4, 4], [60e6, 7e-4, 20], [80e6, 4e-4, 7], [80e6, 7e-4, 28], [120e6, 4e-4, 10]])
    rows = np.vstack([rows, [120e6, 7e-4, 42]])
    for rail in (60, 80, 120):
        study = load(tmp_path, f'hold_out = {{ rail_pressure = ["{rail} MPa"] }}')
        score: Any = calibrate(study, threads=1).scores["best"][1]
        held = study.data[1]
        assert isinstance(held, QuantityData)
        model.append(score.values / held.quantity - 1.0)
        out = rows[:, 0] == rail * 1e6
        found_by = [interpolate(rows[~out], rows[out, :2], power).values / rows[out, 2] - 1.0 for power in (1.0, 0.5)]
        tolerances = [error * rows[out, 2] / (0.15 + 0.03 * rows[out, 2]) for error in found_by]
        baseline.append(found_by[int(np.argmin([np.sum(t**2) for t in tolerances]))])
    rms, other = (100.0 * np.sqrt(np.mean(np.concatenate(part) ** 2)) for part in (model, baseline))
    assert found["figures"]["rms_large_percent"] == pytest.approx(rms, rel=1e-12)
    (interpolation,) = found["baselines"]
    assert interpolation["figures"]["rms_large_percent"] == pytest.approx(other, rel=1e-9)
    assert interpolation["beaten"] is bool(rms < other)


STAGED = """
[[parameter]]
name = "control_chamber.a_hole_diameter"
lower = "190 um"
upper = "240 um"

[optimiser]
method = "staged least squares"
members = 8
generations = 0
starts = 2
finalists = 2
trial_iterations = 0
stage_iterations = 1
"""


@pytest.mark.slow  # its staged search screens in single precision, by a kernel that no other test compiles
def test_the_mean_of_the_members_is_judged_on_the_same_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scoring, "WORST", np.inf)  # whatever the objectives of the descents are
    (tmp_path / "map.csv").write_text(TABLE, encoding="utf-8")
    (tmp_path / "study.toml").write_text(map_study(more=STAGED) + JUDGED.replace("seeds = 1\n", ""), encoding="utf-8")
    (found,) = refits_of(calibrate(load_study(tmp_path / "study.toml"), threads=1), threads=1)["left_out"]
    errors = []
    for rail in (60, 80, 120):
        text = map_study(f'hold_out = {{ rail_pressure = ["{rail} MPa"] }}', more=STAGED)
        (tmp_path / "study.toml").write_text(text, encoding="utf-8")
        study = load_study(tmp_path / "study.toml")
        score: Any = calibrate(study, threads=1).scores["mean"][1]
        errors.append(score.values / np.asarray(study.data[1].measured) - 1.0)
    rms = 100.0 * np.sqrt(np.mean(np.concatenate(errors) ** 2))
    assert found["mean"]["rms_large_percent"] == pytest.approx(rms, rel=1e-12)
    assert found["mean"] != found["figures"]


def test_the_map_of_a_sister_part_stands_beside_them(tmp_path: Path) -> None:
    (tmp_path / "sister.csv").write_text(TABLE, encoding="utf-8")
    study = load(tmp_path, 'sister = { file = "sister.csv", flow_ratio = 1.2 }', JUDGED)
    (found,) = refits_of(calibrate(study, threads=1), threads=1)["left_out"]
    sister = found["baselines"][1]
    assert re.search(r"sister part.* 1\.2$", sister["text"])
    assert sister["figures"]["rms_large_percent"] == pytest.approx(20.0, rel=1e-9)  # the same map


def test_a_search_is_given_no_row_that_it_predicts(
    judged: tuple[Calibration, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Study] = []
    monkeypatch.setattr(refits, "calibrate", lambda study, **_: asked.append(study) or judged[0])
    monkeypatch.setattr(refits, "_add", lambda *_: None)
    refits_of(judged[0])
    searches = asked[1:]  # after the other seed
    for study, rail in zip(searches, (60e6, 80e6, 120e6), strict=True):
        fitted, held = ([p.initial_pressures()[0] for p in data.points] for data in study.data)
        assert [data.role for data in study.data] == [Role.FIT, Role.VALIDATION]
        assert rail not in fitted
        assert (len(fitted), held) == (4, [rail, rail])


def test_energising_times_are_left_out_in_turn(tmp_path: Path) -> None:
    study = load(tmp_path, judgement='[judgement]\nleave_out = ["energising_time"]\n')
    notes: list[str] = []
    (found,) = refits_of(calibrate(study, threads=1), threads=1, note=notes.append)["left_out"]
    assert (found["by"], found["searches"], found["values"]) == ("energising_time", 2, 6)
    assert notes == ["searching without 400 us ...", "searching without 700 us ..."]


def test_a_search_that_the_user_stops_ends_them(
    judged: tuple[Calibration, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(refits, "calibrate", _raising(KeyboardInterrupt()))
    record = refits_of(judged[0])
    assert record["interrupted"] is True
    assert (len(record["seeds"]), record["left_out"]) == (1, [])


def test_a_search_without_a_result_is_said(
    judged: tuple[Calibration, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(refits, "calibrate", _raising(SimulationError("nothing could be simulated")))
    record = refits_of(judged[0])
    assert record["seeds"][1] == {"seed": 2, "failed": True}
    assert record["left_out"] == []


def test_a_run_keeps_them_in_its_result(judged: tuple[Calibration, dict[str, Any]], tmp_path: Path) -> None:
    notes: list[str] = []
    calibrate_into(tmp_path / "run", load(tmp_path, judgement=JUDGED), threads=1, listener=Listener(note=notes.append))
    record = read_run(tmp_path / "run")[0]
    assert record["refits"] == judged[1]
    assert notes[-4:] == [
        "searching with seed 2 ...",
        "searching without 60 MPa ...",
        "searching without 80 MPa ...",
        "searching without 120 MPa ...",
    ]


def test_the_judgement_is_part_of_a_study_s_content(tmp_path: Path) -> None:
    contents = {hash_study(load(tmp_path, judgement=text)) for text in ("", JUDGED, "[judgement]\nseeds = 1\n")}
    assert len(contents) == 3


@pytest.mark.parametrize("text", ["seeds = -1", "seeds = 101", 'leave_out = ["fuel"]', "seeds = 1.5"])
def test_a_wrong_judgement_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match="judgement"):
        load(tmp_path, judgement=f"[judgement]\n{text}\n")


def test_values_are_left_out_once() -> None:
    assert Judgement(1, ("rail_pressure", "rail_pressure")).leave_out == (LeaveOut.RAIL_PRESSURE,)  # type: ignore[arg-type]


def _raising(error: BaseException) -> Any:
    def calibrate(*_: Any, **__: Any) -> Any:
        raise error

    return calibrate
