"""Channels of an MDF record (.mf4, .mdf), each with the times of its own group.

A channel whose name occurs in several groups is named with its group, ``800bar 300us/ROI``. Numbers are converted by
the linear, rational and tabular rules of the file; a rule that is a formula as text is not evaluated.
"""

from __future__ import annotations

import json
import subprocess
import sys
import zlib
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError
from commonrail.reading import mdf_child
from commonrail.reading.file_form import PLAIN, FileForm
from commonrail.reading.guarded_file import read_plain
from commonrail.reading.place import Place
from commonrail.reading.sheet import Column, Table, find_column

__all__ = ["MdfFile"]

TIME = "time"  # name of the times of whatever group
LARGEST_CONTENT = 1_000_000_000  # of compressed blocks when they are unpacked [bytes]
LONGEST_READING = 300.0  # [s]

_BLOCK = 24  # bytes of the head of a block
_PACKED = 24  # bytes of the head of what is packed

Floats = NDArray[np.float64]


class _Channel(NamedTuple):
    """A channel: its group, unit, the name of its group's times, its arrays, and what is wrong with it, if anything."""

    name: str
    group: str
    unit: str
    master: str
    time: Floats
    values: Floats
    fault: str


class _Unreadable(Exception):
    """A record that cannot be read: the reason."""


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
        try:
            found = _channels(data)
        except _Unreadable as error:
            raise InputError(f"{path}: this is no MDF record that can be read ({error}).") from error
        if not found:
            raise InputError(f"{path}: the record has no channels.")
        self._channels = _named(found)
        self.names = list(self._channels)

    def unit(self, name: str) -> str:
        """Unit of a channel, empty if the file has none."""
        return self._channels[name].unit

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of one channel and its times; see `Sheet.take`."""
        channels = [column for column in columns if not column.increasing]
        if len(channels) != 1:
            raise InputError(f"{self.path}: each channel of an MDF record has its own times; name files one by one.")
        (wanted,) = channels
        name = self.names[find_column(self.path, self.names, wanted.name)]
        channel = self._channels[name]
        for column in columns:
            if column.increasing and column.name not in (TIME, channel.master):
                raise InputError(
                    f'{self.path}: the times of "{name}" are called "{channel.master}", not "{column.name}"; write '
                    f'time = "{channel.master}" or "{TIME}".'
                )
        if channel.fault:
            raise Place(str(self.path), f'channel "{name}"').error(channel.fault)
        numbers = {c.name: channel.time if c.increasing else channel.values for c in columns}
        given = {c.name: "s" if c.increasing else channel.unit for c in columns}
        table = Table(self.path, numbers, {}, given, np.arange(1, len(channel.time) + 1), row="sample")
        for each, content in numbers.items():
            wrong = np.flatnonzero(~np.isfinite(content))
            if len(wrong):
                raise table.place(each, int(wrong[0])).error("the value is not a finite number")
        return table


def _named(channels: Sequence[_Channel]) -> dict[str, _Channel]:
    """Channels by name, with their groups where a name is not the only one."""
    counts = Counter(channel.name for channel in channels)
    found: dict[str, _Channel] = {}
    for number, channel in enumerate(channels, start=1):
        whole = channel.name if counts[channel.name] == 1 else f"{channel.group}/{channel.name}"
        found[whole if whole not in found else f"{whole}, channel {number}"] = channel
    return found


def _read_apart(data: bytes) -> bytes:
    """Content that `mdf_child` writes, run in a process of its own."""
    command = [sys.executable, "-P", str(Path(mdf_child.__file__))]
    try:
        done = subprocess.run(command, input=data, capture_output=True, timeout=LONGEST_READING, check=False)
    except subprocess.TimeoutExpired as error:
        raise _Unreadable(f"it takes longer than {LONGEST_READING:g} s") from error
    if done.returncode != 0:
        last = done.stderr.decode("utf-8", "replace").strip().rpartition("\n")[2]
        raise _Unreadable(last[:200] if last.isprintable() and done.returncode > 0 else "asammdf ended on it")
    return done.stdout


@lru_cache(maxsize=2)  # a run reads the copy of its data once more
def _channels(data: bytes) -> tuple[_Channel, ...]:
    """Channels of a record."""
    content = _read_apart(data)
    with np.load(BytesIO(content), allow_pickle=False) as arrays:
        entries = json.loads(arrays["channels"].tobytes())
        none = np.empty(0)
        loaded = {name: arrays[name] for name in arrays.files}
    return tuple(
        _Channel(
            entry["name"],
            entry["group"],
            entry["unit"],
            entry["master"],
            loaded.get(entry.get("times", ""), none),
            loaded.get(entry.get("values", ""), none),
            entry["fault"],
        )
        for entry in entries
    )


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
