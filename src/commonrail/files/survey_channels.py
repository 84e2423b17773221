"""Channels of a data file, and the block of a study that reads a rate of injection among them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.errors import InputError
from commonrail.files.named_columns import pattern_of
from commonrail.reading.channel_sheet import TIME, ChannelSheet
from commonrail.reading.sheet import Column, Sheet
from commonrail.units import convert, fits, to_text

__all__ = ["UNKNOWN", "ZERO", "Channel", "block_of", "channels_of", "zero_of"]

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
_TRIGGER = re.compile(r"trig|ttl|sync", re.I)
_SET = re.compile(r"set|soll|cmd|nominal", re.I)


class Channel(NamedTuple):
    """A column or channel of a file.

    Attributes
    ----------
    name, unit : str
        Unit of the file.
    size : int
    low, high : float
        Smallest and largest value, in that unit.
    step : float, optional
        Median time between samples [s], of a channel with times of its own.
    times : (float, float), optional
        Its first and last time [s].
    """

    name: str
    unit: str
    size: int
    low: float
    high: float
    step: float | None = None
    times: tuple[float, float] | None = None

    @property
    def kind(self) -> str:
        """SI unit of what it measures, empty if that is unknown."""
        return next((si for si in _MEANINGS if fits(self.unit, si)), "") if self.unit else ""

    def text(self) -> str:
        """One line on it."""
        unit = self.unit or "no unit"
        every = f", every {to_text(self.step, 's')}" if self.step else ""
        meaning = f"; {_MEANINGS[self.kind]}" if self.kind else ""
        return f"{self.size} values, {self.low:.6g} to {self.high:.6g} {unit}{every}{meaning}"


def channels_of(sheet: Sheet) -> tuple[list[Channel], dict[str, str]]:
    """Channels with numbers; what is wrong with others that have a unit, by their names."""
    own_times = isinstance(sheet, ChannelSheet)
    found = []
    unread: dict[str, str] = {}
    for name in sheet.names:
        unit = str(sheet.unit(name)) if hasattr(sheet, "unit") else ""
        wanted = [Column(name, "1", required=False)]
        try:
            table = sheet.take([Column(TIME, "s", increasing=True), *wanted] if own_times else wanted)
        except InputError as error:  # of a column without a unit: texts, or nothing
            unread |= {name: f"not read: {str(error).removeprefix(f'{sheet.path}: ')}"} if unit else {}
            continue
        values = table.columns[name]
        values = values[np.isfinite(values)]
        if len(values):
            found.append(Channel(name, unit, len(values), float(values.min()), float(values.max())))
            times = table.columns[TIME] if own_times else np.empty(0)
            if len(times) > 1:
                ends = float(times[0]), float(times[-1])
                found[-1] = found[-1]._replace(step=float(np.median(np.diff(times))), times=ends)
    if not found:
        reason = next(iter(unread.values()), "no column holds numbers below a header.")
        raise InputError(f"{sheet.path}: {reason.removeprefix('not read: ')}")
    return found, unread


def block_of(path: Path, channels: Sequence[Channel], own_times: bool) -> tuple[str, dict[str, Any]]:
    """Purpose that channels are taken for, and the block of a study that reads them."""
    rates = [c for c in channels if c.kind in RATES]
    times = [c for c in channels if c.kind == "s"]
    base: dict[str, Any] = {"kind": "rate", "file": path.name}
    if not rates:
        return "channels without a rate of injection, whose unit would be one such as mm3/ms or mg/ms", {}
    if not own_times:
        named = [c for c in times if c.name.rpartition(".")[2].lower() in ("time", "t", "zeit")] or times
        if len(named) != 1:
            what = "no column is a time" if not named else f"{_names(named)} may be the time"
            return f"channels of which the times are not clear: {what}", {}
        base |= {"time": named[0].name} if named[0].name != TIME else {}
    zero = zero_of(_times(rates[0] if own_times else named[0]), rates[0].size)
    pattern = pattern_of([c.name for c in rates])
    if pattern is not None:
        count = len(rates)
        return f'{count} traces whose names state their operating points, "{pattern}"', base | {
            "columns": pattern
        } | zero
    if len(rates) > 1:
        return f"channels of which several may be the rate of injection, {_names(rates)}; name one by rate = …", {}
    base["rate"] = rates[0].name
    shots = _shots(channels) if own_times else None
    if shots is not None:
        window = {"window": ["-0.1 ms", "3 ms"]}
        return f'a record of shots, found by the trigger "{shots["trigger"]}"', base | {"shots": shots} | window
    return "a trace", base | zero | {"rail_pressure": UNKNOWN, "energising_time": UNKNOWN}


def _times(channel: Channel) -> tuple[float, float]:
    """First and last time [s] of a channel: its own times, or its values where it is one of times."""
    if channel.times is not None:
        return channel.times
    low, high = convert(np.array([channel.low, channel.high]), channel.unit, "s").tolist()
    return low, high


def zero_of(times: tuple[float, float], size: int) -> dict[str, str]:
    """Key of a block with the time of the file at which energising starts: 0, where the file's times hold it.

    Parameters
    ----------
    times : (float, float)
        First and last one [s].
    size : int
        Number of samples; the first one may end, rather than begin, at its time.
    """
    first, last = times
    interval = (last - first) / max(size - 1, 1)
    return {"time_zero": ZERO if first - 1.5 * interval <= 0.0 <= last else UNKNOWN}


def _shots(channels: Sequence[Channel]) -> dict[str, Any] | None:
    """Keys of the shots of a record: its trigger and the channels of the operating point."""
    triggers = [c for c in channels if _TRIGGER.search(c.name)] or [c for c in channels if c.kind == "V"]
    if len(triggers) != 1:
        return None
    found: dict[str, Any] = {"trigger": triggers[0].name, "offset": UNKNOWN}
    for key, kind in (("rail_pressure", "Pa"), ("energising_time", "s")):
        fitting = [c for c in channels if c.kind == kind]
        chosen = [c for c in fitting if _SET.search(c.name)] if len(fitting) > 1 else fitting
        found |= {key: chosen[0].name} if len(chosen) == 1 else {}
    return found


def _names(channels: Sequence[Channel]) -> str:
    return " and ".join(f'"{c.name}"' for c in channels[:4]) + (" and others" if len(channels) > 4 else "")
