"""Numbers as the report writes them."""

from __future__ import annotations

import math

import pytest

from commonrail.base import text
from commonrail.base.text import MISSING


@pytest.mark.parametrize("nothing", [None, math.nan, math.inf, "171", True])
def test_what_is_no_finite_number_is_a_dash(nothing: object) -> None:
    written = [text.to_fixed(nothing, 1), text.to_signed(nothing, 1), text.quantity(nothing, "m")]
    assert [*written, text.significant(nothing), text.duration(nothing)] == [MISSING] * 5


@pytest.mark.parametrize(("value", "shown"), [(2.345, "+2.3"), (-2.345, "−2.3"), (0.0, "0.0"), (-0.04, "0.0")])
def test_a_signed_number_has_a_true_minus_and_no_sign_at_zero(value: float, shown: str) -> None:
    assert text.to_signed(value, 1) == shown


@pytest.mark.parametrize(
    ("value", "shown"), [(1531.4, "1530"), (-21712.4, "−21700"), (171.26, "171"), (1e6, "1·10⁶"), (2.5e-7, "2.5·10⁻⁷")]
)
def test_an_everyday_number_has_no_exponent(value: float, shown: str) -> None:
    assert text.significant(value, 3) == shown


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (1.22e8, "N/m", "122 N/µm"),
        (2.15e-4, "m", "215 µm"),
        (3.7e-8, "m3", "37 mm³"),
        (0.82, "1", "0.82"),
    ],
)
def test_a_value_has_the_prefix_that_suits_it(value: float, unit: str, shown: str) -> None:
    assert text.quantity(value, unit) == shown


@pytest.mark.parametrize(("seconds", "shown"), [(4.25, "4.2 s"), (83.2, "1 min 23 s"), (7380.0, "2 h 3 min")])
def test_a_duration_is_written_for_a_person(seconds: float, shown: str) -> None:
    assert text.duration(seconds) == shown


@pytest.mark.parametrize(
    ("words", "shown"), [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")]
)
def test_words_are_listed(words: list[str], shown: str) -> None:
    assert text.join_words(words) == shown
