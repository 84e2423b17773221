"""Work, cut into tasks: packed by the calling process, done by a worker, answered or lost."""

from __future__ import annotations

import functools
import hashlib
import pickle
import platform
import time
from collections.abc import Hashable, Mapping
from typing import Any, NamedTuple, Protocol

from commonrail.base.errors import StudyError
from commonrail.compiler.target import describe, differences


class Work(Protocol):
    """Work of the workers, which reaches them pickled."""

    @property
    def same_bits(self) -> bool:
        """True if its bits do not depend on the processor, nor on what the compiler targets."""

    def __call__(self, argument: Any, /) -> Any:
        """Result of a task's argument; a `CommonrailError` is raised in the calling process too."""

    def probe(self) -> bytes:
        """Bits of a result that must be equal in the calling process and every worker."""


class Package(NamedTuple):
    """Work for a worker: digest of the content, `software` of the packing process, and the pickled work.

    A worker refuses the package if its software differs, or if it computes other bits for the work's `probe`.
    """

    key: str
    software: tuple[tuple[str, str], ...]
    content: bytes
    probe: bytes


class Task(NamedTuple):
    """A part of the work: the caller's name for it, its package and its pickled argument.

    `limit`: time [s] after which its worker counts as hung; `losses`: number of workers lost on this task.
    """

    name: Hashable
    package: Package
    argument: Any
    limit: float
    losses: int = 0


class Answer(NamedTuple):
    """Result of a task, and the seconds it took."""

    result: Any
    seconds: float


class Lost(NamedTuple):
    """A task without a result, and what became of it: the end of a sentence that begins with "the worker"."""

    reason: str


Outcome = Answer | Lost


def pack(work: Work) -> Package:
    """Work for workers, probed here: its kernels are compiled and on disk before any worker asks for them."""
    content = pickle.dumps(work)
    return Package(hashlib.sha256(content).hexdigest(), software(work.same_bits), content, work.probe())


@functools.lru_cache(maxsize=2)
def unpack(package: Package) -> Work:
    """The work; `StudyError` if this worker has other software, or finds other bits than the process that packed it."""
    asked = dict(package.software)
    differing = unlike(asked, {name: text for name, text in software() if name in asked})
    if differing:
        raise StudyError(f"A worker on {platform.node()} has {differing}")
    work: Work = pickle.loads(package.content)
    if work.probe() != package.probe:
        raise StudyError(
            f"A worker on {platform.node()} ({platform.machine()}) finds another objective for the start values than "
            "this machine, bit for bit; start the run on a machine with the processors of the workers."
        )
    return work


def software(same_bits: bool = False) -> tuple[tuple[str, str], ...]:
    """Versions and compiler target, which determine the bits of a result; with `same_bits`, only versions."""
    target = describe()
    if same_bits:
        return target.versions
    machine = {
        name: value for name, value in target.machine.items() if name != "processor"
    }  # the code depends on the target
    return tuple((dict(target.versions) | machine).items())


def unlike(run: Mapping[str, str], worker: Mapping[str, str]) -> str:
    """Difference between a run's software and a worker's: the end of a sentence with "… has"; "" where they are equal.

    A package that the worker lacks is "missing".
    """
    differing = [
        differences({name: expected}, {name: worker[name]}).replace(", now", "")
        if name == "features" and name in worker
        else f"{name} {worker.get(name) or 'missing'} in place of {expected}"
        for name, expected in run.items()
        if worker.get(name) != expected
    ]
    if not differing:
        return ""
    return (
        f"other software than this run: {', '.join(differing)}; install the same versions, for instance with "
        "constraints.txt, on machines with the same processors."
    )


def perform(package: Package, argument: Any) -> Answer:
    """Answer of a task, on its worker; `StudyError` if this worker must not be used, see `unpack`."""
    work = unpack(package)
    start = time.perf_counter()
    result = work(argument)
    return Answer(result, time.perf_counter() - start)


def failure(error: BaseException) -> Lost:
    """Loss of a task to an error that no work is expected to raise."""
    return Lost(f"met {type(error).__name__}: {' '.join(str(error).split())[:200]}".rstrip(": "))
