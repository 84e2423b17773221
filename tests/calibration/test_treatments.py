"""Treatments of trials that break bounds or constraints, and selection."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from commonrail.calibration.optimisers.evolution import Treatment, reflect, treat, wins
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space, sample_feasible

INF = np.inf


def box(names: str, constraints: list[str], scale: str = "linear") -> Space:
    lower = 1.0 if scale == "log" else 0.0
    return Space(
        [
            Parameter(n, 5.0, lower, 10.0, "1", mark="E", source="test", scale=scale)  # type: ignore[arg-type]
            for n in names
        ],
        constraints,
    )


def no_redraw(members: np.ndarray) -> np.ndarray:
    raise AssertionError("only resampling may draw again")


ORDERED = box("abc", ["a < b < c"])
PARENT = np.array([[0.2, 0.5, 0.8]])
BROKEN = np.array([[0.6, 0.3, 0.9]])
OUTSIDE = np.array([[-0.1, 0.5, 1.2]])


def test_reject_simulates_feasible_trials_only() -> None:
    trials = np.vstack([PARENT, BROKEN, OUTSIDE])
    treated = treat(Treatment.REJECT, ORDERED, np.tile(PARENT, (3, 1)), trials, no_redraw)
    assert treated.simulate.tolist() == [True, False, False]
    assert treated.violation.tolist() == [0.0, INF, INF]
    np.testing.assert_array_equal(treated.unit, trials)


def test_repair_sorts_an_ordering_and_reflects_bounds() -> None:
    trials = np.vstack([BROKEN, OUTSIDE, PARENT])
    treated = treat(Treatment.REPAIR, ORDERED, np.tile(PARENT, (3, 1)), trials, no_redraw)
    assert treated.simulate.all()
    # 0.6 and 0.3 change places; -0.1 and 1.2 come back to 0.1 and 0.8, in order already.
    expected = [[0.3, 0.6, 0.9], [0.1, 0.5, 0.8], [0.2, 0.5, 0.8]]
    # Through SI and back: a few roundings.
    np.testing.assert_allclose(treated.unit, expected, atol=1e-15)


def test_repair_pulls_a_general_row_to_the_parent() -> None:
    space = box("ab", ["a + b <= 10"])
    treated = treat(Treatment.REPAIR, space, np.array([[0.2, 0.2]]), np.array([[0.8, 0.8]]), no_redraw)
    # Along the diagonal the row ends at a = b = 5; it stops 1e-9 of the way short.
    np.testing.assert_allclose(treated.unit, [[0.5, 0.5]], atol=1e-9)
    assert space.satisfies(space.from_unit(treated.unit)).all()


def test_repair_of_equal_values_keeps_the_order_strict() -> None:
    trial = np.array([[0.4, 0.4, 0.4]])
    x = ORDERED.from_unit(treat(Treatment.REPAIR, ORDERED, PARENT, trial, no_redraw).unit)
    assert (np.diff(x) > 0.0).all()


def test_rules_reflect_bounds_and_grade_the_rest() -> None:
    trials = np.vstack([OUTSIDE, BROKEN])
    treated = treat(Treatment.FEASIBILITY_RULES, ORDERED, np.tile(PARENT, (2, 1)), trials, no_redraw)
    assert treated.simulate.tolist() == [True, False]
    # a exceeds b by 0.3 of the range of each; the row can vary by both ranges.
    assert treated.violation[1] == pytest.approx(0.15, rel=1e-6)


def test_resample_takes_the_first_feasible_redraw_and_repairs_the_rest() -> None:
    trials = np.vstack([PARENT, BROKEN, BROKEN])
    redraws = np.array([[[0.9, 0.2, 0.3], [0.1, 0.2, 0.3], [0.3, 0.4, 0.5]], [[0.9, 0.8, 0.7]] * 3])
    asked: list[list[int]] = []

    def redraw(members: np.ndarray) -> np.ndarray:
        asked.append(members.tolist())
        return redraws

    treated = treat(Treatment.RESAMPLE, ORDERED, np.tile(PARENT, (3, 1)), trials, redraw)
    assert asked == [[1, 2]]
    expected = [[0.2, 0.5, 0.8], [0.1, 0.2, 0.3], [0.3, 0.6, 0.9]]
    np.testing.assert_allclose(treated.unit, expected, atol=1e-15)
    assert treated.simulate.all()


@pytest.mark.parametrize(("outside", "inside"), [(-0.25, 0.25), (1.25, 0.75), (0.4, 0.4), (2.0, 0.0), (-1.0, 1.0)])
def test_reflection(outside: float, inside: float) -> None:
    assert reflect(np.array([outside]))[0] == inside


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([Treatment.REPAIR, Treatment.RESAMPLE]),
    st.sampled_from(["linear", "log"]),
    st.integers(0, 2**31),
)
def test_repaired_trials_are_always_feasible(treatment: Treatment, scale: str, seed: int) -> None:
    """Two orderings that share parameters and a general row: sorting alone does not do."""
    space = box("abcd", ["a < b < c", "d < b", "2*a + b + d <= 21.5"], scale)
    rng = np.random.default_rng(seed)
    parents = space.to_unit(sample_feasible(space, 30, rng))
    trials = rng.uniform(-1.0, 2.0, parents.shape)
    treated = treat(treatment, space, parents, trials, lambda rows: rng.uniform(-1, 2, (len(rows), 3, 4)))
    x = space.from_unit(treated.unit)
    a, b, c, d = x.T
    assert ((a < b) & (b < c) & (d < b)).all()
    # The general row forgives 1e-12 of its magnitude, 40.
    assert (2 * a + b + d <= 21.5 + 4e-11).all()
    assert ((x >= space.lower) & (x <= space.upper)).all()


@pytest.mark.parametrize("treatment", list(Treatment))
@pytest.mark.parametrize("scale", ["linear", "log"])
def test_points_in_si_are_those_of_the_unit_coordinates_bit_by_bit(treatment: Treatment, scale: str) -> None:
    space = box("abcd", ["a < b < c", "d < b", "2*a + b + d <= 21.5"], scale)
    rng = np.random.default_rng(5)
    for _ in range(20):
        parents = space.to_unit(sample_feasible(space, 30, rng))
        trials = np.where(rng.random(parents.shape) < 0.7, parents, rng.uniform(-1.0, 2.0, parents.shape))
        treated = treat(treatment, space, parents, trials, lambda rows: rng.uniform(-1, 2, (len(rows), 3, 4)))
        np.testing.assert_array_equal(treated.x, space.from_unit(treated.unit))


def test_a_parent_stands_in_whole_where_rounding_tips_a_row() -> None:
    # Parents outside the space: pulling back gives them up as they are, and then every row is tipped.
    space = box("ab", ["a + b <= 10"], "log")
    rng = np.random.default_rng(8)
    parents = rng.uniform(0.75, 1.2, (60, 2))
    sound = np.arange(60)[:, None] % 3 == 0
    trials = np.where(sound, 0.25, rng.uniform(0.8, 0.99, (60, 2)))
    treated = treat(Treatment.REPAIR, space, parents, trials, no_redraw)
    expected = np.where(sound, trials, parents)
    np.testing.assert_array_equal(treated.unit, expected)
    np.testing.assert_array_equal(treated.x, space.from_unit(expected))


def test_each_is_pulled_towards_its_own_parent() -> None:
    space = box("ab", ["a + b <= 10"])
    parents = np.array([[0.1, 0.1], [0.1, 0.3], [0.3, 0.1]])
    trials = np.array([[0.2, 0.2], [0.9, 0.7], [0.7, 0.9]])
    treated = treat(Treatment.REPAIR, space, parents, trials, no_redraw)
    # From (1, 3) along (8, 4) to a + b = 10: half the way; the other is its mirror image. It stops 1e-9 short.
    np.testing.assert_allclose(treated.unit, [[0.2, 0.2], [0.5, 0.5], [0.5, 0.5]], atol=2e-9)


@pytest.mark.parametrize(
    ("trial", "parent", "expected"),
    [
        ((1.0, 0.0), (2.0, 0.0), True),
        ((2.0, 0.0), (2.0, 0.0), True),  # Eq. (20): <=
        ((2.1, 0.0), (2.0, 0.0), False),
        ((INF, 0.0), (2.0, 0.0), False),
        ((INF, 0.0), (INF, 0.0), False),  # a failure never wins, not even over a failure
        ((9.0, 0.0), (INF, 0.0), True),
        ((9.0, 0.0), (INF, 0.3), True),  # feasible beats infeasible
        ((INF, 0.0), (INF, 0.3), False),
        ((INF, 0.2), (INF, 0.3), True),  # less violation beats more
        ((INF, 0.3), (INF, 0.3), True),
        ((INF, 0.4), (INF, 0.3), False),
        ((INF, 0.1), (9.0, 0.0), False),
        ((INF, INF), (INF, INF), False),  # rejected
        ((INF, INF), (2.0, 0.0), False),
    ],
)
def test_selection(trial: tuple[float, float], parent: tuple[float, float], expected: bool) -> None:
    def arrays(pair: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        return np.array([pair[0]]), np.array([pair[1]])

    assert wins(arrays(trial), arrays(parent)).tolist() == [expected]
