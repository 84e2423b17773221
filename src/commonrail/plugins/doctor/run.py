"""Facts about the machine, commonrail's use of it, and installed plug-ins; as a program, a first simulation."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.base import registry
from commonrail.base.child import python, same_modules
from commonrail.base.choices import Precision
from commonrail.base.errors import CommonrailError
from commonrail.calibration.optimisers.registry import find_optimiser
from commonrail.compiler import cache, target
from commonrail.compiler.target import package_version as version
from commonrail.data.registry import find_kind
from commonrail.engine.job import VECTORS
from commonrail.engine.lanes import load_loop
from commonrail.engine.machine_code import COMPILERS, INSTALL, objection
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.threads import usable_threads
from commonrail.plugins.features.table import find_feature
from commonrail.readers.fuel import load_fuel
from commonrail.readers.injector import load_injector
from commonrail.readers.meters import load_installed_meter

# A module in a fresh process of the same Python.

Runner = Callable[[str, list[str], float], subprocess.CompletedProcess[str]]


def run_child(module: str, arguments: list[str], seconds: float) -> subprocess.CompletedProcess[str]:
    """Run ``python -m module arguments``.

    `module`: on the import path of this process, installed or not. Raises `subprocess.TimeoutExpired` after `seconds`.
    """
    command, environment = python("-m", module, *arguments), same_modules()
    return subprocess.run(command, capture_output=True, text=True, timeout=seconds, env=environment, check=False)


def ask_child(module: str, arguments: list[str], seconds: float, run: Runner = run_child) -> dict[str, Any]:
    """Return the JSON object that a module prints, or {"failed": sentence}."""
    try:
        done = run(module, arguments, seconds)
    except subprocess.TimeoutExpired:
        return {"failed": f"not done within {seconds:g} s"}
    if done.returncode != 0:
        return {"failed": _reason(done)}
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def _reason(done: subprocess.CompletedProcess[str]) -> str:
    if done.returncode < 0:
        return f"the process was killed by signal {-done.returncode}, perhaps for lack of memory"
    last = done.stderr.strip().splitlines()[-1:] or ["no message"]
    return f"the process ended with status {done.returncode}: {last[0]}"


# First simulation of a fresh process: ``python -m commonrail.plugins.doctor.run`` prints JSON with the origin of the
# machine code, the time and the result.

POINT = OperatingPoint(160e6, 700e-6, horizon=1.56e-3)  # of the paper


def first_simulation() -> dict[str, Any]:
    """Time to the first result, origin of its kernel, and the result [SI]."""
    case = load_injector("virtual-lino-2016")
    begin = time.perf_counter()
    solution = simulate(case, POINT)
    seconds = time.perf_counter() - begin
    code = load_loop(case.wired(), Precision.F64, False)
    return {
        "seconds": seconds,
        "origin": code.origin,
        "processor": code.processor,
        "status": solution.status.name,
        "volume": solution.injected_volume if solution.injected_volume == solution.injected_volume else None,
        "balance": solution.balance if solution.balance == solution.balance else None,
    }


# The machine: processor, instruction sets, threads, memory, load, versions.

FEATURES = ("sse2", "avx", "avx2", "fma", "avx512f", "avx512vl", "neon", "sve")
BUSY = 0.5  # load per core above which timings are unreliable


def machine() -> dict[str, Any]:
    """Return a record of the machine."""
    return {
        "processor": processor(),
        "system": f"{platform.system()} {platform.machine()}",
        "instruction_sets": instruction_sets(),
        "threads": usable_threads(),
        "memory_bytes": _memory(),
        "python": platform.python_version(),
        "versions": {name: installed for name in target.PACKAGES if (installed := version(name))},
    }


def processor() -> str:
    """Model of the processor according to the system."""
    return target.processor() or platform.machine() or "unknown"


def instruction_sets() -> list[str]:
    """Return the `FEATURES` that the compiler can use here; empty if it is not installed."""
    try:
        from llvmlite import binding
    except ModuleNotFoundError:
        return []
    features = binding.get_host_cpu_features()
    return [name for name in FEATURES if features.get(name, False)]


def load() -> float | None:
    """Average number of runnable processes in the last minute; None if the system does not report it."""
    with suppress(OSError, AttributeError):
        return os.getloadavg()[0]
    return None


def busy(load: float | None, threads: int) -> bool:
    """Return whether other processes load the machine enough to disturb timings."""
    return load is not None and load > BUSY * threads


def _memory() -> int | None:
    with suppress(OSError, ValueError, AttributeError):
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return None


# Facts about the machine and about commonrail on it, each with a remedy if needed.

OK = "ok"
PATIENCE = 600.0  # for the first simulation, which may compile [s]
# Injected volume of the paper's injector at 160 MPa, 700 us [m³]. Refined physics changes it less than the tolerance.
VOLUME, TOLERANCE = 53.8e-9, 0.05
BALANCE = 1e-9  # (in − out − stored)/injected; rounding leaves 1e-14
# Packages needed by simulations whose machine code is not in a library, and by other features.
WITHOUT_LIBRARIES = {
    "scipy": "the reference engine, refinements and some analyses need",
    **dict.fromkeys(COMPILERS, "the reference engine, the stepper, exports and simulations that no library holds need"),
}
EXTRAS = {
    "distributed": ("distributed", "to calibrate on a cluster", "pip install 'commonrail[cluster]'"),
    "cryptography": ("cryptography", "for --cluster local", "pip install 'commonrail[cluster]'"),
    "nicegui": ("nicegui", "for the app in the browser", "pip install 'commonrail[app]'"),
    "pyarrow": ("pyarrow", "for Parquet tables of fleets", "pip install 'commonrail[fleet]'"),
    "matplotlib": ("matplotlib", "for figures for print", "pip install 'commonrail[plates]'"),
}


class Fact(NamedTuple):
    """One line: name, finding, "ok" or what to do, and whether commonrail needs it."""

    name: str
    value: str
    verdict: str = OK
    essential: bool = False


def doctor() -> list[Fact]:
    """Check that commonrail works on this machine.

    The first simulation may take a minute if it must be compiled. The verdict of a fact is "ok", or says what to do.
    """
    return [*machine_facts(), *cache_facts(), *kernel_facts(), *extra_facts(), *plugin_facts()]


def usable(facts: list[Fact]) -> bool:
    """Return whether all essential facts are "ok"."""
    return all(fact.verdict == OK for fact in facts if fact.essential)


def machine_facts() -> Iterator[Fact]:
    """Versions, processor, instruction sets, threads."""
    yield Fact("Python", platform.python_version())
    yield from package_facts(has_libraries=not objection())
    yield Fact("processor", processor())
    sets = instruction_sets()
    yield Fact("instruction sets", " ".join(sets) or "none known", _vectors(sets) if version("llvmlite") else OK)
    threads, now = usable_threads(), load()
    crowded = "Other processes keep it busy: simulations take longer, with the same results."
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
    """Versions of the packages for simulations.

    `has_libraries`: libraries of compiled simulations are usable; their simulations need only NumPy.
    """
    for package in ("numpy", *WITHOUT_LIBRARIES):
        installed = version(package)
        needless = has_libraries and package in WITHOUT_LIBRARIES
        need = f"Simulations by a library do not need it; {WITHOUT_LIBRARIES[package]} it. " if needless else ""
        cure = f"{need}Install it: {INSTALL if package in COMPILERS else f'pip install {package}'}."
        yield Fact(package, installed or "not installed", OK if installed else cure, not needless)


def cache_facts(folder: Callable[[], Path | None] | None = None) -> Iterator[Fact]:
    """Folder of compiled simulations, its size, and whether its files are intact."""
    usual = cache.places()[0]
    cache_path = (folder or cache.cache_folder)()
    if cache_path is None:
        cure = (
            f"No folder for compiled simulations is writable and private, so every run compiles again: make {usual} "
            "writable for you alone, or name another folder in XDG_CACHE_HOME."
        )
        yield Fact("kernel cache", "none", cure)
        return
    fallback = f"{usual} cannot be used, and this folder may be emptied at any time: make {usual} yours alone."
    yield Fact("kernel cache", str(cache_path), OK if cache_path.parent == usual else fallback)
    files = list(cache_path.glob(f"*{cache.ENDING}"))
    damaged = sum(cache.read(path)[0] is None for path in files)
    size = sum(path.lstat().st_size for path in files)
    renewal = f"{damaged} of them are damaged and will be compiled again when they are used."
    yield Fact("kernels in it", f"{len(files)}, {size / 1e6:.1f} MB", renewal if damaged else OK)
    old = sum(path.name != cache_path.name for path in cache_path.parent.glob("kernels-*"))
    if old:
        cure = "They belong to other versions, next to the cache above; delete the folders of versions no longer used."
        yield Fact("other caches", f"{old} folders", cure)


def kernel_facts(run: Callable[[], dict[str, Any]] | None = None) -> Iterator[Fact]:
    """First simulation of the paper's injector in a fresh process: origin of its kernel, and its plausibility."""
    probe = run or (lambda: ask_child("commonrail.plugins.doctor.run", [], PATIENCE))
    first = probe()
    if "failed" in first:
        yield Fact("first simulation", "failed", f"Nothing can be simulated: {first['failed']}.", True)
        return
    source = {"library": "a library of this package", "cache": "the kernel cache", "compiled": "the compiler"}
    reason = f"; no library: {objection() or 'none has this model variant'}" if first["origin"] != "library" else ""
    yield Fact("machine code", f"from {source[first['origin']]}, for {first['processor']}{reason}", OK)
    if first["origin"] != "compiled":
        yield Fact("first simulation", f"in {first['seconds']:.1f} s", OK, True)
    else:
        again = probe()
        value = f"compiled in {first['seconds']:.1f} s"
        if again.get("origin") == "cache":
            yield Fact("first simulation", f"{value}, from the cache from now on ({again['seconds']:.1f} s)", OK, True)
        else:
            cure = "It was not kept, so every run compiles again: repair the kernel cache above."
            yield Fact("first simulation", value, cure)
    yield self_check(first)


def self_check(simulation: dict[str, Any]) -> Fact:
    """Check that mass is conserved and the quantity is the paper's."""
    volume, balance = simulation["volume"], simulation["balance"]
    if volume is None or balance is None:
        value, sound = simulation["status"], False
    else:
        value = f"{volume * 1e9:.1f} mm³ injected, relative mass error {abs(balance):.0e}"
        sound = abs(balance) < BALANCE and abs(volume / VOLUME - 1.0) < TOLERANCE
    cure = f"Expected: {VOLUME * 1e9:.1f} mm³ and 1e-14. Empty the kernel cache; if that does not help, report it."
    return Fact("self-check", value, OK if sound else cure, True)


def extra_facts(find: Callable[[str], object | None] = find_spec) -> Iterator[Fact]:
    """Optional packages, and the CUDA device."""
    for module, (package, purpose, install) in EXTRAS.items():
        if find(module) is None:
            yield Fact(package, "not installed", f"Only needed {purpose}: {install}.")
        else:
            yield Fact(package, version(package))
    yield Fact("numba-cuda", version("numba-cuda") or "not installed; optional")
    yield Fact("CUDA device", _cuda_device(find))


# Installed packages with parts for commonrail.


class Plugin(NamedTuple):
    """Installed package."""

    distribution: str
    version: str
    citation: str  # `__citation__` of its top-level module, by default its summary
    parts: list[str]  # group and name of each, such as "verbs spread"
    broken: list[str]  # a sentence for each unusable part


# Test of a part by its group; parts of other groups are loaded.
_TRIALS: dict[str, Callable[[str], object]] = {
    "optimisers": find_optimiser,
    "data": find_kind,
    "injectors": load_injector,
    "fuels": load_fuel,
    "meters": load_installed_meter,
    "features": find_feature,
}


def find_plugins() -> list[Plugin]:
    """Find the installed packages by name, and test each of their parts."""
    unused = {entry: why for group in registry.GROUPS for entry, why in registry.find_unused(group).items()}
    parts = [*(entry for group in registry.GROUPS for entry in registry.find_installed(group).values()), *unused]
    plugins = []
    for name in sorted({entry.distribution for entry in parts}):
        entries = [entry for entry in parts if entry.distribution == name]
        texts = [f"{entry.group} {entry.name}" for entry in entries]
        broken = [why for entry in entries if (why := unused.get(entry) or _fault(entry))]
        plugins.append(Plugin(name, entries[0].version, entries[0].citation(), texts, broken))
    return plugins


def _fault(entry: registry.Entry) -> str:
    """Reason why a part cannot be used; empty if it can."""
    try:
        trial = _TRIALS.get(entry.group)
        entry.load() if trial is None else trial(entry.name)
    except CommonrailError as error:
        return str(error)
    return ""


def plugin_facts() -> Iterator[Fact]:
    """Installed packages with their parts."""
    for plugin in find_plugins():
        value = f"{plugin.version}: {', '.join(plugin.parts)}" + (f". {plugin.citation}" if plugin.citation else "")
        yield Fact(f"plug-in {plugin.distribution}", value, " ".join(plugin.broken) or OK)


def _vectors(sets: list[str]) -> str:
    if platform.machine().lower() in ("x86_64", "amd64") and "avx2" not in sets:
        return (
            "Without AVX2 simulations take several times as long; let a virtual machine use the host's processor type."
        )
    return OK


def _cuda_device(find: Callable[[str], object | None]) -> str:
    if find("numba_cuda") is None:
        return "not looked for" if os.path.exists("/dev/nvidia0") else "none"
    try:
        from numba import cuda

        return str(cuda.get_current_device().name) if cuda.is_available() else "none"
    except Exception as error:  # drivers fail in ways of their own
        return f"none ({type(error).__name__})"


if __name__ == "__main__":
    print(json.dumps(first_simulation()))
