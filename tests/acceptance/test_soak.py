"""A study survives SIGKILL at random instants; ``make soak`` does it two hundred times, with the whole study."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.acceptance.test_plausibility import spoilt

ROOT = Path(__file__).resolve().parents[2]
KILLS = 1


@pytest.mark.process
def test_a_short_form_of_the_paper_s_study_survives_being_killed(tmp_path: Path) -> None:
    study = spoilt(tmp_path / "case")
    command = [sys.executable, str(ROOT / "tests" / "robustness" / "soak.py"), str(KILLS), "--jobs", "1"]
    # where the first run compiles, instants are drawn from too long a time, and rounds go on until one was a kill
    command += ["--study", str(study), "--compiled"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    last = done.stdout.splitlines()[-1].split()
    assert int(last[1]) >= KILLS
    assert last[3] == last[5] != "0"  # so many of so many runs
