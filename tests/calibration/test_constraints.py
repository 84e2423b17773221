"""Rows, the room they leave, and which of them conflict."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.constraints import (
    LinearConstraints,
    Polytope,
    conflicting_rows,
    deepest_point,
    parse_constraints,
)


def test_deepest_point_of_a_triangle_is_its_incentre() -> None:
    # Right triangle x, y >= 0, x + y <= 1: inradius (2 - sqrt 2)/2 in closed form.
    rows = parse_constraints(["x + y <= 1"], ["x", "y"])
    centre, radius = deepest_point(Polytope.of(rows, np.zeros(2), np.ones(2)))
    expected = (2.0 - np.sqrt(2.0)) / 2.0
    # The linear programme's own tolerance is 1e-7.
    np.testing.assert_allclose(centre, [expected, expected], atol=1e-6)
    assert radius == pytest.approx(expected, abs=1e-6)


def test_the_deepest_point_is_the_callers_to_change() -> None:
    polytope = Polytope.of(parse_constraints(["x + 2*y <= 1"], ["x", "y"]), np.zeros(2), np.ones(2))
    first = deepest_point(polytope)[0]
    kept = first.copy()
    first[:] = 7.0
    np.testing.assert_array_equal(deepest_point(polytope)[0], kept)


def test_polytopes_of_one_shape_are_told_apart() -> None:
    polytopes = [
        Polytope.of(parse_constraints([text], ["x", "y"]), np.zeros(2), np.ones(2))
        for text in ("x + y <= 1", "x + y <= 0.5", "x + 3*y <= 1")
    ]
    assert len({deepest_point(polytope)[1] for polytope in polytopes}) == 3


def test_rows_are_scaled_to_the_bounds() -> None:
    rows = parse_constraints(["x + y <= 1.5e9"], ["x", "y"])
    polytope = Polytope.of(rows, np.array([0.0, 1e9]), np.array([1e9, 2e9]))
    # In z: z1 + z2 <= 0.5, its row of unit length.
    np.testing.assert_allclose(polytope.rows[0], -np.ones(2) / np.sqrt(2.0))
    assert polytope.floor[0] == pytest.approx(-0.5 / np.sqrt(2.0))


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (["a < b", "b < c"], ()),
        (["a < b", "b < c", "c < a"], (0, 1, 2)),
        (["a < b", "a + b + c > 4", "b < c"], (1,)),
        (["a < c", "a > 0.5", "a < b", "b < 0.4"], (1, 2, 3)),
        (["a <= b", "b <= a"], (0, 1)),  # an equality leaves no room either
    ],
)
def test_conflicts_are_found_and_nothing_else_is_named(lines: list[str], expected: tuple[int, ...]) -> None:
    rows = parse_constraints(lines, ["a", "b", "c"])
    assert conflicting_rows(rows, np.zeros(3), np.ones(3)) == expected


@settings(max_examples=25, deadline=None)
@given(st.lists(st.permutations(range(4)).map(lambda p: p[:2]), min_size=1, max_size=6))
def test_a_conflict_of_orderings_is_a_cycle(pairs: list[list[int]]) -> None:
    """Orderings within one box conflict exactly if they form a cycle: checked by reachability."""
    names = list("wxyz")
    rows = parse_constraints([f"{names[i]} < {names[j]}" for i, j in pairs], names)
    conflict = conflicting_rows(rows, np.zeros(4), np.ones(4))
    assert bool(conflict) == cyclic(pairs)
    if conflict:
        assert cyclic([pairs[row] for row in conflict])
        for fewer in combinations(conflict, len(conflict) - 1):
            assert not cyclic([pairs[row] for row in fewer])


def cyclic(pairs: list[list[int]]) -> bool:
    reach = np.zeros((4, 4), dtype=int)
    for i, j in pairs:
        reach[i, j] = 1
    return any(np.trace(np.linalg.matrix_power(reach, power)) > 0 for power in range(1, 5))


@pytest.mark.parametrize(
    ("matrix", "lower", "why"),
    [
        ([[1.0, 0.0]], [0.0, 1.0], "as many"),
        ([[1.0, np.nan]], [0.0], "finite"),
        ([[0.0, 0.0]], [1.0], "free parameter"),
    ],
)
def test_malformed_rows_are_refused(matrix: list[list[float]], lower: list[float], why: str) -> None:
    with pytest.raises(ConfigurationError, match=why):
        LinearConstraints(np.array(matrix), np.array(lower))


def test_rows_cannot_be_changed_afterwards() -> None:
    rows = parse_constraints(["a < b"], ["a", "b"])
    with pytest.raises(ValueError, match="read-only"):
        rows.matrix[0, 0] = 5.0
