"""Joint fit of the parts of a family, and the type that comes of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from commonrail.base.arguments import function, instance, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.hooks import hold_interrupts
from commonrail.calibration.identifiability import identify_at
from commonrail.calibration.scoring import mean_of, members_of, score_all
from commonrail.calibration.search import Checkpoint, Listeners, Progress, Recorder, Search, SearchResult
from commonrail.data.base import Role, Score
from commonrail.physics.injector import Injector, Source
from commonrail.plugins.family.drawn import FLOW
from commonrail.plugins.family.from_results import FEWEST, PartValues, fixed_values, over_parts, without_prior
from commonrail.plugins.family.injector_type import InjectorType, TypeParameter, TypePart
from commonrail.plugins.family.study import OF, Family, FamilyObjective, Share, Shared
from commonrail.workers.workers import Workers

# Type of injector that a joint fit has taught: values, and the spread of the next part about them.


def learnt_type(family: Family, joint: Mapping[str, float], errors: Mapping[str, float | None]) -> InjectorType:
    """Type of the joint values [SI]: an effective hole diameter is a part's own, and no property of the type.

    `errors` are the standard errors of the joint parameters [SI], None where the data do not hold them.
    """
    names = dict.fromkeys(name for study in family.parts.values() for name in study.space.names if name != FLOW)
    parameters = []
    for name in names:
        value, spread, between = _learnt(name, family.shared.get(name, Shared()), family, joint, errors)
        bounds = [p for s in family.parts.values() for p in s.space.parameters if p.name == name]
        lower, upper = min(p.lower for p in bounds), max(p.upper for p in bounds)
        relation = family.shared.get(name, Shared()).share.value
        source = f'joint fit "{family.title}", {relation}'
        scatter = None if between is None else min(between, spread)
        parameters.append(
            TypeParameter(name, min(max(value, lower), upper), spread, lower, upper, "F", source, scatter)
        )
    values = [PartValues(name, s.injector.values, s.injector.sources, s.fixed) for name, s in family.parts.items()]
    return InjectorType(
        family.name,
        family.title,
        tuple(parameters),
        tuple(_provenance(family, name) for name in family.parts),
        next(iter(family.parts.values())).injector,
        synthetic=" ".join(dict.fromkeys(s.synthetic for s in family.parts.values() if s.synthetic)),
        fixed=fixed_values(values, names),
    )


def _learnt(
    name: str, shared: Shared, family: Family, joint: Mapping[str, float], errors: Mapping[str, float | None]
) -> tuple[float, float, float | None]:
    """Value and spread of a parameter for the next part, and the scatter between parts where that is known."""
    widest = max(
        (p.upper - p.lower) / math.sqrt(12.0)
        for s in family.parts.values()
        for p in s.space.parameters
        if p.name == name
    )
    stated = (p.prior for s in family.parts.values() for p in s.space.parameters if p.name == name)
    prior = next(((p.value, p.sigma) for p in stated if p is not None), None)
    if shared.share is Share.PER_PART:
        part_parameters = [f"{name}{OF}{part_name}" for part_name in family.parts if f"{name}{OF}{part_name}" in joint]
        if len(part_parameters) == 1:
            return joint[part_parameters[0]], errors[part_parameters[0]] or widest, None
        errors_of = [math.nan if errors[key] is None else float(errors[key] or 0.0) for key in part_parameters]
        values = [
            without_prior(joint[key], error, prior) for key, error in zip(part_parameters, errors_of, strict=True)
        ]
        if sum(math.isfinite(error) for _, error in values) < FEWEST:
            return (
                float(np.mean([joint[key] for key in part_parameters])),
                min(prior[1] if prior else widest, widest),
                None,
            )
        estimate = over_parts(*np.array(values).T)
        return estimate.value, min(estimate.spread, widest) or widest, estimate.between
    error = errors[name]
    spread = min(math.hypot(widest if error is None else error, shared.spread), widest) or widest
    return joint[name], spread, shared.spread


def _provenance(family: Family, name: str) -> TypePart:
    study = family.parts[name]
    sources = "; ".join(dict.fromkeys(d.source for d in study.data if d.role is Role.FIT))
    return TypePart(name, sources, {path.name: digest for path, digest in study.files.items()})


@dataclass(frozen=True)
class FittedPart:
    """Injector of one part, the best values of its free parameters [SI], and the scores of its data sets with these.

    `start` are the scores with the start values, `members` its injectors by each member of the joint fit, the best
    first, and `mean` the scores of the mean of what these predict; empty unless all data are maps and there are several
    members.
    """

    injector: Injector
    best: Mapping[str, float]
    scores: tuple[Score, ...]
    start: tuple[Score, ...] = ()
    members: tuple[Injector, ...] = ()
    mean: tuple[Score, ...] = ()


@dataclass(frozen=True, kw_only=True)
class FamilyFit(SearchResult):
    """Result of a joint fit: of its search (`best` are the joint parameters), and what it makes of the parts.

    `injector_type` is what the parts have taught; `members` are the objectives of the optima whose predictions are
    averaged, the best first.
    """

    family: Family
    parts: Mapping[str, FittedPart]
    injector_type: InjectorType
    members: tuple[float, ...]


def objective_of_parts(family: Family, threads: int | None = None) -> FamilyObjective:
    """Objective of a joint fit, on threads of this process."""
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

    The search is that of a calibration; its objective is the sum of the parts' squares and of the squared residuals of
    the joint priors. Validation data of the parts are scored and not fitted. `family.run.fit_into` does the same and
    keeps every step in a run folder. Arguments and errors are those of `commonrail.calibrate`.
    """
    instance(family, Family, "family")
    function(progress, "progress")
    threads = thread_count(threads)
    objective = objective_of_parts(family, threads)
    with hold_interrupts() as stop:
        search_result = Search(family, objective, workers, Listeners(progress, recorder, stop), checkpoint).to_end()
        objective.use_threads(threads)  # workers' copies share the simulators
        ends = members_of(search_result.ends)
        identified = identify_at(family.space, objective, np.array(list(search_result.best.values())))
        errors = {name: identified[name]["standard_error"] for name in family.space.names}
        return FamilyFit(
            family=family,
            parts={name: _part(family, k, [end.x for end in ends], threads) for k, name in enumerate(family.parts)},
            injector_type=learnt_type(family, search_result.best, errors),
            members=tuple(end.cost for end in ends),
            **vars(search_result),
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
