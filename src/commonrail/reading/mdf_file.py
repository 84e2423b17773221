"""Channels of an MDF record (.mf4, .mdf), each with the times of its own group.

A channel whose name occurs in several groups is named with its group, ``800bar 300us/ROI``. Numbers are converted by
the linear, rational and tabular rules of the file; a rule that is a formula as text is not evaluated.
"""

from __future__ import annotations

import gc
import logging
import sys
import traceback
import zlib
from collections import Counter
from collections.abc import Sequence
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError
from commonrail.reading.file_form import PLAIN, FileForm
from commonrail.reading.guarded_file import read_plain
from commonrail.reading.place import Place
from commonrail.reading.sheet import Column, Table, find_column

__all__ = ["MdfFile"]

TIME = "time"  # name of the times of whatever group
MOST_SAMPLES = 20_000_000  # of a channel
MOST_CHANNELS = 10_000
LARGEST_CONTENT = 1_000_000_000  # of compressed blocks when they are unpacked [bytes]

_NUMERIC_RULES = (0, 1, 2, 4, 5, 6)  # none, linear, rational, tables of numbers
_BLOCK = 24  # bytes of the head of a block
_PACKED = 24  # bytes of the head of what is packed


class _Place(NamedTuple):
    """A channel: its group and index, its unit, and the name of the times of its group."""

    group: int
    channel: int
    unit: str
    master: str


class MdfFile:
    """MDF record, a `Sheet` whose columns are apart.

    Parameters
    ----------
    path : Path
    form : FileForm
        Without meaning here.

    Raises
    ------
    InputError
        If it cannot be read, is beyond a limit, or asammdf is not installed.
    """

    apart = True

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        self.path = path
        data = read_plain(path)
        if find_spec("asammdf") is None:
            raise InputError(
                f"{path}: MDF files need asammdf; install commonrail[mdf], or export the channels to a CSV file."
            )
        _check_packed(path, data)
        self._record = _opened(path, data)
        self._places = self._found()
        self.names = list(self._places)

    def _found(self) -> dict[str, _Place]:
        found: list[tuple[str, str, _Place]] = []
        for g, group in enumerate(self._record.groups):
            master = self._record.masters_db.get(g)
            times = TIME if master is None else str(group.channels[master].name)
            label = str(getattr(group.channel_group, "acq_name", "") or "") or f"group {g + 1}"
            for i, channel in enumerate(group.channels):
                if i != master:
                    unit = str(getattr(channel, "unit", "") or "") or _unit_of_rule(channel)
                    found.append((str(channel.name), label, _Place(g, i, unit.strip(" []-"), times)))
        if not 0 < len(found) <= MOST_CHANNELS:
            raise InputError(f"{self.path}: the record has {len(found)} channels, and 1 to {MOST_CHANNELS} are read.")
        counts = Counter(name for name, _, _ in found)
        places: dict[str, _Place] = {}
        for name, label, place in found:
            whole = name if counts[name] == 1 else f"{label}/{name}"
            while whole in places:
                whole = f"{whole}, group {place.group + 1}"
            places[whole] = place
        return places

    def unit(self, name: str) -> str:
        """Unit of a channel, empty if the file has none."""
        return self._places[name].unit

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of one channel and its times; see `Sheet.take`."""
        channels = [column for column in columns if not column.increasing]
        if len(channels) != 1:
            raise InputError(f"{self.path}: each channel of an MDF record has its own times; name files one by one.")
        (wanted,) = channels
        name = self.names[find_column(self.path, self.names, wanted.name)]
        place = self._places[name]
        for column in columns:
            if column.increasing and column.name not in (TIME, place.master):
                raise InputError(
                    f'{self.path}: the times of "{name}" are called "{place.master}", not "{column.name}"; write '
                    f'time = "{place.master}" or "{TIME}".'
                )
        time, values = self._signal(name, place)
        numbers = {column.name: time if column.increasing else values for column in columns}
        given = {column.name: "s" if column.increasing else place.unit for column in columns}
        table = Table(self.path, numbers, {}, given, np.arange(1, len(time) + 1), row="sample")
        for each, content in numbers.items():
            wrong = np.flatnonzero(~np.isfinite(content))
            if len(wrong):
                raise table.place(each, int(wrong[0])).error("the value is not a finite number")
        return table

    def _signal(self, name: str, place: _Place) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        group = self._record.groups[place.group]
        at = Place(str(self.path), f'channel "{name}"')
        count = int(group.channel_group.cycles_nr)
        if count > MOST_SAMPLES:
            raise at.error(f"there are {count} samples, and at most {MOST_SAMPLES} are read; cut the record")
        try:
            signal = self._record.get(group=place.group, index=place.channel, raw=True)
            rule = getattr(signal.conversion, "conversion_type", 0)
            if rule not in _NUMERIC_RULES:
                raise at.error("its values are converted by a formula or to texts, which is not read; export it to CSV")
            samples = np.asarray(signal.physical().samples if signal.conversion is not None else signal.samples)
            time = np.array(signal.timestamps, np.float64)
        except InputError:
            raise
        except Exception as error:  # asammdf raises a dozen types for damaged records
            raise at.error(f"it cannot be read ({type(error).__name__})") from error
        if samples.ndim != 1 or samples.dtype.kind not in "biuf":
            raise at.error("its values are no plain numbers")
        return time, samples.astype(np.float64)


def _unit_of_rule(channel: Any) -> str:
    return str(getattr(getattr(channel, "conversion", None), "unit", "") or "")


def _opened(path: Path, data: bytes) -> Any:
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    from asammdf import MDF

    try:
        return MDF(BytesIO(data))
    except Exception as error:  # as above
        reason = type(error).__name__
        _forget(error)
    raise InputError(f"{path}: this is no MDF record that can be read ({reason}).")


def _forget(error: Exception) -> None:
    """Free a record that could not be opened: asammdf's would complain on stderr whenever it is collected."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        error.__traceback__ = error.__context__ = None
        gc.collect()
    finally:
        sys.unraisablehook = hook


def _check_packed(path: Path, data: bytes) -> None:
    """Refuse compressed blocks that are more than they say, or more than is read in all."""
    total, start = 0, data.find(b"##DZ")
    while start >= 0:
        head = start + _BLOCK
        said = int.from_bytes(data[head + 8 : head + 16], "little")
        length = int.from_bytes(data[head + 16 : head + 24], "little")
        total += said
        if total > LARGEST_CONTENT:
            raise InputError(f"{path}: unpacked the record has {total / 1e6:.0f} MB or more, more than is read.")
        packed = data[head + _PACKED : head + _PACKED + length]
        try:
            unpacked = zlib.decompressobj().decompress(packed, said + 1)
        except zlib.error:
            unpacked = b""  # the four letters of something else, or a damaged block, which is told when it is read
        if len(unpacked) > said:
            raise InputError(f"{path}: a compressed block holds more than it says; the record is damaged.")
        start = data.find(b"##DZ", start + 4)
