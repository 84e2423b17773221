"""The target of the compiler: what it names, and the sentence on how two of them differ."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

from commonrail.compiler import target
from commonrail.compiler.target import (
    LEVEL_3,
    LEVEL_4,
    OF_LEVEL_3,
    OF_LEVEL_4,
    Processor,
    describe,
    differences,
    own_processor,
    package_versions,
)

SHOW = "from commonrail.compiler.target import describe; print('|'.join(describe().machine.values()))"


def shown(**environment: str) -> list[str]:
    line = [sys.executable, "-c", SHOW]
    done = subprocess.run(line, env=os.environ | environment, capture_output=True, text=True, check=True)
    return done.stdout.strip().split("|")


def test_the_target_is_the_processor_that_lanes_are_compiled_for() -> None:
    import llvmlite.binding as llvm

    describe.cache_clear()
    found = describe()
    assert found.triple == llvm.get_process_triple()
    assert found.cpu == own_processor().name
    assert dict(found.versions) == package_versions()
    assert set(found.record) == {*dict(found.versions), *found.machine}


@pytest.mark.parametrize(
    ("lacking", "level"), [((), LEVEL_4), (("avx512bw",), LEVEL_3), (("avx512bw", "fma"), None)], ids=str
)
def test_the_highest_level_that_the_processor_has_is_compiled_for(
    monkeypatch: pytest.MonkeyPatch, lacking: tuple[str, ...], level: Processor | None
) -> None:
    import llvmlite.binding as llvm

    has = llvm.FeatureMap(dict.fromkeys(OF_LEVEL_3 + OF_LEVEL_4, True) | dict.fromkeys(lacking, False))
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(llvm, "get_host_cpu_features", lambda: has)
    for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"):
        monkeypatch.delenv(name, raising=False)
    found = own_processor()
    assert found == level if level else found.name == llvm.get_host_cpu_name()
    monkeypatch.setenv("COMMONRAIL_KERNELS", "v3")
    assert own_processor() == (LEVEL_3 if level else found)


@pytest.mark.process
def test_another_target_on_the_same_processor_is_seen() -> None:
    own, generic = list(describe().machine.values()), shown(NUMBA_CPU_NAME="generic")
    assert generic[1:3] == ["generic", ""]
    assert own[1] != "generic"
    assert own[3] == generic[3]


def test_differences_are_a_part_of_a_sentence() -> None:
    before = {"cpu": "znver3", "features": "+avx,+avx2,-avx512f", "numba": "0.62", "processor": "x86_64 AMD EPYC"}
    assert differences(before, before) == ""
    assert differences(before, before | {"cpu": "generic"}) == "cpu znver3, now generic"
    now = before | {"features": "+avx,-avx2,+avx512f", "numba": "0.63"}
    text = "instruction sets, now without avx2 and with avx512f; numba 0.62, now 0.63"
    assert differences(before, now) == text
    assert differences(before, before | {"features": "+avx,+avx2"}).startswith("instruction sets")
    many = before | {"features": ",".join(f"+{name}" for name in "abcdefgh")}
    assert re.search(r"without avx, avx2 .*with a, b, c, d, e, f \.\.\.$", differences(before, many))


FLAGS = "flags\t\t: fpu sse2 avx2 bmi1 bmi2 f16c fma abm movbe"
WIDER = "avx512f avx512bw avx512cd avx512dq avx512vl"


@pytest.mark.parametrize(
    ("text", "switch", "name"),
    [
        (f"processor\t: 0\n{FLAGS} {WIDER}\nprocessor\t: 1\nflags\t\t: fpu\n", "", "x86-64-v4"),
        (f"{FLAGS} {WIDER}\n", "v3", "x86-64-v3"),
        (f"{FLAGS}\n", "", "x86-64-v3"),
        (f"{FLAGS} {WIDER.replace('avx512vl', '')}\n", "", "x86-64-v3"),
        (f"{FLAGS.replace('abm', '')}\n", "", "unknown"),
        ("Features\t: asimd\n", "", "unknown"),
        (None, "", "unknown"),
    ],
)
def test_without_llvmlite_the_level_is_what_the_system_states(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str | None, switch: str, name: str
) -> None:
    if text is not None:
        (tmp_path / "cpuinfo").write_text(text, encoding="ascii")
    monkeypatch.setattr(target, "CPU_FACTS", tmp_path / "cpuinfo")
    monkeypatch.setattr(target, "_llvm", lambda: None)
    monkeypatch.setenv(target.SWITCH, switch)
    assert target.own_processor() == target.Processor(name)


@pytest.mark.skipif(sys.platform != "linux", reason="the flags of a processor are read from Linux")
def test_without_llvmlite_a_run_states_the_same_target(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that it may be resumed in an environment with llvmlite, and the other way round."""
    known = target.describe.__wrapped__()
    if known.cpu not in (LEVEL_3.name, LEVEL_4.name):
        pytest.skip(f"libraries hold no code for {known.cpu}, so nothing is simulated here without llvmlite")
    monkeypatch.setattr(target, "_llvm", lambda: None)
    found = target.describe.__wrapped__()
    assert (found.cpu, found.processor) == (known.cpu, known.processor)
    assert found.triple.split("-")[0] == known.triple.split("-")[0]
