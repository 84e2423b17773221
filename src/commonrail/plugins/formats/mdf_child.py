"""Reader of MDF records for `guarded`: channels with the times of their groups, by asammdf."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF

from commonrail.base.text import count_noun
from commonrail.plugins.formats.records import Channels, Refused
from commonrail.readers.guarded import Save

WHAT = "MDF record"

# Conversion rules without texts, by version: none, linear, rational, tables; in version 3 also polynomial, exponential.
_NUMERIC_RULES = {3: (0, 1, 2, 6, 7, 8, 9, 65535), 4: (0, 1, 2, 4, 5, 6)}
_TEXT_RULES = {3: (11, 12), 4: (7, 8)}  # a code, or a range of codes, becomes a text
_BUS = re.compile(r"(CAN|LIN|FLX|ETH|MOST|K_LINE)_", re.I)  # prefix of the names of raw frames in ASAM bus logging


def read(path: Path, data: bytes, save: Save) -> dict[str, Any]:
    """Channels, each with the names of its arrays, and a fault if it cannot be read."""
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    record: Any = MDF(BytesIO(data))
    channels = Channels(path, save)
    for g, group in enumerate(record.groups):
        master = record.masters_db.get(g)
        times = "time" if master is None else str(group.channels[master].name)
        label = str(getattr(group.channel_group, "acq_name", "") or "") or f"group {g + 1}"
        for i, channel in enumerate(group.channels):
            if i != master:
                unit = str(getattr(channel, "unit", "") or "") or str(getattr(channel.conversion, "unit", "") or "")
                count = int(group.channel_group.cycles_nr)
                channels.add(str(channel.name), label, unit, times, count, partial(_read_signal, record, g, i))
    return {"channels": channels.entries}


def _read_signal(record: Any, group: int, channel: int) -> tuple[Any, Any, str]:
    """Times [s] and samples of a channel, and a remark on replaced samples or texts."""
    signal = record.get(group=group, index=channel, raw=True)
    version, rule, said = 4 if str(record.version) >= "4" else 3, signal.conversion, ""
    samples, times = np.asarray(signal.samples), np.array(signal.timestamps, np.float64)
    if _BUS.match(signal.name) and (samples.dtype.names or samples.ndim > 1):
        raise Refused("it holds raw frames of a bus; decode them with the DBC, and save the signals as MDF")
    kind = getattr(rule, "conversion_type", _NUMERIC_RULES[version][0])
    if kind in _TEXT_RULES[version]:
        samples, said = _decode(samples, rule, _NUMERIC_RULES[version])
        times, samples = times[~np.isnan(samples)], samples[~np.isnan(samples)]
    elif kind not in _NUMERIC_RULES[version]:
        raise Refused("its values are converted by a formula, which is not evaluated; export it to CSV")
    elif rule is not None:
        samples = np.asarray(signal.physical().samples)
    return times, samples, said


def _decode(samples: Any, rule: Any, numeric: Sequence[int]) -> tuple[Any, str]:
    """Numbers of codes with texts, and a remark on the texts.

    Codes 0 and 1 are the levels of a switch. If most samples have no text, samples with a text, such as SNA, are NaN.
    """
    blocks = rule.referenced_blocks or {}
    if any(getattr(block, "conversion_type", numeric[0]) not in numeric for block in blocks.values()):
        raise Refused("its values are converted by a formula, which is not evaluated; export it to CSV")
    codes, places = np.unique(samples, return_inverse=True)
    words = _words(rule, codes)
    texts = [f"{code:g} is {word[:40]}" for code, word in zip(codes.tolist(), words, strict=True) if word]
    is_text = np.array([word != "" for word in words])[places]
    if len(codes) and is_text.mean() < 0.5:
        numbers = np.asarray(rule.convert(codes, ignore_value2text_conversions=True), np.float64)[places]
        said = [f"{count_noun(int(is_text.sum()), 'sample')} with the code of a text omitted"] if is_text.any() else []
        said += [] if hasattr(blocks.get("default_addr"), "convert") else ["the file has no scaling rule for numbers"]
        return np.where(is_text, np.nan, numbers), "; ".join(said)
    if set(codes.tolist()) <= {0, 1}:
        return codes[places].astype(np.float64), ", ".join(texts)
    raise Refused(f"its values are texts ({', '.join(texts[:4])}{', …' * (len(texts) > 4)})")


def _words(rule: Any, codes: Any) -> list[str]:
    """Text of each code, or empty; asammdf itself omits the upper ends of ranges of codes."""
    words, blocks, i = [""] * len(codes), rule.referenced_blocks or {}, 0
    # version 3 holds some texts in the rule itself
    while (text := blocks.get(f"text_{i}", getattr(rule, f"text_{i}", None))) is not None:
        exact = getattr(rule, f"val_{i}", getattr(rule, f"param_val_{i}", None))
        low, high = (getattr(rule, f"{end}_{i}", exact) for end in ("lower", "upper"))
        for at in np.flatnonzero((codes >= low) & (codes <= high)).tolist() if isinstance(text, bytes) else ():
            words[at] = text.strip(b" \0").decode("utf-8", "replace")
        i += 1
    return words
