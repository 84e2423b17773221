"""The one way to libraries that read foreign formats: a child process with limits of memory and processor time.

A file built on purpose, or damaged, can make a library take memory or time without end, or end the process that runs
it. `child` runs in a process that may take what `memory_limit` and `time_limit` allow; its arrays come back through a
temporary file, without pickle.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError
from commonrail.reading.child import NAME
from commonrail.reading.guarded_file import LARGEST_FILE

__all__ = ["Content", "memory_limit", "read_apart", "time_limit"]

MEMORY = 1_000_000_000  # [bytes] of the whole child, asammdf, the largest library, takes 0.2 GB of them
MEMORY_PER_BYTE = 4  # of the file: its bytes, the unpacked values (twice as many in honest records) and their copies
TIME = 5.0  # [s] of the processor, without the import of the library
TIME_PER_BYTE = 1e-6  # [s]: openpyxl, the slowest, reads 10 MB with two million cells in about as many seconds
WAIT = 10.0  # elapsed time in multiples of the processor time, for a busy machine

_ROOT = str(Path(__file__).resolve().parents[2])
_PROGRAM = "import sys; sys.path.append(sys.argv[1]); from commonrail.reading.child import main; main(*sys.argv[2:])"
# One thread: more take memory for themselves and finish no sooner. Arrow's default allocator reserves memory ahead.
_SETTINGS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "ARROW_DEFAULT_MEMORY_POOL": "system"}


class Content(NamedTuple):
    """Content of a file: a description, as in JSON, and arrays by their names."""

    about: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


def memory_limit(size: int) -> int:
    """Bytes that a child may take for a file of a size [bytes]."""
    return MEMORY + MEMORY_PER_BYTE * size


def time_limit(size: int) -> float:
    """Processor time [s] that a child may take for a file of a size [bytes]."""
    return TIME + TIME_PER_BYTE * size


def read_apart(reader: str, path: Path, data: bytes, **options: Any) -> Content:
    """Content of a file, read by `commonrail.reading.child_<reader>` in a child process.

    Parameters
    ----------
    reader : str
    path : Path
        For messages.
    data : bytes
        Of the file.
    **options
        Of the reader; they go through JSON.

    Raises
    ------
    InputError
        If the reader refuses the file, a limit is hit, or the library ends the child.
    """
    read = _cached if len(data) <= LARGEST_FILE else _content
    try:
        about, arrays = read(reader, data, json.dumps(options), memory_limit(len(data)), time_limit(len(data)))
        return Content(about, dict(arrays))
    except InputError as error:
        raise InputError(f"{path}{str(error).removeprefix(NAME)}") from None


def _content(reader: str, data: bytes, options: str, memory: int, seconds: float) -> Content:
    with tempfile.TemporaryFile() as stream:
        status = _run([reader, options, str(memory), str(math.ceil(seconds))], data, stream)
        stream.seek(0)
        if status == "time":
            raise _beyond(f"{seconds:.0f} s of processor time", len(data))
        if status:
            raise InputError(f"{NAME}: the library that reads it {status}; the file is damaged, export it again.")
        with np.load(stream, allow_pickle=False) as parts:
            about = json.loads(parts["about.json"])
            if "refused" in about:
                raise InputError(about["refused"])
            if "limit" in about:
                raise _beyond(f"{memory / 1e6:.0f} MB of memory", len(data))
            arrays = {name: parts[name] for name in parts.files if name != "about.json"}
    return Content(about, arrays)


_cached = lru_cache(maxsize=2)(_content)  # several blocks of a study read one file, and a run the copy of its data


def _run(args: list[str], data: bytes, stream: IO[bytes]) -> str:
    """Run the child; returns "time" for the limit of time, else how it ended, empty if it ended well."""
    command = [sys.executable, "-P", "-c", _PROGRAM, _ROOT, *args]
    try:
        done = subprocess.run(
            command,
            input=data,
            stdout=stream,
            stderr=subprocess.DEVNULL,
            timeout=WAIT * (TIME + float(args[-1])),
            check=False,
            env=os.environ | _SETTINGS,
        )
    except subprocess.TimeoutExpired:
        return "time"
    if done.returncode in (-getattr(signal, "SIGXCPU", 0), -getattr(signal, "SIGKILL", 0)) and done.returncode:
        return "time"
    return f"ended with status {done.returncode}" if done.returncode else ""


def _beyond(limit: str, size: int) -> InputError:
    return InputError(
        f"{NAME}: to read it takes more than the {limit} that a file of {_shown(size)} may take; save only what is "
        "needed, or export the columns to a CSV file."
    )


def _shown(size: int) -> str:
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{max(size / 1e3, 0.1):.1f} kB"
