"""Run the repetitions side by side, in the order of their seeds, until all are done or the user stops."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

from commonrail.analysis.truth import Truth
from commonrail.arguments import function, instance, sequence, thread_count, whole
from commonrail.calibration.interrupt import Wish, held_interrupts
from commonrail.engine.simulate import usable_threads
from commonrail.engine.time_step import check_step
from commonrail.errors import ConfigurationError
from commonrail.injector.definition import Injector
from commonrail.reproduction.repetition import Bench, Repetition, generations_of_one, repeat

__all__ = ["Progress", "Reproduction", "reproduce"]


class Progress(NamedTuple):
    """Generations done and in all, repetitions done and in all, seconds since the start."""

    generation: int
    generations: int
    done: int
    seeds: int
    seconds: float


@dataclass(frozen=True)
class Reproduction:
    """Outcome of all repetitions.

    Attributes
    ----------
    bench : Bench
    repetitions : tuple of Repetition
        In ascending order of position in the seeds asked for; those that were stopped are not among them.
    asked : int
        Repetitions asked for.
    seconds : float
    """

    bench: Bench
    repetitions: tuple[Repetition, ...]
    asked: int
    seconds: float

    @property
    def status(self) -> str:
        """ "finished", or "interrupted" if repetitions are missing."""
        return "finished" if len(self.repetitions) == self.asked else "interrupted"


def reproduce(
    bench: Bench,
    seeds: Sequence[int],
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Reproduction:
    """Repeat the paper's study once for each seed.

    Every figure depends on its seed alone, not on the threads. Ctrl-C ends in order: repetitions that are complete
    are kept.

    Parameters
    ----------
    bench : Bench
    seeds : sequence of int
        Distinct.
    threads : int, optional
        Repetitions side by side; all usable processors by default.
    progress : function of Progress, optional
        Called now and then, from the calling thread.

    Raises
    ------
    ConfigurationError
        If seeds are missing, repeated, negative or not whole, or an argument is of another kind.
    SimulationError
        If the truth cannot be simulated.
    KeyboardInterrupt
        If the user stops before one repetition is complete.
    """
    bench = _checked(bench)
    threads = thread_count(threads)
    function(progress, "progress")
    seeds = [whole(seed, "seed") for seed in sequence(seeds, "seeds", "[1, 2, 3]")]
    if not seeds or len(set(seeds)) < len(seeds):
        raise ConfigurationError("The seeds of a reproduction must be at least one, each once.")
    start = time.perf_counter()
    counter = _Counter()
    with held_interrupts() as wish, ThreadPoolExecutor(threads or usable_threads()) as pool:
        counter.wish = wish
        futures = [pool.submit(repeat, bench, seed, counter.count) for seed in seeds]
        try:
            _watch(futures, counter, progress, start)
        finally:
            counter.ended = True
            for future in futures:
                future.cancel()
    found = tuple(f.result() for f in futures if not f.cancelled() and f.exception() is None)
    if not found:
        raise KeyboardInterrupt
    return Reproduction(bench, found, len(seeds), time.perf_counter() - start)


def _checked(bench: Bench) -> Bench:
    """The bench with its time step as a number."""
    instance(bench, Bench, "bench")
    instance(bench.truth, Truth, "truth of the bench")
    instance(bench.injector, Injector, "injector of the bench")
    return bench._replace(time_step=check_step(bench.time_step))


class _Counter:
    """Counts generations of all threads, and ends them if the user wishes or a repetition has failed."""

    def __init__(self) -> None:
        self.wish: Wish | None = None
        self.ended = False
        self.generations = 0
        self._lock = threading.Lock()

    def count(self) -> None:
        """One more generation; raises KeyboardInterrupt to end the repetition."""
        with self._lock:
            self.generations += 1
        if self.ended:
            raise KeyboardInterrupt
        if self.wish is not None:
            self.wish.heed()


def _watch(
    futures: Sequence[Future[Repetition]],
    counter: _Counter,
    progress: Callable[[Progress], None] | None,
    start: float,
) -> None:
    """Tell the progress until all repetitions have ended; raise what ended one of them."""
    pending = set(futures)
    while pending:
        done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
        for future in done:
            error = future.exception()
            if error is not None and not isinstance(error, KeyboardInterrupt):
                raise error
        if progress is not None:
            finished = len(futures) - len(pending)
            seconds = time.perf_counter() - start
            total = len(futures) * generations_of_one()
            with suppress(OSError, ValueError):  # a terminal that went away must not end the work
                progress(Progress(counter.generations, total, finished, len(futures), seconds))
