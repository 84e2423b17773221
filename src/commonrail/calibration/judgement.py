"""Further searches by which a study's fit is judged."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from commonrail.arguments import chosen, settle, whole

__all__ = ["NO_JUDGEMENT", "Judgement", "LeaveOut"]


class LeaveOut(StrEnum):
    """Quantity whose values are left out of the fit in turn."""

    RAIL_PRESSURE = "rail_pressure"
    ENERGISING_TIME = "energising_time"


@dataclass(frozen=True)
class Judgement:
    """Searches besides the one that gives the result.

    Parameters
    ----------
    seeds : int
        Searches with the next seeds, to see the spread of what they find.
    leave_out : tuple of LeaveOut
        For each value that the fitted maps have of these, a search without the rows at it, which are then predicted.

    Raises
    ------
    ConfigurationError
        If `seeds` is negative or has a fraction, or something else is to be left out.
    """

    seeds: int = 0
    leave_out: tuple[LeaveOut, ...] = ()

    def __post_init__(self) -> None:
        leave_out = tuple(dict.fromkeys(chosen(by, LeaveOut, "leave_out") for by in self.leave_out))
        settle(self, seeds=whole(self.seeds, "seeds of the judgement"), leave_out=leave_out)

    @property
    def wanted(self) -> bool:
        """True if there is any further search."""
        return bool(self.seeds or self.leave_out)


NO_JUDGEMENT = Judgement()
