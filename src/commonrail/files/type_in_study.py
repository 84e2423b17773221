"""A study that names a type: start, prior and bounds of its free parameters, values of the others."""

from __future__ import annotations

from typing import Any

from commonrail.calibration.injector_type import InjectorType, TypeParameter
from commonrail.files.study_models import FixedModel, ParameterModel, PriorModel, StudyModel
from commonrail.files.type_file import load_type
from commonrail.injector.definition import Injector, Source, parameter_quantities
from commonrail.injector.reads import unread_parameters
from commonrail.reading.place import Place
from commonrail.reading.reach import Reach

__all__ = ["read_type", "with_type"]


def read_type(model: StudyModel, reach: Reach, at: Place) -> InjectorType | None:
    """Type that a study names, or None.

    Parameters
    ----------
    model : StudyModel
    reach : Reach
        Folder of the study.
    at : Place
        Of the study.
    """
    if model.type is None:
        return None
    return load_type(reach.path(reach.file.parent, model.type, at / "type"), reach)


def with_type(model: StudyModel, injector: Injector, known: InjectorType | None, at: Place) -> StudyModel:
    """The study with what it takes from its type.

    A free parameter of the type has the type's value as start and prior, unless the study states a start, a prior or a
    reference, and the type's bounds, unless the study states its own. A study without free parameters frees all those
    of the type. What is not free takes the type's value, fixed values included, unless the study fixes it or it was
    measured on the injector.

    Parameters
    ----------
    model : StudyModel
    injector : Injector
        Of the study, before any value is changed.
    known : InjectorType or None
        None leaves the study as it is.
    at : Place
        Of the study.

    Raises
    ------
    InputError
        If the study has no free parameter and no type.
    """
    if known is None:
        if not model.parameter:
            raise (at / "parameter").error("this key is missing; add [[parameter]] tables, or name a type")
        return model
    fixed = {item.name for item in model.fixed}
    offered = {p.name: p for p in known.given_to(injector, fixed)}
    free = model.parameter or [ParameterModel(name=name) for name in offered]
    by_name = known.by_name
    named = [_completed(item, by_name[item.name]) if item.name in by_name else item for item in free]
    own = {item.name for item in free}
    unread = unread_parameters(injector.variant)
    offered = {name: p for name, p in offered.items() if name not in unread}
    values = [_fixed(p.name, p.value, Source(p.mark, p.source)) for name, p in offered.items() if name not in own]
    values += [_fixed(v.name, v.value, v.of_type(known.name)) for v in known.fixed_for(injector, fixed | own | unread)]
    return model.model_copy(update={"parameter": named, "fixed": [*model.fixed, *values]})


def _completed(item: ParameterModel, known: TypeParameter) -> ParameterModel:
    """A free parameter with the prior and the bounds that the study does not state."""
    changes: dict[str, Any] = {}
    if item.prior is None and item.reference is None:
        value, sigma = (_text(number, known.name) for number in (known.value, known.spread))
        changes["prior"] = PriorModel(value=value, sigma=sigma, source=known.source)
        changes |= {"mark": item.mark or known.mark, "source": item.source or known.source}
    if item.below is item.above is item.lower is item.upper is None:
        changes |= {"lower": known.lower, "upper": known.upper}
    return item.model_copy(update=changes)


def _fixed(name: str, value: float, source: Source) -> FixedModel:
    stated = {"name": name, "value": _text(value, name), "mark": source.mark, "source": source.text}
    return FixedModel.model_validate(stated)


def _text(value: float, name: str) -> str | float:
    """Value as a study states it."""
    unit = parameter_quantities()[name].unit
    return value if unit == "1" else f"{value!r} {unit}"
