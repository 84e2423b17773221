"""Shape of a study file: which keys it has, and of which type each is. Units are read later."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, GetCoreSchemaHandler
from pydantic_core import core_schema

from commonrail.calibration.optimisers.evolution_settings import MOST_GENERATIONS, MOST_MEMBERS, InitialSampling
from commonrail.calibration.optimisers.treatments import Treatment
from commonrail.engine.lanes import Precision
from commonrail.kinds import KINDS
from commonrail.kinds.reading import DataModel, Name, TableModel, Value

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


class _ByKind:
    """Schema of a data set's block: the model of the kind that it names."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        names = [f'"{name}"' for name in KINDS]
        return core_schema.tagged_union_schema(
            {f"<{name}>": handler.generate_schema(kind.model) for name, kind in KINDS.items()},
            _kind_of,
            custom_error_type="kind",
            custom_error_message=f"kind must be {', '.join(names[:-1])} or {names[-1]}",
        )


def _kind_of(item: Any) -> str | None:
    kind = item.get("kind") if isinstance(item, Mapping) else getattr(item, "kind", None)
    return f"<{kind}>" if isinstance(kind, str) and kind in KINDS else None


class ParameterModel(TableModel):
    """A parameter to be calibrated: bounds around a reference in percent, Eq. (16), or outright."""

    name: str
    reference: Value | None = None
    below: Value | None = None
    above: Value | None = None
    lower: Value | None = None
    upper: Value | None = None
    scale: Literal["linear", "log"] = "linear"
    mark: Literal["M", "C", "F", "E"] | None = None
    source: str | None = None


class ConstraintsModel(TableModel):
    """Orderings and other linear inequalities between parameters, Eq. (14), (15)."""

    order: list[str] = Field(default=[], max_length=MOST_CONSTRAINTS)
    linear: list[str] = Field(default=[], max_length=MOST_CONSTRAINTS)


class OptimiserModel(TableModel):
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


AUTO_STEP = "auto"  # short enough for every candidate within the bounds


class StudyModel(TableModel):
    """The whole file."""

    format: Literal["commonrail-study/1"]
    title: Name
    note: str = ""
    allow_outside: bool = False
    injector: str
    seed: int = Field(default=1, ge=0)
    time_step: Value = AUTO_STEP
    precision: Precision = Field(default=Precision.F64, strict=False)
    data: list[Annotated[DataModel, _ByKind()]] = Field(min_length=1, max_length=MOST_SETS)
    parameter: list[ParameterModel] = Field(min_length=1, max_length=MOST_PARAMETERS)
    constraints: ConstraintsModel = ConstraintsModel()
    optimiser: OptimiserModel = OptimiserModel()
