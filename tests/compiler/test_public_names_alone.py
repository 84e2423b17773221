"""Numba and llvmlite are used by public names: private ones change from one release to the next."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "src" / "commonrail"
NOT_PUBLIC = tuple(
    f"numba.core.{name}"
    for name in ("codegen", "registry", "caching", "cpu", "target_extension", "runtime", "dispatcher", "serialize")
)
OF_NAMED_TUPLES = {"_replace", "_fields", "_asdict", "_make"}


def faults(source: str) -> Iterator[str]:
    """Names that are not public in a file that uses Numba or llvmlite."""
    tree = ast.parse(source)
    of_compiler = False
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        found = [name for name in names if name.split(".")[0] in ("numba", "llvmlite")]
        of_compiler = of_compiler or bool(found)
        yield from (name for name in found if name.startswith(NOT_PUBLIC) or "._" in name)
    if of_compiler:
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and node.attr.startswith("_") and node.attr not in OF_NAMED_TUPLES:
                whose = node.value.id if isinstance(node.value, ast.Name) else ""
                if whose not in ("self", "cls", "os") and not node.attr.endswith("__"):
                    yield node.attr


@pytest.mark.parametrize(
    "source",
    [
        "from numba.core.codegen import JITCodeLibrary",
        "import numba.core.registry",
        "from numba.core import cpu",
        "import llvmlite.binding as llvm\nllvm._x()",
        "def f():\n    import numba\n    return numba.njit(f)._cache",
    ],
)
def test_a_private_name_is_seen(source: str) -> None:
    assert list(faults(source))


def test_none_is_used() -> None:
    found = {path.name: list(faults(path.read_text(encoding="utf-8"))) for path in sorted(PACKAGE.rglob("*.py"))}
    assert {name: names for name, names in found.items() if names} == {}
