"""Kinds of study and of file of other packages, which the verbs of the core hand on to them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from commonrail.runs.journal import JOURNAL
from tests.cli.conftest import Command
from tests.distribution import distribution

PLUGIN = """
from commonrail.cli.study_kind import StudyKind


def calibrate(study, out, options):
    print("calibrates", study.name, out.name, options.seed, options.threads)


def resume(run, options):
    print("resumes", run.name, options.generations)


def facts(file):
    return {"taken for": "spray images", "images": "3"}


STUDY = StudyKind(resume, calibrate)
"""


@pytest.fixture(autouse=True)
def plugin(tmp_path: Path) -> Iterator[None]:
    (tmp_path / "path").mkdir()
    parts = "[commonrail.studies]\nspray = example_spray:STUDY\n[commonrail.inspectors]\ncine = example_spray:facts\n"
    with distribution(tmp_path / "path", {"example_spray": PLUGIN}, parts):
        yield


def test_calibrate_goes_by_the_format_of_the_study(command: Command, tmp_path: Path) -> None:
    (tmp_path / "nozzle.toml").write_text('format = "commonrail-spray/1"\n', encoding="utf-8")
    done = command("calibrate", tmp_path / "nozzle.toml", "--out", tmp_path / "run", "--seed", 5, "--threads", 2)
    assert (done.status, done.out) == (0, "calibrates nozzle.toml run 5 2\n")


def test_resume_goes_by_the_study_in_the_run_folder(command: Command, tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    for name in (JOURNAL, "spray.toml"):
        (run / name).touch()
    done = command("resume", run, "--generations", 3)
    assert (done.status, done.out) == (0, "resumes run 3\n")


def test_inspect_goes_by_the_ending_of_the_file(command: Command, tmp_path: Path) -> None:
    (tmp_path / "burst.CINE").touch()
    done = command("inspect", tmp_path / "burst.CINE")
    assert done.status == 0
    assert "spray images" in done.out
