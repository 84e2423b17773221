"""Choices for an inverse map, and the states of its cells."""

from __future__ import annotations

from enum import Enum, IntEnum


class Several(Enum):
    """Rule for quantities that several energising times deliver, because the quantity falls in between.

    NEIGHBOURS takes the time that continues the adjacent cells over rail pressure and quantity.
    """

    NEIGHBOURS = "neighbours"
    SHORTEST = "shortest"
    LONGEST = "longest"


class Beyond(Enum):
    """Rule for quantities that the longest simulated energising time does not deliver.

    EXTRAPOLATE continues the last two simulated times as a straight line, as makers of control units do; HOLD takes
    the longest time; EMPTY leaves the cell without a number.
    """

    EXTRAPOLATE = "extrapolate"
    HOLD = "hold"
    EMPTY = "empty"


class CellState(IntEnum):
    """State of a cell of a map; `sentence` says what its number means."""

    REACHED = 0
    ZERO = 1
    SEVERAL = 2
    JUMP = 3
    BEYOND = 4
    FAILED = 5

    @property
    def sentence(self) -> str:
        """Meaning of the number in a cell of this state."""
        return _SENTENCES[self]


_SENTENCES = {
    CellState.REACHED: "simulated: this energising time delivers the quantity",
    CellState.ZERO: "no quantity: the energising time is 0",
    CellState.SEVERAL: "several energising times deliver the quantity, because it falls in between: one is taken",
    CellState.JUMP: "the quantity jumps past this value: the energising time just after the jump",
    CellState.BEYOND: "more than the longest simulated energising time delivers: by the stated rule",
    CellState.FAILED: "the simulation failed or the needle did not close: no number",
}
