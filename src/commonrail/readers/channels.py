"""Channels of a record, each with times of its own: what the formats of records have in common."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.readers.columns import Column, Table, find_column, finite
from commonrail.readers.location import Place

TIME = "time"  # name of the times of whatever channel


class Channel(NamedTuple):
    """A channel: its group, unit, the name of its times, its arrays, and what is wrong with it, if anything."""

    name: str
    group: str
    unit: str
    master: str
    time: Floats
    values: Floats
    fault: str


class ChannelSheet:
    """Channels as a `Sheet` whose columns are apart.

    A channel whose name occurs several times is named with its group.
    """

    apart = True

    def __init__(self, path: Path, channels: Sequence[Channel]) -> None:
        self.path = path
        self._channels = _named(channels)
        self.names = list(self._channels)

    def unit(self, name: str) -> str:
        """Unit of a channel, empty if the file has none."""
        return self._channels[name].unit

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of one channel and its times; see `Sheet.take`."""
        channels = [column for column in columns if not column.increasing]
        if len(channels) != 1:
            raise InputError(f"{self.path}: each channel of this record has its own times; name files one by one.")
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
        return finite(table, [column._replace(required=True) for column in columns], "the value is not a finite number")


def _named(channels: Sequence[Channel]) -> dict[str, Channel]:
    """Channels by name, with their groups where a name is not the only one."""
    counts = Counter(channel.name for channel in channels)
    found: dict[str, Channel] = {}
    for number, channel in enumerate(channels, start=1):
        whole = channel.name if counts[channel.name] == 1 else f"{channel.group}/{channel.name}"
        found[whole if whole not in found else f"{whole}, channel {number}"] = channel
    return found
