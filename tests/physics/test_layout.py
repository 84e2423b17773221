"""Rows of a lane: every field finds its own row, in both directions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from commonrail.base.choices import Body
from commonrail.physics.components import plunger_needle, rigid_body
from commonrail.physics.law import layout_of
from commonrail.physics.model import Coefficients, Parameters, State
from commonrail.physics.variants import Variant, wiring


class Inner(NamedTuple):
    x: float
    y: float


class Outer(NamedTuple):
    a: float
    inner: Inner
    open: Any


LANES = 8
LAYOUT = layout_of(Outer, (("open", Inner),))


def test_paths_are_dotted_names_in_row_order() -> None:
    assert LAYOUT.paths == ("a", "inner.x", "inner.y", "open.x", "open.y")
    assert LAYOUT.row("open.x") == 3
    assert LAYOUT.row("inner") == 1


def test_load_reads_the_column_of_a_lane() -> None:
    array = np.arange(10 * LANES, dtype=float)
    first, lane = 2, 5
    values = [(first + row) * LANES + lane for row in range(5)]
    assert LAYOUT.load(array, first * LANES + lane, LANES) == (values[0], tuple(values[1:3]), tuple(values[3:]))


@pytest.mark.parametrize("kind", [Parameters, Coefficients, "flexible", "rigid"])
def test_store_and_load_are_inverse_and_touch_one_lane(kind: Any) -> None:
    states = {"flexible": plunger_needle.State, "rigid": rigid_body.State}
    layout = layout_of(State, (("body", states[kind]),)) if isinstance(kind, str) else layout_of(kind)
    rows = len(layout.paths)
    array = np.random.default_rng(2).normal(size=rows * LANES)
    value = layout.load(array, 3, LANES)
    other = np.zeros(rows * LANES)
    layout.store(other, 3, LANES, value)
    assert np.array_equal(other[3::LANES], array[3::LANES])
    assert np.count_nonzero(np.delete(other.reshape(rows, LANES), 3, axis=1)) == 0


def test_a_state_has_the_body_of_its_variant() -> None:
    assert "body.z.i9" in wiring(Variant()).state.paths
    assert "body.z" in wiring(Variant(Body.RIGID)).state.paths
