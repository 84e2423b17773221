"""Reading constraints that a person wrote."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from commonrail.base.errors import CommonrailError, ConfigurationError, InputError
from commonrail.calibration.constraints import parse_constraints

NAMES = ("plunger_needle.k1", "plunger_needle.k2", "plunger_needle.k3", "a", "b")


def test_ordering_gives_one_row_less_than_parameters() -> None:
    names = [f"k{i}" for i in range(1, 8)]
    rows = parse_constraints(["k7 < k2 < k3 < k5 < k4 < k1 < k6"], names)
    # Eq. (14), (15) written out by hand, columns k1 ... k7.
    expected = [
        [0, 1, 0, 0, 0, 0, -1],
        [0, -1, 1, 0, 0, 0, 0],
        [0, 0, -1, 0, 1, 0, 0],
        [0, 0, 0, 1, -1, 0, 0],
        [1, 0, 0, -1, 0, 0, 0],
        [-1, 0, 0, 0, 0, 1, 0],
    ]
    np.testing.assert_array_equal(rows.matrix, expected)
    np.testing.assert_array_equal(rows.lower, np.zeros(6))
    assert rows.strict_rows.all()
    assert rows.chains == ((6, 1, 2, 4, 3, 0, 5),)


@pytest.mark.parametrize(
    ("text", "matrix", "lower", "strict"),
    [
        ("2*a + 3*b <= 5", [0, 0, 0, -2, -3], -5.0, False),
        ("a > b", [0, 0, 0, 1, -1], 0.0, True),
        ("-a - 1.5e-3*b >= -2e-6 + a", [0, 0, 0, -2, -1.5e-3], -2e-6, False),
        ("1 < plunger_needle.k2", [0, 1, 0, 0, 0], 1.0, True),
        ("a+b<4-.5*a", [0, 0, 0, -1.5, -1], -4.0, True),
        ("+a <= 3", [0, 0, 0, -1, 0], -3.0, False),
    ],
)
def test_general_rows(text: str, matrix: list[float], lower: float, strict: bool) -> None:
    rows = parse_constraints([text], NAMES)
    np.testing.assert_array_equal(rows.matrix, [matrix])
    assert rows.lower[0] == lower
    assert rows.strict_rows[0] == strict
    assert rows.labels == (text,)


def test_descending_chain_is_kept_ascending_and_sums_are_no_chain() -> None:
    rows = parse_constraints(["b >= a >= plunger_needle.k1", "2*a < b", "a < 3"], NAMES)
    assert rows.chains == ((0, 3, 4),)


def test_a_chain_that_turns_is_rows_but_no_ordering() -> None:
    rows = parse_constraints(["a < b > plunger_needle.k1"], NAMES)
    assert len(rows) == 2
    assert rows.chains == ()


def test_unknown_name_offers_the_nearest() -> None:
    with pytest.raises(InputError, match=r'"plunger_needel\.k2".*"plunger_needle\.k'):
        parse_constraints(["plunger_needel.k2 < a"], NAMES)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "has no"),
        ("a + b", "has no"),
        ("a = b", '"a = b" where a'),
        ("a == b", '"a == b" where a'),
        ("a < b ; import os", '"b ; import os" where a'),
        ("__import__('os') < a", "where a"),
        ("a < ", "has nothing"),
        ("a + < b", "has nothing"),
        ("a b < 3", '"a b" where a'),
        ("a*2 < b", r'"a\*2" where a'),
        ("a*b < 3", r'"a\*b" where a'),
        ("2*3*a < b", "where a"),
        ("1e999*a < b", "too large"),
        ("a < a", "free parameter"),
        ("1 < 2", "free parameter"),
        ("2a < b", '"2a" where a'),
        ("\u0663*a < b", "where a"),  # a digit, but not one of a number in a study
        ("(lambda: a)() < b", "where a"),
        ("1" * 100_000 + "x < a", "where a"),
        ("-" * 100_000 + "a < b", "has nothing"),
        ("(" * 100_000 + "a < b", "where a"),
    ],
)
def test_unreadable_text_is_refused_in_one_sentence(text: str, why: str) -> None:
    with pytest.raises(CommonrailError, match=why) as caught:
        parse_constraints([text], NAMES)
    assert "\n" not in str(caught.value)


@given(st.text(alphabet="ab12.*+-<>= e\tk_é(", max_size=20))
def test_any_text_gives_rows_or_one_of_our_errors(text: str) -> None:
    try:
        rows = parse_constraints([text], NAMES)
    except CommonrailError:
        return
    assert np.isfinite(rows.matrix).all()
    assert np.isfinite(rows.lower).all()


@given(
    st.lists(st.integers(-5, 5), min_size=2, max_size=2),
    st.lists(st.integers(-5, 5), min_size=2, max_size=2),
    st.sampled_from(["<", "<=", ">", ">="]),
    st.lists(st.floats(-10, 10), min_size=2, max_size=2),
)
def test_rows_mean_what_python_says(left: list[int], right: list[int], relation: str, point: list[float]) -> None:
    text = f"{left[0]}*a + {left[1]}*b {relation} {right[0]}*a - {abs(right[1])}"
    text = text.replace("+ -", "- ")
    a, b = point
    difference = (left[0] * a + left[1] * b) - (right[0] * a - abs(right[1]))
    try:
        rows = parse_constraints([text], ["a", "b"])
    except ConfigurationError:
        assert (left[0] - right[0], left[1]) == (0, 0)  # both parameters cancel
        return
    slack = float(rows.matrix[0] @ np.array(point) - rows.lower[0])
    # Terms up to 100 add up with rounding of some 1e-14.
    assert slack == pytest.approx(difference if ">" in relation else -difference, abs=1e-12)
