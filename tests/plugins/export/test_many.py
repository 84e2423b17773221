"""Many instances of a library, in threads and in several processes."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from commonrail.plugins.export.library import Library
from tests.plugins.export.native import BlockRun, Native, Run

BOUNDARY = (160e6, 5e6, 0.5e6, 0.0)
ROOT = Path(__file__).resolve().parents[3]
# What the objects need of the C library: mathematics, copies of memory, comparison of names.
NEEDED = {"exp", "fmax", "fmin", "memcpy", "memmove", "memset", "sin", "cos", "sincos", "sqrt", "strcmp", "log", "pow"}
NEEDED |= {"_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}

OTHER = """
import sys
from pathlib import Path
from types import SimpleNamespace
import numpy as np
from tests.plugins.export.native import BlockRun, Native, Run

path, name, task = sys.argv[1:4]
native = Native(SimpleNamespace(model=SimpleNamespace(name=name), shared={"own": Path(path)}), "own")
BOUNDARY = (160e6, 5e6, 0.5e6, 0.0)
"""
RESUME = """
for kind, kept in zip((Run, BlockRun), sys.argv[4:]):
    run = kind(native, BOUNDARY if kind is Run else [BOUNDARY] * 3)
    run.memory[:] = np.frombuffer(Path(kept).read_bytes())
    run.march(500)
    Path(kept).write_bytes(run.memory.tobytes())
"""
GROW = """
def resident():
    return int(Path("/proc/self/statm").read_text().split()[1])

def use(count):
    for _ in range(count):
        run, block = Run(native, BOUNDARY), BlockRun(native, [BOUNDARY] * 2)
        run.plan((0.0, 100e-6))
        run.march(5)
        block.march(5)
        run.figures()

use(300)
before = resident()
use(10_000)
print((resident() - before) * 4096)
"""


def run_other(library: Library, task: str, *words: str) -> str:
    """Output of another process that uses the library."""
    command = [sys.executable, "-c", OTHER + task, str(next(iter(library.shared.values()))), library.model.name, "-"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, sys.path)])}
    done = subprocess.run([*command, *words], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_state_goes_on_in_another_process_with_the_same_bits(
    native: Native, library: Library, tmp_path: Path
) -> None:
    single, block = Run(native, BOUNDARY), BlockRun(native, [BOUNDARY] * 3)
    single.plan((0.0, 500e-6))
    block.plan(1, (50e-6, 500e-6))
    kept = [tmp_path / "single", tmp_path / "block"]
    for run, path in zip((single, block), kept, strict=True):
        run.march(333)
        path.write_bytes(run.memory.tobytes())
        run.march(500)
    run_other(library, RESUME, *map(str, kept))
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in kept]
    assert digests == [hashlib.sha256(run.memory.tobytes()).hexdigest() for run in (single, block)]
    assert single.figures().injected > 1e-6


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the size of a process is read from /proc")
def test_ten_thousand_instances_leave_nothing_behind(library: Library) -> None:
    # a state of each would be 520 MB, 500 bytes of each 5 MB; the allocator of Python moves by some pages
    assert int(run_other(library, GROW)) < 2 << 20


def test_a_thousand_simulations_in_threads_have_the_bits_of_one_after_another(native: Native) -> None:
    def injected(i: int) -> bytes:
        run = Run(native, (60e6 + 1e5 * i, *BOUNDARY[1:]))
        run.plan((0.0, 150e-6))
        for _ in range(20):
            run.march(20)
        return hashlib.sha256(run.memory.tobytes()).digest()

    with ThreadPoolExecutor(1000) as pool:
        parallel = list(pool.map(injected, range(1000)))
    assert parallel == [injected(i) for i in range(1000)]
    assert len(set(parallel)) == 1000


def test_the_library_needs_mathematics_and_copies_of_memory_alone(library: Library) -> None:
    if shutil.which("nm") is None:
        pytest.skip("nm, which lists symbols, is not on this machine")
    (static,) = (path for path in library.files if path.suffix == ".a")
    listed = subprocess.run(["nm", str(static)], capture_output=True, text=True, check=True).stdout
    symbols = [line.split()[-2:] for line in listed.splitlines() if len(line.split()) >= 2]
    defined = {name for kind, name in symbols if kind in "TtRrDdBb"}
    needed = {name for kind, name in symbols if kind == "U"} - defined
    assert needed <= NEEDED, needed - NEEDED
    assert "memset" in needed
