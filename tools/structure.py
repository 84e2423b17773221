"""Size and structure of the package in one table: ``python -m tools.structure``, in a clone with its environment.

Packages are the folders directly below ``src/commonrail``; those of ``plugins`` count one by one. What two commands
load is asked of the commands themselves, in processes of their own.
"""

from __future__ import annotations

import ast
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import grimp
from scipy.sparse import lil_array
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "commonrail"
METHODS = 12  # a class with more is counted: beyond it a reader no longer sees the class at once
LOADED = """
import sys
from commonrail.cli.start import main
try:
    main()
except SystemExit:
    pass
print(sum(name.split(".")[0] == "commonrail" for name in sys.modules), file=sys.stderr)
"""


def main() -> None:
    """Print the table."""
    graph = grimp.build_graph(PACKAGE, include_external_packages=False)
    files = {path: path.read_text(encoding="utf-8") for path in sorted((ROOT / "src" / PACKAGE).rglob("*.py"))}
    plugins = {path for path in files if "plugins" in path.parts}
    tests = [path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py")]
    importers = Counter(len(graph.find_modules_that_directly_import(module)) for module in graph.modules)
    for name, value in (
        ("files, lines: package", _size(files.values())),
        ("files, lines: core", _size(text for path, text in files.items() if path not in plugins)),
        ("files, lines: plug-ins", _size(text for path, text in files.items() if path in plugins)),
        ("files, lines: tests", _size(tests)),
        ("imports between modules", graph.count_imports()),
        ("imports across packages", len(list(_across(graph)))),
        ("imports of plug-ins by the core", sum(_is_plugin(b) > _is_plugin(a) for a, b in _across(graph))),
        ("circles (groups of modules that import one another)", len(circles(graph))),
        ("modules with one importer", importers[1]),
        (f"classes with more than {METHODS} methods", sum(_large_classes(text) for text in files.values())),
        ("public names of the package", len(_public_names())),
        ("modules loaded by simulate", _loaded("simulate", "virtual-lino-2016", "--rail-pressure", "160MPa",
                                               "--energising-time", "700us")),
        ("modules loaded by calibrate", _loaded("calibrate", "cases/paper/study.toml")),
    ):  # fmt: skip
        print(f"{name:55}{value}")


def _size(texts: Iterable[str]) -> str:
    lines = [text.count("\n") for text in texts]
    return f"{len(lines)}, {sum(lines)}"


def _package_of(module: str) -> str:
    parts = module.split(".")
    return ".".join(parts[: 3 if parts[1:2] == ["plugins"] else 2])


def _is_plugin(module: str) -> bool:
    return module.startswith(f"{PACKAGE}.plugins.")


def _across(graph: grimp.ImportGraph) -> Iterator[tuple[str, str]]:
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            if module != PACKAGE and _package_of(module) != _package_of(other):
                yield module, other


def circles(graph: grimp.ImportGraph) -> list[list[str]]:
    """Groups of modules that import one another, also for types alone; the lazy names of the package do not count."""
    modules = sorted(graph.modules - {PACKAGE})
    index = {module: i for i, module in enumerate(modules)}
    matrix = lil_array((len(modules), len(modules)), dtype=bool)
    for module in modules:
        for other in graph.find_modules_directly_imported_by(module) - {PACKAGE}:
            matrix[index[module], index[other]] = True
    _, labels = connected_components(matrix.tocsr(), directed=True, connection="strong")
    groups = defaultdict(list)
    for module, label in zip(modules, labels.tolist(), strict=True):
        groups[label].append(module)
    return [group for group in groups.values() if len(group) > 1]


def _large_classes(text: str) -> int:
    classes = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ClassDef))
    return sum(sum(isinstance(member, ast.FunctionDef) for member in each.body) > METHODS for each in classes)


def _public_names() -> list[str]:
    from commonrail.base.public import places

    return [*places()]


def _loaded(*command: str) -> int:
    with tempfile.TemporaryDirectory() as folder:
        out = ["--out", folder + "/run"] if command[0] == "calibrate" else []
        call = [sys.executable, "-c", LOADED, *command, *out]
        done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, check=True)
    return int(done.stderr.split()[-1])


if __name__ == "__main__":
    main()
