"""The one way to libraries that read foreign formats: a child process with limits of memory and processor time.

A file built on purpose, or damaged, can make a library take memory or time without end, or end the process that runs
it. The child limits itself before it reads; its arrays come back through a temporary file, without pickle.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import IO, Any, NamedTuple
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from commonrail.base.child import python
from commonrail.base.errors import InputError
from commonrail.base.input import LARGEST_FILE

NAME = "file"  # placeholder in messages of a reader, which the parent replaces by the path
# Limits of a child: memory of the process, of which asammdf takes 0.2 GB, and processor time without the import of the
# library. Each byte of the file adds 4 bytes (the byte, values twice as long, a copy) and 3 us. The slowest library,
# openpyxl, reads 24 MB with the largest number of cells, two million, in 14 s; a file of 6 MB can pack such cells.
MEMORY, MEMORY_PER_BYTE = 1_000_000_000, 4  # [bytes]
TIME, TIME_PER_BYTE = 5.0, 3e-6  # [s]
WAIT = 10.0  # elapsed time in multiples of the processor time, for a busy machine

TIME_OVER = -getattr(signal, "SIGXCPU", 24)  # exit status of a process that the limit ended
_ROOT = str(Path(__file__).resolve().parents[2])
# The package of the parent, also where another one is installed; its folder must not hide modules of Python.
_PROGRAM = (
    "import sys; sys.path.insert(0, sys.argv[1]); import commonrail; del sys.path[0]; "
    "from commonrail.readers.guarded import main; main(*sys.argv[2:])"
)
# One thread: more take memory for themselves and finish no sooner. Arrow's default allocator reserves memory ahead.
_SETTINGS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "ARROW_DEFAULT_MEMORY_POOL": "system"}


Save = Callable[[str, NDArray[Any]], None]


class Content(NamedTuple):
    """Content of a file: a description, as in JSON, and arrays by their names."""

    about: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


def read_apart(reader: str, path: Path, data: bytes, **options: Any) -> Content:
    """Content of a file, read in a child process.

    `reader`: module whose function ``read`` takes a name for messages, the data, a function that saves an array under a
    name, and the options; it returns the description. `path`: for messages. `data`: of the file. `options` go through
    JSON. Raises `InputError` if the reader refuses the file, a limit is hit, or the library ends the child.
    """
    read = _cached if len(data) <= LARGEST_FILE else _content
    memory, seconds = MEMORY + MEMORY_PER_BYTE * len(data), max(1, int(TIME + TIME_PER_BYTE * len(data)))
    try:
        about, arrays = read(reader, data, json.dumps(options), memory, seconds)
        return Content(about, dict(arrays))
    except InputError as error:
        raise InputError(f"{path}{str(error).removeprefix(NAME)}", code=error.code, file=path) from None


def _content(reader: str, data: bytes, options: str, memory: int, seconds: int) -> Content:
    with tempfile.TemporaryFile() as stream:
        status = _run([reader, options, str(memory), str(seconds)], data, stream)
        stream.seek(0)
        if status == TIME_OVER:
            raise _beyond(f"{seconds} s of processor time", len(data))
        if status:
            raise InputError(
                f"{NAME}: the process that reads it ended with status {status}; the file is damaged, or its library or "
                "the folder of temporary files cannot be used.",
                code="reader-failed",
            )
        with np.load(stream, allow_pickle=False) as parts:
            about = json.loads(parts["about.json"])
            if "refused" in about:
                raise InputError(about["refused"], code="refused")
            if "limit" in about:
                raise _beyond(f"{memory / 1e6:.0f} MB of memory", len(data))
            arrays = {name: parts[name] for name in parts.files if name != "about.json"}
    for array in arrays.values():
        array.setflags(write=False)  # cached arrays are shared
    return Content(about, arrays)


_cached = lru_cache(maxsize=2)(_content)  # several blocks of a study may read one file, and a run also reads the copy


def _run(args: list[str], data: bytes, stream: IO[bytes]) -> int:
    """Run the child; returns its exit status."""
    command = python("-c", _PROGRAM, _ROOT, *args)
    wait, env = WAIT * (TIME + float(args[-1])), os.environ | _SETTINGS
    try:
        silent = subprocess.DEVNULL  # suppresses the output of a library that crashes on a file
        done = subprocess.run(command, input=data, stdout=stream, stderr=silent, timeout=wait, env=env, check=False)
    except subprocess.TimeoutExpired:
        return TIME_OVER
    return done.returncode


def _beyond(limit: str, size: int) -> InputError:
    return InputError(
        f"{NAME}: to read it takes more than the {limit} that a file of {size} bytes may take; save only what is "
        "needed, or export the columns to a CSV file.",
        code="too-costly",
    )


# Program of the child. The content goes to its standard output as a .npz file: the arrays, and ``about.json``, which
# describes them or holds the sentence of a refusal.


def main(reader: str, options: str, memory: str, seconds: str) -> None:
    """Read from the standard input and write to the standard output as it was when the program started."""
    output = os.fdopen(os.dup(1), "w+b")
    os.dup2(2, 1)  # what libraries print must not come between the arrays
    module = import_module(reader)
    with suppress(ImportError, ValueError):  # not POSIX, or no such limit: the parent still limits the time
        _limit(int(memory), int(seconds))
    with output:
        write(output, module, sys.stdin.buffer.read(), json.loads(options), int(memory))
    os._exit(0)  # a fault of a library at its end does no harm


def write(stream: IO[bytes], module: Any, data: bytes, options: Any, most: int) -> None:
    """Write the content of a file, array by array, or the sentence of a refusal.

    `module`: reader, see `read_apart`, whose `WHAT`, if any, names a file of its kind. `most` [bytes]: of all arrays.
    """
    left = most
    with ZipFile(stream, "w") as archive:

        def save(name: str, array: NDArray[Any]) -> None:
            nonlocal left
            left -= array.nbytes
            if left < 0:
                raise MemoryError
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)

        try:
            about = module.read(Path(NAME), data, save, **options)
        except InputError as error:
            about = {"refused": str(error)}
        except MemoryError:
            about = {"limit": "memory"}
        except Exception as error:  # libraries raise a dozen types for damaged files, whose texts name their objects
            what = getattr(module, "WHAT", "file")
            about = {"refused": f"{NAME}: this is no {what} that can be read ({type(error).__name__})."}
        archive.writestr("about.json", json.dumps(about))


def _limit(memory: int, seconds: int) -> None:
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF)
    spent = int(used.ru_utime + used.ru_stime) + 1
    for what, most in (("CPU", spent + seconds), ("DATA", memory)):
        kind = getattr(resource, f"RLIMIT_{what}")
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
