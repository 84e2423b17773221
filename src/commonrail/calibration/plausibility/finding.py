"""One implausible thing about a study or its result."""

from __future__ import annotations

from typing import NamedTuple

from commonrail.errors import one_line

__all__ = ["Finding", "found"]


class Finding(NamedTuple):
    """A warning: the calibration runs, and its result should not be believed before this is looked at.

    Attributes
    ----------
    code : str
        Kind of the finding, an anchor of docs/howto/plausibility.md.
    subject : str
        Data set or parameter, or the study's title.
    sentence : str
        Where, what was found, what is expected and the cure; one line.
    """

    code: str
    subject: str
    sentence: str


def found(code: str, subject: str, text: str) -> Finding:
    """Finding whose sentence begins with its subject.

    Parameters
    ----------
    code, subject : str
        As in `Finding`.
    text : str
        The sentence without its subject.
    """
    return Finding(code, subject, one_line(f"{subject}: {text}"))
