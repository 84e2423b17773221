"""Compilers that make libraries of objects and C sources: this machine's own, or zig for any platform."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from commonrail.errors import ConfigurationError
from commonrail.export.objects import Target
from commonrail.notice import note

__all__ = ["Compiler", "archive", "compile_source", "compiler_for", "link_shared", "own_platform"]

_LONGEST = 900.0  # for one compiler run [s]: zig builds a platform's C library at the first
_FAMILIES = {
    ("Linux", "x86_64"): ("linux64", "linux64-avx2"),
    ("Linux", "aarch64"): ("linux-arm64",),
    ("Darwin", "arm64"): ("darwin-arm64",),
}
_WARNINGS = ("-std=c11", "-Wall", "-Wextra", "-Werror")
_ARITHMETIC = ("-ffp-contract=off",)  # a fused product would give a target bits of its own


class Compiler(NamedTuple):
    """Command of a C compiler, and whether it is zig."""

    command: tuple[str, ...]
    is_zig: bool


def own_platform() -> tuple[str, ...]:
    """Names of the targets that this machine runs, the plainest first; empty where there is none."""
    return _FAMILIES.get((platform.system(), platform.machine()), ())


def compiler_for(target: Target, prefer_zig: bool = False) -> Compiler:
    """Compiler that makes binaries for a target.

    Parameters
    ----------
    target : Target
    prefer_zig : bool
        Take zig, where it is installed, for this machine's own platform too: its binaries run with older C libraries.

    Raises
    ------
    ConfigurationError
        If there is none, with what to install.
    """
    zig = importlib.util.find_spec("ziglang") is not None
    own = target.name in own_platform()
    found = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None) if own else None
    if found and not (prefer_zig and zig):
        return Compiler((found,), False)
    if zig:
        return Compiler((sys.executable, "-m", "ziglang", "cc", "-target", target.zig), True)
    cure = "install it with: pip install 'commonrail[export]'"
    if own:
        raise ConfigurationError(f"Linking for {target.name} needs a C compiler (cc, gcc, clang) or zig; {cure}.")
    raise ConfigurationError(f"Linking for {target.name} on this machine needs zig; {cure}.")


def link_shared(compiler: Compiler, inputs: Sequence[Path], out: Path, target: Target, defines: Sequence[str]) -> None:
    """Compile C sources and link them with objects into a shared library that exports what is marked so.

    Parameters
    ----------
    compiler : Compiler
    inputs : sequence of Path
        Sources and objects, in one folder with their headers.
    out : Path
    target : Target
    defines : sequence of str
        Names defined for the preprocessor.
    """
    command = [
        *compiler.command,
        *_WARNINGS,
        *_ARITHMETIC,
        "-O2",
        "-g0",
        "-fvisibility=hidden",
        *(f"-D{name}" for name in defines),
        *(() if target.suffix == ".dll" else ("-fPIC",)),
        "-shared",
        "-s",
        *map(_absolute, inputs),
        "-o",
        _absolute(out),
        *(("-lm",) if target.suffix == ".so" else ()),
    ]
    run(command, out.parent)


def compile_source(compiler: Compiler, source: Path, out: Path, target: Target, defines: Sequence[str] = ()) -> None:
    """Compile one C source into an object.

    Parameters
    ----------
    compiler : Compiler
    source, out : Path
    target : Target
    defines : sequence of str
        As of `link_shared`.
    """
    position = () if target.suffix == ".dll" else ("-fPIC",)
    options = [*_WARNINGS, *_ARITHMETIC, "-O2", "-g0", *(f"-D{name}" for name in defines), *position]
    run([*compiler.command, *options, "-c", _absolute(source), "-o", _absolute(out)], out.parent)


def archive(compiler: Compiler, objects: Sequence[Path], out: Path) -> None:
    """Put objects into a static library.

    Parameters
    ----------
    compiler : Compiler
    objects : sequence of Path
    out : Path
        Replaced where it exists.
    """
    out.unlink(missing_ok=True)
    tool = (sys.executable, "-m", "ziglang", "ar") if compiler.is_zig else (shutil.which("ar") or "ar",)
    run([*tool, "rcs", _absolute(out), *map(_absolute, objects)], out.parent)


def _absolute(path: Path) -> str:
    # Compilers run in the folder of their output, where a relative path would name another file.
    return str(path.absolute())


def run(command: Sequence[str], folder: Path) -> None:
    """Run a compiler in a folder.

    Raises
    ------
    ConfigurationError
        With its first error line, if it fails.
    """
    caches = {name: str(zig_cache()) for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")}
    environment = os.environ | {name: value for name, value in caches.items() if name not in os.environ}
    built = _built(command, Path(environment["ZIG_GLOBAL_CACHE_DIR"]))
    if built is not None and not built.exists():
        note(f"zig builds the C library of {built.name} for its first use: up to some minutes, once ...")
    try:
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, timeout=_LONGEST, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ConfigurationError(f"The C compiler {command[0]} could not be run: {error}.") from None
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if "error" in line] or [done.stderr.strip() or "no message"]
        raise ConfigurationError(f"The C compiler {command[0]} failed: {lines[0].strip()}")
    if built is not None:
        with suppress(OSError):
            built.mkdir(parents=True, exist_ok=True)


def _built(command: Sequence[str], cache: Path) -> Path | None:
    """Folder that says that zig has linked for the command's target; None for other compilers or no C library."""
    target = command[command.index("-target") + 1] if "-target" in command else "freestanding"
    return None if target.endswith("freestanding") else cache / "targets" / target


def zig_cache() -> Path:
    """Folder in which zig keeps the C libraries that it has built."""
    import platformdirs

    return Path(platformdirs.user_cache_dir("commonrail", False)) / "zig"
