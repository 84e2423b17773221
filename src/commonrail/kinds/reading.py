"""Reading of a data set: shape of its block in a study file, and what a reader gives to a kind of data.

The shapes say which keys there are and of which type each is; units are read later.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, PlainValidator, Tag, model_validator
from pydantic_core import PydanticCustomError

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import reference_density
from commonrail.errors import InputError, nearest_key
from commonrail.injector.definition import Injector
from commonrail.injector.variants import Drive

__all__ = [
    "LEAST_SAMPLES",
    "Columns",
    "Context",
    "Course",
    "DataModel",
    "Name",
    "Place",
    "TableModel",
    "TraceModel",
    "Value",
    "drive_unit",
    "mass_density",
]

Floats = NDArray[np.float64]

LEAST_SAMPLES = 4
LONGEST_NAME = 200


class Place(Protocol):
    """Key in a file, for messages; ``place / "key"`` goes into a table, ``place[0]`` into a list."""

    def __truediv__(self, key: str, /) -> Place: ...
    def __getitem__(self, index: int, /) -> Place: ...
    def error(self, sentence: str, /) -> InputError:
        """Error that opens with this place."""


class Columns(Protocol):
    """Columns of a file: SI values, SI unit and given unit of each, and lines of the rows; see `files.tables.Table`."""

    @property
    def path(self) -> Path: ...
    @property
    def columns(self) -> dict[str, Floats]: ...
    @property
    def units(self) -> dict[str, str]: ...
    @property
    def given(self) -> dict[str, str]: ...
    @property
    def lines(self) -> NDArray[np.intp]: ...
    def cell(self, column: str, row: int) -> str:
        """Place of a value, for messages."""


class Context(Protocol):
    """Surroundings in which a data set is read; time step in s."""

    @property
    def injector(self) -> Injector: ...
    @property
    def time_step(self) -> float: ...

    def columns(
        self,
        file: str,
        at: Place,
        wanted: Mapping[str, str | tuple[str, ...]],
        *,
        stated: Mapping[str, str | None],
        increasing: str = "",
        least: int = LEAST_SAMPLES,
    ) -> Columns:
        """Named columns of a file that the block at `at` names; see `files.tables.read_columns`."""

    def located(self, at: Place | str) -> AbstractContextManager[None]:
        """Put the place before the message of any error of the project raised inside."""


def mass_density(injector: Injector, unit: str, point: OperatingPoint) -> float:
    """Density at cylinder pressure [kg/m³] where `unit` is one of mass, else NaN: see `DataSet.mass_density`."""
    return reference_density(injector, point) if unit.startswith("kg") else math.nan


def drive_unit(injector: Injector) -> str:
    """Unit of a measured drive: current or voltage as the injector is driven, empty if by neither."""
    return {Drive.CURRENT: "A", Drive.VOLTAGE: "V"}.get(injector.variant.drive, "")


class TableModel(BaseModel):
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


class TraceModel(TableModel):
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


class DataModel(TableModel):
    """Keys that the blocks of all kinds have; `selects_rows`: data sets of the kind may share a table."""

    selects_rows: ClassVar[bool] = False

    kind: str
    name: Name
    role: Literal["fit", "validation"]
    file: str
    weight: float = Field(default=1.0, gt=0.0)
    source: str = "no source stated"
    synthetic: str = ""

    @property
    def has_dead_times(self) -> bool:
        """True if a second file has dead times."""
        return False
