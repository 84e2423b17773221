"""The loop over lanes is vectorised: packed divisions and roots on wide registers."""

from __future__ import annotations

import re

import llvmlite.binding as llvm
import numba
import numpy as np
import pytest

from commonrail.compile import _FASTMATH, compiler_choices
from commonrail.engine import lanes, plan
from commonrail.engine.block import make_loop
from commonrail.engine.lanes import VECTORS, Precision
from commonrail.engine.operating_point import OperatingPoint
from commonrail.injector.definition import Injector

pytestmark = [
    pytest.mark.skipif(
        not llvm.get_host_cpu_features().get("avx", False), reason="this machine has no AVX: no wide registers"
    ),
    pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the JIT is switched off: there is no machine code"),
]


@pytest.fixture(scope="module")
def assembly(regulated: Injector) -> str:
    """Text of the regulated variant's kernel, compiled anew: what comes from the cache has no text."""
    loop = numba.njit(
        make_loop(regulated.variant, VECTORS[Precision.F64]), nogil=True, fastmath=_FASTMATH, error_model="numpy"
    )
    theta = plan.candidate_matrix(regulated, (), np.empty((1, 0)))
    job = plan.make_job(regulated, theta, [OperatingPoint(160e6, 1e-4, horizon=1e-5)], 1e-6, True)
    misfit = lanes.Misfit.none(1)
    out = np.empty((1, 8, len(lanes.Outcome._fields)))
    with compiler_choices():
        loop(*job, *misfit, np.empty((0, 0, 0, 0)), out, 0, 1)
        return "\n".join(loop.inspect_asm().values())


def count(assembly: str, instruction: str, registers: str) -> int:
    return len(re.findall(rf"\b{instruction}\b[^\n]*%?[{registers}]mm\d", assembly))


def test_divisions_and_roots_are_packed(assembly: str) -> None:
    """A branch or an alias in any law stops the vectoriser silently: five times slower, same figures."""
    divisions, roots = count(assembly, "vdivpd", "yz"), count(assembly, "vsqrtpd", "yz")
    print("packed divisions:", divisions, "roots:", roots)
    # the step has 4 roots and about a dozen divisions
    assert divisions >= 8
    assert roots >= 4


def test_hardly_any_scalar_root_is_left(assembly: str) -> None:
    # outside the loop over lanes: sound speed and dampers when a candidate is set up, some twenty with unrolling
    scalar, packed = count(assembly, "vsqrtsd", "x"), count(assembly, "vsqrtpd", "yz")
    print("scalar roots:", scalar, "packed:", packed)
    assert scalar < 8 * 8


@pytest.mark.skipif(
    not llvm.get_host_cpu_features().get("avx512vl", False), reason="this machine has no registers of 512 bits"
)
def test_the_widest_registers_are_used(assembly: str) -> None:
    """The loop over lanes is optimised in its own function: what is allowed in the one around it does not reach it."""
    half = [line for line in assembly.splitlines() if re.search(r"\bv(div|sqrt)pd\b.*ymm", line)]
    assert count(assembly, "vdivpd", "z") >= 8
    assert count(assembly, "vsqrtpd", "z") >= 4
    assert not half


def test_the_stack_is_aligned_to_cache_lines(assembly: str) -> None:
    """Unaligned, half of the vectors that are kept on the stack straddle two lines, as the caller's stack has it."""
    assert re.search(r"\band[lq]?\s+\$-64, %rsp", assembly)
