"""Starting points: feasible by construction, and uniform."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space, sample_feasible, sample_uniform


def unit_box(d: int, constraints: list[str], scale: str = "linear") -> Space:
    lower = 1.0 if scale == "log" else 0.0
    return Space(
        [
            Parameter(f"a{i}", 2.0, lower, 100.0, "1", mark="E", source="test", scale=scale)  # type: ignore[arg-type]
            for i in range(d)
        ],
        constraints,
    )


def rejection(space: Space, n: int, rng: np.random.Generator) -> np.ndarray:
    """The slow obvious twin: draw in the box until n points satisfy the space."""
    kept: list[np.ndarray] = []
    while sum(map(len, kept)) < n:
        x = sample_uniform(space, 500_000, rng)
        kept.append(x[space.satisfies(x)])
    return np.vstack(kept)[:n]


def assert_same_moments(drawn: np.ndarray, expected: np.ndarray) -> None:
    """Means and spreads agree within five standard errors of both samples."""
    n = min(len(drawn), len(expected))
    spread = expected.std(axis=0)
    # Standard error of a mean difference: spread sqrt(2/n); of a relative spread: about sqrt(1/n).
    assert (np.abs(drawn.mean(axis=0) - expected.mean(axis=0)) < 5 * np.sqrt(2 / n) * spread).all()
    assert (np.abs(drawn.std(axis=0) / spread - 1.0) < 5.0 * np.sqrt(1.0 / n)).all()
    correlation = np.corrcoef(drawn.T) - np.corrcoef(expected.T)
    assert np.abs(correlation).max() < 5.0 * np.sqrt(2.0 / n)


@pytest.mark.parametrize(("percent", "share"), [(100.0, 0.0030), (20.0, 0.11)])
def test_share_of_the_box_that_keeps_the_ordering(paper_space, percent: float, share: float) -> None:
    space = paper_space(percent)
    x = sample_uniform(space, 400_000, np.random.default_rng(3))
    # Published to two digits; 1200 hits at 0.3 % leave 3 % of noise.
    assert space.satisfies(x).mean() == pytest.approx(share, rel=0.08)


@pytest.mark.parametrize(("percent", "k1_max"), [(60.0, None), (100.0, 150.0)])
def test_draws_are_uniform_on_the_papers_polytope(paper_space, percent, k1_max) -> None:
    space = paper_space(percent, k1_max)
    rng = np.random.default_rng(11)
    drawn = space.to_unit(sample_feasible(space, 3000, rng))
    assert_same_moments(drawn, space.to_unit(rejection(space, 3000, rng)))


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("d", [2, 7, 12])
def test_an_ordering_in_one_box_gives_order_statistics(d: int, scale: str) -> None:
    space = unit_box(d, [" < ".join(f"a{i}" for i in range(d))], scale)
    n = 3000
    unit = space.to_unit(sample_feasible(space, n, np.random.default_rng(d)))
    rank = np.arange(1, d + 1)
    mean = rank / (d + 1)  # of the Beta(rank, d + 1 - rank) distribution
    spread = np.sqrt(rank * (d + 1 - rank) / (d + 2)) / (d + 1)
    # Five standard errors of a mean, and about as many of a spread.
    assert (np.abs(unit.mean(axis=0) - mean) < 5.0 * spread / np.sqrt(n)).all()
    assert (np.abs(unit.std(axis=0) / spread - 1.0) < 5.0 / np.sqrt(n)).all()


def test_a_ratio_of_logarithmic_parameters_is_a_straight_row() -> None:
    space = unit_box(2, ["5*a0 < a1"], "log")
    n = 3000
    unit = space.to_unit(sample_feasible(space, n, np.random.default_rng(4)))
    # A right triangle of sides s = 1 - ln 5/ln 100: means s/3 from its sides, variance s^2/18.
    side = 1.0 - np.log(5.0) / np.log(100.0)
    error = 5.0 * side / np.sqrt(18.0 * n)
    assert unit[:, 0].mean() == pytest.approx(side / 3.0, abs=error)
    assert unit[:, 1].mean() == pytest.approx(1.0 - side / 3.0, abs=error)


def test_a_curved_constraint_between_scales() -> None:
    parameters = [
        Parameter("gap", 10.0, 1.0, 100.0, "1", mark="E", source="test", scale="log"),
        Parameter("lift", 10.0, 0.0, 100.0, "1", mark="E", source="test"),
        Parameter("seat", 10.0, 1.0, 100.0, "1", mark="E", source="test", scale="log"),
    ]
    space = Space(parameters, ["gap + lift < 60", "2*gap < seat"])
    rng = np.random.default_rng(5)
    drawn = sample_feasible(space, 4000, rng)
    assert space.satisfies(drawn).all()
    assert_same_moments(space.to_unit(drawn), space.to_unit(rejection(space, 4000, rng)))


@settings(max_examples=30, deadline=None)
@given(
    st.permutations(range(5)),
    st.lists(st.tuples(st.floats(0, 1), st.floats(0.2, 1)), min_size=5, max_size=5),
    st.lists(st.integers(-3, 3), min_size=5, max_size=5).filter(any),
    st.integers(0, 2**31),
)
def test_every_draw_is_feasible(order, boxes, coefficients, seed: int) -> None:
    """Boxes, an ordering and a general row through the middle of a point that keeps the order."""
    centre = np.empty(5)
    centre[list(order)] = np.linspace(2.0, 3.0, 5)
    parameters = [
        Parameter(f"a{i}", centre[i], centre[i] - low - 0.1, centre[i] + width, "1", mark="E",
                  source="test")
        for i, (low, width) in enumerate(boxes)
    ]  # fmt: skip
    total = float(np.dot(coefficients, centre))
    row = " + ".join(f"{c}*a{i}" for i, c in enumerate(coefficients)).replace("+ -", "- ")
    limit = f"{total + 0.05:.17g}"
    space = Space(parameters, [" < ".join(f"a{i}" for i in order), f"{row} <= {limit}"])
    x = sample_feasible(space, 10, np.random.default_rng(seed))
    assert space.satisfies(x).all()
    assert (np.diff(x[:, list(order)], axis=1) > 0.0).all()
    assert (x @ np.array(coefficients) <= total + 0.05 + 1e-9).all()
    assert len(np.unique(x[:, 0])) == 10  # chains are independent, and do move


def test_same_generator_same_draws(paper_space) -> None:
    space = paper_space(60.0)
    first = sample_feasible(space, 5, np.random.default_rng(1))
    again = sample_feasible(space, 5, np.random.default_rng(1))
    np.testing.assert_array_equal(first, again)


def test_without_constraints_the_draw_is_eq_17(paper_space) -> None:
    space = paper_space(60.0, ordered=False)
    rnd = np.random.default_rng(9).random((6, 7))
    expected = space.lower + rnd * (space.upper - space.lower)
    # The same product and sum, in another order at most: one unit in the last place.
    np.testing.assert_allclose(sample_feasible(space, 6, np.random.default_rng(9)), expected, rtol=1e-15)
