"""Kernels are compiled for this machine, unless Numba is told of another."""

from __future__ import annotations

import llvmlite.binding as llvm
import numba
import pytest

from commonrail.compiler.numba import has_registers_of_512_bits


@pytest.mark.parametrize(
    ("named", "own", "expected"),
    [(None, True, True), (None, False, False), ("", True, False), ("+avx2,+avx512vl", False, True)],
)
def test_features_that_numba_is_told_of_count_before_the_machines(
    monkeypatch: pytest.MonkeyPatch, named: str | None, own: bool, expected: bool
) -> None:
    monkeypatch.setattr(numba.config, "CPU_FEATURES", named)
    monkeypatch.setattr(llvm, "get_host_cpu_features", lambda: {"avx512vl": own})
    assert has_registers_of_512_bits() is expected
