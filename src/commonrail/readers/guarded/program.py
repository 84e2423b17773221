"""Program of the child process in which `parent` has a foreign format read; it limits itself before it reads.

The content goes to the standard output as a .npz file: the arrays, and ``about.json``, which describes them or holds
the sentence of a refusal.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from commonrail.base.errors import InputError

NAME = "file"  # of the file in sentences of a reader, in place of which the parent puts its path

Save = Callable[[str, NDArray[Any]], None]


def main(reader: str, options: str, memory: str, seconds: str) -> None:
    """Read from the standard input and write to the standard output as it was when the program started."""
    output = os.fdopen(os.dup(1), "w+b")
    os.dup2(2, 1)  # what libraries print must not come between the arrays
    module = importlib.import_module(f"commonrail.readers.guarded.{reader}")
    with suppress(ImportError, ValueError):  # beyond POSIX, or what a system does not limit: the parent limits the time
        _limit(int(memory), int(seconds))
    with output:
        write(output, module.read, sys.stdin.buffer.read(), json.loads(options), int(memory))
    os._exit(0)  # a fault of a library at its end does no harm


def write(stream: IO[bytes], read: Callable[..., dict[str, Any]], data: bytes, options: Any, most: int) -> None:
    """Write the content of a file, array by array.

    The function `read` takes a name for messages, the data, a function that saves an array under a name, and the
    options; it returns the description. All arrays together have at most `most` bytes.
    """
    left = most
    with ZipFile(stream, "w") as archive:

        def save(name: str, array: NDArray[Any]) -> None:
            nonlocal left
            left -= array.nbytes
            if left < 0:
                raise MemoryError
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, array, allow_pickle=False)

        try:
            about = read(Path(NAME), data, save, **options)
        except InputError as error:
            about = {"refused": str(error)}
        except MemoryError:
            about = {"limit": "memory"}
        archive.writestr("about.json", json.dumps(about))


def _limit(memory: int, seconds: int) -> None:
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF)
    spent = int(used.ru_utime + used.ru_stime) + 1
    for what, most in (("CPU", spent + seconds), ("DATA", memory)):
        kind = getattr(resource, f"RLIMIT_{what}")
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
