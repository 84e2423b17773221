"""Run a study: the optimiser proposes, the engine simulates, until it is done or the user stops it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from commonrail.base.arguments import flag, function, instance, thread_count
from commonrail.base.display import Shown
from commonrail.base.errors import StudyError
from commonrail.base.hooks import hold_interrupts
from commonrail.calibration.optimisers.base import Best
from commonrail.calibration.plausibility import Finding, Fit, after_fit, of_settings, of_values
from commonrail.calibration.scoring import Scores, injector_of, mean_scores, score_all, scores_of
from commonrail.calibration.search import (
    Checkpoint,
    Listeners,
    Progress,
    Recorder,
    Search,
    SearchResult,
    live_progress,
)
from commonrail.calibration.study import Study, objective_of
from commonrail.data.base import DataSet, Score
from commonrail.data.metering import with_meters
from commonrail.data.records import JUDGED
from commonrail.physics.injector import Injector, Source
from commonrail.physics.meters import Meter

if TYPE_CHECKING:
    from commonrail.workers.workers import Workers


@dataclass(frozen=True, repr=False, kw_only=True)
class Calibration(Shown, SearchResult):
    """Result of a study: of its search, and what it makes of injector and data.

    Attributes
    ----------
    study : Study
    injector : Injector
        The calibrated injector.
    scores : dict of str to tuple of Score
        For "start", "best" and, where the body is flexible, "rigid": every data set, fit and validation. Where several
        optima of maps were found, "mean" is of the mean of what they predict.
    warnings : tuple of Finding
        What about study, data and result is implausible: by its settings, and with the calibrated values.
    start_warnings : tuple of Finding
        What was implausible with the start values, and no longer is.
    members : tuple of Injector
        Of the optima whose mean is scored, the calibrated injector first; empty where there is none.
    best, cost, start_cost, history, counts, status, reason, seconds, simulations, failures, convergence, ends
        As in `commonrail.calibration.search.SearchResult`.
    """

    presenter = "commonrail.report.notebook:CALIBRATION"

    study: Study
    injector: Injector
    scores: dict[str, tuple[Score, ...]]
    warnings: tuple[Finding, ...]
    start_warnings: tuple[Finding, ...] = ()
    members: tuple[Injector, ...]

    @property
    def meters(self) -> tuple[Meter, ...]:
        """Meters of the data with their calibrated quantities, which are marked F."""
        source = Source("F", f'calibrated by "{self.study.title}"')
        return tuple(meter.with_best(self.best, source) for meter in self.study.meters)

    @property
    def data(self) -> tuple[DataSet, ...]:
        """Data of the study with the calibrated meters."""
        return with_meters(self.study.data, self.meters)


def calibrate(
    study: Study,
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    workers: Workers | None = None,
    recorder: Recorder | None = None,
    checkpoint: Checkpoint | None = None,
    warn: Callable[[Finding], None] | None = None,
    strict: bool = False,
) -> Calibration:
    """Run a study to its end, or until Ctrl-C, which ends it in order with the best so far.

    `commonrail.runs.calibrate_into` does the same and keeps every step in a run folder.

    Parameters
    ----------
    study : Study
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    progress : function of Progress, optional
        Called after every generation; by default a bar within a notebook, and nothing elsewhere.
    workers : Workers, optional
        Processes or a cluster that simulate the populations in place of threads; the result is the same.
    recorder : Recorder, optional
        Told of every step before `progress` is.
    checkpoint : Checkpoint, optional
        Where to go on, of the same study; the result is that of a search that was never stopped.
    warn : function of Finding, optional
        Called with each warning as soon as it is found: those about the study before the search begins.
    strict : bool
        Refuse a study that gives a warning before the search begins. Warnings about the result are in
        `Calibration.warnings` either way.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, such as a path in place of a study.
    StudyError
        If the study has no data to fit, if the workers failed, if the checkpoint belongs to another study, or if
        `strict` and the study gives a warning.
    SimulationError
        If not one candidate could be simulated.
    """
    instance(study, Study, "study")
    threads = thread_count(threads)
    progress = function(progress, "progress") or live_progress()
    function(warn, "warn")
    strict = flag(strict, "strict")
    if workers is not None:
        from commonrail.workers.workers import Workers

        instance(workers, Workers, "workers")
    if checkpoint is not None:
        instance(checkpoint, Checkpoint, "checkpoint")
    with hold_interrupts() as stop:
        search = Search(study, objective_of(study, threads), workers, Listeners(progress, recorder, stop), checkpoint)
        start, by_itself, at_start = _start(study, threads, warn, strict)
        calibration = _calibration(study, search.to_end(), start, threads)
        _tell(tuple(finding for finding in calibration.warnings if finding not in by_itself + at_start), warn)
        return calibration


def at_values(calibration: Calibration, best: Mapping[str, float], threads: int | None = None) -> Calibration:
    """The calibration with values `best` [SI] of all parameters, such as the most likely, in place of the search's."""
    study, x = calibration.study, np.array([best[name] for name in calibration.study.space.names])
    cost = float(objective_of(study, threads).costs(x[None]).costs[0])
    values = {item.name: getattr(calibration, item.name) for item in fields(SearchResult)}
    values |= {"best": dict(best), "cost": cost, "ends": (Best(x, cost), *calibration.ends[1:])}
    return _calibration(study, SearchResult(**values), calibration.scores["start"], threads)


def _calibration(study: Study, search_result: SearchResult, start: Scores, threads: int | None) -> Calibration:
    """Result of a search with what it makes of injector and data; `start` are the scores of the start values."""
    injector, finished = injector_of(study, search_result.best), search_result.status == "finished"
    scores = scores_of(study, injector, threads, with_rigid=finished, start=start, best=search_result.best)
    members: tuple[Injector, ...] = ()
    if finished:
        members, mean = mean_scores(study, injector, scores[JUDGED], search_result.ends, threads)
        scores |= mean
    by_itself = of_settings(study)
    after = after_fit(
        Fit(study, search_result.best, search_result.start_cost, search_result.cost, scores["best"]),
        injector,
        by_itself,
    )
    return Calibration(
        study=study,
        injector=injector,
        scores=scores,
        warnings=by_itself + after,
        start_warnings=_others(of_values(study, start), after),
        members=members,
        **vars(search_result),
    )


def check_study(study: Study, threads: int | None = None) -> tuple[Finding, ...]:
    """Warnings about a study that `calibrate` would give before its search: units, signs, times, ranges.

    Every data set is simulated once with the start values.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, such as a path in place of a study.
    """
    instance(study, Study, "study")
    _, by_itself, at_start = _start(study, thread_count(threads))
    return by_itself + at_start


def _start(
    study: Study, threads: int | None, warn: Callable[[Finding], None] | None = None, strict: bool = False
) -> tuple[Scores, tuple[Finding, ...], tuple[Finding, ...]]:
    """Scores of the start values, and warnings about settings and start; if `strict`, the first ones are an error."""
    by_itself = of_settings(study)
    _tell(by_itself, warn)
    _refuse(by_itself, strict)
    start = score_all(study, study.injector, threads)
    simulated = of_values(study, start)
    _tell(simulated, warn)
    _refuse(simulated, strict)
    return start, by_itself, simulated


def _others(findings: tuple[Finding, ...], reported: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Findings whose kind and subject are not among the known ones."""
    said = {(finding.code, finding.subject) for finding in reported}
    return tuple(finding for finding in findings if (finding.code, finding.subject) not in said)


def _tell(findings: tuple[Finding, ...], warn: Callable[[Finding], None] | None) -> None:
    if warn is not None:
        for finding in findings:
            warn(finding)


def _refuse(findings: tuple[Finding, ...], strict: bool) -> None:
    if findings and strict:
        others = f" ({len(findings) - 1} more of this kind)" if len(findings) > 1 else ""
        raise StudyError(f"nothing was run, because a warning counts as an error here: {findings[0].sentence}{others}")
