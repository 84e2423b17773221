"""Free parameters that the data pin down, near the best values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.influence import influence_of
from commonrail.arguments import array, instance
from commonrail.calibration.goal import Goal
from commonrail.calibration.objective import Objective
from commonrail.calibration.prior import Priors
from commonrail.calibration.run import Calibration
from commonrail.calibration.space import Space
from commonrail.elementary import norm, product
from commonrail.kinds import Role, of_role
from commonrail.linear import least_squares

Floats = NDArray[np.float64]

STEP = 5e-3  # of the range, to both sides: above the ripple of a PWM drive, below curvature
WIDE = 0.05  # a standard error above this share of the range does not pin a parameter down


class Identified(dict[str, dict[str, Any]]):
    """Findings of each free parameter by name, and in `summary` those of the fit as a whole.

    The summary is that of `Influence.record`; None where the best values could not be simulated.
    """

    summary: dict[str, Any] | None = None


def identify(calibration: Calibration, threads: int | None = None) -> Identified:
    """Effect, standard error and verdict of each free parameter on the fitted data; see `identify_at`."""
    study = calibration.study
    fitted, goal = of_role(study.data, Role.FIT), Goal(study.loss, Priors.of(study.space.parameters))
    objective = Objective(
        study.injector, study.space.names, fitted, study.time_step, threads, goal=goal, same_bits=study.same_bits
    )
    return identify_at(study.space, objective, np.array([calibration.best[name] for name in study.space.names]))


def identify_at(space: Space, objective: Objective, best: Floats) -> Identified:
    """Effect, standard error and verdict of each free parameter on the data of an objective, at a point.

    From the Jacobian J of the residuals with respect to the position in the bounds, and the residual's own
    size s² = |r|²/(N − d): a parameter moved alone has the standard error s/|J_i|, and s/|J_i⊥| once the
    others may readjust, J_i⊥ being the part of J_i that they cannot imitate. With priors, which the effects leave out,
    the standard error is that of data and priors together, see `Influence.errors`. Local and linear: it says nothing
    about other basins.

    Parameters
    ----------
    space : Space
    objective : Objective
    best : (d,)
        The point, SI.

    Returns
    -------
    dict
        Per parameter: "effect" and "pinned", the root-sum-square change of the residuals for a move of 1 % of the
        range, alone and after readjustment; "standard_error" [SI]; "verdict".
    """
    instance(space, Space, "space")
    instance(objective, Objective, "objective")
    best = space.to_unit(array(best, "1", "best values", 1))
    low, high = (
        np.clip(best - STEP * np.eye(space.dimension), 0.0, 1.0),
        np.clip(best + STEP * np.eye(space.dimension), 0.0, 1.0),
    )
    values = objective.residuals(space.from_unit(np.vstack([best, low, high])))
    many = values.shape[1] - len(objective.goal.priors)  # the data's residuals stand before those of the priors
    residuals = values[:, :many]
    own = residuals[0]
    width = np.diag(high - low)
    # SI value per unit of position, which on a logarithmic scale is not the width of the range
    slopes = np.diag(space.from_unit(high) - space.from_unit(low)) / width
    jacobian = _slopes(residuals, width, space.dimension)
    usable = np.all(np.isfinite(jacobian), axis=0)
    spread = np.sqrt(np.sum(own**2) / max(len(own) - space.dimension, 1))
    pulls = _slopes(values[:, many:], width, space.dimension)
    influence = influence_of(own, np.where(usable, jacobian, 0.0), pulls) if np.isfinite(own).all() else None
    found = Identified()
    found.summary = influence.record(space.names) if influence else None
    for i, p in enumerate(space.parameters):
        alone, joint = _leverage(jacobian, usable, i)
        error = spread / joint if joint > 0.0 else np.inf
        if influence and len(objective.goal.priors):
            error = float(influence.errors[i])
        found[p.name] = {
            "effect": 0.01 * alone,
            "pinned": 0.01 * joint,
            "standard_error": float(error * slopes[i]) if np.isfinite(error) else None,
            "verdict": _verdict(spread, alone, joint),
        }
    return found


def _slopes(residuals: Floats, width: Floats, d: int) -> Floats:
    """Jacobian (m, d) of residuals (1 + 2 d, m) at a point, below and above it in each parameter."""
    return np.asarray(((residuals[1 + d :] - residuals[1 : 1 + d]) / width[:, None]).T)


def _leverage(jacobian: Floats, usable: NDArray[np.bool_], i: int) -> tuple[float, float]:
    """|J_i| and |J_i⊥|."""
    if not usable[i]:
        return 0.0, 0.0
    column = jacobian[:, i]
    others = jacobian[:, usable & (np.arange(jacobian.shape[1]) != i)]
    imitation = product(others, least_squares(others, column)[:, None])[:, 0] if others.shape[1] else 0.0
    return norm(column), norm(column - imitation)


def _verdict(spread: float, alone: float, joint: float) -> str:
    if spread <= WIDE * joint:
        return "pinned down"
    if spread <= WIDE * alone:
        return "pinned only in combination"
    return "hardly moved by the data"
