"""Channels of MDF and TDMS records, each with its own times, read by a library in a child process.

A channel whose name occurs in several groups is named with its group, ``800bar 300us/ROI``. Numbers are converted by
the linear, rational and tabular rules of the file; a rule that is a formula as text is not evaluated. A channel of
codes with texts is numeric if the codes are 0 and 1, as for a trigger, or if only a few samples have a text, such as
SNA; these samples are omitted.

Times of TDMS are ``wf_start_offset + n wf_increment``, from the earliest ``wf_start_time`` of the group; a group
without waveforms has one channel of times.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.errors import InputError
from commonrail.base.input import read_plain
from commonrail.readers.columns import PLAIN, Channel, ChannelSheet, FileForm
from commonrail.readers.guarded import Save, read_apart

MOST_SAMPLES = 20_000_000  # of a channel
MOST_VALUES = 100_000_000  # of all channels
MOST_CHANNELS = 10_000


class _Record(ChannelSheet):
    """Record: a `Sheet` in which each column has its own times.

    The `form` is not used. Raises `InputError` if the record cannot be read or exceeds a limit, or if the library of
    the extra is not installed.
    """

    extra: str
    library: str

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        data = read_plain(path)
        if find_spec(self.library) is None:
            raise InputError(
                f"{path}: {self.extra.upper()} files need {self.library}; install commonrail[{self.extra}], or export "
                "the channels to a CSV file."
            )
        about, arrays = read_apart(f"{__package__}.{self.extra}_child", path, data)
        arrays[""] = np.empty(0)  # of a channel that cannot be read
        channels = [
            Channel(**entry | {key: arrays[entry[key]] for key in ("time", "values")}) for entry in about["channels"]
        ]
        if not channels:
            raise InputError(f"{path}: the record has no channels.")
        super().__init__(path, channels)


class MdfFile(_Record):
    """MDF record (.mf4, .mdf), read by asammdf."""

    extra, library = "mdf", "asammdf"


class TdmsFile(_Record):
    """Record of LabVIEW (.tdms), read by npTDMS."""

    extra, library = "tdms", "nptdms"


class Refused(Exception):
    """The channel is of an unsupported kind; the text is the end of a sentence."""


class Channels:
    """Channels of a record, saved one by one in the child process."""

    def __init__(self, path: Path, save: Save) -> None:
        self.entries: list[dict[str, Any]] = []  # fields of `Channel`, with the names of the saved arrays
        self._path, self._save, self._values = path, save, 0
        self._times: tuple[str, Any] = "", None  # name and values of the times saved last

    def add(
        self, name: str, group: str, unit: str, master: str, count: int, read: Callable[[], tuple[Any, Any, str]]
    ) -> None:
        """Add a channel of `count` samples; `read` returns its times [s], its samples and a remark.

        If a channel has too many samples or cannot be read, its `fault` is the end of a sentence. Raises `InputError`
        if the record has too many channels or values.
        """
        number = len(self.entries)
        entry = dict(
            name=name, group=group, unit=unit.strip(" []-"), master=master, time="", values="", fault="", remark=""
        )
        self.entries.append(entry)
        self._values += count
        if number >= MOST_CHANNELS or self._values > MOST_VALUES:
            raise InputError(
                f"{self._path}: the record has more than the {MOST_CHANNELS} channels or {MOST_VALUES} values that are "
                "read; cut it."
            )
        if count > MOST_SAMPLES:
            entry["fault"] = f"there are {count} samples, and at most {MOST_SAMPLES} are read; cut the record"
            return
        try:
            time, samples, entry["remark"] = read()
            if samples.ndim != 1 or samples.dtype.kind not in "biuf":
                raise Refused("its values are not plain numbers")
            samples = samples.astype(np.float64)
        except MemoryError:
            raise
        except Exception as error:  # the libraries raise a dozen types for damaged records
            entry["fault"] = str(error) if isinstance(error, Refused) else "it cannot be read"
            return
        entry["values"] = f"v{number}"
        self._save(entry["values"], samples)
        if self._times[1] is None or not np.array_equal(self._times[1], time):
            self._times = f"t{number}", time
            self._save(*self._times)
        entry["time"] = self._times[0]
