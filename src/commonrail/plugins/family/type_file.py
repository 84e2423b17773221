"""Types of injectors from TOML and to TOML: values, spreads, bounds, and the parts that they were learnt from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from commonrail.base.arguments import file_path, instance
from commonrail.base.output import write_text
from commonrail.base.units import to_text
from commonrail.calibration.study_file.keys import (
    MOST_PARAMETERS,
    FixedModel,
    InItsUnit,
    ParameterModel,
    PriorModel,
    StudyModel,
    known_parameter,
)
from commonrail.data.study_block import Name
from commonrail.physics.injector import Injector, Source, parameter_quantities
from commonrail.physics.variants import unread_parameters
from commonrail.plugins.family.injector_type import FixedValue, InjectorType, TypeParameter, TypePart
from commonrail.readers.injector.file import in_catalogue, load_injector
from commonrail.readers.location import Place, Reach, located
from commonrail.readers.toml import UNSTATED, FileModel, Mark, Text, read_model, read_toml

FORMAT = "commonrail-type/1"
MOST_PARTS = 1000


class _PartModel(FileModel):
    name: Name
    source: str = UNSTATED.text
    injectors: int = Field(default=1, ge=1)
    files: dict[str, str] = Field(default={}, max_length=MOST_PARTS)


class _ParameterModel(FileModel):
    name: Annotated[str, AfterValidator(known_parameter)]
    value: InItsUnit
    spread: InItsUnit
    lower: InItsUnit
    upper: InItsUnit
    mark: Mark = "F"
    source: str = UNSTATED.text
    between: InItsUnit | None = None


class _TypeModel(FileModel):
    """The whole file."""

    format: Literal["commonrail-type/1"]
    name: Name
    title: Text | None = None
    synthetic: str = ""
    allow_outside: bool = False
    injector: Text | None = None
    part: list[_PartModel] = Field(default=[], max_length=MOST_PARTS)
    parameter: list[_ParameterModel] = Field(min_length=1, max_length=MOST_PARAMETERS)
    fixed: list[FixedModel] = Field(default=[], max_length=MOST_PARAMETERS)


def load_type(path: str | Path, reach: Reach | None = None) -> InjectorType:
    """Read a type of injector.

    Parameters
    ----------
    path : str or Path
        TOML file, as `dump_type` writes it.
    reach : Reach, optional
        Where the file of its injector may lie; by default in the type's folder or below, unless the type's file says
        ``allow_outside = true``.

    Raises
    ------
    InputError
        If the file cannot be read, or something in it is unknown, missing or of the wrong kind.
    ConfigurationError
        If `path` is no path, or numbers contradict one another.
    """
    file = file_path(path, "path of a type")
    at = Place(str(file))
    model = read_model(_TypeModel, read_toml(file)[0], at)
    parameters = []
    for i, item in enumerate(model.parameter):
        with located((at / "parameter")[i]):
            parameters.append(TypeParameter(**dict(item)))
    fixed = []
    for i, stated in enumerate(model.fixed):
        with located((at / "fixed")[i]):
            fixed.append(FixedValue(**dict(stated)))
    with located(at):
        return InjectorType(
            model.name,
            model.title or model.name,
            tuple(parameters),
            tuple(TypePart(part.name, part.source, part.files, part.injectors) for part in model.part),
            _injector(model, reach or Reach(file, model.allow_outside), file, at / "injector"),
            synthetic=model.synthetic,
            fixed=tuple(fixed),
        )


def _injector(model: _TypeModel, reach: Reach, file: Path, at: Place) -> Injector | None:
    if model.injector is None:
        return None
    if model.injector.endswith(".toml"):
        return load_injector(reach.path(file.parent, model.injector, at), reach)
    with located(at):
        return load_injector(model.injector, reach)


def dump_type(injector_type: InjectorType, path: str | Path) -> None:
    """Write a type, which `load_type` reads back bit by bit.

    Its injector is named if all values but those in the file are the catalogue's; another one is not kept.

    Parameters
    ----------
    injector_type : InjectorType
    path : str or Path

    Raises
    ------
    OutputError
        If the file cannot be written.
    ConfigurationError
        If an argument is of another kind.
    """
    instance(injector_type, InjectorType, "type")
    write_text(file_path(path, "path of a type"), type_text(injector_type))


def type_text(injector_type: InjectorType) -> str:
    """The file's text."""
    import tomlkit  # slow to import

    document = tomlkit.document()
    head = {"format": FORMAT, "name": injector_type.name, "title": injector_type.title}
    head |= {"synthetic": injector_type.synthetic} if injector_type.synthetic else {}
    if names_injector(injector_type):
        head["injector"] = injector_type.injector.name  # type: ignore[union-attr]
    document.update(head)
    document.add("part", _tables([_part(part) for part in injector_type.parts]))
    document.add("parameter", _tables([_parameter(parameter) for parameter in injector_type.parameters]))
    if injector_type.fixed:
        document.add("fixed", _tables([_fixed(value) for value in injector_type.fixed]))
    return tomlkit.dumps(document)


def names_injector(injector_type: InjectorType) -> bool:
    """Return whether the file names the type's injector: it is the catalogue's but for the values in the file."""
    own = injector_type.injector
    if own is None or not in_catalogue(own.name):
        return False
    base = load_injector(own.name)
    stated = {*injector_type.by_name, *(value.name for value in injector_type.fixed)}
    same = all(value == base.values.get(name) for name, value in own.values.items() if name not in stated)
    return same and own.variant == base.variant


def _tables(items: list[dict[str, Any]]) -> Any:
    """List of tables, each with a comment behind its value if it has one."""
    import tomlkit  # slow to import

    tables = tomlkit.aot()
    for item in items:
        table = tomlkit.table()
        note = item.pop("", None)
        table.update(item)
        if note:
            table["value"].comment(note)
        tables.append(table)
    return tables


def _part(part: TypePart) -> dict[str, Any]:
    found: dict[str, Any] = {"name": part.name, "source": part.source}
    found |= {"injectors": part.injectors} if part.injectors != 1 else {}
    return found | ({"files": dict(part.files)} if part.files else {})


def _fixed(fixed: FixedValue) -> dict[str, Any]:
    q = parameter_quantities()[fixed.name]
    value = float(fixed.value) if q.unit == "1" else f"{float(fixed.value)!r} {q.unit}"
    return {"name": fixed.name, "value": value, "mark": fixed.mark, "source": fixed.source, "": q.meaning}


def _parameter(parameter: TypeParameter) -> dict[str, Any]:
    q = parameter_quantities()[parameter.name]
    keys = ("value", "spread", "between", "lower", "upper")
    numbers = {key: getattr(parameter, key) for key in keys if getattr(parameter, key) is not None}
    # float(): a NumPy float writes its type into its repr.
    written = {key: float(v) if q.unit == "1" else f"{float(v)!r} {q.unit}" for key, v in numbers.items()}
    note = f"{to_text(parameter.value, q.unit)} ± {to_text(parameter.spread, q.unit)}: {q.meaning}"
    return {"name": parameter.name, **written, "mark": parameter.mark, "source": parameter.source, "": note}


# A study that names a type: start, prior and bounds of its free parameters, values of the others.


def with_type(model: StudyModel, injector: Injector, reach: Reach, at: Place) -> StudyModel:
    """The study with what it takes from the type that it names.

    A free parameter of the type has the type's value as start and prior, unless the study states a start, a prior or a
    reference, and the type's bounds, unless the study states its own. A study without free parameters frees all those
    of the type. What is not free takes the type's value, fixed values included, unless the study fixes it or it was
    measured on the injector.

    `model`: its `type` is the path of the type's file; `injector`: of the study, before any value is changed; `at`: of
    the study.
    """
    known = load_type(reach.path(reach.file.parent, str(model.type), at / "type"), reach)
    fixed = {item.name for item in model.fixed}
    offered = {p.name: p for p in known.given_to(injector, fixed)}
    free = model.parameter or [ParameterModel(name=name) for name in offered]
    by_name = known.by_name
    named = [_completed(item, by_name[item.name]) if item.name in by_name else item for item in free]
    own = {item.name for item in free}
    unread = unread_parameters(injector.variant)
    offered = {name: p for name, p in offered.items() if name not in unread}
    values = [
        _fixed_of_type(p.name, p.value, Source(p.mark, p.source)) for name, p in offered.items() if name not in own
    ]
    values += [
        _fixed_of_type(v.name, v.value, v.of_type(known.name)) for v in known.fixed_for(injector, fixed | own | unread)
    ]
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


def _fixed_of_type(name: str, value: float, source: Source) -> FixedModel:
    stated = {"name": name, "value": _text(value, name), "mark": source.mark, "source": source.text}
    return FixedModel.model_validate(stated)


def _text(value: float, name: str) -> str | float:
    """Value as a study states it."""
    unit = parameter_quantities()[name].unit
    return value if unit == "1" else f"{value!r} {unit}"
