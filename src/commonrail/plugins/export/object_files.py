"""Object files of the compiled physics for the supported processors and systems."""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from commonrail.base.child import python
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.base.hooks import note
from commonrail.compiler import cache, child, lower
from commonrail.compiler.cache import Source
from commonrail.compiler.target import Processor, System
from commonrail.physics.variants import Variant, kernel_name

# LLVM code that is not portable: numbers as pointers, stored pointers, and calls for one processor or Python.
_FOREIGN = re.compile(r"inttoptr|addrspacecast|asm |alloca .*ptr|@llvm\.(x86|aarch64|arm)\.|@NRT_|@Py|@numba_")


class Target(NamedTuple):
    """Processor and system of a binary.

    `triple`, `processor` and `features` are LLVM's target triple, processor and additional instruction sets; `zig` is
    zig's target, with the oldest supported C library. `fmi2` and `fmi3` are the folders of its binary in an FMU, "" if
    that version of the standard has none; `suffix` ends the name of a shared library.
    """

    name: str
    triple: str
    processor: str
    features: str
    zig: str
    fmi2: str
    fmi3: str
    suffix: str


_WASM = "+simd128,+bulk-memory,+nontrapping-fptoint,+sign-ext,+mutable-globals,+multivalue"
_LINUX = "x86_64-unknown-linux-gnu"
_ALL = (
    Target("linux64", _LINUX, "x86-64", "", "x86_64-linux-gnu.2.17", "linux64", "x86_64-linux", ".so"),
    Target("linux64-avx2", _LINUX, "x86-64-v3", "", "x86_64-linux-gnu.2.17", "linux64", "x86_64-linux", ".so"),
    Target("win64", "x86_64-pc-windows-gnu", "x86-64", "", "x86_64-windows-gnu", "win64", "x86_64-windows", ".dll"),
    Target(
        "linux-arm64", "aarch64-unknown-linux-gnu", "generic", "", "aarch64-linux-gnu.2.17", "", "aarch64-linux", ".so"
    ),
    Target("darwin-arm64", "arm64-apple-macosx11.0.0", "apple-m1", "", "aarch64-macos", "", "aarch64-darwin", ".dylib"),
    Target("wasm32", "wasm32-unknown-unknown", "generic", _WASM, "wasm32-wasi", "", "", ".wasm"),
)
TARGETS = {target.name: target for target in _ALL}
# Processors for whose vectors a block of injectors is compiled, by architecture, narrowest first. At its start a block
# selects the widest vectors of the machine (c/block.c); without vectors it simulates its injectors one after another.
_VECTORS = {"x86_64": {"avx2": "x86-64-v3", "avx512": "x86-64-v4"}}


def find_target(name: str) -> Target:
    """Target by name; `ConfigurationError` if it is unknown."""
    if name not in TARGETS:
        raise ConfigurationError(f'Unknown platform "{name}"{nearest(name, TARGETS)}; known: {", ".join(TARGETS)}.')
    return TARGETS[name]


def make_source(variant: Variant, maker: str = "entries") -> Source:
    """Source made by a function of `export.entry_points`; all targets give the same bits as `same_bits`."""
    module = "commonrail.plugins.export.entry_points"
    return Source(f"{module}:{maker}", variant.words, "exact", kernel_name(variant))


def emit(variant: Variant, target: Target, prefix: str = "cr") -> bytes:
    """Object file with the entries of `export.entry_points`, each named ``PREFIX_ENTRY`` and hidden.

    The entries follow Numba's calling convention: ``int32_t f(void *result, void **exception, arguments …)`` returns 0;
    `result` receives a pointer, and `exception` is not written. Prefixes allow linking the objects of two models into
    one program. If the model's variant is not cached, Numba compiles it in about ten seconds. `ConfigurationError` if
    the compiler fails.
    """
    texts = _portable(make_source(variant))
    names = {name: f"{prefix}_{name}" for name in texts}
    return lower.emit(texts, names, System(target.triple, target.processor, target.features), "hidden")


def link_llvm_text(variant: Variant, prefix: str = "cr") -> str:
    """LLVM text of all entries of a wiring, named as in `emit`, for the most basic processor."""
    texts, plain = _portable(make_source(variant)), TARGETS["linux64"]
    system = System(plain.triple, plain.processor)
    names = {name: f"{prefix}_{name}" for name in texts}
    return str(lower.optimise(texts, names, system, "hidden", vectors=False)[1])


def list_vectors(target: Target) -> tuple[str, ...]:
    """Names of the vectors for which `emit_block` compiles on a target, narrowest first; empty if none."""
    return tuple(_VECTORS.get(target.triple.partition("-")[0], ()))


def emit_block(variant: Variant, target: Target, vectors: str, prefix: str = "cr") -> bytes:
    """Object file with the entries of `block_entries`, named ``PREFIX_ENTRY_VECTORS`` and hidden; else as `emit`.

    `vectors` is one of `list_vectors` for the target.
    """
    texts = _portable(make_source(variant, "block_entries"))
    names = {name: f"{prefix}_{name}_{vectors}" for name in texts}
    processor = Processor(_VECTORS[target.triple.partition("-")[0]][vectors])
    return lower.emit(texts, names, System.of(processor, target.triple), "hidden")


def _portable(source: Source) -> dict[str, str]:
    """Texts of a source; `ConfigurationError` names parts that only one machine could run."""
    texts = child.texts(source)
    foreign = sorted({match.group() for text in texts.values() for match in _FOREIGN.finditer(text)})
    if foreign:
        raise ConfigurationError(
            f"The compiled physics cannot be exported: it contains {', '.join(foreign)}, specific to this machine; "
            "install the version of Numba that constraints.txt names."
        )
    return texts


# Compilers that make libraries from objects and C sources: this machine's, or zig for any platform.

_LONGEST = 900.0  # for one compiler run [s]: zig builds a platform's C library on first use
_FAMILIES = {
    ("Linux", "x86_64"): ("linux64", "linux64-avx2"),
    ("Linux", "aarch64"): ("linux-arm64",),
    ("Darwin", "arm64"): ("darwin-arm64",),
}
_WARNINGS = ("-std=c11", "-Wall", "-Wextra", "-Werror")
_ARITHMETIC = ("-ffp-contract=off",)  # fused products would change the bits of a target


class Compiler(NamedTuple):
    """Command of a C compiler, and whether it is zig."""

    command: tuple[str, ...]
    is_zig: bool


def own_platform() -> tuple[str, ...]:
    """Names of the targets that this machine runs, the most basic first; empty if none."""
    return _FAMILIES.get((platform.system(), platform.machine()), ())


def compiler_for(target: Target, prefer_zig: bool = False) -> Compiler:
    """Compiler that makes binaries for a target; `ConfigurationError` with the cure if it is missing.

    With `prefer_zig` an installed zig serves this machine's own platform too: its binaries run with older C
    libraries.
    """
    zig = importlib.util.find_spec("ziglang") is not None
    is_native = target.name in own_platform()
    system_compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None) if is_native else None
    if system_compiler and not (prefer_zig and zig):
        return Compiler((system_compiler,), False)
    if zig:
        return Compiler((*python("-m", "ziglang", "cc", "-target"), target.zig), True)
    needed = "a C compiler (cc, gcc, clang), or zig" if is_native else "zig, which compiles for every platform"
    cure = "pip install 'commonrail[export]' installs zig (its package is ziglang)"
    raise ConfigurationError(f"Binaries for {target.name} need {needed}: {cure}.")


def link_shared(compiler: Compiler, inputs: Sequence[Path], out: Path, target: Target, defines: Sequence[str]) -> None:
    """Compile C sources and link them with objects into a shared library that exports the marked functions.

    All `inputs` lie in one folder with their headers; `defines` are names for the preprocessor.
    """
    options = [*_options(target, defines), "-fvisibility=hidden", "-shared", "-s"]
    libraries = ("-lm",) if target.suffix == ".so" else ()
    paths = [*map(_absolute, inputs), "-o", _absolute(out)]
    run_compiler([*compiler.command, *options, *paths, *libraries], out.parent)


def compile_source(compiler: Compiler, source: Path, out: Path, target: Target, defines: Sequence[str] = ()) -> None:
    """Compile one C source into an object; `defines` as in `link_shared`."""
    paths = [_absolute(source), "-o", _absolute(out)]
    run_compiler([*compiler.command, *_options(target, defines), "-c", *paths], out.parent)


def _options(target: Target, defines: Sequence[str]) -> list[str]:
    position = () if target.suffix == ".dll" else ("-fPIC",)
    return [*_WARNINGS, *_ARITHMETIC, "-O2", "-g0", *(f"-D{name}" for name in defines), *position]


def archive(compiler: Compiler, objects: Sequence[Path], out: Path) -> None:
    """Put objects into a static library, which replaces an existing one."""
    out.unlink(missing_ok=True)
    tool = python("-m", "ziglang", "ar") if compiler.is_zig else [shutil.which("ar") or "ar"]
    run_compiler([*tool, "rcs", _absolute(out), *map(_absolute, objects)], out.parent)


def _absolute(path: Path) -> str:
    # Compilers run in the folder of their output, where relative paths would be wrong.
    return str(path.absolute())


def run_compiler(command: Sequence[str], folder: Path) -> None:
    """Run a compiler in a folder; `ConfigurationError` with its first error line if it fails."""
    with tempfile.TemporaryDirectory(prefix="commonrail-") as spare:
        _run_with_cache(command, folder, cache.private_folder("zig") or Path(spare))


def _run_with_cache(command: Sequence[str], folder: Path, zig: Path) -> None:
    """Run a compiler; `zig` is the cache folder of zig for C libraries."""
    environment = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), str(zig)) | os.environ
    built = _marker_of_zig_target(command, Path(environment["ZIG_GLOBAL_CACHE_DIR"]))
    if built is not None and not built.exists():
        note(f"zig builds the C library of {built.name} for its first use: this can take minutes, once ...")
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            capture_output=True,
            encoding="utf-8",
            errors="replace",  # paths in compiler messages may have any encoding
            timeout=_LONGEST,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ConfigurationError(f"The C compiler {command[0]} could not be run: {error}.") from None
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if "error" in line] or [done.stderr.strip() or "no message"]
        raise ConfigurationError(f"The C compiler {command[0]} failed: {lines[0].strip()}")
    if built is not None:
        with suppress(OSError):
            built.mkdir(parents=True, exist_ok=True)


def _marker_of_zig_target(command: Sequence[str], zig: Path) -> Path | None:
    """Folder that marks the command's target as linked by zig before; None for other compilers or no C library."""
    target = command[command.index("-target") + 1] if "-target" in command else "freestanding"
    return None if target.endswith("freestanding") else zig / "targets" / target
