"""Effects of free parameters near the best values, and, of a calibration, the certainty of each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from commonrail.analysis.certainty.certify import certify
from commonrail.analysis.certainty.verdict import ParameterVerdict
from commonrail.analysis.influence import Influence, influence_of
from commonrail.analysis.neighbourhood import around
from commonrail.analysis.prediction.predict import judged_bands
from commonrail.arguments import instance
from commonrail.arrays import Bools, Floats
from commonrail.calibration.goal import Goal, Loss
from commonrail.calibration.members import equal_ends, fitted_values
from commonrail.calibration.objective import Objective
from commonrail.calibration.prior import Priors
from commonrail.calibration.run import Calibration
from commonrail.calibration.space import Space
from commonrail.elementary import norm, product
from commonrail.kinds import Role, of_role
from commonrail.linear import least_squares

NORMAL = 1.96  # standard errors of half an interval of 95 %


class Identified(dict[str, dict[str, Any]]):
    """Findings of each free parameter by name, and in `summary` those of the fit as a whole.

    The summary is that of `Influence.record`, `influence` what it was made of; None where the best values could not be
    simulated. `bands` are those of `judged_bands`, by the name of the data set; `refits` the record of `refits_of`,
    for the result of a run that has made them. `certainty` is the record of `certify`, from which standard errors and
    verdicts are; empty where a point was judged by `identify_at` alone.
    """

    summary: dict[str, Any] | None = None
    influence: Influence | None = None
    bands: Mapping[str, dict[str, Any]] = {}
    refits: Mapping[str, Any] = {}
    certainty: Mapping[str, Any] = {}


def identify(calibration: Calibration, threads: int | None = None) -> Identified:
    """Effect, standard error and verdict of each free parameter on the fitted data, and bands of all data.

    Standard errors and verdicts are those of the likelihood near the best values, see `certify`; effects are those of
    `identify_at`. With `same_bits` all are those of `identify_at`, and there are no bands; `commonrail certainty` and
    `commonrail predict` compute the others on demand.
    """
    study = calibration.study
    fitted = of_role(study.data, Role.FIT)
    goal = Goal(study.loss, Priors.of(study.space.parameters), scale=study.loss_scale)
    objective = Objective(
        study.injector, study.space.names, fitted, study.time_step, threads, goal=goal, same_bits=study.same_bits
    )
    best = np.array([calibration.best[name] for name in study.space.names])
    found = identify_at(study.space, objective, best)
    if found.influence and not study.same_bits:  # LAPACK, which the likelihood uses, has other bits elsewhere
        certain = certify(study, calibration.best, threads=threads)
        found.bands = judged_bands(study, certain.within, np.array([best, *_others(calibration)]), threads)
        found.certainty = certain.record()
        for one in found.certainty["parameters"]:
            found[one["name"]] |= {key: one[key] for key in ("standard_error", "verdict")}
    return found


def _others(calibration: Calibration) -> list[Floats]:
    """Optima [SI] of the search besides the best that explain the data as well."""
    if calibration.study.loss is not Loss.SQUARES:
        return []
    return [end.x for end in equal_ends(calibration.ends, fitted_values(calibration.study.data))[1:]]


def identify_at(space: Space, objective: Objective, best: Floats) -> Identified:
    """Effect, standard error and verdict of each free parameter on the data of an objective, at a point.

    From the Jacobian J of the residuals with respect to the position in the bounds, and the residual's own
    size s² = |r|²/(N − d): a parameter moved alone has the standard error s/|J_i|, and s/|J_i⊥| once the
    others may readjust, J_i⊥ being the part of J_i that they cannot imitate. With priors, which the effects leave out,
    the standard error is that of data and priors together, see `Influence.errors`. Under the loss soft L1 each residual
    counts with its weight there, see `Goal.roots_of_weights`. Local and linear: it says nothing about other basins.

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
        range, alone and after readjustment; "standard_error" [SI], and "verdict", both of least squares with white
        noise.
    """
    instance(space, Space, "space")
    instance(objective, Objective, "objective")
    place = around(space, best)
    values = objective.linearised(place.values)
    many = values.shape[1] - len(objective.goal.priors)  # the data's residuals stand before those of the priors
    residuals = values[:, :many]
    own = residuals[0]
    jacobian = place.slopes(residuals)
    usable = np.all(np.isfinite(jacobian), axis=0)
    spread = np.sqrt(np.sum(own**2) / max(len(own) - space.dimension, 1))
    pulls = place.slopes(values[:, many:])
    stated = all(data.discrepancy(data.measured) is not None for data in objective.data)  # not in mm³/ms, as curves are
    known = np.where(usable, jacobian, 0.0)
    influence = influence_of(own, known, pulls, stated) if np.isfinite(own).all() else None
    found = Identified()
    found.influence, found.summary = influence, influence.record(space.names) if influence else None
    for i, p in enumerate(space.parameters):
        alone, joint = _leverage(jacobian, usable, i)
        error = spread / joint if joint > 0.0 else np.inf
        if influence and len(objective.goal.priors):
            error = float(influence.errors[i])
        found[p.name] = {
            "effect": 0.01 * alone,
            "pinned": 0.01 * joint,
            "standard_error": float(error * place.scale[i]) if np.isfinite(error) else None,
            "verdict": _verdict(spread * place.scale[i], alone, joint, best[i]),
        }
    return found


def _leverage(jacobian: Floats, usable: Bools, i: int) -> tuple[float, float]:
    """|J_i| and |J_i⊥|."""
    if not usable[i]:
        return 0.0, 0.0
    column = jacobian[:, i]
    others = jacobian[:, usable & (np.arange(jacobian.shape[1]) != i)]
    imitation = product(others, least_squares(others, column)[:, None])[:, 0] if others.shape[1] else 0.0
    return norm(column), norm(column - imitation)


def _verdict(spread: float, alone: float, joint: float, value: float) -> str:
    """Verdict by half the interval relative to the value, as `verdicts_of` has it, for residuals that are white noise.

    Parameters
    ----------
    spread : float
        Scatter of the residuals times the parameter's SI value per position.
    alone, joint : float
        Change of the residuals for the width of the bounds, and the part of it that the others cannot imitate.
    value : float
        Of the parameter [SI].
    """
    half, single = (NORMAL * abs(spread) / change if change > 0.0 else np.inf for change in (joint, alone))
    return ParameterVerdict.by_width(half, single, value).value
