"""Target of the compiler: the processor that kernels are compiled for, and the versions of all that computes.

Equal targets give equal bits. The name of the processor alone does not tell: two generations share the name
"AMD EPYC", and Numba compiles for another processor than this one where ``NUMBA_CPU_NAME`` says so.
"""

from __future__ import annotations

import functools
import platform
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

__all__ = ["CompileTarget", "compiler_settings", "describe", "differences", "package_versions", "processor"]

PACKAGES = ("commonrail", "numpy", "scipy", "numba", "llvmlite")
MOST = 6  # features that a sentence names


class CompileTarget(NamedTuple):
    """Target of the compiler, and what else decides over the bits of a result.

    Attributes
    ----------
    triple : str
        Architecture, vendor and system as LLVM names them.
    cpu : str
        Processor that LLVM compiles for.
    features : str
        Instruction sets that LLVM may (+) or must not (-) use, by name.
    settings : str
        Numba's settings that change machine code: optimisation level, vectorisers, Intel's vector functions, JIT.
    processor : str
        Architecture and model of this machine's processor, as the system names it: NumPy, SciPy's linear algebra and
        the C library choose their code by it.
    versions : tuple of (name, version)
        commonrail, python, numpy, scipy, numba, llvmlite.
    """

    triple: str
    cpu: str
    features: str
    settings: str
    processor: str
    versions: tuple[tuple[str, str], ...]

    @property
    def machine(self) -> dict[str, str]:
        """All but the versions, by name, as records keep them."""
        return {name: str(value) for name, value in self._asdict().items() if name != "versions"}

    @property
    def record(self) -> dict[str, str]:
        """Versions and machine by name, as journals keep them."""
        return dict(self.versions) | self.machine


@functools.cache
def describe() -> CompileTarget:
    """Target of this process; loads Numba."""
    from numba.core.registry import cpu_target

    triple, cpu, features = cpu_target.target_context.codegen().magic_tuple()
    return CompileTarget(
        str(triple),
        str(cpu),
        ",".join(sorted(str(features).split(","), key=lambda feature: feature[1:])),
        compiler_settings(),
        f"{platform.machine()} {processor()}".strip(),
        tuple(package_versions().items()),
    )


def compiler_settings() -> str:
    """Numba's settings that change machine code, as text."""
    from numba import config

    settings = {
        "opt": config.OPT._raw_value,
        "loop vectorizer": config.LOOP_VECTORIZE,
        "slp vectorizer": config.SLP_VECTORIZE,
        "svml": int(config.USING_SVML),
        "jit": int(not config.DISABLE_JIT),
    }
    return ", ".join(f"{name} {value}" for name, value in settings.items())


def package_versions() -> dict[str, str]:
    """Versions of commonrail, Python and the packages that compute; "" for one that is not installed."""
    found = {name: _version(name) for name in PACKAGES}
    return {"commonrail": found.pop("commonrail"), "python": platform.python_version(), **found}


def _version(package: str) -> str:
    with suppress(PackageNotFoundError):
        return version(package)
    return ""


def processor() -> str:
    """Model of the processor, as the system names it; "" where it does not."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()


def differences(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Differences of two targets as the part of a sentence: "cpu haswell, now generic; numba 0.62, now 0.63".

    Parameters
    ----------
    before, now : mapping of str to str
        `CompileTarget.record`; what either lacks, as records of earlier versions do, is not compared.

    Returns
    -------
    str
        "" where they are equal.
    """
    differing = [name for name in now if name in before and before[name] != now[name]]
    return "; ".join(
        _features(before[name], now[name]) if name == "features" else f"{name} {before[name]}, now {now[name]}"
        for name in differing
    )


def _features(before: str, now: str) -> str:
    """Difference of two lists of instruction sets, by those that are in use in one of them only."""
    then, today = ({feature[1:] for feature in text.split(",") if feature.startswith("+")} for text in (before, now))
    parts = [
        f"{word} {', '.join(names[:MOST])}{' ...' if len(names) > MOST else ''}"
        for word, names in (("without", sorted(then - today)), ("with", sorted(today - then)))
        if names
    ]
    return f"instruction sets, now {' and '.join(parts) or 'listed otherwise'}"
