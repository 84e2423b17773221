"""An attack, and the commands that it runs."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

HANGS = 600.0  # [s] A command that has not ended by then is called hung; all of them take seconds.
ATTACKS: list[Attack] = []


class Attack(NamedTuple):
    """One attack: `run` gets an empty folder and how often to try, and returns what fell, "" where it held."""

    name: str
    run: Callable[[Path, int], str]
    times: int
    few: int


def attack(times: int = 1, few: int = 1) -> Callable[[Callable[[Path, int], str]], Callable[[Path, int], str]]:
    """Enter a function into the list of attacks; its docstring's first line is the promise it attacks.

    Parameters
    ----------
    times, few : int
        Repetitions, and those of the short form; 0 where that leaves the attack out, since a test does the same.
    """

    def enter(run: Callable[[Path, int], str]) -> Callable[[Path, int], str]:
        ATTACKS.append(Attack((run.__doc__ or run.__name__).splitlines()[0].rstrip("."), run, times, few))
        return run

    return enter


class Answer(NamedTuple):
    """End of a command: exit status (None: hung), stdout, stderr."""

    status: int | None
    out: str
    said: str

    @property
    def fault(self) -> str:
        """Fault of the end itself: hung, killed by a signal, or a traceback; "" for a sentence or a result."""
        if self.status is None:
            return f"not ended after {HANGS:g} s"
        if self.status < 0:
            return f"ended by signal {-self.status}"
        return "a traceback" if "Traceback (most recent call last)" in self.said else ""


def command(*arguments: str | Path, **environment: str) -> Answer:
    """Run ``commonrail`` in a process of its own."""
    return python("-m", "commonrail", *arguments, **environment)


def python(*arguments: str | Path, **environment: str) -> Answer:
    """Run Python in a process of its own; a process that hangs is killed."""
    line = [sys.executable, *map(str, arguments)]
    try:
        done = subprocess.run(
            line,
            env=os.environ | environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=HANGS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Answer(None, "", "")
    return Answer(done.returncode, done.stdout, done.stderr)


def flipped(content: bytes, times: int, seed: int = 1) -> Iterator[tuple[int, bytes]]:
    """Copies of a file's content with one bit flipped each, and the bit's number."""
    draw = random.Random(seed)
    for _ in range(times):
        bit = draw.randrange(8 * len(content))
        spoilt = bytearray(content)
        spoilt[bit // 8] ^= 1 << bit % 8
        yield bit, bytes(spoilt)
