"""The same search for many seeds, on threads side by side, until all are done or the user stops."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import suppress
from contextvars import copy_context
from typing import NamedTuple, TypeVar

from commonrail.base.arguments import function, integer, sequence, shown, thread_count
from commonrail.base.errors import ConfigurationError
from commonrail.base.hooks import StopRequest, hold_interrupts
from commonrail.engine.threads import usable_threads

_Found = TypeVar("_Found")


class SeedProgress(NamedTuple):
    """Generations done and in all, seeds done and in all, seconds since the start."""

    generation: int
    generations: int
    done: int
    seeds: int
    seconds: float


def for_seeds(
    search: Callable[[int, Callable[[], None]], _Found],
    seeds: Sequence[int],
    *,
    generations: int = 0,
    threads: int | None = None,
    progress: Callable[[SeedProgress], None] | None = None,
) -> tuple[_Found, ...]:
    """Run a search once for each seed, and return what was found in the order of the seeds.

    After Ctrl-C, complete searches are returned; the missing searches were stopped.

    Parameters
    ----------
    search : function of (seed, after)
        Runs on one thread and calls ``after()`` after every generation. ``after`` raises KeyboardInterrupt if the user
        has stopped or another search has failed.
    seeds : sequence of int
        Distinct.
    generations : int
        Of one search, for `progress`.
    threads : int, optional
        Searches side by side; all usable processors by default.
    progress : function of SeedProgress, optional
        Called now and then, from the calling thread.

    Raises
    ------
    ConfigurationError
        If seeds are missing, repeated, negative or not whole, or an argument is of another kind.
    KeyboardInterrupt
        If the user stops before one search is complete.
    """
    threads = thread_count(threads)
    if not callable(search):
        raise ConfigurationError(f"The search must be a function of (seed, after), not {shown(search)}.")
    function(progress, "progress")
    seeds = [integer(seed, "seed") for seed in sequence(seeds, "seeds", "[1, 2, 3]")]
    if not seeds or len(set(seeds)) < len(seeds):
        raise ConfigurationError("Give at least one seed, and each seed once.")
    start = time.perf_counter()
    with hold_interrupts() as stop, ThreadPoolExecutor(threads or usable_threads()) as pool:
        counter = _Counter(stop)
        futures = [pool.submit(copy_context().run, search, seed, counter.count) for seed in seeds]
        pending = set(futures)
        try:
            while pending:
                ended, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
                for error in (future.exception() for future in ended):
                    if error is not None and not isinstance(error, KeyboardInterrupt):
                        raise error
                if progress is not None:
                    done = sum(future not in pending and future.exception() is None for future in futures)
                    count, seconds = len(futures), time.perf_counter() - start
                    with suppress(OSError, ValueError):  # a terminal that went away must not end the work
                        progress(SeedProgress(counter.generations, count * generations, done, count, seconds))
        finally:
            counter.ended = True
            for future in futures:
                future.cancel()
    results = tuple(f.result() for f in futures if not f.cancelled() and f.exception() is None)
    if not results:
        raise KeyboardInterrupt
    return results


class _Counter:
    """Count of the generations of all threads; ends them if the user wishes or a search has failed."""

    def __init__(self, stop: StopRequest) -> None:
        self.stop, self.ended, self.generations = stop, False, 0
        self._lock = threading.Lock()

    def count(self) -> None:
        """One more generation; raises KeyboardInterrupt to end the search."""
        with self._lock:
            self.generations += 1
        if self.ended:
            raise KeyboardInterrupt
        self.stop.check()
