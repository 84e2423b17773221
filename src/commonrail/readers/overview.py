"""Content of a data file, and the block of a study that reads it: what `inspect` lists and `new` writes.

Nothing is guessed in silence: what a file is taken for follows from units, and where several channels fit, from names
that are written down in `Survey.block`, to be checked.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base import registry
from commonrail.base.arguments import file_path
from commonrail.base.errors import InputError
from commonrail.base.units import convert, fits, to_text
from commonrail.readers.columns import PLAIN, TIME, ChannelSheet, Column, FileForm, Sheet, find_headings, find_unit
from commonrail.readers.formats import find_format
from commonrail.readers.grid import Grid, TooManyCells, read_grid
from commonrail.readers.operating_points import find_pattern, find_traces, point_of_name, unit_of_name
from commonrail.readers.quantity_matrix import FoundMap, GivenUnits, HoldsOnlyMaps, NearMap, find_map, map_in
from commonrail.readers.table_sheet import TableSheet
from commonrail.readers.tables import is_grid, open_sheet

# Channels of a data file, and the block of a study that reads a rate of injection among them.

UNKNOWN = "?"  # what a block needs and the file does not tell
ZERO = "0 us"  # time zero of traces whose times hold it: taken for granted, and said

# What a channel of this SI unit can be.
_MEANINGS = {
    "m3/s": "rate of injection by volume",
    "kg/s": "rate of injection by mass",
    "Pa": "pressure",
    "s": "time",
    "A": "current",
    "V": "voltage",
    "m3": "quantity by volume",
    "kg": "quantity by mass",
    "K": "temperature",
    "m": "lift",
    "1": "plain number",
}
RATES = ("m3/s", "kg/s")
_PLACEHOLDERS = {"rail_pressure": "{p}", "energising_time": "{et}"}
_TRIGGER = re.compile(r"trig|ttl|sync", re.I)
_SET = re.compile(r"set|soll|cmd|nominal", re.I)
# Columns that every test plan has, and no other file.
_PLAN = [Column("test"), Column("rail_pressure", "Pa"), Column("energising_time", "s")]
# Begin of a text by which a file says that nobody measured it; the product's own maps say "simulated".
_SYNTHETIC = re.compile(r"\W*(synth[eé]t|simulated by)", re.I)
_CLOCKS = ("time", "t", "zeit")  # names of times


class Channel(NamedTuple):
    """A column or channel of a file."""

    name: str
    unit: str  # of the file, or of the name
    size: int
    low: float  # smallest value, in that unit
    high: float
    step: float | None = None  # median time between samples [s], of a channel with times of its own
    times: tuple[float, float] | None = None  # its first and last time [s]
    unit_by_name: bool = False  # the file states no unit, and the end of the name does
    remark: str = ""  # omitted samples, times that do not increase

    @property
    def kind(self) -> str:
        """SI unit of what it measures, empty if that is unknown."""
        return next((si for si in _MEANINGS if fits(self.unit, si)), "") if self.unit else ""

    def text(self) -> str:
        """One line on it."""
        unit = (self.unit or "no unit") + (" by its name" if self.unit_by_name else "")
        every = f", every {to_text(self.step, 's')}" if self.step else ""
        further = "".join(f"; {text}" for text in (_MEANINGS.get(self.kind), self.remark) if text)
        return f"{self.size} values, {self.low:.6g} to {self.high:.6g} {unit}{every}{further}"


def read_channels(sheet: Sheet) -> tuple[list[Channel], dict[str, str]]:
    """Channels with numbers; why others are not read, by their names."""
    own_times = isinstance(sheet, ChannelSheet)
    channels = []
    unread: dict[str, str] = dict(getattr(sheet, "unread", {}))
    by_name = not any(find_unit(sheet, name) for name in sheet.names)
    for name in sheet.names:
        unit = unit_of_name(name) if by_name else find_unit(sheet, name)
        columns = [Column(name, "1", required=False)]
        try:
            table = sheet.take([Column(TIME, "s", increasing=True), *columns] if own_times else columns)
        except TooManyCells:
            raise
        except InputError as error:
            unread[name] = f"not read: {str(error).removeprefix(str(sheet.path)).lstrip(':, ')}"
            continue
        values = table.columns[name]
        is_clock = not own_times and name.rpartition(".")[2].lower() in _CLOCKS
        times = table.columns[TIME] if own_times else values if is_clock else np.empty(0)
        values = values[np.isfinite(values)]
        if not len(values):
            unread |= {name: "not read: it holds no number"} if name else {}
            continue
        remarks = [sheet.remark(name)] if isinstance(sheet, ChannelSheet) and sheet.remark(name) else []
        if len(wrong := np.flatnonzero(np.diff(times) <= 0.0)):
            remarks.append(f"its times repeat or run backwards {len(wrong)} times, first at value {wrong[0] + 2}")
        ends = float(values.min()), float(values.max())
        channel = Channel(name, unit, len(values), *ends, unit_by_name=by_name and bool(unit))
        channel = channel._replace(remark="; ".join(remarks))
        if own_times and len(times) > 1:
            ends = float(times[0]), float(times[-1])
            channel = channel._replace(step=float(np.median(np.diff(times))), times=ends)
        channels.append(channel)
    if not channels:
        with_units = (reason for name, reason in unread.items() if name in sheet.names and find_unit(sheet, name))
        reason = next(with_units, "no column holds numbers below a header.")
        raise InputError(f"{sheet.path}: {reason.removeprefix('not read: ')}")
    return channels, unread


def propose_block(path: Path, channels: Sequence[Channel], own_times: bool) -> tuple[str, dict[str, Any]]:
    """Purpose of channels, and the block of a study that reads them; `UNKNOWN` marks missing values."""
    rates = [c for c in channels if c.kind in RATES]
    if not rates:
        return (
            "channels without a rate of injection, whose unit, such as mm3/ms or mg/ms, would be that of the channel "
            "or the end of its name",
            {},
        )
    base: dict[str, Any] = {"kind": "rate", "file": path.name}
    taken, time = "", rates[0]
    if not own_times:
        times = [c for c in channels if c.kind == "s"]
        clocks = [c for c in times if c.name.rpartition(".")[2].lower() in _CLOCKS] or times
        if len(clocks) != 1:
            what = "no column is a time" if not clocks else f"{_names(clocks)} may be the time"
            taken, base["time"] = f"; the times are not clear: {what}", UNKNOWN
        else:
            time = clocks[0]
            base |= {"time": time.name} if time.name != TIME else {}
    base |= {"time_unit": time.unit} if time.unit_by_name and not own_times and not taken else {}
    base |= {"rate_unit": rates[0].unit} if rates[0].unit_by_name else {}
    zero = {"time_zero": UNKNOWN}
    if not taken:
        low, high = time.times or convert(np.array([time.low, time.high]), time.unit, "s").tolist()
        zero = propose_time_zero((low, high), rates[0].size)
    stated = point_of_name(path.stem if len(rates) > 1 else f"{path.stem} {rates[0].name}")
    point = {key: stated.get(key, UNKNOWN) for key in ("rail_pressure", "energising_time")}
    pattern = find_pattern([c.name for c in rates])
    if pattern is not None:
        point = {key: value for key, value in point.items() if _PLACEHOLDERS[key] not in pattern}
        said = f'{len(rates)} traces whose names state their operating points, "{pattern}"'
        return said + taken, base | {"columns": pattern} | zero | point
    if len(rates) > 1:
        taken = f"; several channels may be the rate of injection: {_names(rates)}{taken}"
        return f"a trace{taken}", base | {"rate": UNKNOWN} | zero | point
    base["rate"] = rates[0].name
    shots = _shots(channels) if own_times else None
    if shots is not None:
        point = {key: value for key, value in point.items() if key not in shots}
        base |= {"shots": shots, "window": ["-0.1 ms", "3 ms"]} | point
        return f'a record of shots, found by the trigger "{shots["trigger"]}"', base
    return f"a trace{taken}", base | zero | point


def propose_time_zero(times: tuple[float, float], size: int) -> dict[str, str]:
    """Key of a block with the time of the file at which energising starts: 0, where the file's times hold it.

    `times` are the first and the last one [s]. `size`: number of samples; the first one may end, rather than begin, at
    its time.
    """
    first, last = times
    interval = (last - first) / max(size - 1, 1)
    return {"time_zero": ZERO if first - 1.5 * interval <= 0.0 <= last else UNKNOWN}


def _shots(channels: Sequence[Channel]) -> dict[str, Any] | None:
    """Keys of the shots of a record: its trigger and the channels of the operating point."""
    triggers = [c for c in channels if _TRIGGER.search(c.name)] or [c for c in channels if c.kind == "V"]
    if len(triggers) != 1:
        return None
    keys: dict[str, Any] = {"trigger": triggers[0].name, "offset": UNKNOWN}
    for key, kind in (("rail_pressure", "Pa"), ("energising_time", "s")):
        fitting = [c for c in channels if c.kind == kind]
        matches = [c for c in fitting if _SET.search(c.name)] if len(fitting) > 1 else fitting
        keys |= {key: matches[0].name} if len(matches) == 1 else {}
    return keys


def _names(channels: Sequence[Channel]) -> str:
    return " and ".join(f'"{c.name}"' for c in channels[:4]) + (" and others" if len(channels) > 4 else "")


@dataclass(frozen=True)
class Survey:
    """Content of a data file."""

    path: Path
    taken_for: str
    facts: dict[str, str]  # channels, axes and ranges
    said: str = ""  # detected form of the file
    # keys of a block that reads the file, empty if it cannot be data of a study; `UNKNOWN` marks missing values
    block: dict[str, Any] = field(default_factory=dict)
    quantity_map: FoundMap | None = None  # quantity map of the file
    channels: tuple[Channel, ...] = ()
    synthetic: str = ""  # what the file itself says of this, empty if nothing

    def reason(self) -> str:
        """Why the file cannot be data of a study, in one sentence."""
        why = self.facts.get("reason") or self.facts.get("no map")
        return f"taken for {self.taken_for}{f' ({why.removesuffix(chr(46))})' if why else ''}"


def inspect(path: str | Path, form: FileForm = PLAIN, units: GivenUnits = GivenUnits()) -> Survey:
    """List what a data file holds and what it is taken for.

    Parameters
    ----------
    path : str or path
        CSV, Excel, MDF, TDMS, LabVIEW, MAT, Parquet, DCM file, or one of a format that an installed package inspects.
    form : FileForm
        Encoding, decimal sign and sheet, where they are stated.
    units : GivenUnits
        Units of a map that its file does not give.

    Returns
    -------
    Survey
        Of a format that an installed package inspects, its facts alone.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    path = file_path(path, "data file")
    if inspector := registry.find("inspectors", find_format(path)):
        return Survey(path, "", dict(inspector.call(path)))
    return survey(path, form, units)


def survey(path: Path, form: FileForm = PLAIN, units: GivenUnits = GivenUnits()) -> Survey:
    """Find out the content of a data file.

    `form`: encoding, decimal sign and sheet, where they are stated. `units`: units of a map that its
    file does not give. Raises `InputError` if the file cannot be read.
    """
    if not is_grid(path):
        sheet = open_sheet(path, form)
        content = _of_channels(path, sheet, units)
        return replace(content, said=content.said or getattr(sheet, "said", ""))
    grid = read_grid(path, form)
    if _is_plan(grid):
        taken = 'a test plan, for commonrail plan or a block with kind = "test plan"'
        content = _columns(grid, form, units)
        facts = content.facts | {"test": "names of the tests"}
        return replace(content, taken_for=taken, facts=facts, block={}, synthetic=_synthetic(grid))
    reasons, taken, listed = [], "a table, no quantity map and no trace", dict[str, str]()
    for way in (_map, _traces, _columns):
        try:
            content = way(grid, form, units)
        except TooManyCells:  # no way of reading it gives the intended numbers
            raise
        except InputError as error:
            taken = "a quantity map that lacks something" if isinstance(error, NearMap) else taken
            reasons.append(str(error).removeprefix(f"{path}: "))
            continue
        if content.block or not taken.startswith("a quantity map"):
            return replace(content, synthetic=_synthetic(grid))
        listed = content.facts
    facts = listed | {"reason": reasons[0], "rows": str(len(grid.rows)), "first row": _list_cells(grid.rows[0])}
    return Survey(path, taken, facts, "; ".join(grid.said))


def _is_plan(grid: Grid) -> bool:
    try:
        return len(find_headings(TableSheet(grid), _PLAN)) == len(_PLAN)
    except InputError:
        return False


def synthetic_mark(texts: Iterable[str]) -> str:
    """First text, of comments and cells, that opens with the word synthetic, in one of several languages."""
    return next((text.strip() for text in texts if _SYNTHETIC.match(text)), "")


def _synthetic(grid: Grid) -> str:
    return synthetic_mark((*grid.comments, *(cell for row in grid.rows for cell in row if isinstance(cell, str))))


def _map(grid: Grid, form: FileForm, units: GivenUnits) -> Survey:
    return _of_map(find_map(grid, units), form, units)


def _of_map(quantity_map: FoundMap, form: FileForm, units: GivenUnits) -> Survey:
    facts = {
        name: f"{values.min():g} to {values.max():g} {quantity_map.units[name]}"
        + (f", {len(set(values.tolist()))} values" if name != "quantity" else f", {len(values)} points")
        for name, values in quantity_map.values.items()
    }
    facts |= {name.replace("_", " "): text for name, text in quantity_map.notes.items()}
    layout = "matrix" if quantity_map.form.startswith("a matrix") else "found"
    block = {"kind": "quantities", "file": quantity_map.path.name, "layout": layout} | _form_keys(form)
    keys = ("rail_pressure_unit", "energising_time_unit", "quantity_unit")
    block |= {key: unit for key, unit in zip(keys, units.by_kind().values(), strict=True) if unit}
    repeats = len(quantity_map.quantity) > len(
        {*zip(quantity_map.rail_pressure.tolist(), quantity_map.energising_time.tolist(), strict=True)}
    )
    block |= {"repeated": "mean"} if repeats else {}
    return Survey(
        quantity_map.path,
        f"{quantity_map.kind}: {quantity_map.form}",
        facts,
        "; ".join(quantity_map.said),
        block,
        quantity_map,
    )


def _traces(grid: Grid, form: FileForm, units: GivenUnits) -> Survey:
    stated = {"rail pressure": units.pressure, "energising time": units.time}
    wide = find_traces(grid, TIME, stated)
    facts = {
        name: ", ".join(to_text(float(v), {"rail pressure": "Pa"}.get(name, "s")) for v in values)
        for name, values in wide.points.items()
    }
    time = wide.table.columns[TIME]
    facts |= {"time": f"{len(time)} samples from {to_text(float(time[0]), 's')} to {to_text(float(time[-1]), 's')}"}
    block = {"kind": "rate", "file": grid.path.name, "layout": "header rows"} | _form_keys(form)
    block |= propose_time_zero((float(time[0]), float(time[-1])), len(time))
    missing = {key: UNKNOWN for key in ("rail pressure", "energising time") if key not in wide.points}
    block |= {key.replace(" ", "_"): value for key, value in missing.items()}
    taken = f"{len(wide.names)} traces below rows with their operating points"
    return Survey(grid.path, taken, facts, "; ".join(grid.said), block)


def _columns(grid: Grid, form: FileForm, units: GivenUnits) -> Survey:
    content = _of_channels(grid.path, TableSheet(grid), units)
    if not content.block:
        return Survey(grid.path, content.taken_for, content.facts, "; ".join(grid.said))
    block = {"kind": content.block["kind"], "file": grid.path.name, **_form_keys(form)} | content.block
    return replace(content, said="; ".join(grid.said), block=block)


def _of_channels(path: Path, sheet: Sheet, units: GivenUnits) -> Survey:
    """Survey of a file with named channels, or with maps."""
    if isinstance(sheet, HoldsOnlyMaps):
        facts, mark = sheet.facts, synthetic_mark(sheet.comments)
        try:
            content = _of_map(map_in(sheet, units), PLAIN, units)
        except InputError as error:
            facts = facts | {"no map": str(error).removeprefix(f"{path}: ")}
            return Survey(path, sheet.taken_for, facts, synthetic=mark)
        taken = f"{sheet.taken_for}, and {content.taken_for}"
        return replace(content, taken_for=taken, facts=facts | content.facts, synthetic=mark)
    channels, unread = read_channels(sheet)
    facts, no_map = {channel.name: channel.text() for channel in channels} | unread, ""
    if not isinstance(sheet, ChannelSheet | TableSheet):
        try:
            content = _of_map(map_in(sheet, units), PLAIN, units)
            return Survey(
                path, content.taken_for, facts | content.facts, content.said, content.block, content.quantity_map
            )
        except InputError as error:
            no_map = str(error).removeprefix(f"{path}: ")
    taken, block = propose_block(path, channels, isinstance(sheet, ChannelSheet))
    facts |= {"no map": no_map} if no_map and not block else {}
    return Survey(path, taken, facts, "", block, channels=tuple(channels))


def _form_keys(form: FileForm) -> dict[str, Any]:
    stated: Mapping[str, str] = {"encoding": form.encoding, "decimal": form.decimal, "sheet": form.sheet}
    return {key: value for key, value in stated.items() if value}


def _list_cells(row: Sequence[str | float], most: int = 12) -> str:
    heads = [str(cell) for cell in row]
    return ", ".join(heads[:most]) + (f" and {len(heads) - most} more" if len(heads) > most else "")
