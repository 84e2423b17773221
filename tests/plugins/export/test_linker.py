"""Compilers are run in the folder of their output."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from commonrail.compiler import cache
from commonrail.plugins.export.object_files import (
    archive,
    compile_source,
    compiler_for,
    find_target,
    link_shared,
    run_compiler,
)


def test_a_relative_folder_is_that_of_the_caller(own: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    target = find_target(own)
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
        run_compiler([sys.executable, "-c", "", "-target", target], tmp_path)
    assert ["aarch64-linux-gnu.2.17" in said[0], "x86_64-windows-gnu" in said[1], len(said)] == [True, True, 2]


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners are not checked")
def test_a_cache_of_the_linker_that_others_can_write_to_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Libraries are linked with the files in zig's cache: another user who could write there would run code in them."""
    shared = tmp_path / "commonrail"
    shared.mkdir()
    shared.chmod(0o777)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("ZIG_GLOBAL_CACHE_DIR", raising=False)
    monkeypatch.setattr(cache, "note", lambda text: None)
    cache.private_folder.cache_clear()
    code = "import os, pathlib; pathlib.Path('used').write_text(os.environ['ZIG_GLOBAL_CACHE_DIR'])"
    run_compiler([sys.executable, "-c", code], tmp_path)
    cache.private_folder.cache_clear()
    assert not (tmp_path / "used").read_text().startswith(str(shared))
