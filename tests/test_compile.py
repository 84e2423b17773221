"""Kernels are compiled for this machine, unless Numba is told of another, and by one process at a time."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import llvmlite.binding as llvm
import numba
import pytest

from commonrail import compile as compiler
from commonrail.compile import has_registers_of_512_bits

# Another process compiles the same kernel after this one has missed it and before it has its turn.
OVERTAKEN = """
import os, subprocess, sys
from contextlib import contextmanager
from commonrail.compile import kernel
from commonrail.notice import tell_of_compiling

@contextmanager
def told():
    if "OTHER" not in os.environ:
        subprocess.run([sys.executable, __file__], env=os.environ | {"OTHER": "1"}, check=True)
    yield

tell_of_compiling(told)

def double(x):
    return 2.0 * x

run = kernel(double, "a kernel of a test")
run(1.0)
print("OTHER" in os.environ, sum(run.compiled.stats.cache_hits.values()), flush=True)
"""


def test_a_kernel_that_another_process_has_just_compiled_is_taken_from_it(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(OVERTAKEN, encoding="utf-8")
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "0", "False", "1"]


def test_one_process_has_the_turn_and_who_cannot_wait_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "kernel.lock"
    with compiler._turn(path), closing(sqlite3.connect(path, isolation_level=None, timeout=0.0)) as other:
        with pytest.raises(sqlite3.OperationalError, match="locked"):
            other.execute("BEGIN EXCLUSIVE")
        monkeypatch.setattr(compiler, "LONGEST_WAIT", 0.0)
        with compiler._turn(path):
            pass
    with closing(sqlite3.connect(path, isolation_level=None, timeout=0.0)) as other:
        other.execute("BEGIN EXCLUSIVE")


@pytest.mark.parametrize(
    ("named", "own", "expected"),
    [(None, True, True), (None, False, False), ("", True, False), ("+avx2,+avx512vl", False, True)],
)
def test_features_that_numba_is_told_of_count_before_the_machines(
    monkeypatch: pytest.MonkeyPatch, named: str | None, own: bool, expected: bool
) -> None:
    monkeypatch.setattr(numba.config, "CPU_FEATURES", named)
    monkeypatch.setattr(llvm, "get_host_cpu_features", lambda: {"avx512vl": own})
    assert has_registers_of_512_bits() is expected
