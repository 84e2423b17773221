"""Program that reads an MDF record from its standard input and writes its channels as NumPy arrays to its output.

`mdf_file` runs it in a process of its own: asammdf has parts in C that a damaged record can end. It imports nothing of
commonrail, so that it starts quickly.
"""

from __future__ import annotations

import json
import logging
import os
import sys
from io import BytesIO
from typing import Any

import numpy as np

MOST_SAMPLES = 20_000_000  # of a channel
MOST_VALUES = 100_000_000  # of all channels
MOST_CHANNELS = 10_000

# Rules of numbers alone, by version: none, linear, rational, tables; of version 3 polynomial and exponential ones too.
_NUMERIC_RULES = {3: (0, 1, 2, 6, 7, 8, 9, 65535), 4: (0, 1, 2, 4, 5, 6)}


def channels_of(data: bytes) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Channels of a record, each with the names of its arrays, and the arrays.

    A channel that cannot be read has a `fault`, the end of a sentence.
    """
    from asammdf import MDF

    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    record: Any = MDF(BytesIO(data))
    found: list[dict[str, Any]] = []
    arrays: dict[str, Any] = {}
    values = 0
    for g, group in enumerate(record.groups):
        master = record.masters_db.get(g)
        times = "time" if master is None else str(group.channels[master].name)
        label = str(getattr(group.channel_group, "acq_name", "") or "") or f"group {g + 1}"
        count = int(group.channel_group.cycles_nr)
        for i, channel in enumerate(group.channels):
            if i == master:
                continue
            unit = str(getattr(channel, "unit", "") or "") or str(getattr(channel.conversion, "unit", "") or "")
            entry = {
                "name": str(channel.name),
                "group": label,
                "unit": unit.strip(" []-"),
                "master": times,
                "fault": "",
            }
            found.append(entry)
            values += count
            if len(found) > MOST_CHANNELS or values > MOST_VALUES:
                raise SystemExit(f"more than the {MOST_CHANNELS} channels or {MOST_VALUES} values that are read")
            if count > MOST_SAMPLES:
                entry["fault"] = f"there are {count} samples, and at most {MOST_SAMPLES} are read; cut the record"
                continue
            try:
                time, samples = _signal(record, g, i)
            except Exception as error:  # asammdf raises a dozen types for damaged records
                entry["fault"] = str(error) if isinstance(error, _Refused) else "it cannot be read"
                continue
            key = f"{len(found)}"
            arrays[f"v{key}"] = samples
            shared = f"t{g}"
            own = shared if np.array_equal(arrays.setdefault(shared, time), time) else f"t{g}_{key}"
            arrays[own] = time
            entry |= {"values": f"v{key}", "times": own}
    return found, arrays


class _Refused(Exception):
    """A channel of a kind that is not read."""


def _signal(record: Any, group: int, channel: int) -> tuple[Any, Any]:
    signal = record.get(group=group, index=channel, raw=True)
    rules = _NUMERIC_RULES[4 if str(record.version) >= "4" else 3]
    if getattr(signal.conversion, "conversion_type", rules[0]) not in rules:
        raise _Refused("its values are converted by a formula or to texts, which is not read; export it to CSV")
    samples = np.asarray(signal.physical().samples if signal.conversion is not None else signal.samples)
    if samples.ndim != 1 or samples.dtype.kind not in "biuf":
        raise _Refused("its values are no plain numbers")
    return np.array(signal.timestamps, np.float64), samples.astype(np.float64)


def packed(data: bytes) -> bytes:
    """Channels of a record as the content of an .npz file."""
    found, arrays = channels_of(data)
    content = BytesIO()
    np.savez(content, channels=np.frombuffer(json.dumps(found).encode(), np.uint8), **arrays)
    return content.getvalue()


def main() -> None:
    """Read from standard input, write to the standard output as it was when the program began."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print must not come between the arrays
    data = sys.stdin.buffer.read()
    try:
        content = packed(data)
    except Exception as error:  # of damaged records; their texts name objects of asammdf
        raise SystemExit(type(error).__name__) from error
    output.write(content)
    output.close()
    os._exit(0)  # nothing that is left is worth its time, or a fault at its end


if __name__ == "__main__":
    main()
