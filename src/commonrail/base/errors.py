"""Every error that the project raises on purpose, with the exit status each one gives the command.

A message is one clear sentence: place, expectation, cure. A failed
simulation inside a study is not an error but a status with an infinite cost.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import ClassVar

LONGEST_SENTENCE = 1000
MOST_SUGGESTED = 4
MOST_LISTED = 20
LONGEST_NAME = 100  # that is worth comparing: the search for the nearest one costs as the square of the length

# What ends a line or moves the cursor of a terminal: parts of a sentence come from files and their names.
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]+")


class CommonrailError(Exception):
    """Root of the project's errors; its text is one line, written for the user.

    Attributes
    ----------
    code : str
        Kind of the fault, such as "too-large", for programs: the text may change. Empty where none is stated.
    file : str
        File at fault; empty where there is none.
    place : str
        Dotted key, or line and column, in the file; else the argument at fault in words, such as "rail pressure".
    """

    exit_code: ClassVar[int] = 1

    def __init__(self, sentence: str, *, code: str = "", file: str | Path = "", place: str = "") -> None:
        super().__init__(one_line(sentence))
        self.code = code
        self.file = str(file)
        self.place = place


class InputError(CommonrailError):
    """A file, a key or a value that the user gave cannot be used."""

    exit_code: ClassVar[int] = 2


class ConfigurationError(CommonrailError):
    """Settings that are each valid but contradict one another."""

    exit_code: ClassVar[int] = 2


class StudyError(CommonrailError):
    """A study that cannot be started, continued or read back."""

    exit_code: ClassVar[int] = 2


class PluginError(CommonrailError):
    """An installed plug-in that cannot be loaded."""

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
    half = LONGEST_SENTENCE // 2  # the place is at the beginning, the cure at the end
    return f"{line[:half]} ... {line[-half:]}"


def nearest(name: str, options: Iterable[str]) -> str:
    """Suggest the option that `name` was probably meant to be.

    `name`: what the user wrote; upper and lower case count as equal. Of a dotted option the last part alone, or some of
    its words, are understood too: several options are then suggested if several fit. `options`: what would have been
    accepted. Returns ``' (did you mean "x"?)'`` to append to a message, or an empty string when nothing is close.

    Examples
    --------
    >>> nearest("presure", ["pressure", "voltage"])
    ' (did you mean "pressure"?)'
    >>> nearest("hole_diamter", ["nozzle.hole_diameter", "valve.seat_diameter"])
    ' (did you mean "nozzle.hole_diameter"?)'
    """
    if len(name) > LONGEST_NAME:
        return ""
    # Reversed: of two options that differ in case alone, the first one listed wins.
    spelling = {option.casefold(): option for option in reversed(list(options))}
    asked = name.casefold()
    dotted = [option for option in reversed(spelling) if "." in option]
    matches = (_of_dotted(asked, dotted) if dotted else []) or get_close_matches(asked, spelling, n=1)
    if not matches:
        return ""
    *others, last = (f'"{spelling[option]}"' for option in matches)
    return f" (did you mean {', '.join(others)}{' or ' * bool(others)}{last}?)"


def nearest_key(key: str, keys: Iterable[str]) -> str:
    """Suggest the key of a table that `key` was probably meant to be, else list those that a short table can have."""
    options = list(keys)
    if (meant := nearest(key, options)) or not 0 < len(options) <= MOST_LISTED:
        return meant
    return f" (it can have {', '.join(options)})"


def _of_dotted(asked: str, options: list[str]) -> list[str]:
    """Dotted options that a name fits: by its place, the part before the last point, and by its end."""
    place, _, end = re.sub(r"[\s-]+", "_", asked.strip()).rpartition(".")
    places = get_close_matches(place, {option.rpartition(".")[0] for option in options}, n=1)
    in_place = [option for option in options if option.rpartition(".")[0] in places]
    matches = _by_end(end, options if not place else in_place)
    elsewhere = [option for option in options if option.rpartition(".")[2] == end] if place else []
    if matches and len(elsewhere) > 1:  # "toml" of file names
        elsewhere = []
    return list(dict.fromkeys([*matches, *elsewhere]))[:MOST_SUGGESTED]


def _by_end(end: str, options: list[str]) -> list[str]:
    """Options whose last part is the same, else those with these words in it, else the most similar ones."""
    ends = {option: option.rpartition(".")[2] for option in options}
    same = [option for option in options if ends[option] == end]
    # A word of the option begins where the name does: "hole" is in "z_hole_diameter", "ole" is not.
    word = re.compile(rf"(?:^|_){re.escape(end)}" if len(end) > 1 else "(?!)")
    within = [option for option in options if word.search(ends[option])]
    begun = [option for option in options if word.match(option)]
    close = get_close_matches(end, ends.values(), n=1)
    return same or within or begun or [option for option in options if ends[option] in close]
