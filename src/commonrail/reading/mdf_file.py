"""Channels of an MDF record (.mf4, .mdf), each with the times of its own group.

A channel whose name occurs in several groups is named with its group, ``800bar 300us/ROI``. Numbers are converted by
the linear, rational and tabular rules of the file; a rule that is a formula as text is not evaluated.
"""

from __future__ import annotations

import json
import subprocess
import sys
import zlib
from functools import lru_cache
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import numpy as np

from commonrail.errors import InputError
from commonrail.reading import mdf_child
from commonrail.reading.channel_sheet import Channel, ChannelSheet
from commonrail.reading.file_form import PLAIN, FileForm
from commonrail.reading.guarded_file import read_plain

__all__ = ["MdfFile"]

LARGEST_CONTENT = 1_000_000_000  # of compressed blocks when they are unpacked [bytes]
LONGEST_READING = 300.0  # [s]

_BLOCK = 24  # bytes of the head of a block
_PACKED = 24  # bytes of the head of what is packed


class _Unreadable(Exception):
    """A record that cannot be read: the reason."""


class MdfFile(ChannelSheet):
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

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
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
        super().__init__(path, found)


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
def _channels(data: bytes) -> tuple[Channel, ...]:
    """Channels of a record."""
    content = _read_apart(data)
    with np.load(BytesIO(content), allow_pickle=False) as arrays:
        entries = json.loads(arrays["channels"].tobytes())
        none = np.empty(0)
        loaded = {name: arrays[name] for name in arrays.files}
    return tuple(
        Channel(
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
