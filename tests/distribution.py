"""Distribution of another package on the path, with parts registered by entry points."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from commonrail.base import registry


@contextmanager
def distribution(folder: Path, modules: Mapping[str, str], parts: str, name: str = "example-plugin") -> Iterator[None]:
    """Install a package of version 1.2 in the block.

    Parameters
    ----------
    folder : Path
        Empty.
    modules : mapping of str to str
        Source text by the name of the module.
    parts : str
        Content of entry_points.txt.
    name : str
        Of the package.
    """
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text, encoding="utf-8")
    info = folder / f"{name.replace('-', '_')}-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(parts, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        registry.find_installed.cache_clear()
        yield
    for module in modules:
        sys.modules.pop(module, None)
    registry.find_installed.cache_clear()


@contextmanager
def package(root: Path, info: Path) -> Iterator[None]:
    """Install a package from its source folder in the block.

    Parameters
    ----------
    root : Path
        Folder with pyproject.toml and src.
    info : Path
        Empty folder for the metadata that an installation leaves.
    """
    _write_metadata(root, info)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(root / "src")
        patch.syspath_prepend(info)
        registry.find_installed.cache_clear()
        try:
            yield
        finally:  # the next test may install another package of the name
            tops = {path.stem for path in (root / "src").iterdir()}
            for module in [module for module in sys.modules if module.partition(".")[0] in tops]:
                sys.modules.pop(module)
            registry.find_installed.cache_clear()


def run_tests(root: Path, info: Path) -> None:
    """Run a package's own tests in a fresh process; `info` is a folder for its metadata, or has them."""
    if not info.exists():
        _write_metadata(root, info)
    paths = [str(root / "src"), str(info), *filter(None, sys.path)]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", os.devnull, str(root / "tests")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    done = subprocess.run(command, env=environment, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def _write_metadata(root: Path, info: Path) -> None:
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    name, version = project["name"], project["version"]
    folder = info / f"{name.replace('-', '_')}-{version}.dist-info"
    folder.mkdir(parents=True)
    head = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\nSummary: {project['description']}\n"
    (folder / "METADATA").write_text(head, encoding="utf-8")
    lines = []
    for group, parts in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{part} = {target}" for part, target in parts.items())]
    (folder / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
