"""Target of the compiler: the processor for which kernels are compiled, and the versions of the numerical packages.

The lane kernels are compiled for the highest x86-64 level of this machine, v4 (AVX-512) or v3 (AVX2 and FMA).
Libraries compiled elsewhere for this level contain the same code. ``COMMONRAIL_KERNELS=v3`` selects the lower level.
Other processors, and the processor in ``NUMBA_CPU_NAME``, are targets by name. Equal targets give equal bits.
"""

from __future__ import annotations

import functools
import os
import platform
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.base.errors import ConfigurationError

PACKAGES = ("commonrail", "numpy", "scipy", "numba", "llvmlite")
CPU_FACTS = Path("/proc/cpuinfo")
MOST = 6  # features listed in a sentence
SWITCH = "COMMONRAIL_KERNELS"


class CompileTarget(NamedTuple):
    """Target of the compiler, and everything else that affects the bits of a result.

    Attributes
    ----------
    triple : str
        Architecture, vendor and system as LLVM names them.
    cpu : str
        Processor that LLVM compiles for.
    features : str
        Instruction sets that LLVM may (+) or must not (-) use, by name.
    processor : str
        Architecture and model of this machine's processor, as the system names it: NumPy, SciPy's linear algebra and
        the C library choose their code by it.
    versions : tuple of (name, version)
        commonrail, python, numpy, scipy, numba, llvmlite.
    """

    triple: str
    cpu: str
    features: str
    processor: str
    versions: tuple[tuple[str, str], ...]

    @property
    def machine(self) -> dict[str, str]:
        """Everything except the versions, by name, for records."""
        return {name: str(value) for name, value in self._asdict().items() if name != "versions"}

    @property
    def record(self) -> dict[str, str]:
        """Versions and machine by name, for journals."""
        return dict(self.versions) | self.machine


class Processor(NamedTuple):
    """Processor to compile for.

    Attributes
    ----------
    name : str
        LLVM's name.
    features : str
        Further instruction sets that may (+) or must not (-) be used.
    exact : bool
        Compile without fusing or reordering: all processors then round equally.
    """

    name: str
    features: str = ""
    exact: bool = False

    @property
    def is_wide(self) -> bool:
        """True with 32 vector registers of 512 bits."""
        return self.name == LEVEL_4.name or "+avx512vl" in self.features.split(",")


LEVEL_3, LEVEL_4 = Processor("x86-64-v3"), Processor("x86-64-v4")
OF_LEVEL_3 = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
OF_LEVEL_4 = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")


class System(NamedTuple):
    """Processor with its system.

    Attributes
    ----------
    triple : str
        Architecture, vendor and system as LLVM names them; "" for this machine's.
    name, features : str
        See `Processor`.
    """

    triple: str
    name: str
    features: str = ""

    @classmethod
    def of(cls, processor: Processor, triple: str = "") -> System:
        """System with a processor; code uses its full vector width, where LLVM would prefer half of it."""
        wide = "-prefer-256-bit" if processor.is_wide else ""
        return cls(triple, processor.name, ",".join(filter(None, (processor.features, wide))))


def own_processor() -> Processor:
    """Processor that this process compiles for, found with llvmlite; without llvmlite, the level in /proc/cpuinfo."""
    llvm = _llvm()
    if llvm is None:
        other_names = {"abm": "lzcnt", "bmi1": "bmi"}  # LLVM's name for Linux's name
        stated = {other_names.get(flag, flag) for flag in _read_cpuinfo("flags").split()}
        return _level(stated) or Processor("unknown")
    cpu_name, features = os.environ.get("NUMBA_CPU_NAME"), os.environ.get("NUMBA_CPU_FEATURES")
    has: Mapping[str, bool] = llvm.get_host_cpu_features()
    if cpu_name is None and features is None:
        level = _level({name for name, on in has.items() if on})
        if level and is_x86():
            return level
    if features is None:
        features = "" if cpu_name == "generic" else ",".join(f"{'+' if on else '-'}{name}" for name, on in has.items())
    return Processor(cpu_name or llvm.get_host_cpu_name(), features)


def _llvm() -> Any:
    """Bindings of LLVM; None if they are not installed: libraries of compiled simulations work without them."""
    try:
        import llvmlite.binding as llvm
    except ModuleNotFoundError:
        return None
    return llvm


def _read_cpuinfo(field: str) -> str:
    """Field of the processor in Linux's `/proc/cpuinfo`; "" without one."""
    with suppress(OSError):
        for line in CPU_FACTS.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith(field):
                return line.partition(":")[2].strip()
    return ""


def _level(has: set[str]) -> Processor | None:
    """Highest level allowed by `kernels_switch` whose instruction sets are all available."""
    levels = ((LEVEL_4, OF_LEVEL_3 + OF_LEVEL_4), (LEVEL_3, OF_LEVEL_3))
    allowed = levels[1:] if kernels_switch() == "v3" else levels
    return next((level for level, needed in allowed if has.issuperset(needed)), None)


def kernels_switch() -> str:
    """Value of ``COMMONRAIL_KERNELS``: "off" (no libraries), "v3" or "v4" (at most that level), "" if it is not set.

    Raises
    ------
    ConfigurationError
        If the value is unknown.
    """
    setting = os.environ.get(SWITCH, "")
    if setting not in ("", "off", "v3", "v4"):
        raise ConfigurationError(f'{SWITCH} is "{setting}"; set it to off, v3 or v4, or unset it.')
    return setting


def is_x86() -> bool:
    """True on x86-64 processors (Intel and AMD)."""
    return platform.machine() in ("x86_64", "AMD64")


@functools.cache
def describe() -> CompileTarget:
    """Target of this process; loads llvmlite if it is installed."""
    llvm, host = _llvm(), own_processor()
    return CompileTarget(
        f"{platform.machine()}-unknown-linux-gnu" if llvm is None else str(llvm.get_process_triple()),
        host.name,
        ",".join(sorted(host.features.split(","), key=lambda feature: feature[1:])),
        f"{platform.machine()} {processor()}".strip(),
        tuple(package_versions().items()),
    )


def may_compile() -> bool:
    """False if ``NUMBA_DISABLE_JIT`` forbids it."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")


def exact_processor() -> Processor:
    """This machine's processor, for kernels with equal bits on all processors; loads llvmlite.

    Every processor rounds additions, products, divisions and roots equally (IEEE 754). Bits differ only if the compiler
    fuses a product and a sum, or reorders operations, to suit a processor. These kernels are compiled without
    either.

    Raises
    ------
    ConfigurationError
        If the processor is not x86-64.
    """
    if not is_x86():
        raise ConfigurationError(
            f"same_bits needs an x86-64 processor, and this machine is of kind {platform.machine()}; omit same_bits."
        )
    return own_processor()._replace(exact=True)


def package_versions() -> dict[str, str]:
    """Versions of commonrail, Python and the packages that compute; "" for one that is not installed."""
    first, *others = PACKAGES
    first_versions = {first: package_version(first), "python": platform.python_version()}
    return first_versions | {name: package_version(name) for name in others}


def package_version(package: str) -> str:
    """Version of an installed package; "" if it is not installed."""
    with suppress(PackageNotFoundError):
        return version(package)
    return ""


def processor() -> str:
    """Model of the processor, as the system names it; "" if unknown."""
    return _read_cpuinfo("model name") or platform.processor()


def differences(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Differences of two targets as the part of a sentence: "cpu haswell, now generic; numba 0.62, now 0.63".

    `before`, `now`: `CompileTarget.record`; "" where they are equal.
    """
    differing = [name for name in now if before.get(name) != now[name]]
    return "; ".join(
        _features(before[name], now[name]) if name == "features" else f"{name} {before.get(name)}, now {now[name]}"
        for name in differing
    )


def _features(before: str, now: str) -> str:
    """Difference of two lists of instruction sets, by the sets used in only one of them."""
    then, today = ({feature[1:] for feature in text.split(",") if feature.startswith("+")} for text in (before, now))
    parts = [
        f"{word} {', '.join(names[:MOST])}{' ...' if len(names) > MOST else ''}"
        for word, names in (("without", sorted(then - today)), ("with", sorted(today - then)))
        if names
    ]
    return f"instruction sets, now {' and '.join(parts) or 'listed otherwise'}"
