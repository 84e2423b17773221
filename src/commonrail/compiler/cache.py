"""Cache of compiled kernels on disk: files of this user alone, each with a digest that is compared before it is loaded.

A kernel is kept under a stamp of all physics sources: editing any law recompiles, which Numba's own cache (one file at
a time) would miss. A kernel is machine code, so nobody else may be able to write here.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import os
import pickle
import platform
import sqlite3
import stat
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from commonrail.base.hooks import compiling, note
from commonrail.compiler.target import compiler_settings, package_version

LONGEST_WAIT = 120.0  # for another process that compiles the same kernel [s]
ENDING = ".kernel"
LARGEST = 100_000_000  # of a file that is read [bytes]; the largest that was kept has 0.5 MB, a sparse one any size
_HEADER = b"commonrail kernel 2\n"
_DIGEST = hashlib.sha256().digest_size  # [bytes]
# A link is not followed and a pipe not waited for; flags that a system lacks are 0.
_GUARDED = sum(getattr(os, flag, 0) for flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
_COMPILED = ("compiler", "physics", "engine")  # packages whose sources decide over machine code


def read(path: Path) -> tuple[bytes | None, str]:
    """Payload of a file, None where there is none or it must not be loaded, and what is wrong with it."""
    try:
        handle = os.open(path, os.O_RDONLY | _GUARDED)
        with open(handle, "rb") as file:
            about = os.fstat(handle)
            fault = _objection(about, stat.S_ISREG, "a file")
            if not fault and about.st_size > LARGEST:
                fault = f"has {about.st_size / 1e6:.0f} MB, and a compiled simulation has at most {LARGEST / 1e6:.0f}"
            content = b"" if fault else file.read()
    except FileNotFoundError:
        return None, ""
    except OSError as error:
        return None, error.strerror or "cannot be read"
    if fault:
        return None, fault
    payload = content[len(_HEADER) + _DIGEST :]
    if content != _sealed(path.name, payload):
        return None, "is damaged"
    return payload, ""


def _sealed(name: str, payload: bytes) -> bytes:
    # with the name: the code of another kernel under it would give other bits, or end the process
    return _HEADER + hashlib.sha256(name.encode() + payload).digest() + payload


def write(path: Path, payload: bytes) -> None:
    """Keep a payload with its digest; a process that reads meanwhile finds the file before or the one after."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".")
    try:
        with open(handle, "wb") as file:
            file.write(_sealed(path.name, payload))
        if path.is_dir() and not path.is_symlink():  # a file cannot replace it: it would be in the way for ever
            os.rename(path, tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}-"))
        os.replace(name, path)
    except OSError:
        os.unlink(name)
        raise


def damaged(folder: Path) -> list[Path]:
    """Return the kernels of a folder that would not be loaded."""
    return [path for path in sorted(folder.glob(f"*{ENDING}")) if read(path)[0] is None]


def kept_or_made(name: str, make: Callable[[], bytes]) -> bytes:
    """Return the payload of a file beside the kernels; it is made and kept where there is none.

    Parameters
    ----------
    name : str
        Of the file. The folder stands for the physics: whatever else decides over the payload belongs into the name.
    make : function
        Makes the payload.
    """
    folder = cache_folder()
    if folder is None:
        with compiling():
            return make()
    path = folder / name
    found, _ = read(path)
    if found is None:
        with compiling(), turn(path.with_suffix(".lock")):
            found, fault = read(path)
            if fault:
                note(f"{path}: {fault}; it is made anew.")
            if found is None:
                found = make()
                with contextlib.suppress(OSError):
                    write(path, found)
    return found


@contextlib.contextmanager
def turn(path: Path) -> Iterator[None]:
    """Turn at compiling one kernel: processes that start together compile it once, and the others wait for it.

    The lock is the operating system's, by way of SQLite, and ends with its process. A process that cannot get it
    compiles too.
    """
    with contextlib.ExitStack() as held:
        with contextlib.suppress(sqlite3.Error):  # a full disk
            # An interrupted compilation may be cleared away in another thread.
            connection = sqlite3.connect(path, isolation_level=None, timeout=LONGEST_WAIT, check_same_thread=False)
            lock = held.enter_context(contextlib.closing(connection))
            lock.execute("BEGIN EXCLUSIVE")
        yield


@functools.cache
def cache_folder() -> Path | None:
    """Folder of compiled kernels, or None where no place is safe and writable (then every process compiles).

    A place that others can write to is refused with a note: who can write a kernel can run code here.
    """
    for place in places():
        folder = place / f"kernels-{physics_stamp()[:20]}"
        try:
            place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            for level in (place, folder):
                level.mkdir(mode=0o700, exist_ok=True)
            fault = objection(folder)
            if fault:
                note(f"No compiled simulations are kept in {folder}: {fault}.")
                continue
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        return folder
    return None


def places() -> tuple[Path, Path]:
    """The user's cache folder, and a folder for temporary files where that one cannot be used."""
    import platformdirs

    user = os.getuid() if hasattr(os, "getuid") else "user"
    return (
        Path(platformdirs.user_cache_dir("commonrail", False)),
        Path(tempfile.gettempdir()) / f"commonrail-{user}",
    )


def objection(folder: Path) -> str:
    """Reason why others could put files into a folder, or "" where they cannot.

    Parameters
    ----------
    folder : Path
        The folder and the one that holds it have to be this user's, real, and without write permission for group or
        others. Every level above may be written by this user and root alone, or lets nobody touch what is not theirs
        (sticky bit, as for temporary files).
    """
    if not hasattr(os, "getuid"):
        return ""  # on Windows a user's profile is closed to others by its access list
    for level in (folder, folder.parent):
        fault = _objection(os.lstat(level), stat.S_ISDIR, "a folder")
        if fault:
            return f"{level} {fault}"
    above = folder.parent.parent.resolve()
    for level in (above, *above.parents):
        found = os.stat(level)
        if found.st_uid not in (0, os.getuid()):
            return f"{level} belongs to another user"
        if _is_open(found) and not found.st_mode & stat.S_ISVTX:
            return f"{level} may be written by others"
    return ""


def _is_open(found: os.stat_result) -> bool:
    """Return whether others than the owner may write; the group of the same number as the user is the user's own."""
    group = found.st_mode & stat.S_IWGRP and found.st_gid not in (0, os.getuid())
    return bool(group or found.st_mode & stat.S_IWOTH)


def _objection(found: os.stat_result, is_kind: Callable[[int], bool], kind: str) -> str:
    if not is_kind(found.st_mode):
        return f"is not {kind}"
    if not hasattr(os, "getuid"):
        return ""
    if found.st_uid != os.getuid():
        return "belongs to another user"
    if _is_open(found):
        return "may be written by others (chmod go-w makes it private)"
    return ""


@functools.cache
def physics_stamp() -> str:
    """Digest of all that decides over machine code beside the processor: the physics, Python, Numba and llvmlite."""
    versions = " ".join((package_version("numba"), package_version("llvmlite"), platform.python_version()))
    return hashlib.sha256(f"{versions} {sources_stamp()}".encode()).hexdigest()


@functools.cache
def sources_stamp() -> str:
    """Digest of the sources that kernels are compiled from."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    for source in (path for package in _COMPILED for path in sorted((root / package).rglob("*.py"))):
        digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()


# Cache of kernels that Numba's dispatchers call: what Numba makes of one, pickled, in the files of the cache above.


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
