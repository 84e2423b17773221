"""The public names of the package: lazy, complete, and the same to a type checker."""

from __future__ import annotations

import ast
import builtins
import operator
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import commonrail
from commonrail.base import registry
from commonrail.base.public import find_stub, places, read_stub
from tests.every import check_every

HEAVY = ["click", "jinja2", "numba", "numpy", "matplotlib", "pydantic", "rich", "scipy", "tomlkit"]


PLACES = places()
NAMESPACES = [name for name, home in read_stub(find_stub("")).items() if home == "."]


def test_every_public_name_can_be_had() -> None:
    def check(of_place: tuple[str, str]) -> None:
        name, module = of_place[0], import_module(of_place[1])
        assert getattr(module, name) is not None
        assert name in dir(module)

    check_every(PLACES.items(), check)


def test_a_name_has_one_place_and_is_no_builtin() -> None:
    names = [name for space in ["", *NAMESPACES] for name in read_stub(find_stub(space))]
    assert sorted(names) == sorted(set(names))
    assert set(names) & set(dir(builtins)) == set()


def test_a_stub_states_every_name_of_its_module() -> None:
    """A line that the pattern does not read would be a name for the type checker alone."""
    for space in ["", *NAMESPACES]:
        tree = ast.parse(find_stub(space).read_text(encoding="utf-8"))
        names = {a.asname for node in tree.body if isinstance(node, ast.ImportFrom) for a in node.names}
        assert names == set(read_stub(find_stub(space)))


VERBS = [verb for verb in registry.entries("verbs") if verb != "lab"]  # which is the group of its verbs


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_its_function(verb: str) -> None:
    page = (PACKAGE.parents[1] / "docs" / "howto" / "python.md").read_text(encoding="utf-8")
    (path,) = re.findall(rf"^\| `{verb}` \| `cr\.([\w.]+)`", page, re.M)
    assert callable(operator.attrgetter(path)(commonrail))
    word, name = verb.removeprefix("lab ").replace("-", "_"), path.rpartition(".")[2]
    taken = hasattr(builtins, word) or word in NAMESPACES or (PACKAGE / word).is_dir()
    assert word in name.split("_") if taken else word == name


PACKAGE = Path(commonrail.__file__).parent
HOMES = {
    name: home.removeprefix("commonrail.") for s in ["", *NAMESPACES] for name, home in read_stub(find_stub(s)).items()
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
        owners = ["cr", *(f"cr.{space}" for space in NAMESPACES)]
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) in owners and node.attr not in NAMESPACES:
            # public names are loaded when they are used, which the contracts of imports do not see
            assert HOMES[node.attr].split(".")[:2] not in OTHER_PLUGINS, node.attr


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match=r'no simulat .*"simulate"'):
        commonrail.simulat  # noqa: B018


@pytest.mark.parametrize(
    ("module", "name", "place"),
    [
        ("commonrail", "map", "commonrail.maps.quantity_map"),
        ("commonrail", "adapt", "commonrail.parts.adapt"),
        ("commonrail", "Trim", "commonrail.parts.SeriesTrim"),
        ("commonrail.maps", "simulate", "commonrail.simulate"),
    ],
)
def test_a_name_of_another_place_is_an_attribute_error_that_says_where(module: str, name: str, place: str) -> None:
    with pytest.raises(AttributeError, match=rf"no {name}; .*{place}\."):
        getattr(import_module(module), name)


def test_importing_the_package_loads_nothing_of_its_own_either() -> None:
    code = "import sys, commonrail;"
    code += f"print(*(m for m in sys.modules if m in {HEAVY} or m.startswith('commonrail.')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {"commonrail.base", "commonrail.base.public"}
