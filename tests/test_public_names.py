"""The public names of the package: lazy, complete, and the same to a type checker."""

from __future__ import annotations

import ast
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


PACKAGE = Path(commonrail.__file__).parent
STUB = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))
HOMES = {
    alias.name: node.module or "" for node in STUB.body if isinstance(node, ast.ImportFrom) for alias in node.names
}
OTHER_PLUGINS = [
    ["plugins", path.name]
    for path in (PACKAGE / "plugins").iterdir()
    if path.name not in ("paper", "certainty")  # whose intervals the reproduction compares with the truth
]
# What the reproduction may import besides public names: its own package, texts of numbers, and for its figures charts.
REPRODUCTION = {
    "study.py": ("plugins.paper.", "base.arrays."),
    "run.py": ("plugins.paper.", "base.arrays."),
    "claims.py": ("plugins.paper.", "base.arrays.", "base.text."),
    "figures.py": ("plugins.paper.", "base.", "data.records."),
}


@pytest.mark.parametrize("file", REPRODUCTION)
def test_the_reproduction_is_made_of_public_names(file: str) -> None:
    allowed = tuple(f"commonrail.{home}" for home in REPRODUCTION[file])
    for node in ast.walk(ast.parse((PACKAGE / "plugins" / "paper" / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("commonrail"):
            names = [f"{node.module}.{alias.name}." for alias in node.names]
            assert all(f"{node.module}.".startswith(allowed) or n.startswith(allowed) for n in names), names
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "cr":
            assert node.attr in commonrail.__all__, node.attr
            # public names are loaded when they are used, which the contracts of imports do not see
            assert HOMES[node.attr].split(".")[:2] not in OTHER_PLUGINS, node.attr


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match=r'no simulat \(did you mean "simulate"\?\)'):
        commonrail.simulat  # noqa: B018


def test_importing_the_package_loads_nothing_of_its_own_either() -> None:
    code = "import sys, commonrail;"
    code += f"print(*(m for m in sys.modules if m in {HEAVY} or m.startswith('commonrail.')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
