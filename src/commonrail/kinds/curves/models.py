"""Shape of the block of an injection curve in a study file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from commonrail.kinds.reading import Course, DataModel, DriveModel
from commonrail.reading.fields import FileModel, Unit

__all__ = ["PulseModel", "RateModel", "ShotsModel"]

Time = Annotated[float, Unit("s")]


class PulseModel(FileModel):
    """One energising."""

    start: Time
    duration: Time


class ShotsModel(FileModel):
    """Repeated shots in one long record: how each is found, and the columns that state its operating point.

    `offset` is the time from the trigger's edge to the start of energising; shots whose pressures and times differ by
    less than `same` belong to one operating point.
    """

    trigger: str
    level: str | float | int | None = None
    offset: Time = 0.0
    rail_pressure: str | None = None
    energising_time: str | None = None
    same: Annotated[float, Unit("1"), Field(gt=0.0, lt=1.0)] = 0.02


class RateModel(DataModel):
    """An injection curve, or several of one file: by their names, by rows above them, or as shots of a record."""

    kind: Literal["rate"]
    time: str = "time"
    rate: str = "rate"
    columns: str | None = None
    layout: Literal["columns", "header rows"] = "columns"
    shots: ShotsModel | None = None
    time_unit: str | None = None
    rate_unit: str | None = None
    rail_pressure_unit: str | None = None
    energising_time_unit: str | None = None
    rail_pressure: Course | None = None
    cylinder_pressure: Course
    return_pressure: Course
    drive: DriveModel | None = None
    energising_time: Time | None = None
    energisings: list[PulseModel] | None = Field(default=None, min_length=1, max_length=100)
    time_zero: Time = 0.0
    resample: Annotated[float, Unit("s"), Field(gt=0.0)] | None = None
    window: list[Time] | None = Field(default=None, min_length=2, max_length=2)
    sampling: Literal["mean", "centred"] = "mean"
    first_bound: Time | None = None
