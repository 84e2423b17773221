"""Texts of TOML are those that an editing library writes, and read back as what was meant."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
import tomlkit
from hypothesis import given, settings
from hypothesis import strategies as st

from commonrail.readers.toml import inline_table, key_text, table_lines, value_text

CHARACTERS = st.characters(exclude_categories=["Cs"])  # no halves of surrogate pairs: no file can hold them


@settings(deadline=None, database=None, derandomize=True)
@given(st.text(CHARACTERS) | st.floats(allow_nan=False, allow_infinity=False) | st.lists(st.floats(0.0, 1e9)))
def test_a_value_is_written_as_tomlkit_writes_it(value: str | float | list[float]) -> None:
    assert value_text(value) == tomlkit.item(value).as_string()  # type: ignore[union-attr]
    assert tomllib.loads(f"x = {value_text(value)}")["x"] == value


@pytest.mark.parametrize("value", ['"\\', "\x00\x7f\b\t\n\f\r", "é\u2028😀", -0.0, 1e-7, 5e-324])
def test_odd_values_are_written_as_tomlkit_writes_them(value: str | float) -> None:
    assert value_text(value) == tomlkit.item(value).as_string()


def test_tables_in_tables_read_back() -> None:
    table = {"name": "n", "law": {"k": [1.5, -2e-5], "of a": {"error": 0.0}}}
    text = "\n".join(table_lines("fuel", table))
    assert tomllib.loads(text) == {"fuel": table}
    assert text == f"\n{tomlkit.dumps({'fuel': table}).rstrip()}"


def test_a_key_is_quoted_where_it_must_be() -> None:
    assert [key_text(key) for key in ("a-b_1", "a b", "")] == ["a-b_1", '"a b"', '""']
    assert tomllib.loads(f"x = {inline_table({'a b': 1, 'c': 'd'})}") == {"x": {"a b": 1, "c": "d"}}


def test_numbers_of_numpy_and_truth_values_are_written_as_toml() -> None:
    assert value_text([np.float64(1.5), 2.0, True]) == "[1.5, 2.0, true]"
