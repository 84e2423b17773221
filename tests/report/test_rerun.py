"""The command lines in the report."""

from __future__ import annotations

from commonrail.report.fit.record import rerun_lines
from tests.report.samples import fit_of, map_record, rate_record


def test_the_run_s_own_study_and_an_operating_point_of_the_data_are_in_the_lines() -> None:
    commands = [command for _, command in rerun_lines(fit_of(rate_record()), "run-1")]
    assert commands[:2] == ["commonrail calibrate run-1/study.toml", "commonrail resume run-1 --generations 50"]
    simulate = "commonrail simulate run-1/calibrated.toml"
    assert f"{simulate} --rail-pressure 160MPa --energising-time 700us --time-step 1us" in commands


def test_a_map_gives_its_last_quantity_not_a_dead_time() -> None:
    commands = [command for _, command in rerun_lines(fit_of(map_record()), "r")]
    assert any("--rail-pressure 160MPa --energising-time 1.4ms" in command for command in commands)


def test_a_folder_with_a_space_is_quoted() -> None:
    assert ("Make this report again", "commonrail report 'my run'") in rerun_lines(fit_of(rate_record()), "my run")
