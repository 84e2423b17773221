"""Effects of free parameters near the best values, and assessment of a calibration by the plug-ins of "after_fit"."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np

from commonrail.base import hooks, registry
from commonrail.base.arguments import instance
from commonrail.base.arrays import Bools, Floats
from commonrail.base.choices import Precision
from commonrail.base.errors import PluginError
from commonrail.base.hooks import check_stop
from commonrail.calibration.influence import Influence, around, influence_of
from commonrail.calibration.objective import FitObjective, Goal, Objective
from commonrail.calibration.parameter import Priors
from commonrail.calibration.run import Calibration
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study, objective_of

NORMAL = 1.96  # standard errors in half the width of a 95 % interval
LIMIT = 0.1  # relative half width up to which a parameter is called determined


class ParameterVerdict(StrEnum):
    """Verdict on a parameter, by the width of its interval and what holds it."""

    DETERMINED = "determined"
    COMBINED = "only in combination"
    AT_BOUND = "at a bound"
    CONSTRAINED = "held by a constraint"
    INSENSITIVE = "insensitive"
    NOT_CONFIRMED = "not confirmed"

    @classmethod
    def by_width(cls, half: float, alone: float, value: float, limit: float = LIMIT) -> ParameterVerdict:
        """Verdict from the half width [SI] of an interval; `alone`: half width if all other parameters are known."""
        if half <= limit * abs(value):
            return cls.DETERMINED
        return cls.COMBINED if alone <= limit * abs(value) else cls.INSENSITIVE


class Identified(dict[str, dict[str, Any]]):
    """Results for each free parameter by name.

    `influence` is None where the best values could not be simulated. `sections` are parts of result.json on the whole
    fit. `bands` holds the section "band" of each data set by name. `estimate` holds the most likely values [SI] if they
    replace the values of the search. `draws` (m, d) [SI] are draws of the parameters.
    """

    def __init__(self, influence: Influence | None = None) -> None:
        super().__init__()
        self.influence = influence
        self.sections: dict[str, Any] = {}
        self.bands: dict[str, dict[str, Any]] = {}
        self.estimate: Mapping[str, float] | None = None
        self.draws: Floats | None = None


@dataclass(frozen=True)
class FinishedFit:
    """Finished fit, the argument of each function of the group "after_fit".

    Attributes
    ----------
    calibration : Calibration
    identified : Identified
        Results that the function extends or replaces: verdicts on parameters, sections, bands.
    threads : int or None
        None: all usable processors.
    starts : int
        Starts of further searches.
    shared : dict
        Results that a function passes to later functions, by plug-in name.
    """

    calibration: Calibration
    identified: Identified
    threads: int | None
    starts: int = 1
    shared: dict[str, Any] = field(default_factory=dict)


def plain_objective(study: Study, threads: int | None) -> Objective:
    """Objective of a study's fit data in 64 bits, without screening and conditions."""
    goal = Goal(study.loss, Priors.of(study.space.parameters), scale=study.loss_scale)
    return objective_of(replace(study, precision=Precision.F64), threads, goal)


def identify(calibration: Calibration, threads: int | None = None, *, starts: int = 1) -> Identified:
    """Effect, standard error and verdict of each free parameter on the fitted data, and bands of all data.

    `identify_at` gives the effects; the plug-ins of "after_fit" give standard errors, verdicts and bands. Their bits
    depend on the processor even with `same_bits`. Raises `KeyboardInterrupt` if a stop was requested.
    """
    study = instance(calibration, Calibration, "calibration").study
    objective = plain_objective(study, threads)
    best = np.array([calibration.best[name] for name in study.space.names])
    identified = identify_at(study.space, objective, best)
    if identified.influence:
        fit = FinishedFit(calibration, identified, threads, starts)
        for assessment in registry.entries("after_fit").values():
            check_stop()
            try:
                assessment.call(fit)
            except PluginError as error:  # the other plug-ins still assess the fit
                hooks.note(str(error))
    return identified


def identify_at(space: Space, objective: FitObjective, best: Floats) -> Identified:
    """Effect, standard error and verdict of each free parameter on the data of an objective, at a point (d,) [SI].

    J is the Jacobian of the residuals with respect to the position in the bounds, s² = |r|²/(N − d) the residual
    variance. A parameter moved alone has the standard error s/|J_i|. If the other parameters readjust, the standard
    error is s/|J_i⊥|; J_i⊥ is the part of J_i orthogonal to their columns. Priors reduce the standard error, see
    `Influence.errors`, and do not change the effects. The soft-L1 loss weights the residuals, see
    `Goal.roots_of_weights`. The analysis is local and linear: it says nothing about other optima.

    Returns
    -------
    dict
        Per parameter: "effect" and "pinned", the root-sum-square change of the residuals for a move of 1 % of the
        range, alone and after readjustment; "standard_error" [SI], and "verdict", both of least squares with white
        noise.
    """
    instance(space, Space, "space")
    place = around(space, best)
    values = objective.linearised(place.values)
    many = values.shape[1] - len(objective.goal.priors)  # residuals of the data, then of the priors
    at_best = values[0, :many]
    jacobian = place.slopes(values[:, :many])
    usable = np.all(np.isfinite(jacobian), axis=0)
    spread = np.sqrt(np.sum(at_best**2) / max(len(at_best) - space.dimension, 1))
    pulls = place.slopes(values[:, many:])
    stated = all(data.discrepancy(data.measured) is not None for data in objective.data)  # not in mm³/ms, as curves are
    simulated = np.isfinite(at_best).all()
    influence = influence_of(at_best, np.where(usable, jacobian, 0.0), pulls, stated) if simulated else None
    identified = Identified(influence)
    if influence:
        identified.sections["identifiability"] = influence.record(space.names)
    for i, p in enumerate(space.parameters):
        alone, joint = _leverage(jacobian, usable, i)
        error = spread / joint if joint > 0.0 else np.inf
        if influence and len(objective.goal.priors):
            error = float(influence.errors[i])
        half, single = (NORMAL * abs(spread * place.scale[i]) / c if c > 0.0 else np.inf for c in (joint, alone))
        identified[p.name] = {
            "effect": 0.01 * alone,
            "pinned": 0.01 * joint,
            "standard_error": float(error * place.scale[i]) if np.isfinite(error) else None,
            "verdict": ParameterVerdict.by_width(half, single, best[i]).value,
        }
    return identified


def _leverage(jacobian: Floats, usable: Bools, i: int) -> tuple[float, float]:
    """|J_i| and |J_i⊥|."""
    if not usable[i]:
        return 0.0, 0.0
    column = jacobian[:, i]
    others = jacobian[:, usable & (np.arange(jacobian.shape[1]) != i)]
    rest = column - others @ np.linalg.lstsq(others, column, rcond=None)[0]
    return float(np.linalg.norm(column)), float(np.linalg.norm(rest))
