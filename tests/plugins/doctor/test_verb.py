"""commonrail doctor: one line a fact, and the exit status."""

from __future__ import annotations

from pathlib import Path

import pytest

from commonrail.compiler import cache
from commonrail.plugins.doctor import run
from commonrail.plugins.doctor.run import Fact
from tests.cli.conftest import Command
from tests.distribution import distribution


def test_this_machine_is_usable_and_said_in_json(command: Command) -> None:
    done = command("doctor", "--json")
    assert done.status == 0
    record = done.record
    assert record["usable"] is True
    facts = {fact["name"]: fact for fact in record["facts"]}
    assert {"Python", "numba", "processor", "instruction sets", "threads", "kernel cache", "self-check"} <= set(facts)
    if cache.cache_folder() is not None:  # there is a place for compiled simulations
        compiled = "compiler" in facts["machine code"]["value"]
        assert compiled == ("cache" in facts["first simulation"]["value"])


def test_a_machine_that_cannot_be_used_ends_with_2(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "doctor", lambda: [Fact("self-check", "0 mm3", "Report it.", True)])
    done = command("doctor")
    assert done.status == 2
    assert "Report it." in done.out
    assert done.sentence


def test_what_is_only_slow_ends_with_0(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "doctor", lambda: [Fact("kernel cache", "none", "Make it writable.")])
    assert command("doctor").status == 0


def test_a_broken_package_is_named_in_a_sentence_and_the_others_are_listed(command: Command, tmp_path: Path) -> None:
    modules = {
        "example_broken": "raise OSError('no driver')\n",
        "example_lost": "PATH = 'no-such-file.toml'\nSIX = 6\n",
    }
    parts = (
        "[commonrail.readers]\ntpc = example_broken:SHEET\n"
        "[commonrail.injectors]\nlost = example_lost:PATH\n"
        "[commonrail.optimisers]\nsix = example_lost:SIX\n"
        "[commonrail.data]\nsix = example_lost:SIX\n"
    )
    with distribution(tmp_path, modules, parts):
        (fact,) = run.plugin_facts()
        with pytest.warns(RuntimeWarning, match='"lost"'):
            listed = command("catalogue", "injectors")
    assert fact.name == "plug-in example-plugin"
    for name in ('"tpc" of commonrail.readers', '"lost" of commonrail.injectors'):
        assert name in fact.verdict
    assert fact.verdict.count('"six"') == 2
    assert "cri2-16" in listed.out
