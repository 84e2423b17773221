"""How physics becomes machine code: the only file that names Numba flags.

`physics` decorates every small scalar law. With the JIT off (``NUMBA_DISABLE_JIT=1``) it returns the
plain Python function, so debuggers, coverage and dimensional tests see ordinary code.
`kernel` compiles an outer loop and keeps its machine code on disk under a stamp of *all* physics
sources: editing any law recompiles, which Numba's own cache (one file at a time) would miss.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import os
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import Cache, CompileResultCacheImpl, _CacheLocator
from numba.extending import register_jitable

# No "nnan"/"ninf": a candidate that blows up must be seen to be non-finite.
_FASTMATH = {"nsz", "arcp", "contract", "reassoc"}
_INLINED = {
    "forceinline": True,
    "fastmath": _FASTMATH,
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}
_PHYSICS_ROOMS = ("fuel", "flow", "parts", "injector", "engine")


_Law = TypeVar("_Law", bound=Callable[..., Any])


def physics(law: _Law) -> _Law:
    """Let kernels inline a scalar law; from Python it stays the plain function that it is."""
    register_jitable(**_INLINED)(law)
    return law


@physics
def reciprocals(a: float, b: float) -> tuple[float, float]:
    """(1/a, 1/b) with one division: divisions bound the speed of the step."""
    inverse = 1.0 / (a * b)
    return b * inverse, a * inverse


def kernel(loop: Callable[..., Any], name: str, laws: tuple[Callable[..., Any], ...] = ()) -> Any:
    """Compile an outer loop, releasing the GIL, with its machine code cached on disk.

    Parameters
    ----------
    loop : function
        The loop; it may be a closure over physics functions.
    name : str
        What distinguishes this closure from others of the same source line.
    laws : tuple of functions
        Functions from outside the package that `loop` calls: their source joins the cache stamp.
    """
    compiled = numba.njit(loop, nogil=True, fastmath=_FASTMATH, error_model="numpy")
    if numba.config.DISABLE_JIT:
        return loop
    compiled._cache = _kernel_cache(loop, name, laws)

    @functools.wraps(loop)
    def run(*arguments: Any) -> Any:
        if compiled.signatures:
            return compiled(*arguments)
        with _FIRST_CALL, _interleaved_vectors():
            return compiled(*arguments)

    run.compiled = compiled  # type: ignore[attr-defined]
    return run


_FIRST_CALL = threading.Lock()


@contextlib.contextmanager
def _interleaved_vectors() -> Iterator[None]:
    """Have the compiler work on two vectors at a time where there are 32 vector registers.

    One step is a long chain of dependent divisions and roots; two chains side by side hide each other's latency
    (13 % on an AVX-512 machine). LLVM offers this as a process-wide option only, so it is taken back.
    """
    import llvmlite.binding as llvm

    plenty = llvm.get_host_cpu_features().get("avx512vl", False)
    if plenty:
        llvm.set_option("", "-force-vector-interleave=2")
    try:
        yield
    finally:
        if plenty:
            llvm.set_option("", "-force-vector-interleave=0")


@functools.cache
def _physics_stamp() -> str:
    root = Path(__file__).parent
    digest = hashlib.sha256(numba.__version__.encode())
    sources = [Path(__file__)] + [p for r in _PHYSICS_ROOMS for p in sorted((root / r).glob("*.py"))]
    for source in sources:
        digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()[:20]


@functools.cache
def cache_folder() -> Path | None:
    """Folder of compiled kernels, or None where no place is writable (then every run compiles)."""
    import platformdirs

    for place in (Path(platformdirs.user_cache_dir("commonrail", False)), Path(_private_temporary())):
        folder = place / f"kernels-{_physics_stamp()}"
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        return folder
    return None


def _private_temporary() -> str:
    user = os.getuid() if hasattr(os, "getuid") else "user"
    return os.path.join(tempfile.gettempdir(), f"commonrail-{user}")


def _kernel_cache(loop: Callable[..., Any], name: str, laws: tuple[Callable[..., Any], ...]) -> Any:
    folder = cache_folder()
    if folder is None:
        return numba.core.caching.NullCache()
    stamp = _physics_stamp() + "".join(_law_stamp(law) for law in laws)

    class Locator(_CacheLocator):
        def get_cache_path(self) -> str:
            return str(folder)

        def get_source_stamp(self) -> str:
            return stamp

        def get_disambiguator(self) -> str:
            return hashlib.sha256((name + stamp).encode()).hexdigest()[:12]

        @classmethod
        def from_function(cls, py_func: Any, py_file: str) -> Any:
            return cls()

    class Impl(CompileResultCacheImpl):
        _locator_classes = (Locator,)

    class KernelCache(Cache):
        _impl_class = Impl

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            with contextlib.suppress(Exception):  # a damaged file: compile anew and write over it
                return super().load_overload(sig, target_context)
            return None

        def save_overload(self, sig: Any, data: Any) -> None:
            with contextlib.suppress(Exception):  # a full disk: go on without a cache
                super().save_overload(sig, data)

        def _index_key(self, sig: Any, codegen: Any) -> Any:
            # the closure's cells (dispatchers) have no stable hash: the name stands for them
            return (sig, codegen.magic_tuple(), name)

    return KernelCache(loop)


def _law_stamp(law: Callable[..., Any]) -> str:
    source = inspect.getsource(getattr(law, "py_func", law))
    return hashlib.sha256(source.encode()).hexdigest()[:8]
