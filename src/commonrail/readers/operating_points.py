"""Tables of many traces side by side, with the operating point of each in rows above the numbers.

::

    rail pressure [bar];800;800;1200
    energising time [us];300;500;300
    time [us];rate [mm3/ms];rate [mm3/ms];rate [mm3/ms]
    0;0,1;0,0;0,1
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.errors import InputError
from commonrail.base.units import FAST, compatible, convert, fits
from commonrail.readers.columns import Table, is_heading, name_and_unit
from commonrail.readers.grid import Grid, read_numbers
from commonrail.readers.location import Place
from commonrail.readers.quantity_matrix import find_kind, plain_unit, unit_in

# Names of columns that state an operating point, ``800bar_300us``, and the pattern that reads them.

_KINDS = {"p": "Pa", "rail_pressure": "Pa", "et": "s", "energising_time": "s", "shot": ""}
_WORDS = {"Pa": "rail pressure", "s": "energising time"}
_KEYS = {"Pa": "rail_pressure_unit", "s": "energising_time_unit"}
_NUMBER = r"(\d+(?:[.,]\d+)?)"
_SHOT = r"(\w+?)"


class NamedPoint(NamedTuple):
    """Content of a name: rail pressure [Pa], energising time [s], shot; None or empty if not in the pattern."""

    column: str
    rail_pressure: float | None
    energising_time: float | None
    shot: str


class ColumnPattern:
    """Pattern such as ``{p}bar_{et}us`` or ``{p} MPa, {et} us, shot {shot}``.

    `text`: ``{p}`` or ``{rail_pressure}``, ``{et}`` or ``{energising_time}``, and ``{shot}``; the unit follows
    the number, or is stated. `stated`: units by SI unit, "Pa" and "s". Raises `InputError` if the pattern has no
    placeholder, an unknown one or one twice, or a number has no unit.
    """

    def __init__(self, text: str, stated: dict[str, str], at: Place) -> None:
        self.text = text
        self._units: dict[str, str] = {}
        self._kinds: list[str] = []
        first, *parts = re.split(r"\{(\w*)\}", text)
        form = re.escape(first)
        for name, behind in zip(parts[::2], parts[1::2], strict=True):
            if name not in _KINDS:
                raise at.error(
                    f'there is no placeholder "{{{name}}}"; {{p}}, {{et}} and {{shot}} are known', code="unknown-name"
                )
            kind = _KINDS[name]
            if kind in self._kinds:
                raise at.error(f"the {_WORDS.get(kind, 'shot')} has two placeholders; keep one", code="repeated")
            self._kinds.append(kind)
            if kind:
                self._units[kind] = _unit(behind, kind, stated.get(kind, ""), at)
            form += (_NUMBER if kind else _SHOT) + re.escape(behind)
        if not self._kinds:
            raise at.error('the pattern has no placeholder; write it as in "{p}bar_{et}us"', code="no-placeholder")
        self._form = re.compile(form)

    def read(self, name: str) -> NamedPoint | None:
        """Content of a name; None for one that does not fit."""
        match = self._form.fullmatch(name)
        if match is None:
            return None
        texts = dict(zip(self._kinds, match.groups(), strict=True))
        rail, time = (
            convert(float(texts[kind].replace(",", ".")), self._units[kind], kind) if kind in texts else None
            for kind in ("Pa", "s")
        )
        return NamedPoint(name, rail, time, texts.get("", ""))


def _unit(behind: str, kind: str, stated: str, at: Place) -> str:
    """Unit of a number: the longest one at the start of the following text, else the stated one."""
    text = behind.lstrip(" ")
    for end in range(min(len(text), 12), 0, -1):
        if text[:end].isalpha() and fits(text[:end], kind):
            return text[:end]
    if stated:
        return stated
    raise at.error(
        f'the {_WORDS[kind]} has no unit; write it behind the number, as in "{{p}}bar_{{et}}us", or state it with '
        f"{_KEYS[kind]}",
        code="no-unit",
    )


# Operating points in the names of columns, such as "500bar_300us".

_POINT = re.compile(r"(\d+(?:[.,]\d+)?)(\s*[_ ]?)(MPa|bar|hPa|us|µs|ms)(?![A-Za-z])", re.A)
_LAST_NUMBER = re.compile(r"(\d+)(?=\D*$)", re.A)


def unit_of_name(name: str) -> str:
    """Unit at the end of a name, before its operating point; empty if none.

    As in ``t_ms``, ``mdot_mg_ms_100bar`` or ``mdot_mg_per_ms``.
    """
    parts = [word for word in _POINT.sub("", name.rpartition(".")[2]).replace("_per_", "/").split("_") if word]
    texts = ["/".join(parts[-n:]) for n in (2, 1) if len(parts) > n]
    return next((text for text in texts if text in FAST and FAST[text].kind != "1"), "")


def point_of_name(text: str) -> dict[str, str]:
    """Rail pressure and energising time in a text, by study key; a quantity with several values is omitted."""
    texts: dict[str, list[str]] = {"rail_pressure": [], "energising_time": []}
    for match in _POINT.finditer(text):
        texts["rail_pressure" if _placeholder(match) == "{p}" else "energising_time"].append(f"{match[1]} {match[3]}")
    return {key: values[0].replace(",", ".") for key, values in texts.items() if len(set(values)) == 1}


def find_pattern(names: Sequence[str]) -> str | None:
    """Pattern of names that state operating points, if all have one form."""
    if len(names) < 2:
        return None
    patterns = [_POINT.sub(lambda m: _placeholder(m) + m[2] + m[3], name) for name in names]
    patterns = patterns if len(set(patterns)) == 1 else [_LAST_NUMBER.sub("{shot}", name) for name in patterns]
    pattern = patterns[0]
    if len(set(patterns)) > 1 or "{" not in pattern.replace("{shot}", ""):
        return None
    try:
        read = ColumnPattern(pattern, {}, Place(""))
    except InputError:
        return None
    return pattern if all(read.read(name) for name in names) else None


def read_points(names: Sequence[str]) -> tuple[NamedPoint, ...]:
    """Operating points in the names of columns; empty for a single name, or if a name contains no point."""
    text = find_pattern(names)
    if text is None:
        return ()
    pattern = ColumnPattern(text, {}, Place(""))
    return tuple(point for name in names if (point := pattern.read(name)) is not None)


def _placeholder(match: re.Match[str]) -> str:
    return "{et}" if match[3] in ("us", "µs", "ms") else "{p}"


_SI = {"rail pressure": "Pa", "energising time": "s"}


class WideTable(NamedTuple):
    """Traces of a table."""

    table: Table  # in SI units: the time and the traces, which are named "trace 1" and so on
    names: tuple[str, ...]  # of the traces
    points: dict[str, Floats]  # "rail pressure" [Pa] and "energising time" [s], where the table states them


def find_traces(grid: Grid, time: str, stated: dict[str, str]) -> WideTable:
    """Traces of a table with operating points above.

    `time`: name for the first column, which holds the times. `stated`: units that the file lacks, of "rail pressure",
    "energising time", "time" and "rate". Raises `InputError` if rows with operating points or a unit are missing.
    """
    points, start = _points(grid, stated)
    if not points:
        raise InputError(
            f'{grid.path}: no row states operating points; write rows such as "rail pressure [bar]" and '
            '"energising time [us]" above the traces, with a number for each.',
            code="no-points",
            file=grid.path,
        )
    texts, lines, body = _body(grid, start)
    width = len(next(iter(points.values())))
    if any(len(row) != width for row in points.values()) or body.shape[1] != width + 1:
        raise InputError(
            f"{grid.path}: the rows of operating points have {width} numbers and the table {body.shape[1] - 1} "
            "traces; give one number for each trace.",
            code="wrong-number",
            file=grid.path,
        )
    time_unit = _one(grid, "time", [text for row in texts for text in row[:1]], "s", stated)
    rate_unit = _one(grid, "rate", [text for row in texts for text in row[1:]], "m3/s kg/s", stated)
    names = tuple(f"trace {i + 1}" for i in range(width))
    si = "m3/s" if compatible(rate_unit, "m3/s") else "kg/s"
    columns = {time: convert(body[:, 0], time_unit, "s")}
    columns |= {name: convert(body[:, i + 1], rate_unit, si) for i, name in enumerate(names)}
    written_units, units = {time: time_unit, **dict.fromkeys(names, rate_unit)}, {time: "s", **dict.fromkeys(names, si)}
    table = Table(grid.path, columns, {}, written_units, lines, units=units)
    steps = np.flatnonzero(~(np.diff(columns[time]) > 0.0))
    if len(steps):
        raise table.place(time, int(steps[0]) + 1).error("the time must increase from row to row", code="order")
    return WideTable(table, names, points)


def _points(grid: Grid, stated: dict[str, str]) -> tuple[dict[str, Floats], int]:
    """Operating points by kind, and the row below them."""
    points: dict[str, Floats] = {}
    start = 0
    for i, row in enumerate(grid.rows[:30]):
        numbers, head = read_numbers(row[1:]), row[0]
        if isinstance(head, float):
            break
        if numbers is None or not np.isfinite(numbers).any():
            continue
        units = unit_in(head)
        kinds = (
            point_kind
            for point_kind in _SI
            if stated.get(point_kind) and is_heading(head, point_kind.replace(" ", "_"))
        )
        kind = find_kind(units[0]) if units else next(kinds, "")
        if kind in _SI and kind not in points:
            values = np.array(numbers)
            if not np.isfinite(values).all():
                raise InputError(
                    f"{grid.path}, line {grid.lines[i]}: a {kind} is missing; give one for each trace.",
                    code="missing-value",
                    file=grid.path,
                    place=f"line {grid.lines[i]}",
                )
            points[kind] = convert(values, stated.get(kind) or units[0], _SI[kind])
            start = i + 1
    return points, start


def _body(grid: Grid, start: int) -> tuple[list[Sequence[str]], IndexArray, Floats]:
    """Rows of texts, then lines and numbers of the rows below them."""
    texts: list[Sequence[str]] = []
    lines: list[int] = []
    body: list[list[float]] = []
    for line, row in zip(grid.lines[start:], grid.rows[start:], strict=True):
        numbers = read_numbers(row)
        if numbers is not None:
            lines.append(line)
            body.append(numbers)
        elif body:
            raise InputError(
                f"{grid.path}, line {line}: a row of numbers is expected.",
                code="not-a-number",
                file=grid.path,
                place=f"line {line}",
            )
        else:
            texts.append([str(cell) for cell in row])
    width = max(map(len, body), default=0)
    if not body or width < 2:
        raise InputError(
            f"{grid.path}: there are no rows of numbers below the operating points.", code="empty", file=grid.path
        )
    return texts, np.array(lines, np.intp), np.array([row + [np.nan] * (width - len(row)) for row in body])


def _one(grid: Grid, what: str, texts: Sequence[str], kinds: str, stated: dict[str, str]) -> str:
    """Stated unit of a quantity, or the only fitting unit in the texts."""
    units = dict.fromkeys(plain_unit(name_and_unit(text)[1] or text) for text in texts)
    fitting = [unit for unit in units if any(fits(unit, kind) for kind in kinds.split())]
    if stated.get(what):
        return stated[what]
    if len(fitting) == 1:
        return fitting[0]
    cure = "write it into the header" if not fitting else f"the header has {' and '.join(fitting)}; write one"
    raise InputError(
        f"{grid.path}: the {what} has no unit that is clear; {cure}, or state it.", code="no-unit", file=grid.path
    )
