"""The box cut by constraints: coordinates, feasibility, violation, segments."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.constraints import LinearConstraints
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space


def parameter(name: str, lower: float, upper: float, scale: str = "linear") -> Parameter:
    reference = 0.5 * (lower + upper)
    return Parameter(
        name,
        reference,
        lower,
        upper,
        "m",
        mark="E",
        source="test",
        scale=scale,  # type: ignore[arg-type]
    )


MIXED = Space([parameter("gap", 1e-6, 1e-4, "log"), parameter("lift", 2e-4, 8e-4)])


def test_unit_coordinates_by_hand() -> None:
    # Half of two decades on the logarithmic scale, a quarter of the way on the linear one.
    np.testing.assert_allclose(MIXED.from_unit([0.5, 0.25]), [1e-5, 3.5e-4], rtol=1e-14)
    np.testing.assert_allclose(MIXED.to_unit([[1e-5, 3.5e-4]]), [[0.5, 0.25]], rtol=1e-14)


def test_bounds_are_met_exactly() -> None:
    np.testing.assert_array_equal(MIXED.from_unit([[0.0, 0.0], [1.0, 1.0]])[0], MIXED.lower)
    np.testing.assert_array_equal(MIXED.from_unit([[0.0, 0.0], [1.0, 1.0]])[1], MIXED.upper)
    np.testing.assert_array_equal(MIXED.to_unit([MIXED.lower, MIXED.upper]), [[0, 0], [1, 1]])


@given(st.floats(0, 1), st.floats(0, 1))
def test_unit_coordinates_round_trip_within_bounds(u: float, v: float) -> None:
    x = MIXED.from_unit([u, v])
    assert MIXED.satisfies(x)
    # The logarithmic scale rounds an exponential of up to ln 100: a few units in the last place.
    np.testing.assert_allclose(MIXED.to_unit(x), [u, v], atol=1e-14)


def test_an_upper_bound_that_rounding_misses_is_met() -> None:
    spans = [(low, high) for low in np.linspace(0.1, 0.9, 17).tolist() for high in np.linspace(1.1, 2.9, 19).tolist()]
    short = [(low, high) for low, high in spans if low + (high - low) < high]
    assert short
    space = Space([Parameter(f"p{i}", a, a, b, "1", mark="E", source="test") for i, (a, b) in enumerate(short)])
    np.testing.assert_array_equal(space.from_unit(np.ones(len(short))), space.upper)


def test_bounds_do_not_depend_on_what_else_is_mapped() -> None:
    rng = np.random.default_rng(3)
    unit = rng.choice([0.0, 1.0, -0.2, 1.3, 0.25, 1.0 - 2.0**-53, 2.0**-60, -(2.0**-60)], (200, 2))
    alone = np.array([MIXED.from_unit(row) for row in unit])
    np.testing.assert_array_equal(MIXED.from_unit(unit), alone)
    within = (unit >= 0.0) & (unit <= 1.0)
    assert np.array_equal((alone >= MIXED.lower) & (alone <= MIXED.upper) | ~within, np.ones_like(within))
    assert (np.where(unit == 1.0, alone == MIXED.upper, True) & np.where(unit == 0.0, alone == MIXED.lower, True)).all()
    far = np.abs(unit - 0.5) > 0.6
    assert not (far & (alone >= MIXED.lower) & (alone <= MIXED.upper)).any()


def test_points_outside_map_outside() -> None:
    assert not MIXED.satisfies(MIXED.from_unit([[-1e-9, 0.5], [0.5, 1.0 + 1e-9]])).any()


def test_ordering_and_bounds_are_both_asked_for() -> None:
    space = Space([parameter("a", 0.0, 1.0), parameter("b", 0.0, 2.0)], ["a < b"])
    points = [[0.2, 0.3], [0.3, 0.2], [0.3, 0.3], [0.5, 2.0], [0.5, 2.1], [np.nan, 1.0]]
    assert space.satisfies(points).tolist() == [True, False, False, True, False, False]


def test_a_strict_row_refuses_equality_and_a_weak_one_takes_it() -> None:
    pair = [parameter("a", 0.0, 1.0), parameter("b", 0.0, 1.0)]
    assert not Space(pair, ["a < b"]).satisfies([0.7, 0.7])
    assert Space(pair, ["a <= b"]).satisfies([0.7, 0.7])
    # 0.1 + 0.2 rounds above 0.3: forgiven where equality is allowed.
    assert Space(pair, ["a + 0.2 <= b"]).satisfies([0.1, 0.3])


def test_violation_by_hand() -> None:
    space = Space([parameter("a", 0.0, 1.0), parameter("b", 0.0, 4.0)], ["a <= b"])
    # a is 0.5 over, half of its range; a - b = 1.2 of the 5 that the row can vary by.
    assert space.violation([1.5, 0.3]) == pytest.approx(0.5 + 1.2 / 5.0)
    assert space.violation([0.2, 0.3]) == 0.0
    assert space.violation([[np.nan, 0.3]]).tolist() == [np.inf]


@given(st.lists(st.floats(-1, 2), min_size=2, max_size=2))
def test_violation_is_zero_exactly_where_the_space_is_satisfied(point: list[float]) -> None:
    space = Space([parameter("a", 0.0, 1.0), parameter("b", 0.0, 1.0)], ["a < b"])
    assert (space.violation(point) == 0.0) == bool(space.satisfies(point))


def test_slack_is_the_distance_to_the_limit() -> None:
    space = Space([parameter("a", 0.0, 1.0), parameter("b", 0.0, 4.0)], ["a <= b", "a + b >= 1"])
    np.testing.assert_allclose(space.slack([0.5, 2.0]), [1.5, 1.5])


def test_pull_back_finds_the_boundary() -> None:
    space = Space([parameter("a", 0.0, 1.0), parameter("b", 0.0, 1.0)], ["a <= b"])
    anchor = np.array([[0.2, 0.6], [0.2, 0.6], [0.2, 0.6]])
    goal = np.array([[0.6, 0.2], [0.2, 2.6], [0.3, 0.4]])
    # a = b at the middle; b = 1 a fifth of the way; the last needs no change. It stops 1e-9 of
    # the way short of the boundary.
    expected = [[0.4, 0.4], [0.2, 1.0], [0.3, 0.4]]
    pulled = space.pull_back(anchor, goal)
    np.testing.assert_allclose(pulled, expected, atol=2e-9)
    np.testing.assert_array_equal(pulled[2], goal[2])
    assert space.satisfies(pulled).all()


def test_pull_back_leaves_rounding_no_say() -> None:
    """Short of the boundary, the row holds without any tolerance, in whatever order it is added."""
    space = Space([parameter(n, 0.0, 1.0) for n in "abc"], ["0.1*a + 0.2*b + 0.3*c <= 0.35"])
    rng = np.random.default_rng(0)
    anchor = rng.random((2000, 3)) * 0.5
    a, b, c = space.pull_back(anchor, 1.0 + rng.random((2000, 3))).T
    assert (0.1 * a + 0.2 * b + 0.3 * c <= 0.35).all()
    assert (0.3 * c + 0.2 * b + 0.1 * a <= 0.35).all()


def test_pull_back_from_a_corner_stays_there() -> None:
    space = Space([parameter("a", 0.0, 1.0), parameter("b", 0.0, 1.0)], ["a <= b"])
    np.testing.assert_array_equal(space.pull_back([[0.0, 0.0]], [[0.5, -1.0]]), [[0.0, 0.0]])


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3), st.integers(0, 2**32 - 1))
def test_pull_back_always_satisfies(goal: list[float], seed: int) -> None:
    space = Space([parameter(n, 0.0, 1.0) for n in "abc"], ["a < b < c", "a + b + c <= 1.7"])
    inside = np.sort(np.random.default_rng(seed).random((20, 3)))
    inside = inside[space.satisfies(inside)]
    assert space.satisfies(space.pull_back(inside, np.tile(goal, (len(inside), 1)))).all()


def test_conflict_names_constraint_bounds_and_unit() -> None:
    pair = [parameter("sac.length", 2.0, 3.0), parameter("nozzle.length", 0.0, 1.0)]
    with pytest.raises(ConfigurationError) as caught:
        Space(pair, ["sac.length < nozzle.length"])
    text = str(caught.value)
    assert '"sac.length < nozzle.length"' in text
    assert "sac.length 2 to 3 m" in text
    assert "\n" not in text


def test_an_ordering_that_the_bounds_forbid_is_refused(paper_space) -> None:
    # Table 1: k4 is 0.1 % above k5, so at +-0.01 % the paper's order holds and its reverse cannot.
    parameters = paper_space(0.01).parameters
    with pytest.raises(ConfigurationError, match="k4 < k5"):
        Space(parameters, ["k4 < k5"])


@pytest.mark.parametrize(
    ("parameters", "constraints", "why"),
    [
        ([], (), "least one"),
        ([parameter("a", 0, 1), parameter("a", 0, 1)], (), "a .*than once"),
        ([parameter("a", 0, 1)], LinearConstraints(np.ones((1, 2)), np.zeros(1)), "2 columns"),
    ],
)
def test_inconsistent_spaces_are_refused(parameters, constraints, why: str) -> None:
    with pytest.raises(ConfigurationError, match=why):
        Space(parameters, constraints)


def test_centre_satisfies_the_papers_ordering(paper_space) -> None:
    space = paper_space(100.0)
    assert space.satisfies(space.centre)
    assert (space.slack(space.centre) > 1e5).all()  # N/m: well inside, not on an edge
