"""Rules of the verdict on a calibration: three titles, and what decides on them. docs/verdict.md has them for users."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import NamedTuple

from commonrail.report.data.view import FitError

GOOD, CARE, BAD = "good", "care", "bad"
TITLES = {
    GOOD: "Good fit, and no test speaks against it",
    CARE: "Usable for predictions, not for values",
    BAD: "Not usable",
}
SHARES = (0.03, 0.10)  # largest error of a good and of a usable fit, as a share of the measured values
TOLERANCES = (1.0, 3.0)  # largest error of a good and of a usable fit, in tolerances of the data


class Kind(IntEnum):
    """Kind of a point, in the order in which points are named."""

    FAULT = 0  # makes a result unusable however small its errors are
    TEST = 1  # a statistical test that found something
    ERROR = 2  # on a data set, fitted or not
    SEARCH = 3  # unfinished in a way that matters for the values
    BOUND = 4  # values at a bound
    NOTE = 5  # leaves the title as it is


class Step(NamedTuple):
    """One thing to do, the command line for it if there is one, and its turn among the steps."""

    text: str
    command: str = ""
    turn: int = 0


class Point(NamedTuple):
    """Sentence on a calibration, with its cure, the error on a data set, or the probability that a test gave."""

    kind: Kind
    reason: str
    step: Step
    error: FitError | None = None
    probability: float = 1.0

    @property
    def level(self) -> str:
        """Level of the point by itself."""
        if self.error is not None:
            return level_of(self.error)
        return {Kind.FAULT: BAD, Kind.NOTE: GOOD}.get(self.kind, CARE)


def judge(points: Iterable[Point]) -> tuple[str, list[Point]]:
    """Level of a calibration, that is, of its worst point, and the points against it, most important first."""
    against = [point for point in points if point.level != GOOD]
    against.sort(key=lambda p: (p.level != BAD, p.kind, p.probability, -(p.error.size if p.error else 0.0)))
    return (against[0].level if against else GOOD), against


def level_of(error: FitError) -> str:
    """Level of a single error; a larger tolerance in the study replaces a limit."""
    good, usable = (max(limit, error.tolerance) for limit in (TOLERANCES if error.in_tolerances else SHARES))
    return GOOD if error.size <= good else CARE if error.size <= usable else BAD


def worst_level(errors: Iterable[FitError]) -> str:
    """Level of the worst of some errors; empty for none."""
    return max(map(level_of, errors), key=(GOOD, CARE, BAD).index, default="")


class Tile(NamedTuple):
    """Figure on the first page: head, figure, description, and level of its verdict (empty: no verdict).

    `others`: figures of other data, shown in a tooltip.
    """

    head: str
    figure: str
    words: str
    level: str = ""
    others: str = ""

    @property
    def sign(self) -> str:
        """Sign that says the level without colour."""
        return {GOOD: "✓", CARE: "!", BAD: "✗"}.get(self.level, "")
