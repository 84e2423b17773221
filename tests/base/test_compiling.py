"""A kernel that is in no cache is told of, once; one from the cache is not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest

from commonrail.base import hooks
from commonrail.base.hooks import compiled_words, compiling, naming, note, quiet, tell_notes, tell_of_compiling
from tests.compiler.doubled import fresh_cache, value


def test_the_first_use_alone_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[object] = []

    @contextmanager
    def told() -> Iterator[None]:
        said.append("begin")
        yield
        said.append("end")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    fresh_cache()
    before = tell_of_compiling(told)
    try:
        for _ in range(2):  # as two processes: kernels of their own, and one folder
            said += [value(1.0), value(2.0)]
    finally:
        tell_of_compiling(before)
        fresh_cache()
    assert said == ["begin", "end", 2.0, 4.0, 2.0, 4.0]


def test_a_compilation_that_needs_another_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = count()  # of a clock that goes on by one second whenever it is read
    monkeypatch.setattr(hooks, "time", SimpleNamespace(perf_counter=lambda: float(next(seconds))))
    before = hooks.compiling_seconds()
    with compiling(), compiling():  # begin at 0 and 1; the outer ends at 2
        pass
    assert hooks.compiling_seconds() - before == next(seconds) - 1


def test_what_is_compiled_is_named_from_the_outside_in() -> None:
    with naming("model 1 of 2"):
        with naming("rigid body"):
            assert compiled_words().startswith(": model 1 of 2, rigid body (")
        assert compiled_words().startswith(": model 1 of 2 (")
    assert compiled_words().startswith(" (")


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
