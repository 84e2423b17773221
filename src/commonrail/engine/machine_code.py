"""Machine code of the lane loops: from a library in the package, from the cache, or compiled now."""

from __future__ import annotations

import ctypes
import functools
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.base.choices import Precision
from commonrail.base.input import digest
from commonrail.compiler.cache import Source, digests, stamp_of
from commonrail.compiler.load import Call, callable_at, load
from commonrail.compiler.load import object_of as compiled_object
from commonrail.compiler.target import (
    LEVEL_3,
    LEVEL_4,
    SWITCH,
    Processor,
    exact_processor,
    is_x86,
    kernels_switch,
    own_processor,
    package_version,
)
from commonrail.engine.job import Vector
from commonrail.physics.variants import Variant, kernel_name

# Libraries of lane loops in the package, compiled for levels of x86-64 where the package was built.
#
# A library is used if it was made from the present sources, for a level that this processor has, and is intact: a
# truncated library would crash the process. The file `STAMP` next to them records sources, compiler and digests.

FOLDER = Path(__file__).resolve().parents[1] / "kernels"
STAMP = "stamp.json"
SOURCES = "commonrail.engine.block"  # makes the loops
COMPILERS = ("numba", "llvmlite")
INSTALL = "pip install 'commonrail[jit]'"  # installs the compilers in the versions of the libraries


class MachineCode(NamedTuple):
    """A loop that can be called."""

    call: Call
    origin: str  # "library", "cache" or "compiled"
    processor: str  # target of the code
    holder: Any  # keeps the code in memory


def file_of(processor: str) -> Path:
    """Library of a level."""
    return FOLDER / f"lanes-{processor.rpartition('-')[2]}.so"


def find(symbol: str) -> MachineCode | None:
    """Function of a library by its name; None if no library may be used.

    `ConfigurationError` if ``COMMONRAIL_KERNELS`` has an unknown value.
    """
    level = None if objection() else _level()
    if level is None:
        return None
    holder = _open_library(file_of(level))
    try:
        function = getattr(holder, symbol)
    except AttributeError:
        return None
    address = int(ctypes.cast(function, ctypes.c_void_p).value or 0)
    return MachineCode(callable_at(address), "library", level, holder)


@functools.cache
def objection() -> str:
    """Reason why no library is used; "" if libraries are used."""
    if kernels_switch() == "off":
        return f"{SWITCH}=off"
    overrides = [name for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES") if name in os.environ]
    if overrides:
        return f"{overrides[0]} names another processor"
    stamp = read_stamp()
    if stamp is None:
        return "none came with this package"
    if not _is_of_these_sources(stamp):
        return "the sources were changed since they were built"
    for package in COMPILERS:  # results name the installed ones, which may round differently
        installed = package_version(package)
        if installed and installed != stamp.get(package):
            return f"they were compiled by {package} {stamp.get(package)}, and {installed} is installed"
    if not is_x86():
        return "they are for x86-64 processors"
    try:
        level = _level()
    except OSError as error:
        return f"they cannot be loaded: {error}"
    return "" if level else "none is for this processor"


def _is_of_these_sources(stamp: Mapping[str, Any]) -> bool:
    """Return whether libraries were made from the present sources; parses them only if a file differs."""
    files = stamp.get("files")
    if isinstance(files, dict) and files and files == digests(files):
        return True
    return bool(stamp.get("sources") == stamp_of(SOURCES))


@functools.cache
def read_stamp() -> dict[str, Any] | None:
    """Stamp of the libraries: sources, versions of compilers, digests; None without libraries."""
    try:
        stamp = json.loads((FOLDER / STAMP).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return stamp if isinstance(stamp, dict) else None


@functools.cache
def _level() -> str | None:
    """Level whose library is opened: the highest of this processor, unless `SWITCH` names one.

    `OSError` if a library cannot be loaded.
    """
    lowest = file_of(LEVEL_3.name)
    if not lowest.exists():
        return None
    has = int(_open_library(lowest).cr_level())
    highest_allowed = 3 if kernels_switch() == "v3" else 4
    level = {4: LEVEL_4, 3: LEVEL_3}.get(min(has, highest_allowed))
    if level is None or not file_of(level.name).exists():
        return None
    _open_library(file_of(level.name))
    return level.name


@functools.cache
def _open_library(path: Path) -> Any:
    digests = (read_stamp() or {}).get("libraries")
    if not path.is_file() or not isinstance(digests, dict) or digests.get(path.name) != digest(path):
        raise OSError(f"{path} is not the one that was built; build it again, or delete {path.parent}")
    return ctypes.CDLL(str(path))


def symbol_of(variant: Variant, precision: Precision, exact: bool = False) -> str:
    """Name of a loop in an object or a library; `exact`: compiled for an exact `Processor`."""
    words = "_".join(filter(None, variant.words))
    return f"cr_{'exact_' if exact else ''}{precision.value}_{re.sub('[^a-z]+', '_', words)}"


def machine_code(variant: Variant, vector: Vector, same_bits: bool) -> MachineCode:
    """Machine code of a loop.

    `same_bits`: exact code with equal bits on every processor, see `compiler.target.exact_processor`.
    `ConfigurationError` if equal bits are impossible on this machine, or compiling is disabled.
    """
    symbol = symbol_of(variant, vector.precision, same_bits)
    if (shared := find(symbol)) is not None:
        return shared
    processor = exact_processor() if same_bits else own_processor()
    object_file, was_compiled = object_of(variant, vector, processor)
    call, holder = load(object_file, symbol)
    return MachineCode(call, "compiled" if was_compiled else "cache", processor.name, holder)


def source_of(variant: Variant, vector: Vector, exact: bool) -> Source:
    """Source of a loop."""
    precision = vector.precision.value
    kind = "exact" if exact else precision
    return Source(f"{SOURCES}:entries", (precision, str(vector.lanes), *variant.words), kind, kernel_name(variant))


def object_of(variant: Variant, vector: Vector, processor: Processor) -> tuple[bytes, bool]:
    """Object file of a loop, from the cache or compiled, and whether it was compiled.

    `ConfigurationError` if it is not in the cache and ``NUMBA_DISABLE_JIT`` forbids compiling.
    """
    symbol = symbol_of(variant, vector.precision, processor.exact)
    return compiled_object(source_of(variant, vector, processor.exact), {"lanes": symbol}, processor)
