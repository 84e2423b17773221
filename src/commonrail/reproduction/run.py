"""Repetitions of the paper's study for many seeds."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import commonrail as cr
from commonrail.reproduction.repetition import Repetition, generations_of_one, repeat

__all__ = ["Reproduction", "reproduce"]


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

    bench: cr.Bench
    repetitions: tuple[Repetition, ...]
    asked: int
    seconds: float

    @property
    def status(self) -> str:
        """ "finished", or "interrupted" if repetitions are missing."""
        return "finished" if len(self.repetitions) == self.asked else "interrupted"


def reproduce(
    bench: cr.Bench,
    seeds: Sequence[int],
    *,
    threads: int | None = None,
    progress: Callable[[cr.SeedProgress], None] | None = None,
) -> Reproduction:
    """Repeat the paper's study once for each seed.

    Every figure depends on its seed alone, not on the threads. Ctrl-C ends in order: repetitions that are complete
    are kept.

    Parameters
    ----------
    bench : Bench
    seeds, threads, progress
        As for `for_seeds`, which also says what else is raised.

    Raises
    ------
    SimulationError
        If the truth cannot be simulated.
    """
    if not isinstance(bench, cr.Bench):
        raise cr.ConfigurationError(
            f"The bench must be a Bench, not a {type(bench).__name__}; "
            "write commonrail.Bench(truth, injector, time_step)."
        )
    start = time.perf_counter()
    found = cr.for_seeds(
        lambda seed, after: repeat(bench, seed, after),
        seeds,
        generations=generations_of_one(),
        threads=threads,
        progress=progress,
    )
    return Reproduction(bench, found, len(seeds), time.perf_counter() - start)
