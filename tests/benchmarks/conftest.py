"""A clock that tests turn by hand: nothing here is timed."""

from __future__ import annotations

import pytest

from benchmarks.timing import Clocks


class HandClock:
    """Time that passes only when told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def pass_by(self, seconds: float) -> None:
        """Let time pass."""
        self.now += seconds

    @property
    def clocks(self) -> Clocks:
        """Wall and processor time; the processor works half of it."""
        return Clocks(lambda: self.now, lambda: 0.5 * self.now)


@pytest.fixture
def clock() -> HandClock:
    """A clock at zero."""
    return HandClock()
