"""The promises of docs/reliability.md hold under the short form of the attacks; ``make attack`` runs the long one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.process
def test_the_promises_hold_under_attack() -> None:
    command = [sys.executable, "-m", "tools.attack", "--short"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    held, _, tried, _ = done.stdout.splitlines()[-1].split()
    assert held == tried != "0"
