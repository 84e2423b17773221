"""Content of a data file, and the block of a study that reads it: what `inspect` lists and `new` writes.

Nothing is guessed in silence: what a file is taken for follows from units, and where several channels fit, from names
that are written down in `Survey.block`, to be checked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from commonrail.errors import InputError
from commonrail.files.survey_channels import UNKNOWN, block_of, channels_of, zero_of
from commonrail.reading.channel_sheet import TIME, ChannelSheet
from commonrail.reading.column_map import find_column_map
from commonrail.reading.file_form import PLAIN, FileForm
from commonrail.reading.grid import Grid, read_grid
from commonrail.reading.grid_sheet import GridSheet
from commonrail.reading.guarded_file import read_plain
from commonrail.reading.map_table import FoundMap, GivenUnits, find_map
from commonrail.reading.mat_file import MatFile
from commonrail.reading.mat_map import find_mat_map
from commonrail.reading.parquet_file import ParquetFile
from commonrail.reading.sheet import Sheet
from commonrail.reading.tables import open_sheet
from commonrail.reading.wide_table import find_traces
from commonrail.units import to_text

__all__ = ["OF_CHANNELS", "Survey", "survey"]

OF_CHANNELS = (".mf4", ".mdf", ".lvm", ".mat", ".parquet", ".pq")


@dataclass(frozen=True)
class Survey:
    """Content of a data file.

    Attributes
    ----------
    path : Path
    taken_for : str
    facts : dict of str to str
        Channels, axes and ranges.
    said : str
        What was detected of the file's form.
    block : dict of str to object
        Keys of a block of a study that reads the file; empty if it is no data of a study. `UNKNOWN` stands for what
        must be stated.
    found : FoundMap or None
        Quantity map of the file.
    """

    path: Path
    taken_for: str
    facts: dict[str, str]
    said: str = ""
    block: dict[str, Any] = field(default_factory=dict)
    found: FoundMap | None = None


def survey(path: Path, form: FileForm = PLAIN, given: GivenUnits = GivenUnits()) -> Survey:
    """Find out the content of a data file.

    Parameters
    ----------
    path : Path
    form : FileForm
        Encoding and sheet, where they are stated; the decimal sign is detected.
    given : GivenUnits
        Units of a map that its file does not give.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    if path.suffix.lower() in OF_CHANNELS:
        form = _detected(path, form)
        found = _of_channels(path, open_sheet(path, form), given)
        if path.suffix.lower() != ".lvm" or not form.encoding:
            return found
        keys = {"encoding": form.encoding} if found.block else {}
        return replace(found, said=f"encoding {form.encoding}", block=found.block | keys)
    grid = read_grid(path, form.encoding or None, form.sheet or None)
    reasons = []
    for way in (_map, _traces, _columns):
        try:
            return way(grid, form, given)
        except InputError as error:
            reasons.append(str(error).removeprefix(f"{path}: "))
    facts = {"reason": reasons[0], "rows": str(len(grid.rows)), "first row": _shown(grid.rows[0])}
    return Survey(path, "a table, no quantity map and no trace", facts, "; ".join(grid.said))


def _detected(path: Path, form: FileForm) -> FileForm:
    """Form with the encoding of a text of channels: UTF-8, else cp1252, in which LabVIEW writes mm³ on Windows."""
    if path.suffix.lower() != ".lvm" or form.encoding:
        return form
    data = read_plain(path)
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return form if b"\0" in data else form._replace(encoding="cp1252")
    return form


def _map(grid: Grid, form: FileForm, given: GivenUnits) -> Survey:
    return _of_map(grid.path, find_map(grid, given), form, given)


def _of_map(path: Path, found: FoundMap, form: FileForm, given: GivenUnits) -> Survey:
    axes = {"rail pressure": found.rail_pressure, "energising time": found.energising_time, "quantity": found.quantity}
    facts = {
        name: f"{values.min():g} to {values.max():g} {found.units[name]}"
        + (f", {len(set(values.tolist()))} values" if name != "quantity" else f", {len(values)} points")
        for name, values in axes.items()
    }
    layout = "matrix" if found.form.startswith("a matrix") else "found"
    block = {"kind": "quantities", "file": path.name, "layout": layout} | _form_keys(form)
    keys = ("rail_pressure_unit", "energising_time_unit", "quantity_unit")
    block |= {key: unit for key, unit in zip(keys, given.by_kind().values(), strict=True) if unit}
    repeats = len(found.quantity) > len(
        {*zip(found.rail_pressure.tolist(), found.energising_time.tolist(), strict=True)}
    )
    block |= {"repeated": "mean"} if repeats else {}
    return Survey(path, f"a quantity map: {found.form}", facts, "; ".join(found.said), block, found)


def _traces(grid: Grid, form: FileForm, given: GivenUnits) -> Survey:
    stated = {"rail pressure": given.pressure, "energising time": given.time}
    wide = find_traces(grid, TIME, stated)
    facts = {
        name: ", ".join(to_text(float(v), {"rail pressure": "Pa"}.get(name, "s")) for v in values)
        for name, values in wide.points.items()
    }
    time = wide.table.columns[TIME]
    facts |= {"time": f"{len(time)} samples from {to_text(float(time[0]), 's')} to {to_text(float(time[-1]), 's')}"}
    block = {"kind": "rate", "file": grid.path.name, "layout": "header rows"} | _form_keys(form)
    block |= zero_of((float(time[0]), float(time[-1])), len(time))
    missing = {key: UNKNOWN for key in ("rail pressure", "energising time") if key not in wide.points}
    block |= {key.replace(" ", "_"): value for key, value in missing.items()}
    taken = f"{len(wide.names)} traces below rows with their operating points"
    return Survey(grid.path, taken, facts, "; ".join(grid.said), block)


def _columns(grid: Grid, form: FileForm, given: GivenUnits) -> Survey:
    found = _of_channels(grid.path, GridSheet(grid), given)
    if not found.block:
        return Survey(grid.path, found.taken_for, found.facts, "; ".join(grid.said))
    keys = _form_keys(form)
    encoding = grid.said[0].removeprefix("encoding ")
    if grid.path.suffix.lower() != ".xlsx":
        keys |= {"encoding": encoding} if encoding not in ("utf-8", "utf-8-sig") else {}
        keys |= {"decimal": ","} if "decimal comma" in grid.said else {}
    block = {"kind": found.block["kind"], "file": grid.path.name, **keys} | found.block
    return Survey(grid.path, found.taken_for, found.facts, "; ".join(grid.said), block)


def _of_channels(path: Path, sheet: Sheet, given: GivenUnits) -> Survey:
    """Survey of a file with named channels."""
    channels, unread = channels_of(sheet)
    facts = {channel.name: channel.text() for channel in channels} | unread
    if isinstance(sheet, MatFile | ParquetFile):
        try:
            own = find_mat_map(sheet, given) if isinstance(sheet, MatFile) else find_column_map(sheet, given)
            found = _of_map(path, own, PLAIN, given)
            return Survey(path, found.taken_for, facts | found.facts, found.said, found.block, found.found)
        except InputError as error:
            facts["no map"] = str(error).removeprefix(f"{path}: ")
    taken, block = block_of(path, channels, isinstance(sheet, ChannelSheet))
    return Survey(path, taken, facts, "", block)


def _form_keys(form: FileForm) -> dict[str, Any]:
    stated: Mapping[str, str] = {"encoding": form.encoding, "sheet": form.sheet}
    return {key: value for key, value in stated.items() if value}


def _shown(row: Sequence[str | float], most: int = 12) -> str:
    heads = [str(cell) for cell in row]
    return ", ".join(heads[:most]) + (f" and {len(heads) - most} more" if len(heads) > most else "")
