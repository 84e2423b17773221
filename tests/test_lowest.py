"""The lowest versions that pyproject.toml admits, as `make test-lowest` installs them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
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


@pytest.mark.parametrize("requirement", ["numpy", "numpy==2.0", "numpy>=2.0,<3", "numpy>=2.0; python_version > '3'"])
def test_another_form_of_requirement_is_refused(requirement: str) -> None:
    with pytest.raises(ValueError, match="has to be"):
        lowest(PROJECT.replace("numpy>=2.0", requirement))


def test_two_bounds_of_one_package_are_refused() -> None:
    with pytest.raises(ValueError, match="pyarrow is required from 17 and from 18"):
        lowest(PROJECT.replace("pyarrow>=17", "pyarrow>=18"))


def test_the_tool_prints_constraints_that_the_tested_versions_meet() -> None:
    command = [sys.executable, str(ROOT / "tools" / "lowest.py")]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    bounds = dict(line.split("==") for line in printed)
    assert bounds == lowest(PYPROJECT.read_text(encoding="utf-8"))
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    tested = {name.lower(): version for name, _, version in (pin.partition("==") for pin in pins) if version}
    assert {name for name, bound in bounds.items() if Version(bound) > Version(tested[name])} == set()
