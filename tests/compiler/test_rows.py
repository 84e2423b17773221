"""Operations of kernels on whole rows of lanes."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import pytest

from commonrail.compiler.laws import row_tester


@pytest.mark.parametrize(("lanes", "real"), [(8, np.float64), (16, np.float32), (4, np.float64)])
@pytest.mark.parametrize("value", [1.0, -1e-30, math.nan])
def test_any_number_of_a_row_is_found_and_none_beside_it(lanes: int, real: Any, value: float) -> None:
    any_of = row_tester(lanes)

    @numba.njit  # type: ignore[untyped-decorator]
    def found(rows: Any, first: int) -> bool:
        return any_of(rows, first)

    rows = np.zeros(3 * lanes, real)
    rows[1] = -0.0
    assert not found(rows, 0)
    for i in range(3 * lanes):
        rows[:] = 0.0
        rows[i] = value
        assert [found(rows, row * lanes) for row in range(3)] == [row == i // lanes for row in range(3)]
