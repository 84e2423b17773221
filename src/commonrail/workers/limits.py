"""Limits of workers: how many there may be, how long one may take, how often a task may be lost."""

from __future__ import annotations

import time
from typing import NamedTuple

from commonrail.arguments import LARGEST_WHOLE, whole
from commonrail.engine.simulate import usable_threads
from commonrail.errors import ConfigurationError

CROWD = 8  # workers for each processor; more would only take memory
SLICE = 0.5  # how long to wait at a time [s]


def waited(start: float) -> float:
    """Time since `start`, on the clock of `time.monotonic`, that counts as waiting [s].

    It is not what the clock says: where this process was halted too (Ctrl-Z, a lid), nobody was late.
    """
    return min(time.monotonic() - start, 2.0 * SLICE)


class Limits(NamedTuple):
    """Limits of workers.

    Attributes
    ----------
    failures : int
        Times that a task may be lost, or that workers may fail to start in a row.
    patience : float
        A worker hangs if a task of known length takes this many times as long …
    least : float
        … and longer than this [s].
    start : float
        Time that a worker may take to start, or to load the work [s]; where no kernel can be kept on disk, each
        worker compiles its own in this time.
    """

    failures: int = 3
    patience: float = 20.0
    least: float = 60.0
    start: float = 300.0


USUAL = Limits()


def check_count(count: int) -> None:
    """Refuse a number of workers that makes no sense.

    Raises
    ------
    ConfigurationError
        If it is not between 1 and eight for each processor.
    """
    processors = usable_threads()
    count = whole(count, "number of workers", -LARGEST_WHOLE)
    if not 1 <= count <= CROWD * processors:
        raise ConfigurationError(
            f"The number of workers must lie between 1 and {CROWD * processors}, {CROWD} for each processor of this "
            f"machine, not {count}; as many as processors, {processors}, are the fastest."
        )
