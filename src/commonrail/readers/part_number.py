"""Injectors of the catalogue by the part numbers that their files name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from commonrail.base.arguments import plain_text, shown
from commonrail.base.errors import InputError
from commonrail.base.registry import part_digits
from commonrail.base.text import count_noun, join_words
from commonrail.readers.injector import CATALOGUE

LENGTH, GROUP = 10, 7  # digits of a part number, and of its beginning that tells the kind of injector, as 0445110
NEAREST = 2  # numbers that are named where the catalogue has not the one asked for
SAME_TYPE = "in half of the cases only (42 of 84)"  # measured on the numbers of the catalogue


class PartMatch(NamedTuple):
    """Injector of the catalogue by name, those numbers of its file that match or are nearest, and a sentence on it."""

    injector: str
    numbers: tuple[str, ...]
    kind: Literal["exact", "partial", "nearest"]
    reason: str


def find_part(number: str) -> tuple[PartMatch, ...]:
    """Find the injectors of the catalogue for a part number.

    Parameters
    ----------
    number : str
        Whole or in part, with or without spaces, dots, dashes and words: ``"0 445 110 191"``, ``"bosch 445.110.191"``.

    Returns
    -------
    tuple of PartMatch
        The injectors whose files name it; if none does, those of the nearest numbers of its kind, if there are any.

    Raises
    ------
    InputError
        If the text has fewer than four digits or more than ten.
    """
    digits, parts = part_digits(plain_text(number, "part number")), CATALOGUE.parts()
    if not digits:
        raise InputError(
            f"{shown(number)} is no part number; give four to ten digits, as in 0 445 110 191.", code="not-a-number"
        )
    numbers, size = [part_number for part_number in parts if digits in part_number], len(digits)
    kind: Literal["exact", "partial", "nearest"] = "exact" if digits in parts else "partial" if numbers else "nearest"
    if not numbers:
        alike = [part_number for part_number in parts if size < LENGTH or part_number[:GROUP] == digits[:GROUP]]
        numbers = sorted(alike, key=lambda part_number: (abs(int(part_number[-size:]) - int(digits)), part_number))[
            :NEAREST
        ]
    names = dict.fromkeys(parts[part_number] for part_number in numbers)
    numbers_of_name = {
        name: tuple(part_number for part_number in numbers if parts[part_number] == name) for name in names
    }
    return tuple(
        PartMatch(name, numbers_of_name[name], kind, _reason(digits, kind, name, numbers_of_name[name]))
        for name in names
    )


def _reason(digits: str, kind: str, name: str, numbers: Sequence[str]) -> str:
    if kind == "nearest":
        return (
            f"No type of the catalogue names {digits}; near it in number: {join_words(numbers)}, of {name}. Neighbours "
            f"are of one type {SAME_TYPE}: compare lifts, drive or test plan first."
        )
    if kind == "partial":
        return f"{name} has {count_noun(len(numbers), 'part')} with {digits} in the number, as {numbers[0]}."
    if f"specification of part {digits}" in CATALOGUE.text(name):
        return f"{name} has the lifts, the residual gap and the drive of {digits}."
    return f"{digits} is of the type {name}, with the lifts, residual gap and drive of another part of it."
