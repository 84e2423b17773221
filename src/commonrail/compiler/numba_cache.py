"""Cache of kernels that dispatchers of Numba call: what Numba makes of one, pickled, in files of `cache`."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from commonrail.base.hooks import compiling, note
from commonrail.compiler.cache import ENDING, cache_folder, physics_stamp, read, turn, write
from commonrail.compiler.target import compiler_settings


class KernelCache(_Cache):  # type: ignore[misc]
    """Cache of one kernel, in the form that Numba's dispatchers use.

    Parameters
    ----------
    name : str
        Distinguishes this kernel from others of the same source line: its dispatchers have no stable hash.
    laws : tuple of functions
        Functions from outside the package that the kernel calls: their source joins the stamp.

    Attributes
    ----------
    waiting : ExitStack
        Holds, until the kernel is compiled, what shall last so long.
    """

    def __init__(self, name: str, laws: tuple[Callable[..., Any], ...] = ()) -> None:
        self._key = (name, physics_stamp(), *map(_source, laws))
        self._folder = cache_folder()
        self.waiting = contextlib.ExitStack()

    @property
    def cache_path(self) -> str:
        """Folder of the cache, as Numba asks for it."""
        return str(self._folder)

    def enable(self) -> None:
        """Nothing to do: the cache is always used."""

    def disable(self) -> None:
        """Nothing to do: the cache is always used."""

    def flush(self) -> None:
        """Nothing to do: an edited law has a stamp of its own."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the kernel for these argument types, or None where it has to be compiled."""
        target_context.refresh()
        path = self._path(sig, target_context.codegen())
        found = _load(path, target_context)
        if found is None:
            self.waiting.enter_context(compiling())
            if path is not None:
                self.waiting.enter_context(turn(path.with_suffix(".lock")))
                found = _load(path, target_context)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel; without room for it the next process compiles anew."""
        path = self._path(sig, data.codegen)
        if path is not None:
            with contextlib.suppress(OSError, pickle.PicklingError):
                write(path, dumps(data._reduce()))

    def _path(self, sig: Any, codegen: Any) -> Path | None:
        if self._folder is None:
            return None
        key = repr((self._key, str(sig), codegen.magic_tuple(), compiler_settings()))
        return self._folder / (hashlib.sha256(key.encode()).hexdigest()[:24] + ENDING)


def _load(path: Path | None, target_context: Any) -> Any:
    payload, fault = (None, "") if path is None else read(path)
    if fault:
        note(f"{path}: {fault}; this simulation is compiled anew.")
    if payload is None:
        return None
    with contextlib.suppress(Exception):  # Numba of another build: compile anew and write over it
        return CompileResult._rebuild(target_context, *pickle.loads(payload))
    return None


def _source(law: Callable[..., Any]) -> str:
    return hashlib.sha256(inspect.getsource(getattr(law, "py_func", law)).encode()).hexdigest()
