"""The public names of the package: lazy, complete, and the same to a type checker."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import commonrail

HEAVY = ["jinja2", "numba", "numpy", "plotly", "pydantic", "rich", "scipy", "tomlkit", "typer"]


@pytest.mark.parametrize("name", commonrail.__all__)
def test_every_public_name_can_be_had(name: str) -> None:
    assert getattr(commonrail, name) is not None
    assert name in dir(commonrail)


def test_a_type_checker_sees_the_names_that_are_loaded() -> None:
    tree = ast.parse(Path(commonrail.__file__).read_text(encoding="utf-8"))
    checked = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("commonrail.")
        for alias in node.names
    }
    assert checked == commonrail._MODULES
    assert {*checked, "__version__"} == set(commonrail.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        commonrail.simulat  # noqa: B018


def test_importing_the_package_loads_nothing_of_its_own_either() -> None:
    code = "import sys, commonrail;"
    code += f"print(*(m for m in sys.modules if m in {HEAVY} or m.startswith('commonrail.')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
