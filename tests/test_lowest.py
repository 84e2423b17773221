"""The lowest versions that pyproject.toml admits, as `make test-lowest` installs them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from packaging.version import Version

from tools.lowest import PYPROJECT, lowest

ROOT = Path(__file__).resolve().parents[1]

PROJECT = """
[project]
dependencies = ["numpy>=2.0", "PyArrow>=17"]
[project.optional-dependencies]
cuda = ["numba-cuda[cu12]>=0.30"]
fleet = ["pyarrow>=17"]
"""


def test_every_requirement_has_its_lower_bound() -> None:
    assert lowest(PROJECT) == {"numpy": "2.0", "pyarrow": "17", "numba-cuda": "0.30"}


def test_the_tool_prints_constraints_that_the_tested_versions_meet() -> None:
    command = [sys.executable, str(ROOT / "tools" / "lowest.py")]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    bounds = dict(line.split("==") for line in printed)
    assert bounds == lowest(PYPROJECT.read_text(encoding="utf-8"))
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    tested = {name.lower(): version for name, _, version in (pin.partition("==") for pin in pins) if version}
    assert {name for name, bound in bounds.items() if Version(bound) > Version(tested[name])} == set()
