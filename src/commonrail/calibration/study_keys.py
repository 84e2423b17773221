"""Shape of a study file: its keys, with type and unit of each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from enum import Enum
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo, create_model, model_validator

from commonrail.base.choices import Precision
from commonrail.base.errors import nearest
from commonrail.base.registry import find_shipped
from commonrail.calibration.objective import Loss
from commonrail.calibration.optimisers import registry
from commonrail.calibration.optimisers.base import Registered
from commonrail.calibration.parameter import Wanted
from commonrail.calibration.study import LeaveOut
from commonrail.data.registry import find_kind
from commonrail.data.study_block import DataModel, Name
from commonrail.physics.injector import parameter_quantities
from commonrail.readers.injector import MeterTables
from commonrail.readers.toml import UNSTATED, FileModel, Mark, OneOf, Text, Unit, fault

# Far above what anybody calibrates; below what would fill the memory. The loader counts samples and rows.
MOST_SETS = 1000
MOST_PARAMETERS = 1000
MOST_CONSTRAINTS = 1000
MOST_CONDITIONS = 100
MOST_SEEDS = 100


_BLOCK = OneOf(
    "kind", dict.fromkeys(find_shipped("data")), lambda name: None if (kind := find_kind(name)) is None else kind.model
)


def known_parameter(item: str) -> str:
    """Name of a parameter, or a fault with the nearest one."""
    if item not in (quantities := parameter_quantities()):
        raise fault(f'there is no parameter "{item}"{nearest(item, quantities)}', code="unknown-name")
    return item


def _in_its_unit(item: Any, info: ValidationInfo) -> float:
    """Number in the unit of the parameter; NaN if its name is invalid, which is reported first."""
    name = info.data.get("name")
    return Unit(parameter_quantities()[name].unit).read(item) if name else math.nan


def _percent(item: Any) -> float:
    # A bare 50 would be a factor to one reader and percent to another.
    if not isinstance(item, str) or "%" not in item:
        raise fault('write percent with its sign, as in "50 %"', code="no-percent")
    return Unit("%").read(item)


InItsUnit = Annotated[float, PlainValidator(_in_its_unit)]
_Percent = Annotated[float, PlainValidator(_percent)]


class PriorModel(FileModel):
    """Knowledge of a parameter besides the data: value and standard deviation, each with its unit, and their source."""

    value: str | float
    sigma: str | float
    source: Text


class ConditionModel(FileModel):
    """Behaviour that is wanted at all pairs of rail pressures and energising times."""

    wanted: Wanted = Field(strict=False)
    rail_pressure: list[Annotated[float, Unit("Pa")]] = Field(min_length=1, max_length=MOST_CONDITIONS)
    energising_time: list[Annotated[float, Unit("s")]] = Field(min_length=1, max_length=MOST_CONDITIONS)
    cylinder_pressure: Annotated[float, Unit("Pa")]
    return_pressure: Annotated[float, Unit("Pa")]


class FixedModel(FileModel):
    """A value of the injector that the study changes and does not calibrate."""

    name: Annotated[str, AfterValidator(known_parameter)]
    value: InItsUnit
    mark: Mark = "E"
    source: str = UNSTATED.text


class ParameterModel(FileModel):
    """A parameter to be calibrated: bounds around a reference in percent, Eq. (16), or outright."""

    name: Annotated[str, AfterValidator(known_parameter)]
    start: InItsUnit | None = None
    prior: PriorModel | None = None
    reference: InItsUnit | None = None
    below: _Percent | None = None
    above: _Percent | None = None
    lower: InItsUnit | None = None
    upper: InItsUnit | None = None
    scale: Literal["linear", "log"] = "linear"
    mark: Mark | None = None
    source: str | None = None


class ConstraintsModel(FileModel):
    """Orderings and other linear inequalities between parameters, Eq. (14), (15), and those between products."""

    order: list[str] = Field(default=[], max_length=MOST_CONSTRAINTS)
    linear: list[str] = Field(default=[], max_length=MOST_CONSTRAINTS)
    products: list[str] = Field(default=[], max_length=MOST_CONSTRAINTS)


def _known_method(name: str) -> str:
    if registry.find_optimiser(name) is None:
        choices = " or ".join(f'"{method}"' for method in registry.methods())
        raise fault(
            f'this must be {choices}, not "{name}"; one of another package needs that package installed',
            code="unknown-name",
        )
    return name


class Optimisers(NamedTuple):
    """Table of the optimisers: the first one, its settings that are stated, and the refinements after it."""

    optimiser: Registered
    settings: dict[str, Any]
    polish: int
    polish_iterations: int
    stop_when_converged: bool


def read_optimisers(table: Any) -> Optimisers:
    """The optimisers that a table states; a setting that is left out keeps its own default."""
    name = table.get("method") if isinstance(table, Mapping) else None
    match = registry.find_optimiser(name) if isinstance(name, str) else None
    optimiser = match or registry.REGISTERED[0]
    model = _optimiser_model(optimiser.settings)  # type: ignore[arg-type]
    is_valid = match or name is None
    stated = dict(model.model_validate(table if is_valid else {"method": name}))  # reports an unknown method first
    polish = {key: stated.pop(key) for key in ("polish", "polish_iterations", "stop_when_converged")}
    settings = {f.name: stated[f.name] for f in fields(optimiser.settings) if stated[f.name] is not None}
    return Optimisers(optimiser, settings, **polish)


@cache
def _optimiser_model(settings: type[Any]) -> type[FileModel]:
    """The table's keys: a key for each field of an optimiser's settings, and those that all have."""
    types = get_type_hints(settings)
    keys: dict[str, Any] = {
        **{f.name: _setting(types[f.name], f.metadata.get("most")) for f in fields(settings)},
        "polish": (int, Field(default=0, ge=0, le=10_000)),
        "polish_iterations": (int, Field(default=30, ge=1, le=10_000)),
        "stop_when_converged": (bool, False),
        "method": (Annotated[str, AfterValidator(_known_method)] | None, None),
    }
    return create_model("OptimiserModel", __base__=FileModel, **keys)


def _setting(annotation: Any, most: float | None) -> tuple[Any, Any]:
    """Type and limits of a key, from those of a field of settings."""
    if get_origin(annotation) is tuple:
        items = get_args(annotation)
        return list[items[0]] | None, Field(default=None, min_length=len(items), max_length=len(items))  # type: ignore[valid-type]
    strict = not (isinstance(annotation, type) and issubclass(annotation, Enum))
    return annotation | None, Field(default=None, le=most, strict=strict)


class JudgementModel(FileModel):
    """Further searches that assess the fit: with the next seeds, and with the rows at each value held out in turn."""

    seeds: int = Field(default=0, ge=0, le=MOST_SEEDS)
    leave_out: list[Annotated[LeaveOut, Field(strict=False)]] = Field(default=[], max_length=len(LeaveOut))


def _with_pressures(block: Any, shared: Mapping[str, Any]) -> Any:
    """A block of data, with the bench pressures added for the keys that it has and does not state."""
    name = block.get("kind") if isinstance(block, Mapping) else None
    kind = find_kind(name) if isinstance(name, str) else None
    return {**{key: shared[key] for key in shared if key in kind.model.model_fields}, **block} if kind else block


class StudyModel(FileModel):
    """The whole file."""

    @model_validator(mode="before")
    @classmethod
    def _share_pressures(cls, tables: Any) -> Any:
        shared = {key: tables[key] for key in ("cylinder_pressure", "return_pressure") if key in tables}
        if not shared or not isinstance(tables.get("data"), list):
            return tables
        return {**tables, "data": [_with_pressures(block, shared) for block in tables["data"]]}

    format: Literal["commonrail-study/1"]
    title: Name
    note: str = ""
    author: str = ""
    logo: Text | None = None
    allow_outside: bool = False
    injector: str
    type: Text | None = None
    seed: int = Field(default=1, ge=0)
    # None: "auto", short enough for every candidate
    time_step: Annotated[float | None, PlainValidator(lambda x: None if x == "auto" else Unit("s").read(x))] = None
    precision: Precision = Field(default=Precision.F64, strict=False)
    loss: Loss = Field(default=Loss.KINDS, strict=False)
    loss_scale: Annotated[float, Unit("1")] | None = None
    fixed: list[FixedModel] = Field(default=[], max_length=MOST_PARAMETERS)
    same_bits: bool = False
    cylinder_pressure: Annotated[float, Unit("Pa")] | None = None  # default of the data, as the next
    return_pressure: Annotated[float, Unit("Pa")] | None = None
    judgement: JudgementModel = JudgementModel()
    meters: MeterTables = Field(default_factory=dict)
    data: list[Annotated[DataModel, _BLOCK]] = Field(min_length=1, max_length=MOST_SETS)
    parameter: list[ParameterModel] = Field(default=[], max_length=MOST_PARAMETERS)  # all of the type
    constraints: ConstraintsModel = ConstraintsModel()
    condition: list[ConditionModel] = Field(default=[], max_length=MOST_CONDITIONS)
    optimiser: Annotated[Optimisers, PlainValidator(read_optimisers)] = Field(
        default_factory=lambda: read_optimisers({})
    )
