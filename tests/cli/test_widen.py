"""`calibrate --widen`: bounds that a run has met are moved, by a rule and within what a parameter can be."""

from __future__ import annotations

from pathlib import Path

import pytest

import commonrail as cr
from commonrail.calibration.record import CalibrationRecord, ParameterRecord, read_as
from commonrail.physics.injector import parameter_quantities
from commonrail.report.fit.verdict import verdict
from commonrail.runs.folder import read_result, write_record
from commonrail.runs.study_edits import can_widen, widen_bound, widen_study
from tests.cli.conftest import run_command
from tests.plugins.update.conftest import FREE, STUDY, TRUTH, write_map
from tests.report.samples import rate_record


def record(name: str, lower: float, upper: float, side: str) -> ParameterRecord:
    """Record of a parameter that has met a bound."""
    unit = parameter_quantities()[name].unit
    position = 0.999 if side == "upper" else 0.001
    return ParameterRecord(name, unit, lower=lower, upper=upper, position=position)


@pytest.mark.parametrize(
    ("given", "is_log", "after"),
    [
        (record("nozzle.hole_diameter", 100e-6, 130e-6, "upper"), False, 160e-6),
        (record("nozzle.hole_diameter", 100e-6, 130e-6, "lower"), False, 70e-6),
        (record("nozzle.hole_diameter", 100e-6, 130e-6, "upper"), True, 169e-6),
        (record("nozzle.discharge_maximum", 0.7, 0.9, "upper"), False, 1.0),  # a coefficient is at most 1
        (record("nozzle.discharge_maximum", 0.7, 1.0, "upper"), False, 1.0),
    ],
)
def test_a_bound_moves_by_the_range_within_the_domain(given: ParameterRecord, is_log: bool, after: float) -> None:
    moved = widen_bound(given, is_log)
    assert moved.after == pytest.approx(after)
    assert moved.side == ("upper" if given.position == 0.999 else "lower")


@pytest.mark.parametrize(
    ("name", "lower", "upper", "side", "can"),
    [
        ("nozzle.discharge_maximum", 0.7, 1.0, "upper", False),  # the end of the domain
        ("valve.mass", 0.1e-3, 9e-3, "lower", False),  # the end of what is built
        ("valve.mass", 0.2e-3, 9e-3, "lower", True),
    ],
)
def test_widening_is_advised_where_it_changes_something(
    name: str, lower: float, upper: float, side: str, can: bool
) -> None:
    assert can_widen(record(name, lower, upper, side)) is can


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_no_bound_leaves_domain_and_usual_range(side: str) -> None:
    for name, q in parameter_quantities().items():
        low, high = q.usual or (0.5, 0.9)
        half, middle = 0.4 * (high - low), 0.5 * (low + high)
        moved = widen_bound(record(name, middle - half, middle + half, side))
        assert q.domain.admits(moved.after)
        assert q.is_usual(moved.after)
        assert (moved.after - moved.before) * (1.0 if side == "upper" else -1.0) >= 0.0


def test_a_run_at_its_bound_is_widened_and_the_study_file_is_not(tmp_path: Path) -> None:
    study = tmp_path / "small.toml"
    narrow = STUDY.replace('below = "10 %"\nabove = "10 %"', 'lower = "215 um"\nupper = "240 um" # by the drawing')
    study.write_text(narrow, encoding="utf-8")
    write_map(tmp_path / "march.csv", (40, 160), (400, 700, 1000), 1)
    write_map(tmp_path / "check.csv", (60, 120), (500, 900), 2)
    first, second, third = (tmp_path / name for name in ("first", "second", "third"))
    cr.runs.calibrate_into(first, cr.load_study(study), threads=1)
    assert next(p["at_bound"] for p in read_result(first)["parameters"] if p["name"] == FREE)
    advised = [step.command for step in verdict(read_as(CalibrationRecord, read_result(first)), str(first)).steps]
    assert f"commonrail calibrate {study} --widen {first}" in advised
    assert not any(f"{first}/study.toml" in line for line in advised)  # of which her own file would not know
    before = study.read_bytes()
    done = run_command("calibrate", study, "--widen", first, "--out", second, "--no-live", "--threads", "1")
    assert done.status == 0, done.err
    assert "215 um -> 190 um" in done.err
    assert study.read_bytes() == before
    found = cr.load_study(second / "study.toml").space.parameters[0]
    assert (found.lower, found.upper) == pytest.approx((190e-6, 240e-6))
    own = {p["name"]: p for p in read_result(second)["parameters"]}[FREE]
    assert own["best"] == pytest.approx(TRUTH[FREE], rel=0.02)
    assert own["best"] < 215e-6
    assert run_command("resume", second, "--no-live", "--threads", "1").status == 0  # of the same study
    again = run_command("calibrate", study, "--widen", second, "--out", third)
    assert again.status == 2  # no bound was met there
    assert again.sentence
    assert not third.exists()


def test_a_run_of_another_study_is_refused(tmp_path: Path) -> None:
    study = tmp_path / "small.toml"
    study.write_text(STUDY, encoding="utf-8")
    done = run_command("calibrate", study, "--widen", tmp_path / "nothing", "--out", tmp_path / "new")
    assert done.status == 2
    assert done.sentence


def test_a_broken_record_cannot_widen(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    write_map(tmp_path / "march.csv", (40, 160), (400, 700, 1000), 1)
    write_map(tmp_path / "check.csv", (60, 120), (500, 900), 2)
    record = rate_record() | {"schema": 1, "kind": "calibration", "parameters": {"a": 1}}
    write_record(tmp_path / "result.json", record)
    with pytest.raises(cr.errors.InputError, match=r"result\.json: parameters: a list was expected.*make it again"):
        widen_study(tmp_path / "study.toml", tmp_path)
