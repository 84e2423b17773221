"""Deadlines: a call that does not return is left to itself."""

from __future__ import annotations

import threading

import pytest

from commonrail.plugins.cluster import Late, within
from tests.waiting import PATIENCE


def test_a_call_in_time_gives_its_result() -> None:
    assert within(PATIENCE, lambda: 3) == 3


def test_a_call_that_does_not_return_is_late() -> None:
    never = threading.Event()
    with pytest.raises(Late):
        within(0.01, never.wait)
    never.set()


def test_errors_of_a_call_are_raised_here() -> None:
    with pytest.raises(KeyError, match="lacking"):
        within(PATIENCE, lambda: {}["lacking"])
