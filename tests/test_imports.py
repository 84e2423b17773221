"""The direction of imports holds, its contracts can fail, and importing the package is cheap."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

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


# Each line breaks one contract: room, what is imported, and the contract that must object.
@pytest.mark.parametrize(
    ("room", "line", "contract"),
    [
        ("flow", "import commonrail.injector", "Rooms import downwards only"),
        ("parts", "import commonrail.engine", "Rooms import downwards only"),
        ("fuel", "import commonrail.flow", "Rooms import downwards only"),
        ("injector", "import pydantic", "Physics knows no files"),
        ("parts", "def f():\n    import pint", "Only units imports pint"),
        ("engine", "import matplotlib.pyplot", "Only report draws"),
    ],
)
def test_contracts_object(tmp_path: Path, room: str, line: str, contract: str) -> None:
    copy = tmp_path / "commonrail"
    shutil.copytree(SOURCE, copy, ignore=shutil.ignore_patterns("__pycache__", "*.html"))
    (copy / room / "offender.py").write_text(line + "\n", encoding="utf-8")
    done = lint_imports(tmp_path)
    verdicts = [text for text in done.stdout.splitlines() if text.startswith(contract)]
    assert done.returncode != 0
    assert any("BROKEN" in verdict for verdict in verdicts), done.stdout + done.stderr


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = f"import sys, commonrail; print(*(name for name in {HEAVY} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_version_is_the_one_in_pyproject() -> None:
    import commonrail

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert commonrail.__version__ == project["version"]
