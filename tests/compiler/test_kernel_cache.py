"""The cache of kernels: nobody else's files, nothing damaged, and each kernel compiled by one process at a time."""

from __future__ import annotations

import os
import sqlite3
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from commonrail.base import hooks
from commonrail.base.hooks import tell_notes
from commonrail.compiler import cache as kernel_cache
from commonrail.compiler.load import load, object_of
from commonrail.compiler.table import address, fill
from commonrail.compiler.target import own_processor
from tests.compiler import doubled

POSIX = pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners and modes of files are POSIX's")


Answer = tuple[float, int, str]


@pytest.fixture
def answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], Answer]]:
    """Use a kernel as a process of its own would: its result, how often it came from the cache, and the notes."""
    (tmp_path / "second").mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "second"))
    before = hooks._note

    def use() -> Answer:
        doubled.fresh_cache()
        notes: list[str] = []
        tell_notes(notes.append)
        content, made = object_of(doubled.source(), {"double": "double"}, own_processor())
        call, holder = load(content, "double")
        out = np.zeros(1)
        table, given = fill(doubled.GIVEN, (21.0, out))
        result = np.zeros(2, np.int64)
        call(address(result), address(result) + 8, address(table))
        del holder, given
        return float(out[0]), int(not made), "\n".join(notes)

    yield use
    tell_notes(before)
    doubled.fresh_cache()


def kept(cache: Path) -> Path:
    (path,) = cache.glob("commonrail/kernels-*/*.kernel")
    return path


def test_a_kernel_under_the_name_of_another_is_not_loaded(tmp_path: Path) -> None:
    """Its bits are others, or a function is sought in it that it has not, and the process ends."""
    one, other = tmp_path / "one.kernel", tmp_path / "other.kernel"
    kernel_cache.write(one, b"machine code")
    assert kernel_cache.read(one) == (b"machine code", "")
    one.rename(other)
    assert kernel_cache.read(other) == (None, "is damaged")


def test_a_kernel_with_a_flipped_bit_is_compiled_anew_once_with_a_note(
    tmp_path: Path, answer: Callable[[], Answer]
) -> None:
    assert answer() == (42.0, 0, "")
    content = bytearray(kept(tmp_path).read_bytes())
    content[len(content) // 2] ^= 4
    kept(tmp_path).write_bytes(content)
    *said, noted = answer()
    assert said == [42.0, 0]
    assert "damaged" in noted
    assert answer() == (42.0, 1, "")


def test_a_kernel_of_another_processor_or_kind_is_not_taken(answer: Callable[[], Answer]) -> None:
    assert answer()[1] == 0
    for source, processor in (
        (doubled.source(), own_processor()._replace(name="x86-64")),
        (doubled.source(kind="exact"), own_processor()),
        (doubled.source()._replace(key="another law"), own_processor()),
    ):
        assert object_of(source, {"double": "double"}, processor)[1]
    assert answer()[1] == 1


def test_no_flipped_bit_and_no_lost_end_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.kernel"
    kernel_cache.write(path, bytes(range(64)))
    assert kernel_cache.read(path) == (bytes(range(64)), "")
    whole = path.read_bytes()
    for position in range(8 * len(whole)):
        spoilt = bytearray(whole)
        spoilt[position // 8] ^= 1 << position % 8
        path.write_bytes(spoilt)
        assert kernel_cache.read(path) == (None, "is damaged")
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        assert kernel_cache.read(path)[0] is None


@POSIX
def test_neither_a_link_nor_a_pipe_nor_a_file_that_others_may_write_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.kernel"
    kernel_cache.write(path, b"payload")
    link = tmp_path / "b.kernel"
    link.symlink_to(path)
    assert kernel_cache.read(link)[0] is None
    os.mkfifo(tmp_path / "c.kernel")
    assert kernel_cache.read(tmp_path / "c.kernel") == (None, "is not a file")
    path.chmod(0o646)
    assert kernel_cache.read(path)[1].startswith("may be written by others")


@POSIX
def test_a_folder_that_others_could_write_to_is_objected_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "open" / "commonrail" / "kernels-1"
    folder.mkdir(mode=0o700, parents=True)
    assert kernel_cache.objection(folder) == ""
    for level in (folder, folder.parent):
        level.chmod(0o757)
        assert kernel_cache.objection(folder).startswith(f"{level} may be written by others")
        level.chmod(0o700)
    above = folder.parent.parent
    above.chmod(0o777)
    assert kernel_cache.objection(folder) == f"{above} may be written by others"
    above.chmod(0o777 | stat.S_ISVTX)  # as for temporary files
    assert kernel_cache.objection(folder) == ""
    real = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: real + 1)
    assert kernel_cache.objection(folder) == f"{folder} belongs to another user"


@POSIX
def test_a_link_in_place_of_the_folder_is_objected_to(tmp_path: Path) -> None:
    (tmp_path / "elsewhere" / "kernels-1").mkdir(mode=0o700, parents=True)
    (tmp_path / "commonrail").symlink_to(tmp_path / "elsewhere")
    assert kernel_cache.objection(tmp_path / "commonrail" / "kernels-1") == (
        f"{tmp_path / 'commonrail'} is not a folder"
    )


@POSIX
def test_a_folder_that_somebody_else_could_write_to_is_left_with_a_note(
    tmp_path: Path, answer: Callable[[], Answer]
) -> None:
    (tmp_path / "commonrail").mkdir()
    (tmp_path / "commonrail").chmod(0o777)
    *said, noted = answer()
    assert said == [42.0, 0]
    assert f"No compiled simulations are kept in {tmp_path / 'commonrail'}" in noted
    assert not list(tmp_path.glob("commonrail/*/*"))
    assert len(list(tmp_path.glob("second/*/*/*.kernel"))) == 1


# Another process compiles the same kernel after this one has missed it and before it has its turn.
OVERTAKEN = """
import os, subprocess, sys
from contextlib import contextmanager
from commonrail.compiler.load import load, object_of
from commonrail.compiler.table import address, fill
from commonrail.compiler.target import own_processor
from tests.compiler import doubled
from commonrail.base.hooks import set_compiling_listener

@contextmanager
def told():
    if "OTHER" not in os.environ:
        subprocess.run([sys.executable, __file__], env=os.environ | {"OTHER": "1"}, check=True)
    yield

set_compiling_listener(told)

made = object_of(doubled.source(), {"double": "double"}, own_processor())[1]
print("OTHER" in os.environ, int(not made), flush=True)
"""


def test_a_kernel_that_another_process_has_just_compiled_is_taken_from_it(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(OVERTAKEN, encoding="utf-8")
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "0", "False", "1"]


def test_one_process_has_the_turn_and_who_cannot_wait_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "kernel.lock"
    with kernel_cache.turn(path), closing(sqlite3.connect(path, isolation_level=None, timeout=0.0)) as other:
        with pytest.raises(sqlite3.OperationalError, match="locked"):
            other.execute("BEGIN EXCLUSIVE")
        monkeypatch.setattr(kernel_cache, "LONGEST_WAIT", 0.0)
        with kernel_cache.turn(path):
            pass
    with closing(sqlite3.connect(path, isolation_level=None, timeout=0.0)) as other:
        other.execute("BEGIN EXCLUSIVE")


def test_a_folder_in_the_place_of_a_kernel_is_moved_out_of_the_way(
    tmp_path: Path, answer: Callable[[], Answer]
) -> None:
    """It stayed, and the kernel was compiled at every start."""
    assert answer()[:2] == (42.0, 0)
    path = kept(tmp_path)
    path.unlink()
    (path / "inside").mkdir(parents=True)
    value, hits, notes = answer()
    assert (value, hits) == (42.0, 0)
    assert "Is a directory" in notes  # the words of the operating system
    assert answer() == (42.0, 1, "")


def test_a_file_too_large_for_a_kernel_is_not_read(tmp_path: Path, answer: Callable[[], Answer]) -> None:
    """A sparse file of 60 GB was read into the memory, and the lack of it was put down to the simulation's horizon."""
    assert answer()[:2] == (42.0, 0)
    with kept(tmp_path).open("r+b") as file:
        file.truncate(60_000_000_000)
    value, hits, notes = answer()
    assert (value, hits) == (42.0, 0)
    assert "60000 MB" in notes
    assert answer() == (42.0, 1, "")
