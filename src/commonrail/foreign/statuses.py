"""Status of a simulation of a foreign FMU, whose sentence says what to do."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["FmuStatus"]


class FmuStatus(IntEnum):
    """Outcome of one candidate. All but `FMU_OK` cost +inf: a candidate that failed never wins.

    The numbers are apart from those of `commonrail.engine.status.Status`: both stand in journals.
    """

    FMU_OK = 0
    FMU_NOT_STARTED = 64
    FMU_DISCARDED = 65
    FMU_ERROR = 66
    FMU_FATAL = 67
    FMU_NOT_FINITE = 68
    FMU_ENDED_EARLY = 69
    FMU_TOO_LONG = 70
    FMU_CRASHED = 71

    @property
    def sentence(self) -> str:
        """Event and cure in one sentence."""
        return _SENTENCES[self]


_SENTENCES = {
    FmuStatus.FMU_OK: "The simulation ended well.",
    FmuStatus.FMU_NOT_STARTED: (
        "The FMU could not be loaded or gave no instance; check its platform, its token and the libraries it needs."
    ),
    FmuStatus.FMU_DISCARDED: (
        'The FMU ended a call with the status "discard"; take a shorter communication step or narrow the bounds.'
    ),
    FmuStatus.FMU_ERROR: 'The FMU ended a call with the status "error"; narrow the bounds, or correct a start value.',
    FmuStatus.FMU_FATAL: 'The FMU ended a call with the status "fatal"; narrow the bounds, or ask the FMU\'s maker.',
    FmuStatus.FMU_NOT_FINITE: "An output of the FMU is not finite; narrow the bounds or shorten the step.",
    FmuStatus.FMU_ENDED_EARLY: "The FMU ended its simulation before the last measured time; narrow the bounds.",
    FmuStatus.FMU_TOO_LONG: (
        "The FMU gave no answer within the time limit, and its process was ended; raise time_limit or narrow bounds."
    ),
    FmuStatus.FMU_CRASHED: (
        "The FMU's binary ended its process; narrow the bounds, or ask the FMU's maker. Other candidates went on."
    ),
}
