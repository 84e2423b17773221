"""The machine: processor, instruction sets, threads, memory, load, versions."""

from __future__ import annotations

import os
import platform
from contextlib import suppress
from importlib import metadata
from typing import Any

from commonrail import compile_target
from commonrail.engine.simulate import usable_threads

__all__ = ["FEATURES", "busy", "instruction_sets", "load", "machine", "processor", "version"]

FEATURES = ("sse2", "avx", "avx2", "fma", "avx512f", "avx512vl", "neon", "sve")
BUSY = 0.5  # load for each core above which timings are not to be trusted


def machine() -> dict[str, Any]:
    """Everything here, for the record."""
    return {
        "processor": processor(),
        "system": f"{platform.system()} {platform.machine()}",
        "instruction_sets": instruction_sets(),
        "threads": usable_threads(),
        "memory_bytes": _memory(),
        "python": platform.python_version(),
        "versions": {name: found for name in compile_target.PACKAGES if (found := version(name))},
    }


def processor() -> str:
    """Model of the processor, as the system names it."""
    return compile_target.processor() or platform.machine() or "unknown"


def instruction_sets() -> list[str]:
    """Those of `FEATURES` that the compiler may use here; none where it is not installed."""
    try:
        from llvmlite import binding
    except ModuleNotFoundError:
        return []
    found = binding.get_host_cpu_features()
    return [name for name in FEATURES if found.get(name, False)]


def version(package: str) -> str:
    """Installed version, empty if it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def load() -> float | None:
    """Processes that wanted to run in the last minute, on average; None where the system does not tell."""
    with suppress(OSError, AttributeError):
        return os.getloadavg()[0]
    return None


def busy(load: float | None, threads: int) -> bool:
    """Return whether others work on the machine so much that timings would suffer."""
    return load is not None and load > BUSY * threads


def _memory() -> int | None:
    with suppress(OSError, ValueError, AttributeError):
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return None
