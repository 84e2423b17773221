"""Run a study: the optimiser proposes, the engine simulates, until it is done or the user stops it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from commonrail.base.arguments import flag, function, instance, thread_count
from commonrail.base.display import Shown
from commonrail.base.errors import SimulationError, StudyError
from commonrail.calibration.members import injector_of, mean_scores
from commonrail.calibration.optimisers.base import Best, Convergence, Counts
from commonrail.calibration.plausibility.check import after_fit, of_settings, of_start
from commonrail.calibration.plausibility.finding import Finding
from commonrail.calibration.plausibility.fit import Fit
from commonrail.calibration.scoring import Scores, score_all, scores_of
from commonrail.calibration.search import (
    Checkpoint,
    Generation,
    Listeners,
    Progress,
    Recorder,
    Search,
    live_progress,
    objective_of,
)
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Score
from commonrail.data.metering import with_meters
from commonrail.data.records import JUDGED
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector, Source
from commonrail.physics.meters import Meter
from commonrail.workers.interrupt import held_interrupts
from commonrail.workers.workers import Workers


@dataclass(frozen=True, repr=False)
class Calibration(Shown):
    """Result of a study.

    Attributes
    ----------
    study : Study
    injector : Injector
        The calibrated injector.
    best : dict of str to float
        Best values of the free parameters [SI].
    cost, start_cost : float
        Objective of the best and of the start values; +inf if nothing succeeded.
    history : tuple of Generation
    counts : Counts
        Slots offered, simulations run, simulations failed; a simulation is one candidate at all points.
    status, reason : str
        "finished" or "interrupted", and why it stopped.
    scores : dict of str to tuple of Score
        For "start", "best" and, where the body is flexible, "rigid": every data set, fit and validation. Where several
        optima of maps were found, "mean" is of the mean of what they predict.
    seconds : float
        Time of the search.
    simulations : int
        Single injections simulated.
    failures : mapping of str to int
        Failed simulations by the name of their status.
    warnings : tuple of Finding
        What about study, data and result is implausible, found before and after the fit.
    convergence : Convergence or None
        Whether the search has converged, by which rule; None of one that was interrupted.
    ends : tuple of Best
        Optima that the search has found side by side, the best first.
    members : tuple of Injector
        Of the optima whose mean is scored, the calibrated injector first; empty where there is none.
    """

    presenter = "commonrail.report.notebook:CALIBRATION"

    study: Study
    injector: Injector
    best: dict[str, float]
    cost: float
    start_cost: float
    history: tuple[Generation, ...]
    counts: Counts
    status: str
    reason: str
    scores: dict[str, tuple[Score, ...]]
    seconds: float
    simulations: int
    failures: Mapping[str, int] = field(default_factory=dict)
    warnings: tuple[Finding, ...] = ()
    convergence: Convergence | None = None
    ends: tuple[Best, ...] = ()
    members: tuple[Injector, ...] = ()

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

    `commonrail.calibrate_into` does the same and keeps every step in a run folder.

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
        instance(workers, Workers, "workers")
    if checkpoint is not None:
        instance(checkpoint, Checkpoint, "checkpoint")
    with held_interrupts() as wish:
        search = Search(study, objective_of(study, threads), workers, Listeners(progress, recorder, wish), checkpoint)
        start, before = _start(study, threads, warn, strict)
        calibration = _calibrate(search, study, threads, start)
        fit = Fit(study, calibration.best, calibration.start_cost, calibration.cost, calibration.scores["best"])
        after = after_fit(fit, calibration.injector, before)
        _tell(after, warn)
        return replace(calibration, warnings=before + after)


def check_study(study: Study, threads: int | None = None) -> tuple[Finding, ...]:
    """Warnings about a study that `calibrate` would give before its search: units, signs, times, ranges.

    Every data set is simulated once with the start values.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, such as a path in place of a study.
    """
    instance(study, Study, "study")
    return _start(study, thread_count(threads))[1]


def _start(
    study: Study, threads: int | None, warn: Callable[[Finding], None] | None = None, strict: bool = False
) -> tuple[Scores, tuple[Finding, ...]]:
    """Scores of the start values, and the warnings before the fit; if `strict`, the first ones are an error."""
    by_itself = of_settings(study)
    _tell(by_itself, warn)
    _refuse(by_itself, strict)
    start = score_all(study, study.injector, threads)
    simulated = of_start(study, start)
    _tell(simulated, warn)
    _refuse(simulated, strict)
    return start, by_itself + simulated


def _tell(findings: tuple[Finding, ...], warn: Callable[[Finding], None] | None) -> None:
    if warn is not None:
        for finding in findings:
            warn(finding)


def _refuse(findings: tuple[Finding, ...], strict: bool) -> None:
    if findings and strict:
        others = f" ({len(findings) - 1} more of this kind)" if len(findings) > 1 else ""
        raise StudyError(f"nothing was run, because a warning counts as an error here: {findings[0].sentence}{others}")


def _calibrate(search: Search, study: Study, threads: int | None, start: Scores) -> Calibration:
    status, reason = search.until_stopped()
    seconds = search.seconds
    x, cost = search.best
    if not np.isfinite(cost):
        if status == "interrupted":
            raise KeyboardInterrupt
        raise SimulationError(_all_failed(study.title, search.failures))
    best = dict(zip(study.space.names, x.tolist(), strict=True))
    calibrated = injector_of(study, best)
    scores = scores_of(study, calibrated, threads, with_rigid=status == "finished", start=start, best=best)
    members: tuple[Injector, ...] = ()
    if status == "finished":
        members, mean = mean_scores(study, calibrated, scores[JUDGED], search.ends, threads)
        scores |= mean
    return Calibration(
        study,
        calibrated,
        best,
        cost,
        float(search.objective.costs(study.space.reference[None, :]).costs[0]),
        tuple(search.history),
        search.counts,
        status,
        reason,
        scores,
        seconds,
        search.simulations,
        dict(search.failures),
        convergence=search.verdict() if status == "finished" else None,
        ends=search.ends,
        members=members,
    )


def _all_failed(title: str, failures: Counter[str]) -> str:
    """Sentence on a search in which nothing could be simulated: the most frequent reason and its cure."""
    if not failures:
        return (
            f"{title}: not one candidate satisfied the constraints, so none was simulated; widen the bounds or "
            'take initial = "feasible".'
        )
    (name, count), total = failures.most_common(1)[0], failures.total()
    return (
        f"{title}: not one of {total} candidates could be simulated; {count} of them: "
        f"{Status[name.upper()].sentence} Check the start values with `commonrail simulate`."
    )
