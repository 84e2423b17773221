"""Type of injector: values and spreads learnt from calibrated parts for the next part; its TOML file."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, Field

from commonrail.base.arguments import file_path, instance, instances, number, plain_text, settle
from commonrail.base.errors import ConfigurationError, InputError, nearest
from commonrail.base.output import write_text
from commonrail.base.units import to_text
from commonrail.calibration.parameter import Mark, Prior
from commonrail.calibration.study_file import named_injector
from commonrail.calibration.study_keys import (
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
from commonrail.readers.injector import in_catalogue, load_injector
from commonrail.readers.location import Place, Reach, locate_errors
from commonrail.readers.toml import UNSTATED, FileModel, Text, inline_table, read_model, read_toml, value_text
from commonrail.readers.toml import Mark as MarkField

ROUNDING = 1e-9  # the scatter between parts may exceed the spread by this share


@dataclass(frozen=True)
class TypeParameter:
    """A parameter of a type.

    Parameters
    ----------
    name : str
        Component and field, such as ``valve.mass``.
    value : float
        Expected value of a part of the type, SI.
    spread : float
        Standard deviation of the next part's value about it, SI, greater than zero.
    lower, upper : float
        Bounds of the fits of the parts, SI; they enclose the value.
    mark : {"M", "C", "F", "E"}
        Source mark of value and spread: F if they come from fitted parts.
    source : str
        Source of value and spread.
    between : float or None
        Scatter between parts, SI, which is included in the spread; the rest is the error of the value. None if the two
        are not separated.

    Raises
    ------
    ConfigurationError
        If the parameter is unknown, a number is not finite, the spread is not greater than zero, or the value lies
        outside the bounds.
    """

    name: str
    value: float
    spread: float
    lower: float
    upper: float
    mark: Mark = "F"
    source: str = "no source stated"
    between: float | None = None

    def __post_init__(self) -> None:
        quantities = parameter_quantities()
        if plain_text(self.name, "name of a parameter") not in quantities:
            raise ConfigurationError(f"A type has no parameter {self.name}{nearest(self.name, quantities)}.")
        read = {key: getattr(self, key) for key in ("value", "spread", "lower", "upper")}
        settle(self, **{key: number(x, quantities[self.name].unit, f"{key} of {self.name}") for key, x in read.items()})
        if not self.spread > 0.0:
            raise ConfigurationError(f"{self.name}: a type needs a spread greater than zero.")
        if self.between is not None and not 0.0 <= self.between <= self.spread * (1.0 + ROUNDING):
            raise ConfigurationError(
                f"{self.name}: the scatter between parts must lie between zero and the spread, {self.spread:g}, "
                f"not {self.between:g}."
            )
        if not self.lower <= self.value <= self.upper or self.lower == self.upper:
            raise ConfigurationError(
                f"{self.name}: the value {self.value:g} must lie within its bounds, {self.lower:g} to {self.upper:g}."
            )

    @property
    def prior(self) -> Prior:
        """Prior for the next part's value."""
        return Prior(self.value, self.spread, self.source)


@dataclass(frozen=True)
class FixedValue:
    """A value fixed in the studies of a type's parts; it replaces the injectors' value.

    Parameters
    ----------
    name : str
        Component and field, such as ``valve.lift``.
    value : float
        SI.
    mark : {"M", "C", "F", "E"}
        Mark of the value on the parts of the type.
    source : str

    Raises
    ------
    ConfigurationError
        If the parameter is unknown, or the value lies outside its domain.
    """

    name: str
    value: float
    mark: Mark = "E"
    source: str = "no source stated"

    def __post_init__(self) -> None:
        quantities = parameter_quantities()
        if plain_text(self.name, "name of a parameter") not in quantities:
            raise ConfigurationError(f"A type has no parameter {self.name}{nearest(self.name, quantities)}.")
        settle(self, value=number(self.value, quantities[self.name].unit, self.name))
        if not quantities[self.name].domain.admits(self.value):
            raise ConfigurationError(f"{self.name}: a fixed value must be {quantities[self.name].domain.value}.")

    def source_on_part(self, name: str) -> Source:
        """Return the source of the value on another part, for which a measurement on this part is only an estimate (F).

        `name`: name of the type.
        """
        return Source("F" if self.mark == "M" else self.mark, f'type "{name}": {self.source}')


class TypePart(NamedTuple):
    """A calibrated part, or a fleet, from which a type was learnt.

    Attributes
    ----------
    name : str
    source : str
        Source of its data.
    files : mapping of str to str
        SHA-256 of its files by name: study, data, results.
    injectors : int
        Number of injectors, 1 for a single part.
    """

    name: str
    source: str = "no source stated"
    files: Mapping[str, str] = {}
    injectors: int = 1


@dataclass(frozen=True)
class InjectorType:
    """Values and spreads of the parameters of a type of injector, and the parts from which they were learnt.

    Parameters
    ----------
    name, title : str
    parameters : sequence of TypeParameter
        At least one, each name once.
    parts : sequence of TypePart
    injector : Injector or None
        Injector with the parts' other values; None if unknown.
    synthetic : str
        Note on synthetic data of the parts; empty if all are measured.
    fixed : sequence of FixedValue
        Values fixed in the fits of the parts.

    Raises
    ------
    ConfigurationError
        If the parameters are missing, or one is given twice.
    """

    name: str
    title: str
    parameters: tuple[TypeParameter, ...]
    parts: tuple[TypePart, ...] = ()
    injector: Injector | None = None
    synthetic: str = field(default="", kw_only=True)
    fixed: tuple[FixedValue, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        for what in ("name", "title", "synthetic"):
            plain_text(getattr(self, what), f"{what} of a type")
        settle(self, parameters=instances(self.parameters, TypeParameter, "parameters of a type"))
        settle(self, parts=instances(self.parts, TypePart, "parts of a type"))
        settle(self, fixed=instances(self.fixed, FixedValue, "fixed values of a type"))
        if not self.parameters:
            raise ConfigurationError(f"{self.name}: a type needs at least one parameter.")
        names = [p.name for p in self.parameters] + [value.name for value in self.fixed]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise ConfigurationError(f"{self.name}: {name} is given a second time; keep one of both.")

    @property
    def by_name(self) -> dict[str, TypeParameter]:
        """Parameters by name."""
        return {parameter.name: parameter for parameter in self.parameters}

    def parameters_for(self, injector: Injector, keep: Collection[str] = ()) -> tuple[TypeParameter, ...]:
        """Return the parameters that an injector takes from the type.

        Values measured on the injector (mark M), and values named by `keep`, stay the injector's.
        """
        excluded = self._measured_names(injector).union(keep)
        return tuple(p for p in self.parameters if p.name not in excluded)

    def fixed_values_for(self, injector: Injector, keep: Collection[str] = ()) -> tuple[FixedValue, ...]:
        """Return the fixed values that an injector takes from the type, as in `parameters_for`."""
        excluded = self._measured_names(injector).union(keep)
        return tuple(value for value in self.fixed if value.name not in excluded)

    def _measured_names(self, injector: Injector) -> set[str]:
        """Names of values measured on an injector, except values measured on the type's injector."""
        base = self.injector

        def of_base(name: str) -> bool:
            return (
                base is not None
                and base.values.get(name) == injector.values[name]
                and base.sources.get(name) == injector.sources[name]
            )

        return {name for name, source in injector.sources.items() if source.mark == "M" and not of_base(name)}

    def apply_to(self, injector: Injector, keep: Collection[str] = ()) -> Injector:
        """Return the injector with the values of the type, as in `parameters_for`."""
        type_parameters, fixed = self.parameters_for(injector, keep), self.fixed_values_for(injector, keep)
        sources = {p.name: Source(p.mark, p.source) for p in type_parameters} | {
            v.name: v.source_on_part(self.name) for v in fixed
        }
        changed = injector.with_values({p.name: p.value for p in type_parameters} | {v.name: v.value for v in fixed})
        # the type's text starts with the text of its injector
        texts = (injector.synthetic, self.synthetic.removeprefix(injector.synthetic).strip())
        synthetic = " ".join(text for text in texts if text)
        return replace(changed, sources={**injector.sources, **sources}, synthetic=synthetic)


# Types of injectors from TOML and to TOML.

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
    mark: MarkField = "F"
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
        Permitted folder of the injector's file; by default the type's folder and below, unless the type's file has
        ``allow_outside = true``.

    Raises
    ------
    InputError
        If the file cannot be read, or a key is unknown, missing or of the wrong type.
    ConfigurationError
        If `path` is not a path, or values contradict each other.
    """
    file = file_path(path, "path of a type")
    if file.is_dir() or not (file.suffix or file.exists()):  # a run, or a catalogue name
        raise InputError(f"{file}: a type file is expected; `commonrail type RUN --out TYPE.toml` makes one of a run.")
    at = Place(str(file))
    model = read_model(_TypeModel, read_toml(file)[0], at)
    parameters = []
    for i, item in enumerate(model.parameter):
        with locate_errors((at / "parameter")[i]):
            parameters.append(TypeParameter(**dict(item)))
    fixed = []
    for i, stated in enumerate(model.fixed):
        with locate_errors((at / "fixed")[i]):
            fixed.append(FixedValue(**dict(stated)))
    within = reach or Reach(file, model.allow_outside)
    injector = None if model.injector is None else named_injector(model.injector, file.parent, within, at / "injector")
    with locate_errors(at):
        return InjectorType(
            model.name,
            model.title or model.name,
            tuple(parameters),
            tuple(
                TypePart(part_model.name, part_model.source, part_model.files, part_model.injectors)
                for part_model in model.part
            ),
            injector,
            synthetic=model.synthetic,
            fixed=tuple(fixed),
        )


def dump_type(injector_type: InjectorType, path: str | Path) -> None:
    """Write a type file; `load_type` reads back the same type bit by bit.

    The file names a catalogue injector if all values that are not in the file equal the catalogue. Otherwise the file
    has no injector.

    Parameters
    ----------
    injector_type : InjectorType
    path : str or Path

    Raises
    ------
    OutputError
        If the file cannot be written.
    ConfigurationError
        If an argument has the wrong type.
    """
    instance(injector_type, InjectorType, "type")
    write_text(file_path(path, "path of a type"), type_text(injector_type))


def type_text(injector_type: InjectorType) -> str:
    """Return the text of a type file."""
    head = {"format": FORMAT, "name": injector_type.name, "title": injector_type.title}
    head |= {"synthetic": injector_type.synthetic} if injector_type.synthetic else {}
    if names_injector(injector_type):
        head["injector"] = injector_type.injector.name  # type: ignore[union-attr]
    lines = [f"{key} = {value_text(value)}" for key, value in head.items()]
    for name, items in (
        ("part", map(_part_table, injector_type.parts)),
        ("parameter", map(_parameter_table, injector_type.parameters)),
        ("fixed", map(_fixed_table, injector_type.fixed)),
    ):
        lines += [line for item in items for line in _table_lines(name, item)]
    return "\n".join([*lines, ""])


def names_injector(injector_type: InjectorType) -> bool:
    """Return whether the file names the injector: it equals the catalogue except for the values in the file."""
    injector = injector_type.injector
    if injector is None or not in_catalogue(injector.name):
        return False
    base = load_injector(injector.name)
    stated = {*injector_type.by_name, *(value.name for value in injector_type.fixed)}
    same = all(value == base.values.get(name) for name, value in injector.values.items() if name not in stated)
    return same and injector.variant == base.variant


def _table_lines(name: str, item: dict[str, Any]) -> Iterator[str]:
    """Lines of one table in a list of tables; the item with an empty key becomes a comment after the value."""
    note = item.pop("", "")
    yield from ("", f"[[{name}]]")
    for key, value in item.items():
        text = inline_table(value) if isinstance(value, Mapping) else value_text(value)
        yield f"{key} = {text}" + (f" # {note}" if key == "value" else "")


def _part_table(type_part: TypePart) -> dict[str, Any]:
    table: dict[str, Any] = {"name": type_part.name, "source": type_part.source}
    table |= {"injectors": type_part.injectors} if type_part.injectors != 1 else {}
    return table | ({"files": dict(type_part.files)} if type_part.files else {})


def _fixed_table(fixed: FixedValue) -> dict[str, Any]:
    q = parameter_quantities()[fixed.name]
    value = float(fixed.value) if q.unit == "1" else f"{float(fixed.value)!r} {q.unit}"
    return {"name": fixed.name, "value": value, "mark": fixed.mark, "source": fixed.source, "": q.meaning}


def _parameter_table(parameter: TypeParameter) -> dict[str, Any]:
    q = parameter_quantities()[parameter.name]
    keys = ("value", "spread", "between", "lower", "upper")
    numbers = {key: getattr(parameter, key) for key in keys if getattr(parameter, key) is not None}
    # float(): a NumPy float writes its type into its repr.
    written = {key: float(v) if q.unit == "1" else f"{float(v)!r} {q.unit}" for key, v in numbers.items()}
    note = f"{to_text(parameter.value, q.unit)} ± {to_text(parameter.spread, q.unit)}: {q.meaning}"
    return {"name": parameter.name, **written, "mark": parameter.mark, "source": parameter.source, "": note}


# Study with a type: start, prior and bounds of the free parameters, values of the others.


def with_type(model: StudyModel, injector: Injector, reach: Reach, at: Place) -> StudyModel:
    """Complete a study with the values of its type.

    A free parameter takes its start and prior from the type, unless the study states a start, a prior or a reference.
    It takes its bounds from the type, unless the study states bounds. A study without free parameters frees all
    parameters of the type. All other values, fixed values included, are the type's, unless the study fixes them or they
    were measured on the injector.

    `model`: its `type` is the path of the type's file; `injector`: of the study, with its original values; `at`:
    location of the study.
    """
    injector_type = load_type(reach.path(reach.file.parent, str(model.type), at / "type"), reach)
    fixed = {item.name for item in model.fixed}
    offered = {p.name: p for p in injector_type.parameters_for(injector, fixed)}
    free = model.parameter or [ParameterModel(name=name) for name in offered]
    by_name = injector_type.by_name
    completed_parameters = [
        _complete_parameter(item, by_name[item.name]) if item.name in by_name else item for item in free
    ]
    free_names = {item.name for item in free}
    unread = unread_parameters(injector.variant)
    offered = {name: p for name, p in offered.items() if name not in unread}
    values = [
        _fixed_of_type(p.name, p.value, Source(p.mark, p.source))
        for name, p in offered.items()
        if name not in free_names
    ]
    values += [
        _fixed_of_type(v.name, v.value, v.source_on_part(injector_type.name))
        for v in injector_type.fixed_values_for(injector, fixed | free_names | unread)
    ]
    return model.model_copy(update={"parameter": completed_parameters, "fixed": [*model.fixed, *values]})


def _complete_parameter(item: ParameterModel, type_parameter: TypeParameter) -> ParameterModel:
    """Complete a free parameter with prior and bounds that the study does not state."""
    changes: dict[str, Any] = {}
    if item.prior is None and item.reference is None:
        value, sigma = (_text(number, type_parameter.name) for number in (type_parameter.value, type_parameter.spread))
        changes["prior"] = PriorModel(value=value, sigma=sigma, source=type_parameter.source)
        changes |= {"mark": item.mark or type_parameter.mark, "source": item.source or type_parameter.source}
    if item.below is item.above is item.lower is item.upper is None:
        changes |= {"lower": type_parameter.lower, "upper": type_parameter.upper}
    return item.model_copy(update=changes)


def _fixed_of_type(name: str, value: float, source: Source) -> FixedModel:
    stated = {"name": name, "value": _text(value, name), "mark": source.mark, "source": source.text}
    return FixedModel.model_validate(stated)


def _text(value: float, name: str) -> str | float:
    """Write a value as a study states it."""
    unit = parameter_quantities()[name].unit
    return value if unit == "1" else f"{value!r} {unit}"
