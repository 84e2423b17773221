"""A kernel that is in no cache is told of, once; one from the cache is not."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import commonrail as cr
from commonrail.base import hooks
from commonrail.base.hooks import compiling, describe_compiling, lasting, listen_to_compiling, naming, note, quiet
from commonrail.engine import plan
from tests.compiler.doubled import fresh_cache, value
from tests.waiting import PATIENCE


def test_the_first_use_alone_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[object] = []

    @contextmanager
    def told() -> Iterator[None]:
        said.append("begin")
        yield
        said.append("end")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    fresh_cache()
    with listen_to_compiling(told):
        for _ in range(2):  # as two processes: kernels of their own, and one folder
            said += [value(1.0), value(2.0)]
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
            assert describe_compiling().startswith(": model 1 of 2, rigid body (")
        assert describe_compiling().startswith(": model 1 of 2 (")
    assert describe_compiling().startswith(" (")


@pytest.fixture
def notes(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Notes that were said."""
    said: list[str] = []
    monkeypatch.setattr(hooks, "_note", said.append)
    monkeypatch.setattr(hooks, "_noted", set())
    return said


def test_notes_inside_a_quiet_block_are_left_out_and_one_said_once_comes_later(notes: list[str]) -> None:
    with quiet():
        note("plain")
        note("once", once=True)
    for _ in range(2):
        note("plain")
        note("once", once=True)
    assert notes == ["plain", "once", "plain"]


Block = Callable[[], AbstractContextManager[Any]]


def interleave(first: Block, second: Block) -> None:
    """Enter two contexts in threads of their own, and leave the first one before the second."""
    entered, left = threading.Barrier(2, timeout=PATIENCE), threading.Event()

    def one() -> None:
        with first():
            entered.wait()
        left.set()

    def other() -> None:
        with second():
            entered.wait()
            assert left.wait(PATIENCE)

    with ThreadPoolExecutor(2) as pool:
        for done in [pool.submit(one), pool.submit(other)]:
            done.result()


def test_threads_whose_blocks_overlap_leave_nothing_behind(notes: list[str]) -> None:
    words = describe_compiling()
    interleave(quiet, quiet)
    interleave(lambda: lasting("an hour"), lambda: lasting("a day"))
    interleave(lambda: listen_to_compiling(unused), lambda: listen_to_compiling(unused))
    note("said")
    assert notes == ["said"]
    assert describe_compiling() == words
    with compiling():
        pass


def unused() -> AbstractContextManager[None]:
    raise AssertionError("a listener of another block is called")


def test_compilations_of_two_threads_count_once_where_they_overlap(monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = count()
    monkeypatch.setattr(hooks, "time", SimpleNamespace(perf_counter=lambda: float(next(seconds))))
    before = hooks.compiling_seconds()
    interleave(compiling, compiling)  # the clock is read as the first begins and as the last ends
    assert hooks.compiling_seconds() - before == 1.0


def test_a_note_points_to_the_line_that_calls_the_package(
    monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder
) -> None:
    monkeypatch.setattr(hooks, "_noted", set())
    narrow = {"feed_pipe.diameter": "1 mm", "feed_pipe.length": "1 m"}
    injector = cr.load_injector("virtual-lino-2016").with_values(narrow)
    plan.prepare(injector, [cr.OperatingPoint("160 MPa", "700 us")], 1e-6)
    assert [one.filename for one in recwarn] == [__file__]
