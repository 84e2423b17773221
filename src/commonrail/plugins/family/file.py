"""A joint fit as one JSON-able record: what its run folder keeps and the report reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from commonrail.base.text import number
from commonrail.calibration.optimisers.registry import registered
from commonrail.calibration.result import CLOCK, data_records
from commonrail.compiler.target import describe, package_versions
from commonrail.physics.injector import parameter_quantities
from commonrail.plugins.family.adapt import FLOW
from commonrail.plugins.family.fit import FamilyFit
from commonrail.plugins.family.study import Shared

SCHEMA, KIND = 1, "family"
TEXTS = {"start": "start values", "best": "best member", "mean": "mean of the members"}


def family_record(fit: FamilyFit) -> dict[str, Any]:
    """Record of a joint fit: the type's parameters with each part's values, and the data of each part."""
    family, entry = fit.family, registered(fit.family.method.evolution)
    return {
        "schema": SCHEMA,
        "kind": KIND,
        "software": package_versions(),
        "target": describe().machine,
        "name": family.name,
        "title": family.title,
        "synthetic": family.synthetic,
        "seed": family.seed,
        "status": fit.status,
        "reason": fit.reason,
        "optimiser": {"method": entry.name if entry else "", **vars(family.method.evolution)},
        "objective": {"start": number(fit.start_cost), "best": number(fit.cost)},
        "members": [number(cost) for cost in fit.members],
        "parts": _parts(fit),
        "parameters": _parameters(fit),
        "joint": dict(fit.joint),
        "evaluations": {**asdict(fit.counts), "injections": fit.simulations, "failures": dict(fit.failures)},
        "generations": [
            {"generation": g.generation, "best": number(g.best), "mean": number(g.mean)} for g in fit.history
        ],
        CLOCK: {"seconds": fit.seconds},
    }


def parts_data(fit: FamilyFit) -> dict[str, list[dict[str, Any]]]:
    """Records of the data sets of each part, with figures of the start, the best member and the mean of the members."""
    studies = fit.family.parts
    return {
        name: data_records(
            studies[name].data,
            {"start": part.start, "best": part.scores} | ({"mean": part.mean} if part.mean else {}),
        )
        for name, part in fit.parts.items()
    }


def _parts(fit: FamilyFit) -> list[dict[str, Any]]:
    data = parts_data(fit)
    return [
        {
            "name": name,
            "title": fit.family.parts[name].title,
            "injector": part.injector.name,
            "flow_factor": _flow_factor(part.best, fit.family.parts[name].injector.values),
            "best": dict(part.best),
            "data": data[name],
        }
        for name, part in fit.parts.items()
    ]


def _flow_factor(best: Mapping[str, float], drawn: Mapping[str, float]) -> float | None:
    """Effective area of the holes relative to the drawing, where it was fitted."""
    return (best[FLOW] / drawn[FLOW]) ** 2 if FLOW in best else None


def _parameters(fit: FamilyFit) -> list[dict[str, Any]]:
    known = parameter_quantities()
    return [
        {
            "name": p.name,
            "unit": known[p.name].unit,
            "meaning": known[p.name].meaning,
            "relation": fit.family.shared.get(p.name, Shared()).share.value,
            "value": p.value,
            "spread": p.spread,
            "lower": p.lower,
            "upper": p.upper,
            "mark": p.mark,
            "source": p.source,
            "parts": {name: part.best.get(p.name) for name, part in fit.parts.items()},
        }
        for p in fit.injector_type.parameters
    ]
