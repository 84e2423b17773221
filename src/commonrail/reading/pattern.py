"""Names of columns that state an operating point, ``800bar_300us``, and the pattern that reads them."""

from __future__ import annotations

import re
from typing import NamedTuple

from commonrail.reading.place import Place
from commonrail.units import convert, fits

__all__ = ["ColumnPattern", "NamedPoint"]

_KINDS = {"p": "Pa", "rail_pressure": "Pa", "et": "s", "energising_time": "s", "shot": ""}
_WORDS = {"Pa": "rail pressure", "s": "energising time"}
_KEYS = {"Pa": "rail_pressure_unit", "s": "energising_time_unit"}
_NUMBER = r"(\d+(?:[.,]\d+)?)"
_SHOT = r"(\w+?)"


class NamedPoint(NamedTuple):
    """Content of a name: rail pressure [Pa], energising time [s], shot; None or empty where the pattern has none."""

    column: str
    rail_pressure: float | None
    energising_time: float | None
    shot: str


class ColumnPattern:
    """Pattern such as ``{p}bar_{et}us`` or ``{p} MPa, {et} us, shot {shot}``.

    Parameters
    ----------
    text : str
        ``{p}`` or ``{rail_pressure}``, ``{et}`` or ``{energising_time}``, and ``{shot}``; the unit stands behind the
        number, or is stated.
    stated : dict of str to str
        Units by SI unit, "Pa" and "s".
    at : Place
        Of the pattern.

    Raises
    ------
    InputError
        If the pattern has no placeholder, an unknown one or one twice, or a number has no unit.
    """

    def __init__(self, text: str, stated: dict[str, str], at: Place) -> None:
        self.text = text
        self._units: dict[str, str] = {}
        self._kinds: list[str] = []
        first, *parts = re.split(r"\{(\w*)\}", text)
        form = re.escape(first)
        for name, behind in zip(parts[::2], parts[1::2], strict=True):
            if name not in _KINDS:
                raise at.error(f'there is no placeholder "{{{name}}}"; {{p}}, {{et}} and {{shot}} are known')
            kind = _KINDS[name]
            if kind in self._kinds:
                raise at.error(f"the {_WORDS.get(kind, 'shot')} has two placeholders; keep one")
            self._kinds.append(kind)
            if kind:
                self._units[kind] = _unit(behind, kind, stated.get(kind, ""), at)
            form += (_NUMBER if kind else _SHOT) + re.escape(behind)
        if not self._kinds:
            raise at.error('the pattern has no placeholder; write it as in "{p}bar_{et}us"')
        self._form = re.compile(form)

    def read(self, name: str) -> NamedPoint | None:
        """Content of a name; None for one that does not fit."""
        found = self._form.fullmatch(name)
        if found is None:
            return None
        texts = dict(zip(self._kinds, found.groups(), strict=True))
        numbers = {
            kind: convert(float(text.replace(",", ".")), self._units[kind], kind)
            for kind, text in texts.items()
            if kind
        }
        return NamedPoint(name, numbers.get("Pa"), numbers.get("s"), texts.get("", ""))


def _unit(behind: str, kind: str, stated: str, at: Place) -> str:
    """Unit of a number: the longest one with which the text behind it begins, else what is stated."""
    text = behind.lstrip(" ")
    for end in range(min(len(text), 12), 0, -1):
        if text[:end].isalpha() and fits(text[:end], kind):
            return text[:end]
    if stated:
        return stated
    raise at.error(
        f'the {_WORDS[kind]} has no unit; write it behind the number, as in "{{p}}bar_{{et}}us", or state it with '
        f"{_KEYS[kind]}"
    )
