"""The public names of the package: lazy, complete, and the same to a type checker."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import commonrail

HEAVY = ["click", "jinja2", "numba", "numpy", "matplotlib", "pydantic", "rich", "scipy", "tomlkit"]


@pytest.mark.parametrize("name", commonrail.__all__)
def test_every_public_name_can_be_had(name: str) -> None:
    assert getattr(commonrail, name) is not None
    assert name in dir(commonrail)


def test_every_public_name_is_on_the_page() -> None:
    page = (Path(__file__).parents[1] / "docs" / "howto" / "python.md").read_text(encoding="utf-8")
    table = page.partition("## All names")[2]
    assert set(re.findall(r"`(\w+)`", table)) >= set(commonrail.__all__) - {"__version__"}


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="simulat"):
        commonrail.simulat  # noqa: B018


def test_importing_the_package_loads_nothing_of_its_own_either() -> None:
    code = "import sys, commonrail;"
    code += f"print(*(m for m in sys.modules if m in {HEAVY} or m.startswith('commonrail.')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
