"""Shape of a study file: its keys, with type and unit of each."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo

from commonrail.calibration.optimisers.evolution_settings import MOST_GENERATIONS, MOST_MEMBERS, InitialSampling
from commonrail.calibration.optimisers.treatments import Treatment
from commonrail.choices import Precision
from commonrail.errors import nearest
from commonrail.injector.definition import parameter_quantities
from commonrail.kinds import KINDS
from commonrail.kinds.reading import DataModel, Name
from commonrail.reading.fields import FileModel, Mark, OneOf, Unit, fault

__all__ = [
    "ConstraintsModel",
    "OptimiserModel",
    "ParameterModel",
    "StudyModel",
]

# Far above what anybody calibrates; below what would fill the memory. The loader counts samples and rows.
MOST_SETS = 1000
MOST_PARAMETERS = 1000
MOST_CONSTRAINTS = 1000

_BLOCK = OneOf("kind", {name: kind.model for name, kind in KINDS.items()})


def _parameter(item: str) -> str:
    if item not in (known := parameter_quantities()):
        raise fault(f'there is no parameter "{item}"{nearest(item, known)}')
    return item


def _in_its_unit(item: Any, info: ValidationInfo) -> float:
    """Number in the unit of the parameter; a fault of its name is told before."""
    name = info.data.get("name")
    return Unit(parameter_quantities()[name].unit).read(item) if name else math.nan


def _percent(item: Any) -> float:
    # A bare 50 would be a factor to one reader and percent to another.
    if not isinstance(item, str) or "%" not in item:
        raise fault('write percent with its sign, as in "50 %"')
    return Unit("%").read(item)


def _step(item: Any) -> float | None:
    return None if item == "auto" else Unit("s").read(item)


_Value = Annotated[float, PlainValidator(_in_its_unit)]
_Percent = Annotated[float, PlainValidator(_percent)]


class ParameterModel(FileModel):
    """A parameter to be calibrated: bounds around a reference in percent, Eq. (16), or outright."""

    name: Annotated[str, AfterValidator(_parameter)]
    reference: _Value | None = None
    below: _Percent | None = None
    above: _Percent | None = None
    lower: _Value | None = None
    upper: _Value | None = None
    scale: Literal["linear", "log"] = "linear"
    mark: Mark | None = None
    source: str | None = None


class ConstraintsModel(FileModel):
    """Orderings and other linear inequalities between parameters, Eq. (14), (15)."""

    order: list[str] = Field(default=[], max_length=MOST_CONSTRAINTS)
    linear: list[str] = Field(default=[], max_length=MOST_CONSTRAINTS)


class OptimiserModel(FileModel):
    """Settings of the optimiser; what is left out keeps the paper's value."""

    members: int | None = Field(default=None, le=MOST_MEMBERS)
    generations: int | None = Field(default=None, le=MOST_GENERATIONS)
    crossover: float | None = None
    factor: list[float] | None = Field(default=None, min_length=2, max_length=2)
    treatment: Treatment | None = Field(default=None, strict=False)
    initial: InitialSampling | None = Field(default=None, strict=False)
    redraws: int | None = Field(default=None, le=1000)
    polish: int = Field(default=0, ge=0, le=10_000)
    polish_iterations: int = Field(default=30, ge=1, le=10_000)


class StudyModel(FileModel):
    """The whole file."""

    format: Literal["commonrail-study/1"]
    title: Name
    note: str = ""
    allow_outside: bool = False
    injector: str
    seed: int = Field(default=1, ge=0)
    time_step: Annotated[float | None, PlainValidator(_step)] = None  # "auto": short enough for every candidate
    precision: Precision = Field(default=Precision.F64, strict=False)
    data: list[Annotated[DataModel, _BLOCK]] = Field(min_length=1, max_length=MOST_SETS)
    parameter: list[ParameterModel] = Field(min_length=1, max_length=MOST_PARAMETERS)
    constraints: ConstraintsModel = ConstraintsModel()
    optimiser: OptimiserModel = OptimiserModel()
