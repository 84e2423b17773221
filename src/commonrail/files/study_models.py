"""The shape of a study file: which keys it has, and of which type each is. Units are read later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from enum import Enum
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    create_model,
    model_validator,
)
from pydantic_core import PydanticCustomError

from commonrail.calibration.optimisers import registry
from commonrail.calibration.optimisers.registry import Registered
from commonrail.engine.lanes import Precision
from commonrail.errors import nearest_key

__all__ = [
    "ConstraintsModel",
    "DeadTimesModel",
    "Optimisers",
    "ParameterModel",
    "PulseModel",
    "QuantitiesModel",
    "RateModel",
    "StudyModel",
    "TraceModel",
    "read_optimisers",
]

UNSTATED = "no source stated"

# Far above what anybody calibrates; below what would fill the memory. The loader counts samples and rows.
MOST_SETS = 1000
MOST_PARAMETERS = 1000
MOST_CONSTRAINTS = 1000
LONGEST_NAME = 200


class _TableModel(BaseModel):
    """A table of the file: no key beyond its fields, no type converted in silence."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        for key in data if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                hint = nearest_key(key, cls.model_fields)
                raise PydanticCustomError("unknown_key", 'there is no key "{key}"{hint}', {"key": key, "hint": hint})
        return data


def _value(item: Any) -> str | float:
    if isinstance(item, bool) or not isinstance(item, (str, int, float)):
        raise PydanticCustomError("value", 'must be a text with a unit, such as "160 MPa"')
    return item


def _name(item: str) -> str:
    if not item.isprintable():
        raise PydanticCustomError("value", "must be one line of characters that are printed")
    return item


# What tables, legends and files call something.
Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_name)]

# A number with its unit; a plain number is refused by `units`, unless its unit is 1.
Value = Annotated[str | float, PlainValidator(_value)]


class TraceModel(_TableModel):
    """A course in time from a file, by default that of the data set."""

    column: str
    file: str | None = None
    time: str | None = None
    unit: str | None = None
    time_unit: str | None = None


def _course_form(item: Any) -> str:
    return "<trace>" if isinstance(item, (dict, TraceModel)) else "<value>"


Course = Annotated[
    Annotated[Value, Tag("<value>")] | Annotated[TraceModel, Tag("<trace>")], Discriminator(_course_form)
]


class PulseModel(_TableModel):
    """One energising."""

    start: Value
    duration: Value


class _DataModel(_TableModel):
    name: Name
    role: Literal["fit", "validation"]
    file: str
    weight: float = Field(default=1.0, gt=0.0)
    source: str = UNSTATED
    synthetic: str = ""


class RateModel(_DataModel):
    """An injection curve."""

    kind: Literal["rate"]
    time: str = "time"
    rate: str = "rate"
    time_unit: str | None = None
    rate_unit: str | None = None
    rail_pressure: Course
    cylinder_pressure: Course
    return_pressure: Course
    drive: TraceModel | None = None
    energising_time: Value | None = None
    energisings: list[PulseModel] | None = Field(default=None, min_length=1, max_length=100)
    window: list[Value] | None = Field(default=None, min_length=2, max_length=2)
    sampling: Literal["mean", "centred"] = "mean"
    first_bound: Value | None = None


class DeadTimesModel(_TableModel):
    """Energising times at which a small quantity is reached."""

    file: str
    quantity: Value
    rail_pressure_unit: str | None = None
    energising_time_unit: str | None = None


class QuantitiesModel(_DataModel):
    """A map of quantities per stroke; rail_pressure and energising_time choose rows of it."""

    kind: Literal["quantities"]
    rail_pressure_unit: str | None = None
    energising_time_unit: str | None = None
    quantity_unit: str | None = None
    rail_pressure: list[Value] | None = Field(default=None, min_length=1, max_length=1000)
    energising_time: list[Value] | None = Field(default=None, min_length=1, max_length=1000)
    dead_times: DeadTimesModel | None = None
    cylinder_pressure: Value
    return_pressure: Value
    absolute: Value = "0.15 mm3"
    relative: Value = 0.03


_KINDS = ("rate", "quantities")


def _data_kind(item: Any) -> str | None:
    kind = item.get("kind") if isinstance(item, Mapping) else getattr(item, "kind", None)
    return f"<{kind}>" if kind in _KINDS else None


DataModel = Annotated[
    Annotated[RateModel, Tag("<rate>")] | Annotated[QuantitiesModel, Tag("<quantities>")],
    Discriminator(
        _data_kind,
        custom_error_type="kind",
        custom_error_message='kind must be "rate" or "quantities"',
    ),
]


class ParameterModel(_TableModel):
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


class ConstraintsModel(_TableModel):
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
def _optimiser_model(settings: type[Any]) -> type[_TableModel]:
    """The table's keys: a key for each field of an optimiser's settings, and those that all have."""
    types = get_type_hints(settings)
    keys: dict[str, Any] = {
        **{f.name: _setting(types[f.name], f.metadata.get("most")) for f in fields(settings)},
        "polish": (int, Field(default=0, ge=0, le=10_000)),
        "polish_iterations": (int, Field(default=30, ge=1, le=10_000)),
        "method": (Annotated[str, AfterValidator(_known_method)] | None, None),
    }
    return create_model("OptimiserModel", __base__=_TableModel, **keys)


def _setting(annotation: Any, most: float | None) -> tuple[Any, Any]:
    """Type and limits of a key, from those of a field of settings."""
    if get_origin(annotation) is tuple:
        items = get_args(annotation)
        return list[items[0]] | None, Field(default=None, min_length=len(items), max_length=len(items))  # type: ignore[valid-type]
    strict = not (isinstance(annotation, type) and issubclass(annotation, Enum))
    return annotation | None, Field(default=None, le=most, strict=strict)


AUTO_STEP = "auto"  # short enough for every candidate within the bounds


class StudyModel(_TableModel):
    """The whole file."""

    format: Literal["commonrail-study/1"]
    title: Name
    note: str = ""
    allow_outside: bool = False
    injector: str
    seed: int = Field(default=1, ge=0)
    time_step: Value = AUTO_STEP
    precision: Precision = Field(default=Precision.F64, strict=False)
    data: list[DataModel] = Field(min_length=1, max_length=MOST_SETS)
    parameter: list[ParameterModel] = Field(min_length=1, max_length=MOST_PARAMETERS)
    constraints: ConstraintsModel = ConstraintsModel()
    optimiser: Annotated[Optimisers, PlainValidator(read_optimisers)] = Field(
        default_factory=lambda: read_optimisers({})
    )
