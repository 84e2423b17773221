"""Libraries of lane loops for a wheel or clone: ``python -m tools.wheel_libraries [FOLDER] [all]``.

Each level of x86-64 gets one library, of the same objects that the cache of kernels holds.
`engine.machine_code` uses them.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import NamedTuple

from commonrail.base.choices import Actuation, Body, Boundary, Drive, Laws, Precision
from commonrail.base.errors import ConfigurationError
from commonrail.base.input import digest
from commonrail.compiler.cache import digests, sources_of, stamp_of
from commonrail.compiler.target import LEVEL_3, LEVEL_4, Processor, package_version
from commonrail.engine.job import VECTORS
from commonrail.engine.machine_code import COMPILERS, FOLDER, SOURCES, STAMP, file_of, object_of, symbol_of
from commonrail.engine.threads import usable_threads
from commonrail.physics.variants import Variant
from commonrail.plugins.export.object_files import compiler_for, find_target, link_shared

_SERVO = tuple(
    Variant(body, boundary, drive, laws) for laws in Laws for body in Body for boundary in Boundary for drive in Drive
)
_DIRECT = tuple(Variant(drive=drive, laws=laws, actuation=Actuation.DIRECT) for laws in Laws for drive in Drive)
ALL = (*_SERVO, *_DIRECT)
# The injectors of the catalogue with either body, and with the drive that replaces theirs in searches.
CATALOGUE = (
    *(v for v in _SERVO if v.laws is Laws.PAPER and v.drive in (Drive.PWM, Drive.REGULATED)),
    *(Variant(body, Boundary.VOLUME, Drive.REGULATED, Laws.EXTENDED) for body in Body),
    Variant(drive=Drive.CURRENT, actuation=Actuation.DIRECT),
)


GROUP = 10  # wirings that one process compiles: they share its laws
MEMORY = 2_000_000_000  # of a process, at most [bytes]; measured: 1.3 GB


class _Task(NamedTuple):
    """Loops of some wirings in one precision, each for several processors."""

    variants: tuple[Variant, ...]
    precision: Precision
    processors: tuple[Processor, ...]


def write_libraries(
    folder: Path,
    variants: Sequence[Variant] = CATALOGUE,
    precisions: Sequence[Precision] = tuple(Precision),
    levels: Sequence[Processor] = (LEVEL_3, LEVEL_4),
    processes: int = 1,
) -> tuple[Path, ...]:
    """Compile and link loops; returns the libraries, which replace those of their names in `folder`.

    A loop is compiled for each of the variants, precisions and levels, some five seconds where it is in no cache; in
    double precision an exact one too. With one of `processes` this one compiles. ConfigurationError if there is no C
    compiler, or it fails.
    """
    target = find_target("linux64")
    compiler = compiler_for(target)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / STAMP).unlink(missing_ok=True)  # without it no library is used, also if this ends halfway
    written = []
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        _write_objects(place, _tasks(variants, precisions, levels), processes)
        shutil.copy(Path(__file__).with_name("level.c"), place)
        for level in levels:
            library = place / file_of(level.name).name
            inputs = [place / "level.c", *sorted((place / level.name).glob("*.o"))]
            link_shared(compiler, inputs, library, target, ())
            written.append(folder / library.name)
            # replaced whole: a process may be running the one before
            os.replace(shutil.copy(library, folder / f".{library.name}"), written[-1])
    stamp = {
        "sources": stamp_of(SOURCES),
        "files": digests(sources_of(SOURCES)),
        "libraries": {path.name: digest(path) for path in written},
        **{package: package_version(package) for package in COMPILERS},
    }
    (folder / STAMP).write_text(json.dumps(stamp, indent=1) + "\n", encoding="utf-8")
    return tuple(written)


def _tasks(variants: Sequence[Variant], precisions: Sequence[Precision], levels: Sequence[Processor]) -> list[_Task]:
    groups = [tuple(variants[first : first + GROUP]) for first in range(0, len(variants), GROUP)]
    return [_Task(group, precision, _processors(precision, levels)) for precision in precisions for group in groups]


def _processors(precision: Precision, levels: Sequence[Processor]) -> tuple[Processor, ...]:
    """Levels, in double precision each exact too: f32 screens candidates and is compiled where it has to be exact."""
    kinds = (False, True) if precision is Precision.F64 else (False,)
    return tuple(level._replace(exact=exact) for level in levels for exact in kinds)


def _write_objects(place: Path, tasks: Sequence[_Task], processes: int) -> None:
    """Write object files of all loops, those of a level into a folder of its name."""
    for objects in _compile_in_processes(tasks, processes) if processes > 1 else map(_compile_task, tasks):
        for (level, symbol), content in objects.items():
            (place / level).mkdir(exist_ok=True)
            (place / level / f"{symbol}.o").write_bytes(content)


def _compile_in_processes(tasks: Sequence[_Task], processes: int) -> Iterator[_Objects]:
    """Results of tasks in processes, which end with this one.

    Each task has a fresh process, since LLVM does not release memory. More than one task for each can deadlock
    before Python 3.12.3.
    """
    others, pool = active_children(), ProcessPoolExecutor(processes, get_context("spawn"), max_tasks_per_child=1)
    try:
        yield from pool.map(_compile_task, tasks)
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(active_children()).difference(others):
            child.terminate()
        raise
    pool.shutdown()


_Objects = dict[tuple[str, str], bytes]


def _compile_task(task: _Task) -> _Objects:
    """Object files of a task's loops by level and symbol."""
    vector = VECTORS[task.precision]
    return {
        (processor.name, symbol_of(variant, task.precision, processor.exact)): object_of(variant, vector, processor)[0]
        for variant in task.variants
        for processor in task.processors
    }


def _most_processes() -> int:
    """Number of processes that processors and memory allow."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return max(1, min(usable_threads(), memory // MEMORY))


def _main(words: list[str]) -> int:
    folder = Path(words[0]) if words else FOLDER
    try:
        paths = write_libraries(folder, ALL if words[1:] == ["all"] else CATALOGUE, processes=_most_processes())
    except ConfigurationError as error:
        print(f"commonrail: {error}", file=sys.stderr)
        return error.exit_code
    except BrokenProcessPool:
        print("commonrail: a process that compiled was killed, perhaps for want of memory.", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    for path in paths:
        print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1:]))
