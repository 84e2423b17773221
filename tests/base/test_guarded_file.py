"""One guarded way to files: what it refuses, what it says of a file, and that nothing goes past it."""

from __future__ import annotations

import ast
import hashlib
import os
import tracemalloc
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from commonrail.base import input as input_module
from commonrail.base.errors import InputError
from commonrail.base.input import (
    LARGEST_FILE,
    SUMS,
    UNREADABLE,
    check_sum,
    fingerprint,
    noting_files,
    open_plain,
    read_arrays,
    read_plain,
    sha256,
)
from tests.refused import refused

SRC = Path(__file__).resolve().parents[2] / "src" / "commonrail"

# Calls that open a file, by the last part of the name: those of functions, and those of methods.
FUNCTIONS = {"open"}
METHODS = {"open", "fdopen", "open_code", "read_text", "read_bytes", "connect", "mmap", "memmap"}
METHODS |= {"loadtxt", "genfromtxt", "fromfile", "loadmat", "read_csv", "read_excel"}
METHODS |= {"ParquetFile", "read_table", "read_metadata", "read_schema", "read_parquet"}
LOADERS = {"np", "numpy", "json", "pickle", "tomllib", "scipy"}  # modules whose `load` takes a file
# Places that may: each with its reason.
ALLOWED = {
    "base/input.py": "the guarded way itself",
    "base/output.py": "writes: the file is new",
    "cli/options.py": "tries whether a target can be written, after `check_target`",
    "plugins/new/verb.py": "files of the installed package",
    "base/public.py": "stubs of the installed package",
    "report/html.py": "a file of the installed package",
    "plugins/app/server.py": "a file of the installed package, and the browser",
    "plugins/app/workshop.py": "a file of the installed package",
    "plugins/app/preview.py": "SQLite, a journal that is only read",
    "plugins/app/project.py": "writes uploads and logs, and reads the end of a log that it has written",
    "cli/start.py": "the null device in place of a closed stream",
    "base/registry.py": "files of the installed package",
    "plugins/new/study.py": "files of the installed package",
    "compiler/cache.py": "guards its own folder: files of this user alone",
    "engine/machine_code.py": "a file of the installed package",
    "compiler/lower.py": "its standard output",
    "compiler/target.py": "/proc",
    "runs/lock.py": "SQLite, after `check_target`",
    "runs/tables.py": "SQLite in memory",
    "runs/journal.py": "SQLite, after `check_target` or `check_plain`",
    "runs/listing.py": "SQLite, a lock beside a journal that was read",
    "plugins/formats/parquet_child.py": "pyarrow on bytes of `read_plain`",
    "readers/guarded.py": "NumPy on what its child process has written, and the child's standard output",
    "plugins/export/fmu.py": "what it has just written into a temporary folder of its own",
    "plugins/export/sources.py": "files of the installed package",
    "plugins/observer/online.py": "files of the installed package",
    "plugins/paper/claims.py": "a file of the installed package",
    "plugins/page/module.py": "files of the installed package, and what zig has just written into a temporary folder",
}


def opening_calls(text: str) -> Iterator[tuple[int, str]]:
    """Lines and names of calls in a source that open a file."""
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        if isinstance(function, ast.Name) and function.id in FUNCTIONS:
            yield node.lineno, function.id
        elif isinstance(function, ast.Attribute):
            owner = function.value.id if isinstance(function.value, ast.Name) else ""
            if function.attr in METHODS or (function.attr == "load" and owner in LOADERS):
                yield node.lineno, function.attr


def test_no_source_opens_a_file_past_the_guard() -> None:
    found = [
        f"{path.relative_to(SRC)}:{line} {name}"
        for path in sorted(SRC.rglob("*.py"))
        if path.relative_to(SRC).as_posix() not in ALLOWED
        for line, name in opening_calls(path.read_text(encoding="utf-8"))
    ]
    assert found == [], "read it with commonrail.base.input, or state the reason in ALLOWED"


@pytest.mark.parametrize(
    "line",
    [
        "open('a')",
        "path.open()",
        "Path(x).read_text()",
        "self.file.read_bytes()",
        "np.load(path)",
        "pd.read_csv(path)",
        "os.open(path, 0)",
        "sqlite3.connect(path)",
        "parquet.read_table(path)",
        "tomllib.load(stream)",
    ],
)
def test_the_search_finds_each_kind_of_opening(line: str) -> None:
    assert list(opening_calls(line))


def test_the_files_that_may_open_are_there_and_do() -> None:
    for name in ALLOWED:
        assert list(opening_calls((SRC / name).read_text(encoding="utf-8"))), name


def test_a_fingerprint_is_that_of_what_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"abc")
    assert fingerprint(path) == sha256(read_plain(path)) == sha256(b"abc")


def test_a_fingerprint_of_nothing_and_of_no_file(tmp_path: Path) -> None:
    assert fingerprint(tmp_path / "absent") == ""
    assert fingerprint(Path("a\0b")) == ""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    assert [fingerprint(tmp_path / name) for name in ("pipe", "link", ".")] == [UNREADABLE] * 3


def test_a_sparse_file_is_refused_by_its_size_and_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "sparse"
    with path.open("wb") as stream:
        stream.truncate(20_000_000_000)
    monkeypatch.setattr(os, "open", None)  # to open it is a fault
    assert fingerprint(path) == UNREADABLE
    with refused(InputError, "too-large"):
        read_plain(path)


def test_a_small_file_takes_no_memory_for_the_largest_one(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"abc")
    tracemalloc.start()
    try:
        assert read_plain(path, 1_000_000_000) == b"abc"
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


def test_a_pipe_that_takes_the_place_of_a_file_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("x")
    plain = (tmp_path / "file").stat()
    monkeypatch.setattr(Path, "stat", lambda *_, **__: plain)  # a file when it was examined
    with refused(InputError, "not-a-file", "pipe"), open_plain(tmp_path / "pipe"):
        pass


def test_a_file_that_differs_at_its_second_reading_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"abc")
    with noting_files() as noted:
        read_plain(path)
        read_plain(path)
        path.write_bytes(b"abd")
        with refused(InputError, "changed", "a"):
            read_plain(path)
    assert noted == {path: sha256(b"abc")}


def test_a_large_file_is_not_hashed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").touch()
    (tmp_path / SUMS).write_text(f"{sha256(b'')}  a\n", encoding="utf-8")
    os.truncate(tmp_path / "a", LARGEST_FILE + 1)
    monkeypatch.setattr(hashlib, "file_digest", None)  # to read it is a fault
    with pytest.raises(InputError):
        check_sum(tmp_path / "a")


@pytest.mark.parametrize("content", ["too large", "a lie about the shape", "no zip file", "an array is missing"])
def test_arrays_that_cannot_be_read_are_refused_before_they_take_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str
) -> None:
    monkeypatch.setattr(input_module, "LARGEST_ARRAYS", 10_000)
    path = tmp_path / "a.npz"
    np.savez_compressed(path, points=np.zeros(2000 if content == "too large" else 10))
    if content == "a lie about the shape":
        with zipfile.ZipFile(path, "w") as archive, archive.open("points.npy", "w") as part:
            np.lib.format.write_array_header_1_0(part, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)})
    if content == "no zip file":
        path.write_bytes(b"PK nothing")
    with pytest.raises(InputError):
        read_arrays(path, *(["names"] if content == "an array is missing" else []))
