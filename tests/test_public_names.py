"""The public names of the package: lazy, complete, and the same to a type checker."""

from __future__ import annotations

import ast
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


ROOT = Path(commonrail.__file__).parent
SHOWCASE = sorted(path for pattern in ("plugins/paper/*.py", "report/draw/print.py") for path in ROOT.glob(pattern))
# Rooms whose public names the reproduction may use, and what its report may use besides: tables, charts, units.
BELOW = {"analysis", "calibration", "choices", "engine", "errors", "fuel", "injector", "kinds", "observation"}
SHOWN = {"report": ("commonrail.base.", "commonrail.data.records.")}


@pytest.mark.parametrize("path", SHOWCASE, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_the_reproduction_is_made_of_public_names(path: Path) -> None:
    rooms = (f"commonrail.{path.parent.name}.", "commonrail.base.arrays.", *SHOWN.get(path.parent.name, ()))
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        named: list[str] = []
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0
            named = [node.module or ""]
            if node.module == "commonrail":
                assert {alias.name for alias in node.names} <= set(commonrail.__all__), path.name
        elif isinstance(node, ast.Import):
            named = [alias.name for alias in node.names]
        for module in named:
            if module.split(".")[0] == "commonrail":
                assert module == "commonrail" or (module + ".").startswith(rooms), (path.name, module)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "cr":
            assert node.attr in commonrail.__all__, (path.name, node.attr)
            home = commonrail._MODULES[node.attr].split(".")[1]
            assert home in BELOW, (path.name, node.attr)


def test_every_public_name_is_on_the_page() -> None:
    page = (Path(__file__).parents[1] / "docs" / "howto" / "python.md").read_text(encoding="utf-8")
    table = page.partition("## All names")[2]
    assert set(re.findall(r"`(\w+)`", table)) >= set(commonrail.__all__) - {"__version__"}


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        commonrail.simulat  # noqa: B018


def test_importing_the_package_loads_nothing_of_its_own_either() -> None:
    code = "import sys, commonrail;"
    code += f"print(*(m for m in sys.modules if m in {HEAVY} or m.startswith('commonrail.')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
