"""Joint fit of the parts of a family, and the type that comes of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.identifiability import identify_at
from commonrail.arguments import function, instance, thread_count
from commonrail.calibration.injector_type import InjectorType, TypeParameter, TypePart
from commonrail.calibration.optimisers.registry import row
from commonrail.calibration.prior import Priors
from commonrail.calibration.run import score_all
from commonrail.calibration.search import Progress, steps
from commonrail.errors import SimulationError
from commonrail.family.adapt import FLOW
from commonrail.family.objective import FamilyObjective
from commonrail.family.sharing import OF, Share, Shared
from commonrail.family.spread import FEWEST, over_parts, without_prior
from commonrail.family.study import Family
from commonrail.injector.definition import Injector, Source
from commonrail.kinds import Role, Score

__all__ = ["FamilyFit", "FittedPart", "fit_family"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FittedPart:
    """Result of one part: its injector, its values by parameter [SI], and the score of each of its data sets."""

    injector: Injector
    best: Mapping[str, float]
    scores: tuple[Score, ...]


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
        Single injections simulated.
    """

    family: Family
    parts: Mapping[str, FittedPart]
    injector_type: InjectorType
    joint: Mapping[str, float]
    cost: float
    simulations: int


def fit_family(
    family: Family, *, threads: int | None = None, progress: Callable[[Progress], None] | None = None
) -> FamilyFit:
    """Fit the parts of a family together.

    The search is that of a calibration; its objective is the sum of the parts' squares and of the squared pulls of the
    joint priors. Validation data of the parts are scored and not fitted.

    Parameters
    ----------
    family : Family
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    progress : function of Progress, optional
        Called after every step; its times are not measured here and are 0.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind.
    SimulationError
        If not one candidate could be simulated.
    """
    instance(family, Family, "family")
    function(progress, "progress")
    studies = list(family.parts.values())
    priors = Priors.of(family.space.parameters)
    objective = FamilyObjective(studies, family.sharing, priors, thread_count(threads))
    simulations, before = 0, None
    for begin in row(family.method, family.space, family.seed):
        before = begin(before)
        for step in steps(before, objective):
            simulations += step.simulations
            if progress is not None:
                told = float(before.best.cost), math.nan
                progress(Progress(before.phase, before.steps, before.total, *told, simulations, 0.0))
    assert before is not None  # a row has an optimiser
    x, cost = before.best
    if not np.isfinite(cost):
        raise SimulationError(f"{family.title}: no candidate could be simulated for all parts; check the bounds.")
    parts = {name: _part(family, k, x, threads) for k, name in enumerate(family.parts)}
    found = identify_at(family.space, objective, x)
    errors = {name: found[name]["standard_error"] for name in family.space.names}
    joint = dict(zip(family.space.names, x.tolist(), strict=True))
    return FamilyFit(family, parts, _type(family, joint, errors), joint, cost, simulations)


def _part(family: Family, index: int, x: Floats, threads: int | None) -> FittedPart:
    name, study = list(family.parts.items())[index]
    values = family.sharing.of_part(index, x)
    best = dict(zip(study.space.names, values.tolist(), strict=True))
    note = Source("F", f'fitted together with the other parts of "{family.title}"')
    injector = replace(
        study.injector.with_values(best),
        name=f"{study.injector.name}-{name}",
        sources={**study.injector.sources, **dict.fromkeys(best, note)},
    )
    return FittedPart(injector, best, score_all(study, injector, threads))


def _type(family: Family, joint: Mapping[str, float], errors: Mapping[str, float | None]) -> InjectorType:
    """Type of the joint values: an effective hole diameter is a part's own, and no property of the type."""
    names = dict.fromkeys(name for study in family.parts.values() for name in study.space.names if name != FLOW)
    parameters = []
    for name in names:
        value, spread = _learnt(name, family.shared.get(name, Shared()), family, joint, errors)
        bounds = [p for s in family.parts.values() for p in s.space.parameters if p.name == name]
        lower, upper = min(p.lower for p in bounds), max(p.upper for p in bounds)
        relation = family.shared.get(name, Shared()).share.value
        source = f'joint fit "{family.title}", {relation}'
        parameters.append(TypeParameter(name, min(max(value, lower), upper), spread, lower, upper, "F", source))
    return InjectorType(
        family.name,
        family.title,
        tuple(parameters),
        tuple(_provenance(family, name) for name in family.parts),
        next(iter(family.parts.values())).injector,
        synthetic=" ".join(dict.fromkeys(s.synthetic for s in family.parts.values() if s.synthetic)),
    )


def _learnt(
    name: str, shared: Shared, family: Family, joint: Mapping[str, float], errors: Mapping[str, float | None]
) -> tuple[float, float]:
    """Value and spread of a parameter for the next part."""
    widest = max(
        (p.upper - p.lower) / math.sqrt(12.0)
        for s in family.parts.values()
        for p in s.space.parameters
        if p.name == name
    )
    stated = (p.prior for s in family.parts.values() for p in s.space.parameters if p.name == name)
    prior = next(((own.value, own.sigma) for own in stated if own is not None), None)
    if shared.share is Share.PER_PART:
        own = [f"{name}{OF}{part}" for part in family.parts if f"{name}{OF}{part}" in joint]
        if len(own) == 1:
            return joint[own[0]], errors[own[0]] or widest
        errors_of = [math.nan if errors[key] is None else float(errors[key] or 0.0) for key in own]
        values = [without_prior(joint[key], error, prior) for key, error in zip(own, errors_of, strict=True)]
        if sum(math.isfinite(error) for _, error in values) < FEWEST:
            return float(np.mean([joint[key] for key in own])), min(prior[1] if prior else widest, widest)
        found = over_parts(*np.array(values).T)
        return found.value, min(found.spread, widest) or widest
    error = errors[name]
    return joint[name], min(math.hypot(widest if error is None else error, shared.spread), widest) or widest


def _provenance(family: Family, name: str) -> TypePart:
    study = family.parts[name]
    sources = "; ".join(dict.fromkeys(d.source for d in study.data if d.role is Role.FIT))
    return TypePart(name, sources, {path.name: digest for path, digest in study.files.items()})
