"""Counting what a step is made of."""

from __future__ import annotations

import shutil

import llvmlite.binding as llvm
import pytest

from benchmarks import roofline

STEP = """
\tvdivpd\t%zmm1, %zmm2, %zmm3
\tvsqrtpd\t%zmm3, %zmm3
\tvmulpd\t64(%rbx), %zmm3, %zmm4  # a load, too
\tvfmadd231pd\t128(%rsp), %zmm3, %zmm4
\tvcmpltpd\t%zmm3, %zmm4, %k1
\tvmovapd\t%zmm4, 192(%rsp)
\tvmulsd\t%xmm1, %xmm2, %xmm3
"""


def test_instructions_are_counted_by_kind() -> None:
    found = roofline.counts([line.strip() for line in STEP.split("#")[0].splitlines() if line.strip()])
    assert found["divisions"] == 1
    assert found["roots"] == 1
    assert found["multiply, add"] == 1


def test_loads_and_stores_are_counted_where_they_are_operands() -> None:
    lines = [line.split("#")[0].strip() for line in STEP.splitlines() if line.strip()]
    found = roofline.counts(lines)
    assert found["loads"] == 2
    assert found["stores"] == 1
    assert found["on the stack"] == 2
    assert found["compare, select, min, max"] == 1


def test_only_long_pieces_of_vector_arithmetic_are_the_step() -> None:
    wide, narrow = "\tvaddpd\t%zmm1, %zmm2, %zmm3\n", "\tvaddpd\t%xmm1, %xmm2, %xmm3\n"
    text = 50 * narrow + ".LBB0_1:\n" + 50 * wide + "\tjne\t.LBB0_1\n" + 30 * wide
    assert len(roofline.step_block(text)) == 50


@pytest.mark.skipif(shutil.which("llvm-mca") is None, reason="there is no llvm-mca")
def test_the_bound_of_divisions_alone() -> None:
    # a division of 512 bits keeps its port 16 cycles (Intel since Skylake) or 8 to 10 (AMD since Zen 4)
    bound = roofline.port_bound(["vdivpd %zmm1, %zmm2, %zmm3"] * 10)
    assert bound is None or 50.0 <= bound <= 250.0


def test_nothing_waits_in_the_measured_bound() -> None:
    lines = [line.split("#")[0].strip() for line in STEP.splitlines() if line.strip()]
    made = roofline.without_waiting(lines)
    assert made[0] == "vdivpd %zmm31, %zmm30, %zmm0"
    assert made[2] == "vmulpd 64(%rsi), %zmm30, %zmm2"
    assert made[3] == "vfmadd231pd 128(%rdx), %zmm30, %zmm3"
    assert made[5] == "vmovapd %zmm31, 192(%rdx)"
    assert len(made) == 6  # the scalar one is left out


@pytest.mark.skipif(
    not llvm.get_host_cpu_features().get("avx512vl", False), reason="this machine has no registers of 512 bits"
)
def test_the_measured_bound_of_divisions_is_that_of_their_port() -> None:
    """They wait for their port alone: ten of them cannot take less than 40 cycles, nor as long as one after another."""
    seconds = roofline.measured_bound(["vdivpd %zmm1, %zmm2, %zmm3"] * 10)
    assert seconds is not None
    assert 40.0 < seconds * roofline.clock() < 240.0 * 2.0  # others may use the machine meanwhile
