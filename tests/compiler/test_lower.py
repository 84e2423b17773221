"""The child process that lowers laws: it may end, fail or be killed."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.compiler import child, lower
from commonrail.compiler.target import System
from tests.compiler import doubled


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "get_or_make", lambda name, make: make())


def test_a_child_that_has_gone_idle_is_started_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may end between the look at it and the question."""
    one = child._Child("f64")
    one.process.stdin.close()  # type: ignore[union-attr]
    assert one.process.wait() == 0
    started = iter([one, child._Child("f64")])
    monkeypatch.setattr(child, "_child", lambda kind: next(started))
    one.process.stdin = Path("/dev/null").open("wb")  # noqa: SIM115
    assert set(child.texts(doubled.source())) == {"double"}


def test_a_child_that_was_killed_is_replaced() -> None:
    one = child._child("f64")
    one.process.kill()
    one.process.wait()
    assert set(child.texts(doubled.source())) == {"double"}  # another one is started


def test_a_function_that_allocates_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="allocates memory"):
        child.texts(doubled.source("allocating"))


def test_the_fault_of_a_law_is_told() -> None:
    with pytest.raises(ConfigurationError, match="KeyError"):
        child.texts(doubled.source("no such function"))


@pytest.mark.skipif(not hasattr(os, "getpgid"), reason="groups of processes are POSIX's")
def test_a_ctrl_c_in_a_terminal_does_not_reach_the_child() -> None:
    """A search that is asked to stop goes on to its report, for which it may have to compile."""
    assert os.getpgid(child._child("f64").process.pid) != os.getpgid(0)


def test_on_windows_the_child_has_a_group_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows has no sessions: a process group keeps Ctrl-C from the child."""
    started: dict[str, object] = {}
    monkeypatch.setattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0x200, raising=False)
    monkeypatch.setattr(subprocess, "Popen", lambda command, **settings: started.update(settings))
    child._Child("f64")
    assert started["creationflags"] == 0x200


@pytest.mark.parametrize(
    ("triple", "cpu", "tuned"),
    [("x86_64-unknown-linux-gnu", "x86-64-v3", True), ("aarch64-unknown-linux-gnu", "", False)],
)
def test_only_code_for_x86_is_ordered_for_a_processor_that_reorders_nothing(triple: str, cpu: str, tuned: bool) -> None:
    """The model of another kind of processor would be refused on the user's terminal."""
    machine, module = lower.optimise(child.texts(doubled.source()), {"double": "twice"}, System(triple, cpu))
    assert ("tune-cpu" in str(lower.schedule_instructions(machine, module))) is tuned
