"""The same search for many seeds, on threads side by side, until all are done or the user stops."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from commonrail.base.arguments import function, sequence, shown, thread_count, whole
from commonrail.base.errors import ConfigurationError, SimulationError
from commonrail.base.hooks import StopRequest, held_interrupts
from commonrail.base.text import number
from commonrail.base.units import to_text
from commonrail.calibration.run import Calibration, calibrate
from commonrail.calibration.study import NO_JUDGEMENT, Judgement, Study
from commonrail.data.base import DataSet, Role
from commonrail.data.quantities.baselines import interpolated
from commonrail.data.quantities.cross_validation import Fold, folded_record, levels, without
from commonrail.data.quantities.data import QuantityData
from commonrail.data.records import JUDGED, MEAN
from commonrail.data.registry import of_role
from commonrail.engine.simulate import usable_threads

if TYPE_CHECKING:
    from commonrail.workers.workers import Workers

# Further searches of a study: with other seeds, and without the rows that they then predict.

Note = Callable[[str], None]
Search = Callable[[Study], "Calibration | None"]

_UNITS = {"rail_pressure": "Pa", "energising_time": "s"}


class _StoppedError(Exception):
    """The user has stopped a further search."""


def refits_of(
    calibration: Calibration, *, threads: int | None = None, workers: Workers | None = None, note: Note = lambda _: None
) -> dict[str, Any]:
    """Searches that the study's `judgement` asks for, as a JSON-able record; empty where it asks for none.

    "seeds" and "left_out"; "interrupted" is true if the user stopped before the last search. Nothing is searched if the
    calibration was interrupted. `note` is called before each search.
    """
    wanted: Judgement = calibration.study.judgement
    if not wanted.wanted or calibration.status != "finished":
        return {}

    def search(study: Study) -> Calibration | None:
        try:
            found = calibrate(study, threads=threads, workers=workers)
        except SimulationError:
            return None
        except KeyboardInterrupt:
            raise _StoppedError from None
        if found.status != "finished":
            raise _StoppedError
        return found

    record: dict[str, Any] = {"seeds": [_seed_record(calibration)] if wanted.seeds else [], "left_out": []}
    study = replace(calibration.study, judgement=NO_JUDGEMENT)
    try:
        for seed in range(study.seed + 1, study.seed + 1 + wanted.seeds):
            note(f"searching with seed {seed} ...")
            other = search(replace(study, seed=seed))
            record["seeds"].append({"seed": seed, "failed": True} if other is None else _seed_record(other))
        for by in wanted.leave_out:
            record["left_out"] += _left_out(study, by.value, search, note)
    except _StoppedError:
        record["interrupted"] = True
    return record


def _seed_record(found: Calibration) -> dict[str, Any]:
    """Objective, errors of the data sets and positions of the parameters that one seed has found."""
    scores = zip(found.study.data, found.scores["best"], strict=True)
    parameters = found.study.space.parameters
    return {
        "seed": found.study.seed,
        "objective": number(found.cost),
        "errors": {data.name: number(score.error) for data, score in scores},
        "error_heads": {data.name: " ".join(data.error_head) for data in found.study.data},
        "positions": {p.name: p.position(found.best[p.name]) for p in parameters},
    }


def _left_out(study: Study, by: str, search: Search, note: Note) -> list[dict[str, Any]]:
    """Records of all fitted maps whose rows at each value of a quantity are held out in turn."""
    fitted = of_role(study.data, Role.FIT)
    maps = [data for data in fitted if isinstance(data, QuantityData)]
    folds: dict[str, list[Fold]] = {data.name: [] for data in maps}
    failed = []
    for value in sorted({level for data in maps for level in levels(data, by)}):
        text = to_text(value, _UNITS[by])
        parts = {data.name: found for data in maps if (found := without(data, by, value)) is not None}
        if not parts:
            continue
        note(f"searching without {text} ...")
        kept = [parts[data.name][0] if data.name in parts else data for data in fitted]
        held = [part[1] for part in parts.values()]
        other = search(replace(study, data=(*kept, *held)))
        if other is None:
            failed.append(text)
            continue
        _add(folds, parts, other, kept)
    records = [folded_record(data, folds[data.name]) for data in maps if folds[data.name]]
    return [{"by": by, "searches": len(folds[record["name"]]), "failed": failed, **record} for record in records]


def _add(folds: dict[str, list[Fold]], parts: dict[str, Any], found: Calibration, kept: Sequence[DataSet]) -> None:
    """Note the scores of one search on the rows that it has not seen."""
    names = [data.name for data in found.study.data]
    maps = [data for data in kept if isinstance(data, QuantityData)]
    for name, (_, held, rows) in parts.items():
        scores: dict[str, Any] = {label: own[names.index(held.name)] for label, own in found.scores.items()}
        baseline = interpolated(held, [one for one in maps if one.kind == held.kind])
        folds[name].append(Fold(rows, scores[JUDGED], baseline, scores.get(MEAN)))


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

    Ctrl-C ends in order: searches that are complete are kept, those that are missing were stopped.

    Parameters
    ----------
    search : function of (seed, after)
        Runs on one thread and calls ``after()`` after every generation, which ends it by KeyboardInterrupt when the
        user stops or another search has failed.
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
    seeds = [whole(seed, "seed") for seed in sequence(seeds, "seeds", "[1, 2, 3]")]
    if not seeds or len(set(seeds)) < len(seeds):
        raise ConfigurationError("The seeds must be at least one, each once.")
    start = time.perf_counter()

    def tell(futures: Sequence[Future[_Found]], pending: set[Future[_Found]]) -> None:
        if progress is not None:
            done = sum(future not in pending and future.exception() is None for future in futures)
            seconds = time.perf_counter() - start
            with suppress(OSError, ValueError):  # a terminal that went away must not end the work
                progress(SeedProgress(counter.generations, len(futures) * generations, done, len(futures), seconds))

    with held_interrupts() as stop, ThreadPoolExecutor(threads or usable_threads()) as pool:
        counter = _Counter(stop)
        futures = [pool.submit(search, seed, counter.count) for seed in seeds]
        try:
            _watch(futures, lambda pending: tell(futures, pending))
        finally:
            counter.ended = True
            for future in futures:
                future.cancel()
    found = tuple(f.result() for f in futures if not f.cancelled() and f.exception() is None)
    if not found:
        raise KeyboardInterrupt
    return found


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


def _watch(futures: Sequence[Future[_Found]], tell: Callable[[set[Future[_Found]]], None]) -> None:
    """Tell which are pending until all searches have ended; raise what ended one of them."""
    pending = set(futures)
    while pending:
        done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
        for future in done:
            error = future.exception()
            if error is not None and not isinstance(error, KeyboardInterrupt):
                raise error
        tell(pending)
