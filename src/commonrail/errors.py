"""Every error that the project raises on purpose, with the exit status each one gives the command.

A message is one clear sentence: where it happened, what was expected, what to do. A failed
simulation inside a study is not an error but a status with an infinite cost.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import ClassVar

__all__ = [
    "CommonrailError",
    "ConfigurationError",
    "InputError",
    "OutputError",
    "SimulationError",
    "StudyError",
    "nearest",
    "one_line",
]


LONGEST_SENTENCE = 1000
LONGEST_NAME = 100  # that is worth comparing: the search for the nearest one costs as the square of the length

# What ends a line or moves the cursor of a terminal: parts of a sentence come from files and their names.
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]+")


class CommonrailError(Exception):
    """Root of the project's errors; its text is one line, meant to be read by the user as it stands."""

    exit_code: ClassVar[int] = 1

    def __init__(self, sentence: str) -> None:
        super().__init__(one_line(sentence))


class InputError(CommonrailError):
    """A file, a key or a value that the user gave cannot be used."""

    exit_code: ClassVar[int] = 2


class ConfigurationError(CommonrailError):
    """Settings that are each valid but contradict one another."""

    exit_code: ClassVar[int] = 2


class StudyError(CommonrailError):
    """A study that cannot be started, continued or read back."""

    exit_code: ClassVar[int] = 2


class OutputError(CommonrailError):
    """A result that cannot be written: no permission, no such folder, disk full."""

    exit_code: ClassVar[int] = 3


class SimulationError(CommonrailError):
    """A simulation that the user asked for by itself and that has no usable result."""

    exit_code: ClassVar[int] = 4


def one_line(sentence: str) -> str:
    """The sentence without control characters, cut in its middle if it is very long."""
    line = _CONTROL.sub(" ", sentence)
    if len(line) <= LONGEST_SENTENCE:
        return line
    half = LONGEST_SENTENCE // 2  # a place stands at the beginning, what to do at the end
    return f"{line[:half]} ... {line[-half:]}"


def nearest(name: str, options: Iterable[str]) -> str:
    """Suggest the option that `name` was probably meant to be.

    Parameters
    ----------
    name : str
        What the user wrote; upper and lower case count as equal.
    options : iterable of str
        What would have been accepted.

    Returns
    -------
    str
        ``' (did you mean "x"?)'`` to append to a message, or an empty string when nothing is close.

    Examples
    --------
    >>> nearest("presure", ["pressure", "voltage"])
    ' (did you mean "pressure"?)'
    """
    if len(name) > LONGEST_NAME:
        return ""
    # Reversed, so that of two options that differ in case alone the first one listed wins.
    known = {option.casefold(): option for option in reversed(list(options))}
    found = get_close_matches(name.casefold(), known, n=1)
    return f' (did you mean "{known[found[0]]}"?)' if found else ""
