"""The loop over lanes is vectorised: packed arithmetic on wide registers, in one precision.

In the suite it is this machine's own kernels that are looked at, which other tests compile anyway. With the slow tests
a kernel is compiled for processors named here, whatever this machine has, and not run: what is asserted is a property
of the laws and of the compiler.
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from commonrail.base.choices import Precision
from commonrail.compiler.target import LEVEL_3, may_compile, own_processor
from commonrail.engine.job import VECTORS
from commonrail.engine.machine_code import object_of
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.physics.injector import Injector
from tests.verification.disassembly import MISSING, disassembled

ROOT = Path(__file__).resolve().parents[2]
X86_64 = platform.machine() in ("x86_64", "AMD64")
pytestmark = pytest.mark.skipif(
    not X86_64, reason=f"this machine is of kind {platform.machine()}: Numba compiles for no x86-64 processor here"
)


class Target(NamedTuple):
    """A processor by LLVM's name for it, the feature that decides on registers, and the precision of the kernel."""

    processor: str
    features: str
    precision: Precision

    @property
    def own(self) -> str:
        """Suffix of instructions on whole vectors of its precision."""
        return "pd" if self.precision is Precision.F64 else "ps"

    @property
    def other(self) -> str:
        """Suffix of those of the other precision."""
        return "ps" if self.precision is Precision.F64 else "pd"


WIDE = Target("skylake-avx512", "+avx512vl", Precision.F64)
SINGLE = WIDE._replace(precision=Precision.F32)
NARROW = Target("haswell", "+avx2", Precision.F64)


class Case(NamedTuple):
    """A target, and whether this machine's own kernel stands for it; else one is compiled for it by a process."""

    target: Target
    own: bool


def is_here(target: Target) -> bool:
    """Return whether this machine's own kernels have what is asserted of a target's."""
    processor = own_processor()
    narrow = processor == LEVEL_3 or "+avx2" in processor.features.split(",")
    own = {WIDE, SINGLE} if processor.is_wide else {NARROW} if narrow else set()
    return target in own and may_compile() and not MISSING


@pytest.fixture(scope="module")
def compiled(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, regulated: Injector, pwm: Injector
) -> tuple[Target, str]:
    """A target and the assembly text of the kernel for it."""
    case: Case = request.param
    if case.own:
        return case.target, own_assembly({WIDE: regulated, NARROW: regulated, SINGLE: pwm}[case.target], case.target)
    path = tmp_path_factory.mktemp("assembly") / "kernel.s"
    cross_compile(case.target, path)
    return case.target, path.read_text(encoding="utf-8")


def own_assembly(injector: Injector, target: Target) -> str:
    """Assembly text of the kernel that this machine runs, from its object file, which the cache keeps."""
    simulate_batch(injector, [OperatingPoint(160e6, 1e-4, horizon=1e-5)], precision=target.precision)
    return disassembled(object_of(injector.wired(), VECTORS[target.precision], own_processor())[0])


def cross_compile(target: Target, path: Path, *options: str) -> None:
    """Write the assembly text of the kernel that a process compiles for a target."""
    environment = os.environ | {"NUMBA_CPU_NAME": target.processor, "NUMBA_CPU_FEATURES": target.features}
    environment |= {"NUMBA_DISABLE_JIT": "0", "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [sys.executable, "-m", "tests.verification.cross_compile", target.precision.value, str(path), *options]
    subprocess.run(command, check=True, env=environment, cwd=ROOT)


def for_each(*targets: Target) -> pytest.MarkDecorator:
    """Run a test for this machine's own kernel, and with the slow tests for each of these targets.

    A target takes half a minute of processor time; one after the other, so that each is compiled once.
    """
    own = [Case(t, True) for t in targets if is_here(t)]
    cases = [pytest.param(case, id=f"own-{case.target.precision.value}") for case in own]
    if not own:
        names = " or ".join(sorted({t.features.lstrip("+") for t in targets}))
        cases = [pytest.param(None, id="own", marks=pytest.mark.skip(MISSING or f"kernels here are not for {names}"))]
    for t in targets:
        cases.append(pytest.param(Case(t, False), id=f"{t.processor}-{t.precision.value}", marks=pytest.mark.slow))
    return pytest.mark.parametrize("compiled", cases, indirect=True, scope="module")


def innermost_loop(assembly: str) -> str:
    """The shortest stretch between a label and a jump back to it that holds a packed root."""
    lines = assembly.splitlines()
    labels = {line.split(":")[0]: i for i, line in enumerate(lines) if re.match(r"\.?\w+:", line)}
    root = re.compile(r"\bv(rsqrt14|sqrt)p[sd]\b")
    found = []
    for i, line in enumerate(lines):
        jump = re.match(r"\s+j\w+\s+(\.?\w+)", line)
        start = labels.get(jump.group(1), i) if jump else i
        if start < i and any(map(root.search, lines[start:i])):
            found.append(lines[start:i])
    return "\n".join(min(found, key=len))


def packed(loop: str, suffix: str) -> int:
    """Arithmetic instructions on whole vectors of doubles (pd) or singles (ps)."""
    name = rf"\bv(add|sub|mul|div|sqrt|rsqrt14|rcp14|min|max|fn?m(add|sub)\d+){suffix}\b"
    return len(re.findall(name, loop))


def scalar(loop: str) -> int:
    return len(re.findall(r"\bv(div|sqrt|rsqrt14|rcp14)s[sd]\b", loop))


@for_each(WIDE, SINGLE, NARROW)
def test_the_step_is_vectorised_in_its_own_precision(compiled: tuple[Target, str]) -> None:
    """A branch or an alias in any law stops the vectoriser silently: five times slower, same figures.

    One constant or law left in double would draw its neighbours along: right figures at half the speed.
    """
    target, assembly = compiled
    loop = innermost_loop(assembly)
    own, other, single = packed(loop, target.own), packed(loop, target.other), scalar(loop)
    print(target, "packed:", own, "of the other precision:", other, "scalar:", single)
    # Apart from the step: clocks of the lanes, which are doubles in f32 too, and the volume of a sample, once a lane.
    assert other + single < 0.05 * own
    if target is WIDE:  # what is allowed in the function around the loop over lanes does not reach it
        assert not re.search(r"\bv(div|sqrt)pd\b.*ymm", loop)


@pytest.mark.slow
@pytest.mark.parametrize("target", [WIDE, NARROW], ids=lambda target: target.processor)
def test_nothing_is_fused_or_estimated_in_an_exact_kernel(tmp_path: Path, target: Target) -> None:
    """Rounding would depend on the processor. It calls no C library, and is packed as the usual one is."""
    cross_compile(target, tmp_path / "exact.s", "same_bits")
    text = (tmp_path / "exact.s").read_text(encoding="utf-8")
    assert not re.search(r"\bvfn?m(add|sub)", text)
    assert not re.search(r"\bv(rsqrt|rcp)", text)
    assert not re.findall(r"\bcallq?\s+(\S+)", text)
    assert re.findall(r"\bj\w+\s+(\S+)", text)  # the pattern finds where the code goes
    assert re.search(rf"\bvsqrtpd\b[^\n]*%?{'z' if target is WIDE else 'y'}mm", text)
