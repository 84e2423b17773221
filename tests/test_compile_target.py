"""The target of the compiler: what it names, and the sentence on how two of them differ."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from commonrail.compile_target import describe, differences, package_versions

SHOW = "from commonrail.compile_target import describe; print('|'.join(describe().machine.values()))"


def shown(**environment: str) -> list[str]:
    line = [sys.executable, "-c", SHOW]
    done = subprocess.run(line, env=os.environ | environment, capture_output=True, text=True, check=True)
    return done.stdout.strip().split("|")


def test_the_target_is_the_one_that_numba_compiles_for() -> None:
    from numba.core.registry import cpu_target

    triple, cpu, features = cpu_target.target_context.codegen().magic_tuple()
    found = describe()
    assert (found.triple, found.cpu) == (triple, cpu)
    assert set(found.features.split(",")) == set(features.split(","))
    assert dict(found.versions) == package_versions()
    assert set(found.record) == {*dict(found.versions), *found.machine}


@pytest.mark.process
def test_another_target_on_the_same_processor_is_seen() -> None:
    own, generic, slow = list(describe().machine.values()), shown(NUMBA_CPU_NAME="generic"), shown(NUMBA_OPT="1")
    assert generic[1:3] == ["generic", ""]
    assert own[1] != "generic"
    assert own[4] == generic[4] == slow[4]
    assert (own[:3], own[3]) == (slow[:3], slow[3].replace("opt 1", "opt 3"))
    assert own[3] != slow[3]


def test_differences_are_a_part_of_a_sentence() -> None:
    before = {"cpu": "znver3", "features": "+avx,+avx2,-avx512f", "numba": "0.62", "processor": "x86_64 AMD EPYC"}
    assert differences(before, before) == ""
    assert differences(before, before | {"cpu": "generic"}) == "cpu znver3, now generic"
    now = before | {"features": "+avx,-avx2,+avx512f", "numba": "0.63"}
    text = "instruction sets, now without avx2 and with avx512f; numba 0.62, now 0.63"
    assert differences(before, now) == text
    assert differences(before, before | {"features": "+avx,+avx2"}) == "instruction sets, now listed otherwise"
    many = before | {"features": ",".join(f"+{name}" for name in "abcdefgh")}
    assert differences(before, many) == "instruction sets, now without avx, avx2 and with a, b, c, d, e, f ..."


def test_what_an_earlier_version_did_not_note_is_not_compared() -> None:
    assert differences({"numba": "0.62"}, {"numba": "0.62", "cpu": "znver3"}) == ""
    assert differences({"numba": "0.62", "cpu": "znver3"}, {"numba": "0.62"}) == ""
