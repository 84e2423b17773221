"""Calibration of a foreign FMU: the search of a study, with the model in processes of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from commonrail.base.arguments import function, instance
from commonrail.base.arrays import Floats
from commonrail.base.errors import SimulationError
from commonrail.base.hooks import note
from commonrail.calibration.identifiability import identify_at
from commonrail.calibration.optimisers.base import Convergence, Counts
from commonrail.calibration.search import Checkpoint, Generation, Listeners, Progress, Recorder, Search
from commonrail.plugins.foreign_fmu.fmu import FmuSimulator, FmuStatus, opened
from commonrail.plugins.foreign_fmu.study import FmuObjective, FmuStudy
from commonrail.workers.interrupt import held_interrupts

NOT_JUDGED = "not judged: the search was stopped"


@dataclass(frozen=True)
class FmuFit:
    """Result of a calibration of an FMU.

    Attributes
    ----------
    study : FmuStudy
    best : mapping of str to float
        Best values of the free parameters, in the units of the FMU.
    cost, start_cost : float
        Objective of the best and of the start values; +inf if the start values failed.
    simulated : mapping of str to mapping of str to (m,) array
        For "start" and "best": values of each data set by its name, NaN where a simulation failed.
    found : mapping of str to mapping
        Effect, standard error and verdict of each parameter, as `identify_at` gives them; of a search that was stopped
        the verdict alone says so, and the numbers are None.
    step_effect : mapping of str to float
        Largest change of a value of each data set in tolerances, with the best values and half the communication step;
        NaN where that could not be simulated. Empty if it was stopped.
    history : tuple of Generation
    counts : Counts
    simulations : int
        Simulations of the FMU in the search.
    failures : mapping of str to int
        Failed candidates by the name of their status.
    told : mapping of str to str
        The first message of the FMU with each of these statuses.
    status, reason : str
        "finished" or "interrupted", and why it stopped.
    convergence : Convergence or None
        None of one that was interrupted.
    seconds : float
        Time of the search.
    """

    study: FmuStudy
    best: Mapping[str, float]
    cost: float
    start_cost: float
    simulated: Mapping[str, Mapping[str, Floats]]
    found: Mapping[str, Mapping[str, Any]]
    step_effect: Mapping[str, float]
    history: tuple[Generation, ...]
    counts: Counts
    simulations: int
    failures: Mapping[str, int]
    told: Mapping[str, str]
    status: str = "finished"
    reason: str = ""
    convergence: Convergence | None = None
    seconds: float = 0.0


def calibrate_fmu(
    study: FmuStudy,
    *,
    processes: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    recorder: Recorder | None = None,
    checkpoint: Checkpoint | None = None,
) -> FmuFit:
    """Calibrate an FMU to its end, or until Ctrl-C, which ends it in order with the best so far.

    A simulation that fails, hangs or ends its process is a status and costs +inf; the others go on.
    `commonrail.plugins.foreign_fmu.run.calibrate_fmu_into` does the same and keeps every step in a run folder.

    Parameters
    ----------
    study : FmuStudy
    processes : int, optional
        Processes that simulate; all usable processors by default. The result does not depend on it.
    progress : function of Progress, optional
        Called after every step.
    recorder : Recorder, optional
        Told of every step before `progress` is.
    checkpoint : Checkpoint, optional
        State to resume from, of the same study.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind.
    InputError
        If the FMU cannot be unpacked.
    StudyError
        If processes cannot be started, or the checkpoint belongs to another study.
    SimulationError
        If no candidate could be simulated; the sentence has the most frequent status and the FMU's own message.
    """
    instance(study, FmuStudy, "study")
    function(progress, "progress")
    for sentence in study.notes:
        note(sentence)
    how = study.fmu, study.space.names, study.data, study.step, study.time_limit, processes
    with opened(*how) as simulator, held_interrupts() as wish:
        simulator.heed = wish.heed
        objective = FmuObjective(study, simulator)
        search = Search(study, objective, None, Listeners(progress, recorder, wish), checkpoint)
        status, reason = search.until_stopped()
        simulator.heed = lambda: None  # what follows is short, and the result of the search
        x, cost = search.best
        if not np.isfinite(cost):
            if status == "interrupted":
                raise KeyboardInterrupt
            raise SimulationError(_all_failed(study, search, simulator))
        # a search that was stopped is judged when it is resumed: simulations about the best values may take long
        stopped = status == "interrupted"
        found = _not_judged(study) if stopped else identify_at(study.space, objective, x)
        simulated, start_cost = _compared(study, objective, simulator, x)
        effect = {} if stopped else _step_effect(study, simulator, x, simulated["best"])
        return FmuFit(
            study,
            dict(zip(study.space.names, x.tolist(), strict=True)),
            cost,
            start_cost,
            simulated,
            dict(found),
            effect,
            tuple(search.history),
            search.counts,
            search.simulations,
            dict(search.failures),
            {key.name.lower(): text for key, text in simulator.told.items()},
            status,
            reason,
            search.verdict() if status == "finished" else None,
            search.seconds,
        )


def _not_judged(study: FmuStudy) -> dict[str, dict[str, Any]]:
    """Findings of a search that was stopped: none, by the keys of `identify_at`."""
    none = {"effect": None, "pinned": None, "standard_error": None, "verdict": NOT_JUDGED}
    return {name: dict(none) for name in study.space.names}


def _step_effect(
    study: FmuStudy, simulator: FmuSimulator, best: Floats, simulated: Mapping[str, Floats]
) -> dict[str, float]:
    """Largest change of each data set in tolerances, with half the communication step.

    Parameters
    ----------
    study : FmuStudy
    simulator : FmuSimulator
    best : (d,)
        Best values.
    simulated : mapping of str to (m,)
        Values of each data set with them.
    """
    edges = np.cumsum([len(one.measured) for one in study.data])[:-1]
    finer = np.split(simulator.simulate(study.data, best[None, :], finer=2).values[0], edges)
    return {
        one.name: float(np.max(np.abs(values - simulated[one.name]) / one.tolerances))
        for one, values in zip(study.data, finer, strict=True)
    }


def _compared(
    study: FmuStudy, objective: FmuObjective, simulator: FmuSimulator, best: Floats
) -> tuple[dict[str, dict[str, Floats]], float]:
    """Values of all data with the start values and the best, and the objective of the start values."""
    start = study.space.reference
    values = simulator.simulate(study.data, np.array([start, best])).values
    edges = np.cumsum([len(one.measured) for one in study.data])[:-1]
    simulated = {
        label: {one.name: part for one, part in zip(study.data, np.split(row, edges), strict=True)}
        for label, row in zip(("start", "best"), values, strict=True)
    }
    return simulated, float(objective.costs(start[None, :]).costs[0])


def _all_failed(study: FmuStudy, search: Search, simulator: FmuSimulator) -> str:
    if not search.failures:
        return f"{study.title}: not one candidate satisfied the constraints, so none was simulated; widen the bounds."
    (name, count), total = search.failures.most_common(1)[0], search.failures.total()
    status = FmuStatus[name.upper()]
    told = f" It said: {simulator.told[status]}" if simulator.told.get(status) else ""
    return f"{study.title}: not one of {total} candidates could be simulated; {count} of them: {status.sentence}{told}"
