"""A kernel that is in no cache is told of, once; one from the cache is not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from commonrail import notice
from commonrail.notice import note, quiet, tell_notes

CODE = """
from contextlib import contextmanager
from commonrail.jit import kernel
from commonrail.notice import tell_of_compiling

@contextmanager
def told():
    print("begin")
    yield
    print("end")

tell_of_compiling(told)

def double(x):
    return 2.0 * x

run = kernel(double, "a kernel of a test")
print(run(1.0), run(2.0))
"""


def said(cache: Path) -> list[str]:
    environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
    script = cache / "script.py"
    script.write_text(CODE, encoding="utf-8")
    line = [sys.executable, str(script)]
    done = subprocess.run(line, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_the_first_use_alone_is_told(tmp_path: Path) -> None:
    assert said(tmp_path) == ["begin", "end", "2.0 4.0"]
    assert said(tmp_path) == ["2.0 4.0"]


def test_notes_inside_a_quiet_block_are_not_told() -> None:
    told: list[str] = []
    before = notice._note
    tell_notes(told.append)
    try:
        note("first")
        with quiet():
            note("second")
        note("third")
    finally:
        tell_notes(before)
    assert told == ["first", "third"]
