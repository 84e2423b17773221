"""Every error that the project raises on purpose, with the exit status each one gives the command.

A message is one clear sentence: where it happened, what was expected, what to do. A failed
simulation inside a study is not an error but a status with an infinite cost.
"""

from __future__ import annotations

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
]


class CommonrailError(Exception):
    """Root of the project's errors; its text is meant to be read by the user as it stands."""

    exit_code: ClassVar[int] = 1


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
    # Reversed, so that of two options that differ in case alone the first one listed wins.
    known = {option.casefold(): option for option in reversed(list(options))}
    found = get_close_matches(name.casefold(), known, n=1)
    return f' (did you mean "{known[found[0]]}"?)' if found else ""
