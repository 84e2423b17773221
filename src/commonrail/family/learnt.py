"""Type of injector that a joint fit has taught: values, and the spread of the next part about them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from commonrail.calibration.injector_type import InjectorType, TypeParameter, TypePart
from commonrail.calibration.study import Study
from commonrail.family.adapt import FLOW
from commonrail.family.fixed import PartValues, fixed_values
from commonrail.family.sharing import OF, Share, Shared
from commonrail.family.spread import FEWEST, over_parts, without_prior
from commonrail.family.study import Family
from commonrail.kinds import Role

__all__ = ["learnt_type"]


def learnt_type(family: Family, joint: Mapping[str, float], errors: Mapping[str, float | None]) -> InjectorType:
    """Type of the joint values: an effective hole diameter is a part's own, and no property of the type.

    Parameters
    ----------
    family : Family
    joint : mapping of str to float
        Joint parameters, SI.
    errors : mapping of str to float or None
        Their standard errors, SI; None where the data do not hold them.
    """
    names = dict.fromkeys(name for study in family.parts.values() for name in study.space.names if name != FLOW)
    parameters = []
    for name in names:
        value, spread, between = _learnt(name, family.shared.get(name, Shared()), family, joint, errors)
        bounds = [p for s in family.parts.values() for p in s.space.parameters if p.name == name]
        lower, upper = min(p.lower for p in bounds), max(p.upper for p in bounds)
        relation = family.shared.get(name, Shared()).share.value
        source = f'joint fit "{family.title}", {relation}'
        own = None if between is None else min(between, spread)
        parameters.append(TypeParameter(name, min(max(value, lower), upper), spread, lower, upper, "F", source, own))
    return InjectorType(
        family.name,
        family.title,
        tuple(parameters),
        tuple(_provenance(family, name) for name in family.parts),
        next(iter(family.parts.values())).injector,
        synthetic=" ".join(dict.fromkeys(s.synthetic for s in family.parts.values() if s.synthetic)),
        fixed=fixed_values([_values(name, study) for name, study in family.parts.items()], names),
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
    prior = next(((own.value, own.sigma) for own in stated if own is not None), None)
    if shared.share is Share.PER_PART:
        own = [f"{name}{OF}{part}" for part in family.parts if f"{name}{OF}{part}" in joint]
        if len(own) == 1:
            return joint[own[0]], errors[own[0]] or widest, None
        errors_of = [math.nan if errors[key] is None else float(errors[key] or 0.0) for key in own]
        values = [without_prior(joint[key], error, prior) for key, error in zip(own, errors_of, strict=True)]
        if sum(math.isfinite(error) for _, error in values) < FEWEST:
            return float(np.mean([joint[key] for key in own])), min(prior[1] if prior else widest, widest), None
        found = over_parts(*np.array(values).T)
        return found.value, min(found.spread, widest) or widest, found.between
    error = errors[name]
    spread = min(math.hypot(widest if error is None else error, shared.spread), widest) or widest
    return joint[name], spread, shared.spread


def _values(name: str, study: Study) -> PartValues:
    return PartValues(name, study.injector.values, study.injector.sources, study.fixed)


def _provenance(family: Family, name: str) -> TypePart:
    study = family.parts[name]
    sources = "; ".join(dict.fromkeys(d.source for d in study.data if d.role is Role.FIT))
    return TypePart(name, sources, {path.name: digest for path, digest in study.files.items()})
