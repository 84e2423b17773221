"""An optimiser that the search was not written for: named in a study, kept, gone on with, lengthened, reported."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from commonrail.base.errors import ConfigurationError, InputError, StudyError
from commonrail.calibration.optimisers import registry
from commonrail.calibration.study_file import load_study
from commonrail.report.page import write_report
from commonrail.runs.fit import calibrate_into, resume
from commonrail.runs.listing import list_runs
from tests.calibration.guessing import GUESSING, GuessingSettings
from tests.runs.conftest import REFINEMENTS, stopped_run, timeless

STEPS = 3


@pytest.fixture
def guessed(study_file: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The study, which names the optimiser."""
    monkeypatch.setattr(registry, "REGISTERED", (*registry.REGISTERED, GUESSING))
    return _rewritten(study_file, "study.toml", STEPS)


def _rewritten(study: Path, name: str, generations: int) -> Path:
    head, _, _ = study.read_text(encoding="utf-8").partition("[optimiser]")
    settings = f'method = "guessing"\ngenerations = {generations}\nmiddle = 0.25\npolish = {REFINEMENTS}'
    path = study.with_name(name)
    path.write_text(f"{head}[optimiser]\n{settings}\npolish_iterations = 2\n", encoding="utf-8")
    return path


def test_its_settings_are_read_and_reported(guessed: Path, tmp_path: Path) -> None:
    study = load_study(guessed)
    assert study.method.evolution == GuessingSettings(generations=STEPS, middle=0.25)
    calibrate_into(tmp_path / "run", study, threads=1)
    result = json.loads((tmp_path / "run" / "result.json").read_text(encoding="utf-8"))
    own = {"method": "guessing", "members": 6, "generations": STEPS, "middle": 0.25}
    more = {"polish": REFINEMENTS, "polish_iterations": 2, "stop_when_converged": False}
    assert result["optimiser"] == own | more
    assert len(result["generations"]) == 1 + STEPS
    assert result["reason"] == "all guesses are made"
    page = write_report(tmp_path / "run").read_text(encoding="utf-8")
    assert f"guessing, {STEPS} generations of 6 members; {REFINEMENTS} least-squares refinements" in page
    (found,) = list_runs(tmp_path / "run")
    assert (found.generation, found.generations, found.refinements) == (1 + STEPS, 1 + STEPS, REFINEMENTS)


@pytest.mark.parametrize("steps", [2, STEPS + 2])
def test_killed_resumed_and_lengthened_it_ends_in_the_same_bytes(guessed: Path, tmp_path: Path, steps: int) -> None:
    study = load_study(guessed)
    calibrate_into(tmp_path / "whole", study, threads=1)
    run = stopped_run(tmp_path / "run", study, steps)
    resume(run, threads=2)
    assert timeless(run) == timeless(tmp_path / "whole")
    calibrate_into(tmp_path / "longer", load_study(_rewritten(guessed, "longer.toml", STEPS + 2)), threads=1)
    resume(run, generations=2, threads=1)
    assert timeless(run) == timeless(tmp_path / "longer")


def test_a_run_does_not_change_its_optimiser(guessed: Path, tmp_path: Path) -> None:
    run = stopped_run(tmp_path / "run", load_study(guessed), 2)
    copy = run / "study.toml"
    copy.write_text(copy.read_text(encoding="utf-8").replace('method = "guessing"\n', ""), encoding="utf-8")
    with pytest.raises(StudyError, match="method"):
        resume(run)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            'method = "gessing"',
            r'optimiser\.method: .*"differential evolution" .*"guessing".*"gessing"',
        ),
        ("crossover = 0.8", r'optimiser: .*"crossover" \(.*members, generations, middle'),
        ("members = 1.5", r"optimiser\.members: .*whole number.* 1\.5"),
    ],
)
def test_what_it_does_not_know_is_refused(guessed: Path, line: str, said: str) -> None:
    text = guessed.read_text(encoding="utf-8")
    text = text.replace('method = "guessing"', line) if "method" in line else f"{text}{line}\n"
    guessed.write_text(text, encoding="utf-8")
    with pytest.raises((InputError, ConfigurationError), match=said):
        load_study(guessed)
