"""Counting what a step is made of."""

from __future__ import annotations

import platform

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
\tvandpd\t.LCPI0_0(%rip){1to8}, %zmm3, %zmm5
"""
LINES = [line.split("#")[0].strip() for line in STEP.splitlines() if line.strip()]


def test_nothing_waits_in_the_measured_bound() -> None:
    made = roofline.without_waiting(LINES)
    assert made[0] == "vdivpd %zmm31, %zmm30, %zmm0"
    assert made[2] == "vmulpd 64(%rsi), %zmm30, %zmm2"
    assert made[3] == "vfmadd231pd 128(%rdx), %zmm30, %zmm3"
    assert made[5] == "vmovapd %zmm31, 192(%rdx)"
    assert made[6] == "vandpd (%rsi){1to8}, %zmm30, %zmm4"  # a named constant
    assert len(made) == 7  # the scalar one is left out


@pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64"), reason=f"the assembler here is that of {platform.machine()}"
)
def test_what_is_measured_can_be_assembled() -> None:
    """For a processor with registers of 512 bits, whatever this machine has; it is not run."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    llvm.initialize_native_asmparser()
    machine = llvm.Target.from_default_triple().create_target_machine(cpu="skylake-avx512")
    made = machine.emit_assembly(llvm.parse_assembly(roofline.repeat_block(LINES)))
    wide = [line.strip().replace("\t", " ") for line in made.splitlines() if "zmm" in line]
    assert wide[2:] == roofline.without_waiting(LINES)


def test_cycles_and_shares_by_hand() -> None:
    found = roofline.figures(LINES, 1000, roofline.Times(2e-6, 4e-10, 4e9), 2.0)
    assert found["cycles_a_step"] == pytest.approx(8.0)  # 2 us at 4 GHz for 1000 steps
    assert found["cycles_without_waiting"] == pytest.approx(1.6)
    assert found["share_of_measured_bound"] == pytest.approx(0.2)
    assert found["share_of_bound"] == pytest.approx(0.25)
    assert found["gigahertz"] == 4.0
    assert (found["instructions"], found["divisions"], found["stores"]) == (8, 1, 1)


def test_what_was_not_measured_is_left_out() -> None:
    found = roofline.figures(LINES, 1000, roofline.Times(2e-6, None, 4e9), None)
    missing = {"bound_cycles", "share_of_bound", "cycles_without_waiting", "share_of_measured_bound"}
    assert {name for name, value in found.items() if value is None} == missing
