"""The direction of imports holds, its contracts can fail, and importing the package is cheap."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from grimp import build_graph

from tools.structure import circles

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "commonrail"
HEAVY = ["numba", "pint", "matplotlib", "pydantic", "scipy"]


def lint_imports(source: Path) -> subprocess.CompletedProcess[str]:
    """Check the contracts of this project on the package below `source`."""
    code = "import sys; from importlinter.cli import lint_imports as lint;"
    code += "sys.exit(lint(sys.argv[1], no_cache=True))"
    return subprocess.run(
        [sys.executable, "-c", code, str(ROOT / "pyproject.toml")],
        cwd=source,
        env=os.environ | {"PYTHONPATH": str(source), "PYTHONUTF8": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


def test_contracts_hold() -> None:
    done = lint_imports(SOURCE.parent)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_modules_import_one_another() -> None:
    assert circles(build_graph("commonrail", include_external_packages=False)) == []


# Each line breaks one contract: package, what is imported, and the contract that must object.
OFFENDERS = [
    ("physics", "import commonrail.engine", "Packages import downwards only"),
    ("data", "import commonrail.calibration", "Packages import downwards only"),
    ("report", "import commonrail.plugins.maps", "Packages import downwards only"),
    ("plugins.tolerance", "import commonrail.plugins.fleet", "Plug-ins import one another only where listed"),
    ("physics", "import pydantic", "Physics knows no files"),
    ("physics", "def f():\n    import pint", "Only units imports pint"),
    ("engine", "import matplotlib.pyplot", "Only what draws into axes loads matplotlib"),
]


@pytest.fixture(scope="module")
def objected(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Output of the linter about a package with all of them."""
    folder = tmp_path_factory.mktemp("offended")
    copy = folder / "commonrail"
    shutil.copytree(SOURCE, copy, ignore=shutil.ignore_patterns("__pycache__", "*.html"))
    for number, (package, line, _) in enumerate(OFFENDERS):
        copy.joinpath(*package.split("."), f"offender_{number}.py").write_text(line + "\n", encoding="utf-8")
    done = lint_imports(folder)
    assert done.returncode != 0
    return done.stdout + done.stderr


@pytest.mark.parametrize("number", range(len(OFFENDERS)))
def test_contracts_object(objected: str, number: int) -> None:
    package, _, contract = OFFENDERS[number]
    # a contract that is broken has a heading, which is underlined, and its faults up to the next one
    faults = re.search(rf"^{contract}[^\n]*\n-+\n(.*?)(?=^[^\n]+\n-{{9,}}$|\Z)", objected, re.MULTILINE | re.DOTALL)
    assert faults, objected
    assert f"commonrail.{package}.offender_{number} ->" in faults[1], objected


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = f"import sys, commonrail; print(*(name for name in {HEAVY} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_version_is_the_one_in_pyproject() -> None:
    import commonrail

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert commonrail.__version__ == project["version"]


# Modules that take long to import and serve few functions: these import them, no module does at its top.
LAZY = ("asammdf", "distributed", "h5py", "matplotlib", "nptdms", "openpyxl", "pandas", "pyarrow", "rich")
LAZY += ("scipy.stats", "tomlkit", "xarray")
# Plates are drawn by Matplotlib, and each reader of a child process exists for one library: whoever asks for these
# modules needs them.
AT_THE_TOP = {
    "engine/reference.py": {"scipy"},
    "plugins/formats/mat_child.py": {"scipy"},
    "plugins/formats/mdf_child.py": {"asammdf"},
    "plugins/formats/parquet_child.py": {"pyarrow"},
    "plugins/formats/tdms_child.py": {"nptdms"},
    "readers/xlsx_child.py": {"openpyxl"},
    "plugins/certainty/draws_plot.py": {"matplotlib"},
    "plugins/paper/plates.py": {"matplotlib"},
    "report/plot.py": {"matplotlib"},
}


def at_the_top(source: str) -> set[str]:
    """Lazy modules that a module imports as soon as it is imported itself, but not for a type checker alone."""
    found: set[str] = set()
    waiting: list[ast.AST] = [ast.parse(source)]
    while waiting:
        node = waiting.pop()
        named: list[str] = []
        if isinstance(node, ast.Import):
            named = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            named = [node.module or ""]
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        found |= {lazy for name in named for lazy in LAZY if f"{name}.".startswith(f"{lazy}.")}
        checked = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        waiting += node.orelse if checked and isinstance(node, ast.If) else ast.iter_child_nodes(node)
    return found


def test_what_is_slow_to_import_is_imported_where_it_is_used() -> None:
    files = {path.relative_to(SOURCE).as_posix(): at_the_top(path.read_text("utf-8")) for path in SOURCE.rglob("*.py")}
    surplus = {file: sorted(found - AT_THE_TOP.get(file, set())) for file, found in files.items()}
    assert {file: names for file, names in surplus.items() if names} == {}


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("from pandas.api import types", {"pandas"}),
        ("import tomlkit.items as items", {"tomlkit"}),
        ("if True:\n    try:\n        import rich\n    except ImportError:\n        pass", {"rich"}),
        ("class A:\n    import pandas", {"pandas"}),
        ("def f():\n    import pandas", set()),
        ("if TYPE_CHECKING:\n    import pandas\nelse:\n    import rich", {"rich"}),
        ("import richfoo", set()),
    ],
)
def test_the_search_for_imports_finds_them(source: str, found: set[str]) -> None:
    assert at_the_top(source) == found


# What a module of this package asks for itself; Numba asks for SciPy's linear algebra on its own account.
WATCH = """
import sys
class Watch:
    def find_spec(self, name, path=None, target=None):
        frame = sys._getframe(1)
        while "importlib" in frame.f_code.co_filename:
            frame = frame.f_back
        if name.split(".")[0] in {lazy} and "commonrail" in frame.f_globals.get("__name__", ""):
            print("LOADED", name, frame.f_globals["__name__"])
sys.meta_path.insert(0, Watch())
"""


def loaded(code: str, lazy: tuple[str, ...] = LAZY) -> list[str]:
    """Lines about slow modules that this package loads while a new process runs some code."""
    done = subprocess.run(
        [sys.executable, "-c", f"{WATCH.replace('{lazy}', repr(set(lazy)))}\n{code}"],
        capture_output=True,
        text=True,
        check=True,
    )
    return [line for line in done.stdout.splitlines() if line.startswith("LOADED")]


def test_the_watch_sees_what_is_loaded() -> None:
    assert loaded("import commonrail.plugins.paper.plates")


@pytest.mark.parametrize(
    "modules",
    [
        "commonrail.engine.simulate, commonrail.engine.solution, commonrail.cli.verbs.simulate",
        "commonrail.plugins.maps.run, commonrail.plugins.maps.verb",
    ],
)
def test_simulations_and_maps_load_nothing_slow(modules: str) -> None:
    assert loaded(f"import {modules}", (*LAZY, "numba", "scipy")) == []


def test_a_verb_is_imported_when_it_is_called() -> None:
    code = "import sys; from commonrail.cli.grammar import cli; cli(['simulate', '--help'], standalone_mode=False);"
    code += "names = 'cli.verbs.simulate', 'cli.verbs.calibrate', 'plugins.maps.verb';"
    code += "print('verbs:', *(n for n in names if f'commonrail.{n}' in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "verbs: cli.verbs.simulate"
