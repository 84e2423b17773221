"""Processes that are started run no module of the current folder, which may be a stranger's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from commonrail.base.errors import InputError
from commonrail.compiler import child as child_process
from commonrail.plugins.doctor.run import run_child
from commonrail.plugins.export.object_files import compiler_for, find_target, run_compiler
from commonrail.readers.guarded import read_apart
from commonrail.workers.task import pack
from commonrail.workers.workers import Workers
from tests.compiler import doubled
from tests.workers.crews import Deed, Deeds, sines, tasks

pytestmark = pytest.mark.process


def compile_laws(folder: Path) -> None:
    child = child_process._Child("f64")
    child.ask(doubled.source())
    child.end()


def use_workers(folder: Path) -> None:
    with Workers.processes(1) as workers:
        sines(workers.run(tasks(pack(Deeds(folder)), [Deed(1)])))


def use_cluster(folder: Path) -> None:
    pytest.importorskip("distributed")
    with Workers.cluster("local", 1) as workers:
        sines(workers.run(tasks(pack(Deeds(folder)), [Deed(1)])))


def read_mat(folder: Path) -> None:
    with pytest.raises(InputError):
        read_apart("tests.readers.nothing", folder / "a.mat", b"")


def link(folder: Path) -> None:
    pytest.importorskip("ziglang")
    run_compiler([*compiler_for(find_target("wasm32")).command, "--version"], folder)


def check_machine(folder: Path) -> None:
    run_child("commonrail.plugins.doctor.run", [], 300.0)


@pytest.fixture
def traps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Current folder with modules named as those that every child imports; each that is run leaves a mark."""
    for name in ("json", "threading", "numba", "subprocess", "signal", "numpy"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'mark')!r}, 'a').close()\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("start", [compile_laws, use_workers, use_cluster, read_mat, link, check_machine])
def test_modules_of_the_current_folder_are_not_run(traps: Path, start: Callable[[Path], None]) -> None:
    start(traps)
    assert not (traps / "mark").exists()
