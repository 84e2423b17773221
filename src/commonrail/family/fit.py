"""Joint fit of the parts of a family, and the type that comes of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from commonrail.analysis.identifiability import identify_at
from commonrail.arguments import function, instance, thread_count
from commonrail.arrays import Floats
from commonrail.calibration.checkpoint import Checkpoint, Generation, Recorder
from commonrail.calibration.injector_type import InjectorType
from commonrail.calibration.members import mean_of, members_of
from commonrail.calibration.optimisers import Counts
from commonrail.calibration.run import score_all
from commonrail.calibration.search import Listeners, Progress, Search
from commonrail.errors import SimulationError
from commonrail.family.learnt import learnt_type
from commonrail.family.objective import FamilyObjective
from commonrail.family.study import Family
from commonrail.injector.definition import Injector, Source
from commonrail.kinds import Score
from commonrail.workers.interrupt import held_interrupts
from commonrail.workers.workers import Workers

__all__ = ["FamilyFit", "FittedPart", "fit_family", "objective_of_parts"]


@dataclass(frozen=True)
class FittedPart:
    """Result of one part.

    Attributes
    ----------
    injector : Injector
    best : mapping of str to float
        Values of its free parameters, SI.
    scores, start : tuple of Score
        Of each of its data sets, with these values and with the start values.
    members : tuple of Injector
        Its injectors by each member of the joint fit, the best first.
    mean : tuple of Score
        Of the mean of what the members predict; empty unless all data are maps and there are several members.
    """

    injector: Injector
    best: Mapping[str, float]
    scores: tuple[Score, ...]
    start: tuple[Score, ...] = ()
    members: tuple[Injector, ...] = ()
    mean: tuple[Score, ...] = ()


@dataclass(frozen=True)
class FamilyFit:
    """Result of a joint fit.

    Attributes
    ----------
    family : Family
    parts : mapping of str to FittedPart
    injector_type : InjectorType
        What the parts have taught.
    joint : mapping of str to float
        Joint parameters.
    cost : float
        Objective of all parts together.
    simulations : int
        Single injections simulated, those of equal candidates of a part counted for each.
    status, reason : str
        "finished" or "interrupted", and why it stopped.
    start_cost : float
        Objective of the start values.
    history : tuple of Generation
    counts : Counts
    failures : mapping of str to int
        Failed candidates by the name of their status.
    seconds : float
        Time of the search.
    members : tuple of float
        Objectives of the optima whose predictions are averaged, the best first.
    """

    family: Family
    parts: Mapping[str, FittedPart]
    injector_type: InjectorType
    joint: Mapping[str, float]
    cost: float
    simulations: int
    status: str = "finished"
    reason: str = ""
    start_cost: float = float("inf")
    history: tuple[Generation, ...] = ()
    counts: Counts = field(default_factory=Counts)
    failures: Mapping[str, int] = field(default_factory=dict)
    seconds: float = 0.0
    members: tuple[float, ...] = ()


def objective_of_parts(family: Family, threads: int | None = None) -> FamilyObjective:
    """Objective of a joint fit, on threads of this process.

    Parameters
    ----------
    family : Family
    threads : int, optional
        All usable processors by default.
    """
    return FamilyObjective(list(family.parts.values()), family.sharing, family.space, threads)


def fit_family(
    family: Family,
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    workers: Workers | None = None,
    recorder: Recorder | None = None,
    checkpoint: Checkpoint | None = None,
) -> FamilyFit:
    """Fit the parts of a family together, to the end or until Ctrl-C, which ends it in order with the best so far.

    The search is that of a calibration; its objective is the sum of the parts' squares and of the squared pulls of the
    joint priors. Validation data of the parts are scored and not fitted. `commonrail.family.run.fit_into` does the same
    and keeps every step in a run folder.

    Parameters
    ----------
    family : Family
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    progress : function of Progress, optional
        Called after every step.
    workers : Workers, optional
        Processes or a cluster that simulate in place of threads; the result is the same.
    recorder : Recorder, optional
        Told of every step before `progress` is.
    checkpoint : Checkpoint, optional
        State to resume from, of the same family.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind.
    StudyError
        If the workers failed, or the checkpoint belongs to another family.
    SimulationError
        If no candidate could be simulated.
    """
    instance(family, Family, "family")
    function(progress, "progress")
    threads = thread_count(threads)
    objective = objective_of_parts(family, threads)
    with held_interrupts() as wish:
        search = Search(family, objective, workers, Listeners(progress, recorder, wish), checkpoint)
        status, reason = search.until_stopped()
        x, cost = search.best
        if not np.isfinite(cost):
            if status == "interrupted":
                raise KeyboardInterrupt
            raise SimulationError(f"{family.title}: no candidate could be simulated for all parts; check the bounds.")
        objective.threads = threads  # workers' copies share the simulators
        ends = members_of(search.ends)
        found = identify_at(family.space, objective, x)
        errors = {name: found[name]["standard_error"] for name in family.space.names}
        joint = dict(zip(family.space.names, x.tolist(), strict=True))
        return FamilyFit(
            family,
            {name: _part(family, k, [end.x for end in ends], threads) for k, name in enumerate(family.parts)},
            learnt_type(family, joint, errors),
            joint,
            cost,
            search.simulations,
            status,
            reason,
            float(objective.costs(family.space.reference[None, :]).costs[0]),
            tuple(search.history),
            search.counts,
            dict(search.failures),
            search.seconds,
            tuple(end.cost for end in ends),
        )


def _part(family: Family, index: int, ends: Sequence[Floats], threads: int | None) -> FittedPart:
    """Result of one part from the joint members, the best first."""
    name, study = list(family.parts.items())[index]
    note = Source("F", f'fitted together with the other parts of "{family.title}"')
    injectors, scores = [], []
    for number, x in enumerate(ends):
        values = dict(zip(study.space.names, family.sharing.of_part(index, x).tolist(), strict=True))
        injector = replace(
            study.injector.with_values(values),
            name=f"{study.injector.name}-{name}" + (f"-{number + 1}" if number else ""),
            sources={**study.injector.sources, **dict.fromkeys(values, note)},
        )
        injectors.append(injector)
        scores.append(score_all(study, injector, threads))
    best = {key: injectors[0].values[key] for key in study.space.names}
    start = score_all(study, study.injector, threads)
    return FittedPart(injectors[0], best, scores[0], start, tuple(injectors), mean_of(study.data, scores))
