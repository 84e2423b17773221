"""Facts about the machine and what commonrail made of it, each with its cure."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from commonrail import kernel_cache
from commonrail.bench.child import ask_child
from commonrail.bench.machine import busy, instruction_sets, load, processor, version
from commonrail.engine.lanes import VECTORS
from commonrail.engine.library import COMPILERS, INSTALL, objection
from commonrail.engine.simulate import usable_threads

__all__ = [
    "OK",
    "Fact",
    "cache_facts",
    "examine",
    "extra_facts",
    "kernel_facts",
    "machine_facts",
    "package_facts",
    "usable",
]

OK = "ok"
PATIENCE = 600.0  # for the first simulation, which may compile [s]
# The paper's injector at 160 MPa, 700 us [m³]. The physics may be refined by less than the room; miscompiled it is not.
VOLUME, ROOM = 53.8e-9, 0.05
BALANCE = 1e-9  # (in − out − stored)/injected; rounding leaves 1e-14
# Packages that a simulation needs where no library holds it, and what needs them in any case.
WITHOUT_LIBRARIES = {
    "scipy": "the reference engine, refinements and some analyses need",
    **dict.fromkeys(COMPILERS, "the reference engine, the stepper, exports and simulations that no library holds need"),
}
EXTRAS = {
    "distributed": ("distributed", "to calibrate on a cluster", "pip install 'commonrail[cluster]'"),
    "cryptography": ("cryptography", "for --cluster local", "pip install 'commonrail[cluster]'"),
    "pyarrow": ("pyarrow", "for Parquet tables of fleets", "pip install 'commonrail[fleet]'"),
    "matplotlib": ("matplotlib", "for figures for print", "pip install 'commonrail[plates]'"),
}


class Fact(NamedTuple):
    """One line: name, finding, "ok" or what to do, and whether one cannot do without it."""

    name: str
    value: str
    verdict: str = OK
    essential: bool = False


def examine() -> Iterator[Fact]:
    """Everything, one after another; the first simulation may take a minute where it has to be compiled."""
    yield from machine_facts()
    yield from cache_facts()
    yield from kernel_facts()
    yield from extra_facts()


def usable(facts: list[Fact]) -> bool:
    """True if nothing essential is amiss."""
    return all(fact.verdict == OK for fact in facts if fact.essential)


def machine_facts() -> Iterator[Fact]:
    """Versions, processor, instruction sets, threads."""
    yield Fact("Python", platform.python_version())
    yield from package_facts(has_libraries=not objection())
    yield Fact("processor", processor())
    sets = instruction_sets()
    yield Fact("instruction sets", " ".join(sets) or "none known", _vectors(sets) if version("llvmlite") else OK)
    threads, now = usable_threads(), load()
    crowded = "Others keep it busy: simulations take longer, with the same results."
    yield Fact(
        "threads",
        f"{threads}, load {'unknown' if now is None else f'{now:.1f}'}",
        crowded if busy(now, threads) else OK,
    )
    kernels = " or ".join(
        f"{vector.lanes} candidates side by side in {precision.value}" for precision, vector in VECTORS.items()
    )
    yield Fact("kernel", kernels)


def package_facts(has_libraries: bool) -> Iterator[Fact]:
    """Versions of the packages that simulate.

    Parameters
    ----------
    has_libraries : bool
        Libraries of compiled simulations are used: what is in them needs NumPy alone.
    """
    for package in ("numpy", *WITHOUT_LIBRARIES):
        found = version(package)
        needless = has_libraries and package in WITHOUT_LIBRARIES
        lacking = f"Simulations by a library do without; {WITHOUT_LIBRARIES[package]} it. " if needless else ""
        cure = f"{lacking}Install it: {INSTALL if package in COMPILERS else f'pip install {package}'}."
        yield Fact(package, found or "not installed", OK if found else cure, not needless)


def cache_facts(folder: Callable[[], Path | None] | None = None) -> Iterator[Fact]:
    """Folder of compiled simulations, what is there, and whether it is whole."""
    usual = kernel_cache.places()[0]
    found = (folder or kernel_cache.cache_folder)()
    if found is None:
        cure = (
            f"No place for compiled simulations is writable and private, so every run compiles anew: make {usual} "
            "writable for you alone, or name another place in XDG_CACHE_HOME."
        )
        yield Fact("kernel cache", "none", cure)
        return
    fallen_back = f"{usual} cannot be used and this place may be emptied at any time: make that one yours alone."
    yield Fact("kernel cache", str(found), OK if found.parent == usual else fallen_back)
    files = list(found.glob(f"*{kernel_cache.ENDING}"))
    damaged = len(kernel_cache.damaged(found))
    size = sum(path.lstat().st_size for path in files)
    renewed = f"{damaged} of them differ from what was written and are compiled anew when they are used."
    yield Fact("kernels in it", f"{len(files)}, {size / 1e6:.1f} MB", renewed if damaged else OK)
    old = sum(path.name != found.name for path in found.parent.glob("kernels-*"))
    if old:
        cure = (
            "Other versions made them, perhaps still in use; those beside the cache above that are not may be deleted."
        )
        yield Fact("other caches", f"{old} folders", cure)


def kernel_facts(run: Callable[[], dict[str, Any]] | None = None) -> Iterator[Fact]:
    """First simulation of the paper's injector in a fresh process: from the cache or not, and plausible or not."""
    probe = run or (lambda: ask_child("commonrail.bench.kernel_probe", [], PATIENCE))
    first = probe()
    if "failed" in first:
        yield Fact("first simulation", "failed", f"Nothing can be simulated: {first['failed']}.", True)
        return
    source = {"library": "a library of this package", "cache": "the kernel cache", "compiled": "the compiler"}
    reason = f"; no library: {objection() or 'this wiring is in none'}" if first["origin"] != "library" else ""
    yield Fact("machine code", f"from {source[first['origin']]}, for {first['processor']}{reason}", OK)
    if first["origin"] != "compiled":
        yield Fact("first simulation", f"in {first['seconds']:.1f} s", OK, True)
    else:
        again = probe()
        value = f"compiled in {first['seconds']:.1f} s"
        if again.get("origin") == "cache":
            yield Fact("first simulation", f"{value}, from the cache from now on ({again['seconds']:.1f} s)", OK, True)
        else:
            cure = "It was not kept, so every run compiles anew: see to the kernel cache above."
            yield Fact("first simulation", value, cure)
    yield self_check(first)


def self_check(found: dict[str, Any]) -> Fact:
    """Check that mass is conserved and the quantity is that of the paper's injector."""
    volume, balance = found["volume"], found["balance"]
    if volume is None or balance is None:
        value, sound = found["status"], False
    else:
        value = f"{volume * 1e9:.1f} mm3 injected, mass kept to {abs(balance):.0e}"
        sound = abs(balance) < BALANCE and abs(volume / VOLUME - 1.0) < ROOM
    cure = f"It should be {VOLUME * 1e9:.1f} mm3 and 1e-14: empty the kernel cache; if it stays, report it."
    return Fact("self-check", value, OK if sound else cure, True)


def extra_facts(find: Callable[[str], object | None] = find_spec) -> Iterator[Fact]:
    """Optional packages, and the CUDA device."""
    for module, (package, purpose, install) in EXTRAS.items():
        if find(module) is None:
            yield Fact(package, "not installed", f"Only needed {purpose}: {install}.")
        else:
            yield Fact(package, version(package))
    yield Fact("numba-cuda", version("numba-cuda") or "not installed; commonrail does without")
    yield Fact("CUDA device", _cuda_device(find))


def _vectors(sets: list[str]) -> str:
    if platform.machine().lower() in ("x86_64", "amd64") and "avx2" not in sets:
        return "Without AVX2 simulations take several times as long; on a virtual machine, hand the processor through."
    return OK


def _cuda_device(find: Callable[[str], object | None]) -> str:
    if find("numba_cuda") is None:
        return "not looked for" if os.path.exists("/dev/nvidia0") else "none"
    try:
        from numba import cuda

        return str(cuda.get_current_device().name) if cuda.is_available() else "none"
    except Exception as error:  # drivers fail in ways of their own
        return f"none ({type(error).__name__})"
