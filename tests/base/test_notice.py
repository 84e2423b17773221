"""A kernel that is in no cache is told of, once; one from the cache is not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from commonrail.base import hooks
from commonrail.base.hooks import note, quiet, tell_notes, tell_of_compiling
from commonrail.compiler.cache import cache_folder
from tests.compiler.doubled import value


def test_the_first_use_alone_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[object] = []

    @contextmanager
    def told() -> Iterator[None]:
        said.append("begin")
        yield
        said.append("end")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cache_folder.cache_clear()
    before = tell_of_compiling(told)
    try:
        for _ in range(2):  # as two processes: kernels of their own, and one folder
            said += [value(1.0), value(2.0)]
    finally:
        tell_of_compiling(before)
        cache_folder.cache_clear()
    assert said == ["begin", "begin", "end", "end", 2.0, 4.0, 2.0, 4.0]


def test_notes_inside_a_quiet_block_are_not_told() -> None:
    told: list[str] = []
    before = hooks._note
    tell_notes(told.append)
    try:
        note("first")
        with quiet():
            note("second")
        note("third")
    finally:
        tell_notes(before)
    assert told == ["first", "third"]
