"""Calibration of a foreign FMU: the search of a study, with the model in processes of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from commonrail.base.arguments import function, instance
from commonrail.base.arrays import Floats
from commonrail.base.hooks import hold_interrupts, note
from commonrail.calibration.identifiability import identify_at
from commonrail.calibration.search import Checkpoint, Listeners, Progress, Recorder, Search, SearchResult
from commonrail.plugins.foreign_fmu.data import by_set
from commonrail.plugins.foreign_fmu.fmu import FmuSimulator, open_simulator
from commonrail.plugins.foreign_fmu.study import FmuObjective, FmuStudy

STOPPED = "not judged: the search was stopped"
NOT_JUDGED = {"effect": None, "pinned": None, "standard_error": None, "verdict": STOPPED}  # keys of `identify_at`


@dataclass(frozen=True, kw_only=True)
class FmuFit(SearchResult):
    """Result of a calibration of an FMU: of its search, and what the FMU gives with the start values and the best.

    Attributes
    ----------
    study : FmuStudy
    simulated : mapping of str to mapping of str to (m,) array
        For "start" and "best": values of each data set by its name, NaN where a simulation failed.
    estimates : mapping of str to mapping
        Effect, standard error and verdict of each parameter, as `identify_at` gives them; of a search that was stopped
        the verdict alone says so, and the numbers are None.
    step_effect : mapping of str to float
        Largest change of a value of each data set in tolerances, with the best values and half the communication step;
        NaN where that could not be simulated. Empty if it was stopped.
    messages : mapping of str to str
        The first message of the FMU with each status of failed candidates.
    best, cost, start_cost, history, counts, status, reason, seconds, simulations, failures, convergence, ends
        As in `commonrail.calibration.search.SearchResult`; values are in the units of the FMU.
    """

    study: FmuStudy
    simulated: Mapping[str, Mapping[str, Floats]]
    estimates: Mapping[str, Mapping[str, Any]]
    step_effect: Mapping[str, float]
    messages: Mapping[str, str]


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
    note(f"{study.fmu.path}: the code of this FMU runs with your rights; run none that you do not trust.")
    for sentence in study.notes:
        note(sentence)
    simulator_settings = study.fmu, study.space.names, study.data, study.step, study.time_limit, processes
    with open_simulator(*simulator_settings) as simulator, hold_interrupts() as stop:
        objective = FmuObjective(study, simulator)
        search = Search(study, objective, None, Listeners(progress, recorder, stop), checkpoint)
        simulator.check_stop = lambda: search.check_stop()
        result = search.to_end()
        start, best = study.space.reference, np.array(list(result.best.values()))
        simulated = {label: _simulate(study, simulator, x) for label, x in (("start", start), ("best", best))}
        # a search that was stopped is judged when it is resumed: simulations about the best values may take long
        estimates = {name: dict(NOT_JUDGED) for name in study.space.names}
        effect = {}
        if result.status == "finished":
            estimates = dict(identify_at(study.space, objective, best))
            finer = _simulate(study, simulator, best, finer=2)
            effect = {
                data.name: float(np.max(np.abs(finer[data.name] - simulated["best"][data.name]) / data.tolerances))
                for data in study.data
            }
        messages = {key.name.lower(): text for key, text in simulator.messages.items()}
        return FmuFit(
            study=study, simulated=simulated, estimates=estimates, step_effect=effect, messages=messages, **vars(result)
        )


def _simulate(study: FmuStudy, simulator: FmuSimulator, x: Floats, finer: int = 1) -> dict[str, Floats]:
    """Values of each data set with values of the free parameters (d,), at the communication step or a finer one."""
    parts = by_set(study.data, simulator.simulate(study.data, x[None, :], finer).values[0])
    return {data.name: values_of_set for data, values_of_set in zip(study.data, parts, strict=True)}
