"""Wheels as they are built: pure without being asked, and with libraries of kernels where they are asked for."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import tarfile
import tempfile
import zipfile
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError
from commonrail.compiler.target import LEVEL_3
from commonrail.physics.injector import Injector
from commonrail.plugins.export.object_files import compiler_for, find_target
from tools.wheel_libraries import write_libraries

LACKING = "hatchling, which builds wheels, is not installed"
wheels = pytest.importorskip("hatchling.builders.wheel", reason=LACKING)
sources = pytest.importorskip("hatchling.builders.sdist", reason=LACKING)

ROOT = Path(__file__).resolve().parents[1]
ASKED, TAG = "COMMONRAIL_BUILD_KERNELS", "COMMONRAIL_WHEEL_TAG"


def has_compiler() -> bool:
    """True if libraries can be linked here."""
    try:
        compiler_for(find_target("linux64"))
    except ConfigurationError:
        return False
    return True


@pytest.fixture(autouse=True)
def not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is asked for by the environment of whoever runs the tests."""
    for name in (ASKED, TAG):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy of what a wheel is built from, with libraries that a developer has made in it."""
    root = tmp_path_factory.mktemp("tree")
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE", ".gitignore"):
        shutil.copy(ROOT / name, root)
    ignored = shutil.ignore_patterns("__pycache__", "kernels")
    shutil.copytree(ROOT / "src", root / "src", ignore=ignored)
    own = root / "src" / "commonrail" / "kernels"
    own.mkdir()
    (own / "lanes-v3.so").write_bytes(b"of a developer")
    return root


class Built(NamedTuple):
    """A wheel: its name, its files of the folder of kernels, what it requires, and what extras do of the compiler."""

    name: str
    kernels: dict[str, bytes]
    required: set[str]
    compiler: set[str]


def build(tree: Path, target: Path) -> Built:
    """Build a wheel, and check that nothing else is left, the requirements of the next build included."""
    builder = wheels.WheelBuilder(str(tree))
    made = Path(next(builder.build(directory=str(target), versions=["standard"])))
    assert [path.name for path in target.iterdir()] == [made.name]
    assert "numba>=0.66" in builder.metadata.core.dependencies
    assert builder.metadata.core.optional_dependencies["jit"] == ["numba>=0.66"]
    with zipfile.ZipFile(made) as wheel:
        names = wheel.namelist()
        assert {"commonrail/py.typed", "commonrail/physics/catalogue/fuels/iso4113.toml"} <= set(names)
        (about,) = (wheel.read(n).decode() for n in names if n.endswith(".dist-info/METADATA"))
        kernels = {Path(n).name: wheel.read(n) for n in names if n.startswith("commonrail/kernels/")}
    required, of_extra = (
        set(re.findall(rf"^Requires-Dist: ([^;\n]+){rest}$", about, re.MULTILINE))
        for rest in ("", "; extra == '(?:jit|export)'")
    )
    return Built(made.name, kernels, {re.split(r"\W", one)[0] for one in required}, of_extra)


def test_a_wheel_is_pure_unless_it_is_asked_for_libraries(tree: Path, tmp_path: Path) -> None:
    built = build(tree, tmp_path)
    assert built.name.endswith("-py3-none-any.whl")
    assert built.kernels == {}
    assert {"numpy", "scipy", "numba"} <= built.required
    assert built.compiler == {"numba>=0.66", "ziglang>=0.13"}


@pytest.fixture
def unpacked(tree: Path, tmp_path: Path) -> Path:
    """Source distribution as it is unpacked, with the metadata that were written into it."""
    archive = next(sources.SdistBuilder(str(tree)).build(directory=str(tmp_path / "source"), versions=["standard"]))
    with tarfile.open(archive) as packed:
        # Python 3.11.2 and 3.11.3 have no filters
        packed.extractall(tmp_path, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))
    return tmp_path / Path(archive).name.removesuffix(".tar.gz")


@pytest.mark.skipif(not has_compiler(), reason="no C compiler for x86-64 Linux is installed")
@pytest.mark.parametrize("tag", ["", "py3-none-manylinux_2_28_x86_64"])
@pytest.mark.parametrize("source", ["tree", "unpacked"])
def test_a_wheel_has_the_libraries_that_were_asked_for(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    rigid: Injector,
    tag: str,
    source: str,
) -> None:
    tree: Path = request.getfixturevalue(source)
    folders: list[Path] = []
    link = subprocess.run

    def run(command: list[str], **settings: Any) -> Any:
        if command[1:2] != ["-m"]:
            return link(command, **settings)  # the C compiler
        assert command[2] == "tools.wheel_libraries"
        assert settings["env"]["PYTHONPATH"] == f"{tree / 'src'}{os.pathsep}{tree}"
        assert command[4:] == ["all"]  # who has no compiler needs every wiring
        folders.append(Path(command[3]))
        # all of them take minutes; these loops are compiled for tests of the libraries too
        write_libraries(folders[-1], [rigid.wired()], (Precision.F64,), (LEVEL_3,))
        (folders[-1] / ".lanes-v4.so").write_bytes(b"of an interrupted build")
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setenv(ASKED, "1")
    if tag:
        monkeypatch.setenv(TAG, tag)
    name, kernels, required, compiler = build(tree, tmp_path / "wheels")
    assert name.endswith(f"-{tag or 'py3-none-linux_x86_64'}.whl")
    assert "numpy" in required
    assert "numba" not in required
    assert compiler == {*(f"{package}=={version(package)}" for package in ("llvmlite", "numba")), "ziglang>=0.13"}
    assert set(kernels) == {"lanes-v3.so", "stamp.json"}
    stamp = json.loads(kernels["stamp.json"])
    assert stamp["libraries"] == {"lanes-v3.so": hashlib.sha256(kernels["lanes-v3.so"]).hexdigest()}
    assert not folders[0].exists()  # nor in the temporary folder


def test_a_source_distribution_that_was_asked_for_libraries_requires_the_compiler(
    monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """Its metadata hold for wheels of either kind that are built from it."""
    monkeypatch.setenv(ASKED, "1")
    about = (request.getfixturevalue("unpacked") / "PKG-INFO").read_text(encoding="utf-8")
    assert "\nRequires-Dist: numba>=0.66\n" in about


def test_an_editable_installation_is_not_asked_for_them(
    tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its libraries lie beside the sources, where `make kernels` writes them."""

    def run(command: list[str], **_: Any) -> Any:
        raise AssertionError(command)

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setenv(ASKED, "1")
    builder = wheels.WheelBuilder(str(tree))
    for hook in builder.get_build_hooks(str(tmp_path)).values():
        hook.initialize("editable", {})
        hook.finalize("editable", {}, "")


def test_without_its_libraries_a_wheel_that_was_asked_for_them_is_not_built(
    tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed: subprocess.CompletedProcess[str] = subprocess.CompletedProcess([], 3)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: failed)
    monkeypatch.setenv(ASKED, "1")
    with pytest.raises(SystemExit, match=r"wheel .*none"):
        build(tree, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_the_compiler_is_asked_for_with_the_libraries_alone(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def needed() -> set[str]:
        builder = wheels.WheelBuilder(str(tree))
        hooks = builder.get_build_hooks(tempfile.gettempdir())
        return {word for hook in hooks.values() for word in hook.dependencies()}

    assert needed() == set()
    monkeypatch.setenv(ASKED, "1")
    assert any(word.startswith("numba") for word in needed())
