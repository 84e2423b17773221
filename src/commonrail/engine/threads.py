"""Threads that stay: to start some for every batch takes a good part of a small batch's own time."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

__all__ = ["side_by_side"]


def side_by_side(work: Callable[[int], None], items: Sequence[int]) -> None:
    """Call `work` with every item at the same time: with the first in the calling thread, the others in threads."""
    pool = _pool(len(items) - 1) if len(items) > 1 else None
    others = [pool.submit(work, item) for item in items[1:]] if pool is not None else []
    try:
        work(items[0])
    finally:
        for other in others:
            other.result()


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "commonrail")


if hasattr(os, "register_at_fork"):  # a forked process inherits the pools, but none of their threads
    os.register_at_fork(after_in_child=_pool.cache_clear)
