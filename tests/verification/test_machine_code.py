"""The loop over lanes is vectorised: packed divisions and roots on wide registers."""

from __future__ import annotations

import re

import llvmlite.binding as llvm
import numba
import numpy as np
import pytest

from commonrail.compile import _FASTMATH
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
    none = np.zeros((1, 0))
    misfit = lanes.Misfit(np.zeros(1, np.int64), none, none, none)
    out = np.empty((1, 8, len(lanes.Outcome._fields)))
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
