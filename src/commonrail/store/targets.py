"""Targets of a run's sessions: said where they differ, and whether this one finds the same bits."""

from __future__ import annotations

import numpy as np

from commonrail.calibration.plausibility import Finding
from commonrail.calibration.plausibility.finding import found
from commonrail.calibration.search import Listeners, Search
from commonrail.calibration.study import Study
from commonrail.compile_target import describe, differences
from commonrail.store.journal import Journal
from commonrail.workers.interrupt import Wish

__all__ = ["other_targets"]

CODE = "target"
TRIED = 8  # candidates that are simulated again: one block of the vectorised loop


def other_targets(journal: Journal, study: Study, threads: int | None) -> tuple[Finding, ...]:
    """Warning that a run's results need not be those of a run that was never stopped; none where they are.

    The best candidate so far, and some beside it, are simulated again and compared bit for bit.

    Parameters
    ----------
    journal : Journal
    study : Study
    threads : int or None
    """
    differing = _differences(journal)
    kept, here = _best_again(journal, study, threads)
    if not differing and kept == here:
        return ()
    begun = f"{differing}; " if differing else "the compiler's target is that of the earlier sessions, but "
    best = (
        f"the best candidate has the same objective here, {here!r}, bit for bit, but the last digits of others may "
        "differ"
        if kept == here
        else f"the objective of the best candidate or of one beside it is {here!r} here and was {kept!r}"
    )
    text = f"{begun}{best}: the run need not end as one that was never stopped; resume it where it was begun."
    return (found(CODE, study.title, text),)


def _differences(journal: Journal) -> str:
    """Sessions on other targets than this one, and how they differ."""
    now, said = describe().record, {}
    for number, before in enumerate(journal.targets, 1):
        if (text := differences(before, now)) and text not in said:
            said[text] = "begun" if number == 1 else f"resumed (session {number})"
    return "; ".join(f"{how} with {text}" for text, how in said.items())


def _best_again(journal: Journal, study: Study, threads: int | None) -> tuple[float, float]:
    """Objective of the best candidate in the journal and here; of the first one beside it if only that differs."""
    trials, costs = journal.best_step()
    chosen = np.argsort(np.where(np.isnan(costs), np.inf, costs), kind="stable")[:TRIED]
    chosen = chosen[np.isfinite(costs[chosen])]
    if not len(chosen):
        return 0.0, 0.0
    objective = Search(study, threads, None, Listeners(None, None, Wish())).objective
    again = objective.costs(np.ascontiguousarray(trials[chosen])).costs
    differs = again != costs[chosen]
    which = int(np.argmax(differs))
    return float(costs[chosen][which]), float(again[which])
