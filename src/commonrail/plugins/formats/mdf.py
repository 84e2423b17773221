"""Channels of an MDF record (.mf4, .mdf), each with the times of its own group, read by asammdf in a child process.

A channel whose name occurs in several groups is named with its group, ``800bar 300us/ROI``. Numbers are converted by
the linear, rational and tabular rules of the file; a rule that is a formula as text is not evaluated.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np

from commonrail.base.errors import InputError
from commonrail.base.input import read_plain
from commonrail.readers.columns import PLAIN, Channel, ChannelSheet, FileForm
from commonrail.readers.guarded import read_apart


class MdfFile(ChannelSheet):
    """MDF record, a `Sheet` whose columns are apart.

    The `form` has no meaning here. Raises `InputError` if it cannot be read, is beyond a limit, or asammdf is not
    installed.
    """

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        data = read_plain(path)
        if find_spec("asammdf") is None:
            raise InputError(
                f"{path}: MDF files need asammdf; install commonrail[mdf], or export the channels to a CSV file."
            )
        about, arrays = read_apart(f"{__name__}_child", path, data)
        arrays[""] = np.empty(0)  # of a channel that cannot be read
        channels = [
            Channel(**entry | {key: arrays[entry[key]] for key in ("time", "values")}) for entry in about["channels"]
        ]
        if not channels:
            raise InputError(f"{path}: the record has no channels.")
        super().__init__(path, channels)
