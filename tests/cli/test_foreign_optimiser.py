"""An optimiser of another package that fails, or that is missing when its run is taken up again."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.cli.conftest import Command
from tests.distribution import distribution

PARTS = "[commonrail.optimisers]\nguess = example_guess:REGISTERED\n"
MODULE = """
from dataclasses import dataclass

from commonrail.calibration.optimisers.base import Optimiser, Registered, asked
from commonrail.calibration.space import sample_feasible


@dataclass(frozen=True)
class Guesses:
    members: int = 2
    generations: int = 3


class Guess(Optimiser):
    method, phase = "guess", "guesses"

    def _step(self):
        x = sample_feasible(self.space, 2, self._rng)
        self.population, self.costs = x, (yield asked(x[:, :MOST]))
        self._offer(self.population, self.costs)
        FAULT

    def _kept(self):
        return {}

    def _restore(self, state):
        pass


REGISTERED = Registered(Guess, Guesses)
"""


def module(fault: str = "pass", most: str = "None") -> dict[str, str]:
    """Source of an optimiser with a statement at the end of its step, and a largest number of parameters."""
    return {"example_guess": MODULE.replace("FAULT", fault).replace("MOST", most)}


@pytest.fixture
def guessed(study: Path) -> Path:
    """Study that names the optimiser."""
    text = study.read_text(encoding="utf-8")
    head = text.partition("[optimiser]")[0]
    study.write_text(f'{head}[optimiser]\nmethod = "guess"\n', encoding="utf-8")
    return study


@pytest.mark.parametrize("fault", [('{}["step"]',), ("self.best = None",), ("pass", "1")])
def test_an_optimiser_that_fails_is_named_with_its_package(
    command: Command, guessed: Path, tmp_path: Path, fault: tuple[str, ...]
) -> None:
    (tmp_path / "site").mkdir()
    with distribution(tmp_path / "site", module(*fault), PARTS):
        done = command("calibrate", guessed, "--out", tmp_path / "run", "--threads", "1")
    assert done.status == 2
    assert 'example-plugin 1.2: "guess" of commonrail.optimisers fails (' in done.sentence
    assert "internal fault" not in done.err


def test_a_run_whose_optimiser_is_not_installed_says_what_it_needs(
    command: Command, guessed: Path, tmp_path: Path
) -> None:
    (tmp_path / "site").mkdir()
    run = tmp_path / "run"
    with distribution(tmp_path / "site", module(), PARTS):
        assert command("calibrate", guessed, "--out", run, "--threads", "1").status == 0
    done = command("resume", run)
    assert done.status == 2
    assert re.search(r'not "guess"; .*package', done.sentence)
