"""Each fact can be well or not, and says what to do."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest

from commonrail.compiler import cache
from commonrail.plugins.doctor import run
from commonrail.plugins.doctor.run import (
    OK,
    Fact,
    cache_facts,
    extra_facts,
    kernel_facts,
    run_child,
    self_check,
    usable,
)
from tests.compiler.doubled import fresh_cache

SOUND: dict[str, Any] = {
    "seconds": 0.5,
    "origin": "cache",
    "processor": "x86-64-v4",
    "status": "OK",
    "volume": 53.8e-9,
    "balance": 1e-14,
}


def facts_of(*answers: dict[str, Any]) -> list[Fact]:
    """Facts of kernels that answered so."""
    given = iter(answers)
    return list(kernel_facts(lambda: next(given)))


@pytest.mark.slow  # tests/plugins/doctor/test_verb.py reads the same of the command
@pytest.mark.skipif(cache.cache_folder() is None, reason="no place for compiled simulations can be used here")
def test_a_second_process_loads_what_the_first_has_compiled() -> None:
    first, second = (json.loads(run_child("commonrail.plugins.doctor.run", [], 300.0).stdout) for _ in range(2))
    assert first["origin"] in ("compiled", "cache", "library")
    assert second["origin"] in ("cache", "library")


def test_a_cache_that_cannot_be_written_is_told() -> None:
    (fact,) = cache_facts(lambda: None)
    assert fact.value == "none"
    assert "XDG_CACHE_HOME" in fact.verdict
    assert not fact.essential  # slow, and usable


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="other systems keep caches elsewhere")
def test_the_cache_falls_back_where_its_usual_place_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "commonrail").touch()  # even root cannot make a folder below a file
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    fresh_cache()
    try:
        first = next(iter(cache_facts()))
    finally:
        fresh_cache()
    assert str(tmp_path / "commonrail") in first.verdict


def test_kernels_are_counted(tmp_path: Path) -> None:
    folder = tmp_path / "kernels-1"
    folder.mkdir()
    (tmp_path / "kernels-0").mkdir()
    (folder / "a.kernel").write_bytes(bytes(1_500_000))
    (folder / "a.lock").write_bytes(b"")
    facts = {fact.name: fact for fact in cache_facts(lambda: folder)}
    assert facts["kernels in it"].value == "1, 1.5 MB"
    assert facts["kernels in it"].verdict.startswith("1 ")
    assert facts["other caches"].value == "1 folders"


def test_a_kernel_from_the_cache_is_well() -> None:
    facts = facts_of(SOUND)
    assert [fact.verdict for fact in facts] == [OK, OK, OK]
    assert "x86-64-v4" in facts[0].value
    assert usable(facts)


def test_a_kernel_from_a_library_is_well() -> None:
    facts = facts_of(SOUND | {"origin": "library"})
    assert "x86-64-v4" in facts[0].value
    assert facts[0].value != facts_of(SOUND)[0].value
    assert [fact.verdict for fact in facts] == [OK, OK, OK]


def test_a_kernel_that_is_never_kept_is_told() -> None:
    compiled = SOUND | {"origin": "compiled"}
    assert facts_of(compiled, compiled)[1].verdict != OK
    assert facts_of(compiled, SOUND)[1].verdict == OK


def test_a_process_that_dies_makes_it_unusable() -> None:
    facts = facts_of({"failed": "ended by signal 4"})
    assert "signal 4" in facts[0].verdict
    assert not usable(facts)


@pytest.mark.parametrize("wrong", [{"volume": 40e-9}, {"balance": 1e-6}, {"volume": None, "status": "NOT_FINITE"}])
def test_a_wrong_simulation_makes_it_unusable(wrong: dict[str, Any]) -> None:
    fact = self_check(SOUND | wrong)
    assert fact.verdict != OK
    assert not usable([fact])


def test_what_is_optional_is_named_with_its_cure() -> None:
    facts = {fact.name: fact for fact in extra_facts(lambda module: None)}
    assert "'commonrail[cluster]'" in facts["distributed"].verdict
    assert usable(list(facts.values()))


def test_without_the_compiler_the_machine_is_looked_at_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """A library may simulate without it; what it would tell of the processor is not made up."""
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    monkeypatch.setattr(run, "version", lambda package: "" if package == "llvmlite" else "1.0")
    facts = {fact.name: fact for fact in run.machine_facts()}
    assert "'commonrail[jit]'" in facts["llvmlite"].verdict
    assert facts["instruction sets"].verdict == OK


@pytest.mark.parametrize("package", ["scipy", "numba", "llvmlite", "numpy"])
def test_a_package_is_essential_unless_libraries_do_without(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    monkeypatch.setattr(run, "version", lambda name: "" if name == package else "1.0")
    lacking, with_libraries = (
        next(fact for fact in run.package_facts(found) if fact.verdict != OK) for found in (False, True)
    )
    wanted = "'commonrail[jit]'" if package in ("numba", "llvmlite") else package
    assert (lacking.name, lacking.essential) == (package, True)
    assert f"pip install {wanted}" in lacking.verdict
    assert with_libraries.essential == (package == "numpy")
    assert (with_libraries.verdict != lacking.verdict) == (package != "numpy")
