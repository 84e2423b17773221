"""A joint fit as one JSON-able record: what its run folder keeps and the report reads."""

from __future__ import annotations

from typing import Any

from commonrail.base.text import number
from commonrail.calibration.result import data_records, fit_record
from commonrail.physics.injector import parameter_quantities
from commonrail.plugins.family.drawn import FLOW
from commonrail.plugins.family.fit import FamilyFit
from commonrail.plugins.family.study import Shared

KIND = "family"
TEXTS = {"start": "start values", "best": "best member", "mean": "mean of the members"}


def family_record(fit: FamilyFit) -> dict[str, Any]:
    """Record of a joint fit: the type's parameters with each part's values, and the data of each part."""
    return {
        **fit_record(KIND, fit.family, fit),
        "name": fit.family.name,
        "members": [number(cost) for cost in fit.members],
        "parts": _parts(fit),
        "parameters": _parameters(fit),
        "joint": fit.best,
    }


def parts_data(fit: FamilyFit) -> dict[str, list[dict[str, Any]]]:
    """Records of the data sets of each part, with figures of the start, the best member and the mean of the members."""
    studies = fit.family.parts
    return {
        name: data_records(
            studies[name].data,
            {"start": fitted_part.start, "best": fitted_part.scores}
            | ({"mean": fitted_part.mean} if fitted_part.mean else {}),
        )
        for name, fitted_part in fit.parts.items()
    }


def _parts(fit: FamilyFit) -> list[dict[str, Any]]:
    data, studies = parts_data(fit), fit.family.parts
    # effective area of the holes relative to the drawing, where it was fitted
    factors = {
        name: (fitted_part.best[FLOW] / studies[name].injector.values[FLOW]) ** 2
        for name, fitted_part in fit.parts.items()
        if FLOW in fitted_part.best
    }
    return [
        {
            "name": name,
            "title": studies[name].title,
            "injector": fitted_part.injector.name,
            "flow_factor": factors.get(name),
            "best": dict(fitted_part.best),
            "data": data[name],
        }
        for name, fitted_part in fit.parts.items()
    ]


def _parameters(fit: FamilyFit) -> list[dict[str, Any]]:
    quantities = parameter_quantities()
    return [
        {
            "name": p.name,
            "unit": quantities[p.name].unit,
            "meaning": quantities[p.name].meaning,
            "relation": fit.family.shared.get(p.name, Shared()).share.value,
            "value": p.value,
            "spread": p.spread,
            "lower": p.lower,
            "upper": p.upper,
            "mark": p.mark,
            "source": p.source,
            "parts": {name: fitted_part.best.get(p.name) for name, fitted_part in fit.parts.items()},
        }
        for p in fit.injector_type.parameters
    ]
