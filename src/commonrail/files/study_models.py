"""Shape of a study file: which keys it has, and of which type each is. Units are read later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from enum import Enum
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from pydantic import AfterValidator, Field, GetCoreSchemaHandler, PlainValidator, create_model
from pydantic_core import PydanticCustomError, core_schema

from commonrail.calibration.optimisers import registry
from commonrail.calibration.optimisers.registry import Registered
from commonrail.engine.lanes import Precision
from commonrail.kinds import KINDS
from commonrail.kinds.reading import DataModel, Name, TableModel, Value

__all__ = [
    "ConstraintsModel",
    "Optimisers",
    "ParameterModel",
    "StudyModel",
    "read_optimisers",
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


def _known_method(name: str) -> str:
    names = [entry.name for entry in registry.REGISTERED]
    if name not in names:
        known = " or ".join(f'"{known}"' for known in names)
        raise PydanticCustomError("kind", 'this must be {known}, not "{name}"', {"known": known, "name": name})
    return name


class Optimisers(NamedTuple):
    """Table of the optimisers: the first one, its settings that are stated, and the refinements after it."""

    chosen: Registered
    settings: dict[str, Any]
    polish: int
    polish_iterations: int


def read_optimisers(table: Any) -> Optimisers:
    """The optimisers that a table states; a setting that is left out keeps its own default."""
    name = table.get("method") if isinstance(table, Mapping) else None
    known = [entry for entry in registry.REGISTERED if name in (entry.name, None)]
    chosen = known[0] if known else registry.REGISTERED[0]
    model = _optimiser_model(chosen.settings)  # type: ignore[arg-type]
    stated = dict(model.model_validate(table if known else {"method": name}))  # an unknown one is its first fault
    polish = {key: stated.pop(key) for key in ("polish", "polish_iterations")}
    kept = {f.name: stated[f.name] for f in fields(chosen.settings) if stated[f.name] is not None}
    return Optimisers(chosen, kept, **polish)


@cache
def _optimiser_model(settings: type[Any]) -> type[TableModel]:
    """The table's keys: a key for each field of an optimiser's settings, and those that all have."""
    types = get_type_hints(settings)
    keys: dict[str, Any] = {
        **{f.name: _setting(types[f.name], f.metadata.get("most")) for f in fields(settings)},
        "polish": (int, Field(default=0, ge=0, le=10_000)),
        "polish_iterations": (int, Field(default=30, ge=1, le=10_000)),
        "method": (Annotated[str, AfterValidator(_known_method)] | None, None),
    }
    return create_model("OptimiserModel", __base__=TableModel, **keys)


def _setting(annotation: Any, most: float | None) -> tuple[Any, Any]:
    """Type and limits of a key, from those of a field of settings."""
    if get_origin(annotation) is tuple:
        items = get_args(annotation)
        return list[items[0]] | None, Field(default=None, min_length=len(items), max_length=len(items))  # type: ignore[valid-type]
    strict = not (isinstance(annotation, type) and issubclass(annotation, Enum))
    return annotation | None, Field(default=None, le=most, strict=strict)


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
    optimiser: Annotated[Optimisers, PlainValidator(read_optimisers)] = Field(
        default_factory=lambda: read_optimisers({})
    )
