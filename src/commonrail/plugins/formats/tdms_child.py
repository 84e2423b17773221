"""Reader of TDMS files for `guarded`: channels with the times of their waveforms or groups, by npTDMS."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from nptdms import TdmsFile

from commonrail.base.errors import InputError
from commonrail.base.units import convert, fits
from commonrail.plugins.formats.records import MOST_VALUES, Channels, Refused
from commonrail.readers.guarded import Save

WHAT = "TDMS file"

_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")  # properties, the usual one first
_TIMES = ("time", "t", "zeit", "x", "timestamp", "zeitstempel")  # names of a channel of times that has no unit of time


def read(path: Path, data: bytes, save: Save) -> dict[str, Any]:
    """Channels, each with the names of its arrays, and a fault if it cannot be read."""
    logging.getLogger("nptdms").setLevel(logging.CRITICAL)
    channels = Channels(path, save)
    with TdmsFile(BytesIO(data), read_metadata_only=True, keep_open=True) as file:
        groups = [(str(group.name), list(group.channels())) for group in file.groups()]
        if sum(len(channel) for _, members in groups for channel in members) > MOST_VALUES:
            raise InputError(f"{path}: the record has more than the {MOST_VALUES} values that are read; cut it.")
        for group, members in groups:
            _add_group(channels, group, members)
    return {"channels": channels.entries}


def _add_group(channels: Channels, group: str, members: list[Any]) -> None:
    waveforms = [c for c in members if "wf_increment" in c.properties]
    starts = [start for c in waveforms if isinstance(start := c.properties.get("wf_start_time"), np.datetime64)]
    first = min(starts, default=None)
    clocks = [c for c in members if c not in waveforms and _is_clock(c)]
    clock = clocks[0] if len(clocks) == 1 else None
    for channel in members:
        if channel is not clock:
            read = partial(_read_channel, channel, clock, first)
            master = "time" if channel in waveforms or clock is None else str(clock.name)
            channels.add(str(channel.name), group, _unit(channel.properties), master, len(channel), read)


def _unit(properties: Mapping[str, Any]) -> str:
    return next((str(properties[key]) for key in _UNITS if properties.get(key)), "")


def _is_clock(channel: Any) -> bool:
    """Return whether a channel holds times: it is named so, and has time stamps, seconds or no unit."""
    unit = _unit(channel.properties).strip(" []-")
    is_named = str(channel.name).strip().lower().partition(" ")[0] in _TIMES
    return channel.dtype.kind == "M" or (is_named and (not unit or fits(unit, "s")))


def _read_channel(channel: Any, clock: Any, first: Any) -> tuple[Any, Any, str]:
    """Times [s] and samples of a channel; `first` is the start of the earliest waveform of its group."""
    if channel.dtype.kind not in "biuf":
        raise Refused("its values are not plain numbers")
    samples, wave = channel[:], channel.properties
    if "wf_increment" in wave:
        step, offset = float(wave["wf_increment"]), float(wave.get("wf_start_offset", 0.0))
        start = wave.get("wf_start_time")
        if not step > 0.0:
            raise Refused(f"its wf_increment is {step:g} s, and a time between samples is expected")
        if isinstance(start, np.datetime64):
            offset += float((start - first) / np.timedelta64(1, "ns")) * 1e-9
        return offset + step * np.arange(len(samples)), samples, ""
    if clock is None:
        raise Refused("it has no times: neither wf_increment nor a channel of times in its group")
    times = clock[:]
    if len(times) != len(samples):
        raise Refused(f'it has {len(samples)} samples, and "{clock.name}" has {len(times)} times')
    if times.dtype.kind == "M":
        return (times - times[0]) / np.timedelta64(1, "ns") * 1e-9 if len(times) else np.empty(0), samples, ""
    return convert(times.astype(np.float64), _unit(clock.properties).strip(" []-") or "s", "s"), samples, ""
