"""The core works without any plug-in, and without each of them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from grimp import build_graph

ROOT = Path(__file__).resolve().parents[2]
PLUGINS = "commonrail.plugins"
NAMES = sorted(path.stem for path in (ROOT / "src/commonrail/plugins").iterdir() if not path.name.startswith("_"))


def staying_without(name: str) -> list[str]:
    """Plug-ins that are there without one: neither it nor those that import it, in any number of steps."""
    graph = build_graph("commonrail", include_external_packages=False)
    package = f"{PLUGINS}.{name}"
    inside = {package, *graph.find_descendants(package)}
    users = {user for module in inside for user in graph.find_downstream_modules(module)}
    leaving = {name} | {user.split(".")[2] for user in users if user.startswith(f"{PLUGINS}.")}
    return [one for one in NAMES if one not in leaving]


def run_commands(folder: Path, staying: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.without_plugins", str(folder), *staying],
        cwd=ROOT,
        env=os.environ | {"PYTHONUTF8": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for name in ("simulation.html", "simulation.csv", "run/result.json", "run/report.html"):
        assert (folder / name).stat().st_size > 0


def test_core_without_any_plugin(tmp_path: Path) -> None:
    run_commands(tmp_path, [])


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_core_without_each_plugin(tmp_path: Path, name: str) -> None:
    run_commands(tmp_path, staying_without(name))
