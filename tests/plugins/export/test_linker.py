"""Compilers are run in the folder of their output."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from commonrail.plugins.export.object_files import archive, compile_source, compiler_for, link_shared, run, target_named


def test_a_relative_folder_is_that_of_the_caller(own: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    target = target_named(own)
    compiler = compiler_for(target)
    folder = Path("library")
    folder.mkdir()
    source, compiled = folder / "one.c", folder / "one.o"
    source.write_text("int one(void);\nint one(void) { return 1; }\n", encoding="utf-8")
    static, shared = folder / "libone.a", folder / f"libone{target.suffix}"
    compile_source(compiler, source, compiled, target)
    archive(compiler, (compiled,), static)
    link_shared(compiler, (source,), shared, target, ())
    assert [path.exists() for path in (compiled, static, shared)] == [True, True, True]


def test_the_first_link_for_a_target_says_that_a_c_library_is_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "zig"))
    said: list[str] = []
    monkeypatch.setattr("commonrail.plugins.export.object_files.note", said.append)
    for target in ("aarch64-linux-gnu.2.17", "aarch64-linux-gnu.2.17", "wasm32-freestanding", "x86_64-windows-gnu"):
        run([sys.executable, "-c", "", "-target", target], tmp_path)
    assert ["aarch64-linux-gnu.2.17" in said[0], "x86_64-windows-gnu" in said[1], len(said)] == [True, True, 2]
