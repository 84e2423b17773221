"""Reader of MDF records for `guarded`: channels with the times of their groups, by asammdf."""

from __future__ import annotations

import logging
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF

from commonrail.base.errors import InputError
from commonrail.readers.guarded import Save

MOST_SAMPLES = 20_000_000  # of a channel
MOST_VALUES = 100_000_000  # of all channels
MOST_CHANNELS = 10_000

# Rules of numbers alone, by version: none, linear, rational, tables; of version 3 polynomial and exponential ones too.
_NUMERIC_RULES = {3: (0, 1, 2, 6, 7, 8, 9, 65535), 4: (0, 1, 2, 4, 5, 6)}


class _Refused(Exception):
    """A channel of a kind that is not read."""


def read(path: Path, data: bytes, save: Save) -> dict[str, Any]:
    """Channels, each with the names of its arrays; one that cannot be read has a `fault`, the end of a sentence."""
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    try:
        return {"channels": _channels(path, MDF(BytesIO(data)), save)}
    except (InputError, MemoryError):
        raise
    except Exception as error:  # of damaged records; their texts name objects of asammdf
        raise InputError(f"{path}: this is no MDF record that can be read ({type(error).__name__}).") from error


def _channels(path: Path, record: Any, save: Save) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    values = 0
    for g, group in enumerate(record.groups):
        master = record.masters_db.get(g)
        times = "time" if master is None else str(group.channels[master].name)
        label = str(getattr(group.channel_group, "acq_name", "") or "") or f"group {g + 1}"
        count = int(group.channel_group.cycles_nr)
        shared: Any = None
        for i, channel in enumerate(group.channels):
            if i == master:
                continue
            unit = str(getattr(channel, "unit", "") or "") or str(getattr(channel.conversion, "unit", "") or "")
            entry = dict(name=str(channel.name), group=label, unit=unit.strip(" []-"), master=times)
            entry |= dict(time="", values="", fault="")
            found.append(entry)
            values += count
            if len(found) > MOST_CHANNELS or values > MOST_VALUES:
                raise InputError(
                    f"{path}: the record has more than the {MOST_CHANNELS} channels or {MOST_VALUES} values that are "
                    "read; cut it."
                )
            if count > MOST_SAMPLES:
                entry["fault"] = f"there are {count} samples, and at most {MOST_SAMPLES} are read; cut the record"
                continue
            try:
                time, samples = _signal(record, g, i)
            except MemoryError:
                raise
            except Exception as error:  # asammdf raises a dozen types for damaged records
                entry["fault"] = str(error) if isinstance(error, _Refused) else "it cannot be read"
                continue
            save(f"v{len(found)}", samples)
            entry |= {"values": f"v{len(found)}", "time": f"t{g}"}
            if shared is None:
                shared = time
                save(f"t{g}", time)
            elif not np.array_equal(shared, time):
                entry["time"] = f"t{g}_{len(found)}"
                save(entry["time"], time)
    return found


def _signal(record: Any, group: int, channel: int) -> tuple[Any, Any]:
    """Times [s] and samples of a channel."""
    signal = record.get(group=group, index=channel, raw=True)
    rules = _NUMERIC_RULES[4 if str(record.version) >= "4" else 3]
    if getattr(signal.conversion, "conversion_type", rules[0]) not in rules:
        raise _Refused("its values are converted by a formula or to texts, which is not read; export it to CSV")
    samples = np.asarray(signal.physical().samples if signal.conversion is not None else signal.samples)
    if samples.ndim != 1 or samples.dtype.kind not in "biuf":
        raise _Refused("its values are no plain numbers")
    return np.array(signal.timestamps, np.float64), samples.astype(np.float64)
