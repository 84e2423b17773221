"""commonrail doctor: one line a fact, and the exit status."""

from __future__ import annotations

import pytest

from commonrail.cli.verbs import doctor as bench_doctor
from commonrail.cli.verbs.doctor import Fact
from commonrail.compiler import cache
from tests.cli.conftest import Command


def test_this_machine_is_usable_and_said_in_json(command: Command) -> None:
    done = command("doctor", "--json")
    assert done.status == 0
    record = done.record
    assert record["usable"] is True
    facts = {fact["name"]: fact for fact in record["facts"]}
    assert {"Python", "numba", "processor", "instruction sets", "threads", "kernel cache", "self-check"} <= set(facts)
    if cache.cache_folder() is not None:  # there is a place for compiled simulations
        compiled = facts["machine code"]["value"].startswith("from the compiler, for ")
        assert compiled == ("from the cache from now on" in facts["first simulation"]["value"])


def test_a_machine_that_cannot_be_used_ends_with_2(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_doctor, "examine", lambda: iter([Fact("self-check", "0 mm3", "Report it.", True)]))
    done = command("doctor")
    assert done.status == 2
    assert "Report it." in done.out
    assert "cannot be used" in done.sentence


def test_what_is_only_slow_ends_with_0(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_doctor, "examine", lambda: iter([Fact("kernel cache", "none", "Make it writable.")]))
    assert command("doctor").status == 0
