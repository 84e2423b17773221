"""Verdict on the convergence of a search that does not judge itself: restarts that agree, or a collapsed population."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.arrays import Floats
from commonrail.calibration.checkpoint import Generation
from commonrail.calibration.goal import Loss
from commonrail.calibration.optimisers.verdict import AGREEING, ALIKE, SMALL_GAIN, Convergence, noise_of
from commonrail.kinds import DataSet

__all__ = ["LATEST", "judge_population", "judge_restarts", "noise_in"]


ONE_POINT = "the search ended with one point and compared it with no other; refinements (polish = 3) would"
LATEST = 20  # generations over which the gain of one is the mean


def noise_in(cost: float, residuals: int, parameters: int, goal: tuple[Loss, Sequence[DataSet]]) -> float:
    """Change of a study's objective that changes 2 ln L by 1, by the objective's own residual noise (`noise_of`).

    Parameters
    ----------
    cost : float
        Objective of the best.
    residuals, parameters : int
        Numbers of residuals, those of priors included, and of free parameters.
    goal : (Loss, sequence of DataSet)
        Loss and fitted data: J of a curve is a sum of absolute errors.
    """
    loss, data = goal
    absolute = loss is Loss.KINDS and any(one.bounds is not None for one in data)
    return noise_of(cost, residuals, parameters, 2.0 if absolute else 1.0)


def judge_population(costs: Floats, history: Sequence[Generation], noise: float) -> Convergence:
    """Verdict on an evolution: converged if its population has collapsed and its best no longer gains.

    Parameters
    ----------
    costs : (n,)
        Objective of the members.
    history : sequence of Generation
    noise : float
        Change of the objective that changes 2 ln L by 1.
    """
    finite = costs[np.isfinite(costs)]
    if len(finite) < 2:
        why = ONE_POINT if len(costs) == 1 else "fewer than two members could be simulated"
        return Convergence.of(False, why, {"members": len(finite)})
    spread = float(finite.max() - finite.min()) / noise
    past = history[max(len(history) - 1 - LATEST, 0)]
    done = max(history[-1].generation - past.generation, 1)
    gain = (past.best - history[-1].best) / noise / done
    known = len(history) > LATEST and bool(np.isfinite(gain))
    converged = spread <= ALIKE and known and gain <= SMALL_GAIN
    figures = {"members": len(finite), "spread": spread, "gain_per_generation": gain if np.isfinite(gain) else None}
    sentence = (
        f"the members differ by {spread:.2g} of 2 ln L, and the last {done} generations gained {gain:.2g} each; "
        f"{ALIKE} and {SMALL_GAIN} over {LATEST} generations are asked for"
    )
    return Convergence.of(converged, sentence, figures)


def judge_restarts(costs: Floats, noise: float) -> Convergence:
    """Verdict on refinements: converged if enough of them end within `ALIKE` of the best 2 ln L.

    Parameters
    ----------
    costs : (n,)
        Objective of the ends.
    noise : float
        Change of the objective that changes 2 ln L by 1.
    """
    finite = costs[np.isfinite(costs)]
    agreeing = int((finite <= finite.min(initial=np.inf) + ALIKE * noise).sum())
    converged = agreeing >= AGREEING
    sentence = f"{agreeing} of {len(costs)} refinements end within {ALIKE} of the best 2 ln L; {AGREEING} are asked for"
    return Convergence.of(converged, sentence, {"starts": len(costs), "agreeing": agreeing})
