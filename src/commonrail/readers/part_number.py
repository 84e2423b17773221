"""Injectors of the catalogue by the part numbers that their files name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

from commonrail.base.arguments import plain_text, shown
from commonrail.base.errors import InputError
from commonrail.base.registry import part_digits
from commonrail.base.text import counted, listed
from commonrail.readers.injector import CATALOGUE

LENGTH, GROUP = 10, 7  # digits of a part number, and of its beginning that tells the kind of injector, as 0445110
NEAREST = 2  # numbers that are named where the catalogue has not the one asked for
# Of the 84 parts that the catalogue names, those whose nearest other number is of the same type.
SAME_TYPE = "in half of the cases only (42 of 84)"


class PartMatch(NamedTuple):
    """Injector of the catalogue for a part number.

    `injector`: its name; `numbers`: those parts of its file that match or are nearest; `reason`: a sentence.
    """

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
        raise InputError(f"{shown(number)} is no part number; give four to ten digits, as in 0 445 110 191.")
    if matches := [part for part in parts if digits in part]:
        return tuple(_match(digits, name, numbers) for name, numbers in _by_injector(matches, parts))
    size = len(digits)
    near = sorted(parts, key=lambda part: (abs(int(part[-size:]) - int(digits)), part))[:NEAREST]
    if size == LENGTH:
        near = [part for part in near if part[:GROUP] == digits[:GROUP]]
    reason = (
        f"No type of the catalogue names {digits}; the nearest {{}}, of {{}}. Neighbours are of one type {SAME_TYPE}"
    )
    return tuple(
        PartMatch(
            name, numbers, "nearest", f"{reason.format(_are(numbers), name)}: compare lifts, drive or test plan first."
        )
        for name, numbers in _by_injector(near, parts)
    )


def part_kinds() -> list[str]:
    """Beginnings of the part numbers that the catalogue names."""
    return sorted({part[:GROUP] for part in CATALOGUE.parts()})


def _by_injector(numbers: list[str], parts: Mapping[str, str]) -> list[tuple[str, tuple[str, ...]]]:
    """Injectors with those of the numbers that their files name."""
    names = dict.fromkeys(parts[part] for part in numbers)
    return [(name, tuple(part for part in numbers if parts[part] == name)) for name in names]


def _are(numbers: Sequence[str]) -> str:
    return f"{'number is' if len(numbers) == 1 else 'numbers are'} {listed(numbers)}"


def _match(digits: str, name: str, numbers: tuple[str, ...]) -> PartMatch:
    first, *more = numbers
    if digits != first:
        reason = f"{name} has {counted(len(numbers), 'part')} with {digits} in the number: {first}{', …' * bool(more)}."
        return PartMatch(name, numbers, "partial", reason)
    if f"specification of part {digits}" in CATALOGUE.text(name):
        return PartMatch(name, numbers, "exact", f"{name} has the lifts, the residual gap and the drive of {digits}.")
    reason = (
        f"{digits} is of the type {name}, to whose test plan its hydraulics were fitted among others; lifts, residual "
        "gap and drive are those of another part."
    )
    return PartMatch(name, numbers, "exact", reason)
