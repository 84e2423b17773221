"""Attacks on the cache of compiled simulations."""

from __future__ import annotations

import os
from pathlib import Path

from tools.attack.base import Answer, attack, flipped, python

USE = """
from commonrail.compile import kernel

def poly(x):
    return 2.0 * x * x + 3.0 * x - 7.0

print(kernel(poly, "attacked")(5.0))
"""
EXPECTED = "58.0"


def _use(folder: Path) -> Answer:
    script = folder / "use.py"
    script.write_text(USE, encoding="utf-8")
    return python(script, XDG_CACHE_HOME=str(folder / "cache"), TMPDIR=str(folder / "tmp"))


def _kernel(folder: Path) -> Path:
    (path,) = (folder / "cache").glob("commonrail/kernels-*/*.kernel")
    return path


@attack(times=2000, few=3)
def flips(folder: Path, times: int) -> str:
    """A flipped bit in a cached kernel neither crashes nor changes a number."""
    if _use(folder).out.strip() != EXPECTED:
        return "the kernel does not run at all"
    path = _kernel(folder)
    whole = path.read_bytes()
    for bit, spoilt in flipped(whole, times):
        path.write_bytes(spoilt)
        answer = _use(folder)
        if answer.fault or answer.out.strip() != EXPECTED:
            return f"bit {bit}: {answer.fault or answer.out.strip()}"
        if path.read_bytes() == spoilt:
            return f"bit {bit}: the damaged kernel stays"
    return ""


@attack()
def open_folder(folder: Path, times: int) -> str:
    """Code from a cache that others may write to is not run."""
    _use(folder)
    kernels = _kernel(folder).parent
    for level in (kernels, kernels.parent):
        for mode in (0o777, 0o1777, 0o722):
            level.chmod(mode)
            said = _use(folder).said
            level.chmod(0o700)
            if "may be written by others" not in said:
                return f"{level.name} with mode {mode:o} is used without a word"
    return ""


@attack()
def linked_folder(folder: Path, times: int) -> str:
    """A link in place of the cache, in the user's folder or that for temporary files, is not followed."""
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir(mode=0o700)
    for base, name in ((folder / "cache", "commonrail"), (folder / "tmp", f"commonrail-{os.getuid()}")):
        base.mkdir(mode=0o700)
        (base / name).symlink_to(elsewhere)
    answer = _use(folder)
    if answer.fault or answer.out.strip() != EXPECTED:
        return answer.fault or "another number"
    return "the link is followed" if list(elsewhere.glob("*/*.kernel")) else ""


@attack()
def file_in_place(folder: Path, times: int) -> str:
    """A file, a pipe or nothing writable in place of the cache costs compiling alone."""
    for base in (folder / "cache", folder / "tmp"):
        base.mkdir(mode=0o700)
    (folder / "cache" / "commonrail").touch()
    os.mkfifo(folder / "tmp" / f"commonrail-{os.getuid()}")
    answer = _use(folder)
    return answer.fault or ("" if answer.out.strip() == EXPECTED else "another number")
