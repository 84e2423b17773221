"""Counting what a step is made of."""

from __future__ import annotations

import shutil

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
