"""Attacks on the cache of compiled simulations."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.robustness.attack.base import Answer, attack, flipped, python

USE = """
import os
import sys

from tests.compiler.doubled import value

def use():
    print(value(5.0, "poly"), flush=True)

if sys.argv[1:]:  # a start for each line: a process that has not seen the attacked kernel, only the compiler at work
    value(5.0, "double")
    for line in sys.stdin:
        child = os.fork()
        if not child:
            use()
            os._exit(0)
        print(os.waitpid(child, 0)[1], flush=True)
else:
    use()
"""
EXPECTED = "58.0"


def _use(folder: Path) -> Answer:
    script = folder / "use.py"
    script.write_text(USE, encoding="utf-8")
    return python(script, **_places(folder))


def _places(folder: Path) -> dict[str, str]:
    """Environment of a program that finds this project's tests, and has caches of its own."""
    root = str(Path(__file__).parents[3])
    return {"XDG_CACHE_HOME": str(folder / "cache"), "TMPDIR": str(folder / "tmp"), "PYTHONPATH": root}


@contextmanager
def _starts(folder: Path) -> Iterator[Callable[[], list[str]]]:
    """Starts of the same program one after the other, each with its answer and the status of its end."""
    environment = os.environ | _places(folder)
    program = subprocess.Popen(
        [sys.executable, folder / "use.py", "starts"],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    with program:
        assert program.stdin is not None
        assert program.stdout is not None
        write, read = program.stdin, program.stdout

        def start() -> list[str]:
            write.write("\n")
            write.flush()
            answer = [read.readline().strip()]
            return answer if answer[0].isdigit() else [*answer, read.readline().strip()]

        yield start


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
    with _starts(folder) as start:
        for bit, spoilt in flipped(whole, times):
            path.write_bytes(spoilt)
            answer = start()
            if answer != [EXPECTED, "0"]:
                return f"bit {bit}: {' and status '.join(answer)}"
            if path.read_bytes() == spoilt:
                return f"bit {bit}: the damaged kernel stays"
    return ""


@attack(times=6, few=2)
def open_folder(folder: Path, times: int) -> str:
    """Code from a cache that others may write to is not run."""
    _use(folder)
    kernels = _kernel(folder).parent
    tried = [(level, mode) for mode in (0o777, 0o1777, 0o722) for level in (kernels, kernels.parent)]
    for level, mode in tried[:times]:
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
