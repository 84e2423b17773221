"""Cache of compiled kernels on disk: private files, each with a digest that is checked before loading.

A kernel is kept under a stamp of its sources without comments: editing a law recompiles every kernel that may
call it; editing a comment, an error or another module does not. A kernel is machine code, and nobody else may be
able to write here.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import importlib.util
import json
import os
import platform
import sqlite3
import stat
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from commonrail.base.hooks import compiling, note, note_of_process
from commonrail.compiler.target import package_version

LONGEST_WAIT = 120.0  # for another process that compiles the same kernel [s]
ENDING = ".kernel"
_STAMPS = "stamps"
LARGEST = 100_000_000  # largest file to read [bytes]; the largest kernel has 0.5 MB, a sparse file can be any size
_HEADER = b"commonrail kernel 2\n"
_DIGEST = hashlib.sha256().digest_size  # [bytes]
# Links are not followed, pipes not waited for; flags that a system lacks are 0.
_GUARDED = sum(getattr(os, flag, 0) for flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
_PACKAGE = __name__.partition(".")[0]
_LANES = f"{_PACKAGE}.engine.block"  # makes the kernels that most simulations call


def read(path: Path) -> tuple[bytes | None, str]:
    """Payload of a file, None if it is absent or unsafe, and its fault."""
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
    if content != _seal(path.name, payload):
        return None, "is damaged"
    return payload, ""


def _seal(name: str, payload: bytes) -> bytes:
    # the digest includes the name: a different kernel under this name would give wrong results or crash
    return _HEADER + hashlib.sha256(name.encode() + payload).digest() + payload


def write(path: Path, payload: bytes) -> None:
    """Store a payload with its digest; a concurrent reader gets the old or the new file."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".")
    try:
        with open(handle, "wb") as file:
            file.write(_seal(path.name, payload))
        if path.is_dir() and not path.is_symlink():  # a folder would block the file permanently
            os.rename(path, tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}-"))
        os.replace(name, path)
    except OSError:
        os.unlink(name)
        raise


def get_or_make(name: str, make: Callable[[], bytes]) -> bytes:
    """Return the payload of a cached file; make and store it if absent.

    Parameters
    ----------
    name : str
        Of the file. The folder identifies the versions of the compiler; the name must identify everything else.
    make : function
        Makes the payload.
    """
    folder = cache_folder()
    if folder is None:
        with compiling():
            return make()
    path = folder / name
    content, _ = read(path)
    if content is None:
        with compiling(), turn(path.with_suffix(".lock")):
            content, fault = read(path)
            if fault:
                note(f"{path}: {fault}; it is made anew.")
            if content is None:
                content = make()
                with contextlib.suppress(OSError):
                    write(path, content)
    return content


@contextlib.contextmanager
def turn(path: Path) -> Iterator[None]:
    """Wait for the turn to compile one kernel: of processes that start together one compiles, the others wait.

    The lock is the operating system's, through SQLite, and ends with its process. A process that cannot get it
    compiles too.
    """
    with contextlib.ExitStack() as cleanup:
        with contextlib.suppress(sqlite3.Error):  # a full disk
            # An interrupted compilation may be cleared away in another thread.
            connection = sqlite3.connect(path, isolation_level=None, timeout=LONGEST_WAIT, check_same_thread=False)
            lock = cleanup.enter_context(contextlib.closing(connection))
            lock.execute("BEGIN EXCLUSIVE")
        yield


@functools.cache
def cache_folder() -> Path | None:
    """Folder of compiled kernels, or None without a safe and writable place (then every process compiles).

    Its name covers everything that determines the lanes' machine code except the processor: laws, Python, Numba and
    llvmlite.
    """
    stamps = private_folder(_STAMPS)
    if stamps is None:
        return None
    versions = " ".join((package_version("numba"), package_version("llvmlite"), platform.python_version()))
    stamp = hashlib.sha256(f"{versions} {stamp_of(_LANES)}".encode()).hexdigest()
    folder = stamps.parent / f"kernels-{stamp[:20]}"
    return folder if _is_usable(folder) else None


@functools.cache
def private_folder(name: str) -> Path | None:
    """Folder of a name in the first place that only this user can write, or None."""
    return next((place / name for place in places() if _is_usable(place / name)), None)


def _is_usable(folder: Path) -> bool:
    """True for an existing folder that can be written to.

    A folder that others can write to is refused with a note: whoever can write a kernel can run code here.
    """
    try:
        folder.parent.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        for level in (folder.parent, folder):
            level.mkdir(mode=0o700, exist_ok=True)
        fault = objection(folder)
        if fault:
            note_of_process(f"No compiled simulations are kept in {folder.parent}: {fault}.")
            return False
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def places() -> tuple[Path, Path]:
    """The user's cache folder, and a fallback in the folder for temporary files."""
    import platformdirs

    user = os.getuid() if hasattr(os, "getuid") else "user"
    return (
        Path(platformdirs.user_cache_dir("commonrail", False)),
        Path(tempfile.gettempdir()) / f"commonrail-{user}",
    )


def objection(folder: Path) -> str:
    """Reason why others could put files into a folder, or "" if they cannot.

    Parameters
    ----------
    folder : Path
        The folder and its parent must be this user's, real, and without write permission for group or
        others. Every level above must be writable by this user and root alone, or be sticky, as for
        temporary files.
    """
    if not hasattr(os, "getuid"):
        return ""  # on Windows a user's profile is closed to others by its access list
    for level in (folder, folder.parent):
        fault = _objection(os.lstat(level), stat.S_ISDIR, "a folder")
        if fault:
            return f"{level} {fault}"
    above = folder.parent.parent.resolve()
    for level in (above, *above.parents):
        status = os.stat(level)
        if status.st_uid not in (0, os.getuid()):
            return f"{level} belongs to another user"
        if _is_open(status) and not status.st_mode & stat.S_ISVTX:
            return f"{level} may be written by others"
    return ""


def _is_open(status: os.stat_result) -> bool:
    """Return whether others than the owner may write; a group with the user's own number counts as the user."""
    group = status.st_mode & stat.S_IWGRP and status.st_gid not in (0, os.getuid())
    return bool(group or status.st_mode & stat.S_IWOTH)


def _objection(status: os.stat_result, is_kind: Callable[[int], bool], kind: str) -> str:
    if not is_kind(status.st_mode):
        return f"is not {kind}"
    if not hasattr(os, "getuid"):
        return ""
    if status.st_uid != os.getuid():
        return "belongs to another user"
    if _is_open(status):
        return "may be written by others (chmod go-w makes it private)"
    return ""


# Sources of a kernel: the module that makes it, and everything that this and the compiler import, except
# `base`, which has neither laws nor numbers. Changes elsewhere in the package do not affect kernels.


@functools.cache
def stamp_of(module: str) -> str:
    """Hash of the sources of a module's kernels, ignoring comments and docstrings.

    Cached on disk with the digests of the files, because parsing would slow start-up.
    """
    key = repr((platform.python_version(), __file__, module))
    stamps = private_folder(_STAMPS)
    path = stamps / hashlib.sha256(key.encode()).hexdigest() if stamps else None
    content, _ = read(path) if path else (None, "")
    if content is not None:
        stamp, files = json.loads(content)
        if files == digests(files):
            return str(stamp)
    trees = _syntax_trees(module)
    stamp = hashlib.sha256(repr({name: _meaning(trees[name]) for name in sorted(trees)}).encode()).hexdigest()
    if path:
        with contextlib.suppress(OSError):
            write(path, json.dumps((stamp, digests(trees))).encode())
    return stamp


def digests(modules: Iterable[str]) -> dict[str, str]:
    """Digests of the files of modules by name, comments included; "" for a module without a file."""
    files = {name: _file_of(name) for name in modules}
    return {name: hashlib.sha256(file.read_bytes()).hexdigest() if file else "" for name, file in files.items()}


def sources_of(module: str) -> list[str]:
    """Modules that affect the kernels of a module."""
    return sorted(_syntax_trees(module))


def _syntax_trees(module: str) -> dict[str, ast.Module]:
    """Syntax trees of a module, of the compiler, and of all their imports, by name."""
    tops = {module.partition(".")[0], _PACKAGE}
    trees: dict[str, ast.Module] = {}
    names = [module, f"{_PACKAGE}.compiler.lower"]
    while names:
        name = names.pop()
        if name in trees or name.partition(".")[0] not in tops or f"{name}.".startswith(f"{_PACKAGE}.base."):
            continue
        if file := _file_of(name):
            trees[name] = ast.parse(file.read_bytes())
            names += _imports(trees[name], name if file.name == "__init__.py" else name.rpartition(".")[0])
    return trees


def _imports(tree: ast.Module, package: str) -> Iterator[str]:
    """Names imported by a module of a package, anywhere in its text, which may be modules."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            yield from (start, *(f"{start}.{alias.name}" for alias in node.names))


def _file_of(module: str) -> Path | None:
    """Source file of a module, or None if there is none; the module is not loaded."""
    top, *parts = module.split(".")
    spec = importlib.util.find_spec(top)
    if spec is None:
        return None
    for place in spec.submodule_search_locations or ():
        path = Path(place, *parts)
        for file in (path / "__init__.py", path.with_suffix(".py")):
            if file.is_file():
                return file
    return Path(spec.origin) if spec.origin and not parts else None


class Source(NamedTuple):
    """Functions to compile.

    Attributes
    ----------
    maker : str
        ``module:function`` that returns {name: (function, Numba's signature)}; imported only in the child.
    words : tuple of str
        Its arguments.
    kind : str
        "f64", "f32" or "exact": see `laws.FASTMATH`.
    key : str
        Anything else that affects the text, such as a digest of a law from another package.
    """

    maker: str
    words: tuple[str, ...]
    kind: str
    key: str = ""

    @property
    def digest(self) -> str:
        """Name of the text, from everything that affects it."""
        module = self.maker.partition(":")[0]
        key = repr((*self, stamp_of(module), platform.machine()))
        return hashlib.sha256(key.encode()).hexdigest()[:24]


def _meaning(tree: ast.Module) -> str:
    """Text of a syntax tree without docstrings, errors, argument types and comments, which no kernel contains."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(node, clean=False):
            node.body = node.body[1:]
        elif isinstance(node, ast.Raise):
            node.exc = node.cause = None
        elif isinstance(node, ast.arg):
            node.annotation = None
    return ast.dump(tree)
