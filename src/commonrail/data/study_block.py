"""Blocks of data sets in a study file, and the context in which they are read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple, cast

from pydantic import AfterValidator, Discriminator, Field, Tag

from commonrail.base.choices import Drive
from commonrail.base.errors import nearest
from commonrail.data.noise import NoiseModel
from commonrail.engine.operating_point import CUT_OFFS, OperatingPoint
from commonrail.engine.plan import reference_density
from commonrail.physics.injector import Injector
from commonrail.physics.meters import Meter
from commonrail.readers.columns import PLAIN, Column, FileForm, FormModel, Sheet, Table
from commonrail.readers.location import Place, Reach
from commonrail.readers.table_sheet import TableSheet
from commonrail.readers.tables import LEAST_SAMPLES, idle_key, open_sheet, take_columns
from commonrail.readers.toml import Unit, fault

LONGEST_NAME = 200


class Context(NamedTuple):
    """Surroundings in which a data set is read."""

    injector: Injector
    time_step: float  # [s]
    reach: Reach  # folders where its files may lie
    at: Place  # of its block in the study file
    meters: Mapping[str, Meter] = {}  # described in the study, by name

    def meter(self, name: str | None) -> Meter | None:
        """Meter that a block names, or None; `InputError` if the study does not describe it."""
        if name is None:
            return None
        if name not in self.meters:
            raise (self.at / "meter").error(
                f'there is no meter "{name}"{nearest(name, self.meters)}; describe it in a table [meters.{name}]',
                code="unknown-name",
            )
        return self.meters[name]

    def path(self, file: str, at: Place, form: FileForm) -> Path:
        """Path of a file that a table names with the key "file".

        `file`: name in the study; `form`: format that the table states. `InputError` if the study may not read from
        that folder, or a key of the format has no effect on this file.
        """
        path = self.reach.path(self.reach.file.parent, file, at / "file")
        if idle := idle_key(form, [path]):
            raise (at / idle[0]).error(idle[1], code="idle-key")
        return path

    def sheet(self, file: str, at: Place, form: FileForm) -> Sheet:
        """File with named columns; see `path` and `open_sheet`. The file opened last is cached."""
        source, last = (self.path(file, at, form), form), self.reach.opened
        if last[:-1] == source:
            return cast(Sheet, last[-1])
        sheet = open_sheet(*source)
        if sheet.independent_columns or isinstance(sheet, TableSheet):  # other sheets can be read only once
            self.reach.opened = (*source, sheet)
        return sheet

    def columns(
        self, file: str, at: Place, columns: Sequence[Column], least: int = LEAST_SAMPLES, form: FileForm = PLAIN
    ) -> Table:
        """Columns of a file; see `sheet` and `read_columns`."""
        return take_columns(self.sheet(file, at, form), columns, least)


def mass_density(injector: Injector, unit: str, point: OperatingPoint) -> float:
    """Density at cylinder pressure [kg/m³] if `unit` is a unit of mass, else NaN: see `DataSet.mass_density`."""
    return reference_density(injector, point) if unit.startswith("kg") else math.nan


def drive_unit(injector: Injector) -> str:
    """Unit of the measured current or voltage that drives the injector; empty for another drive."""
    return {Drive.CURRENT: "A", Drive.VOLTAGE: "V"}.get(injector.variant.drive, "")


def _name(item: str) -> str:
    if not item.isprintable():
        raise fault(f"this must be one line of characters that are printed, not {item!r}", code="bad-name")
    return item


# Name of an object in tables, legends and files.
Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_name)]


class TraceModel(FormModel):
    """A time series from a file, by default the data set's file."""

    column: str
    file: str | None = None
    time: str | None = None
    unit: str | None = None
    time_unit: str | None = None


class PressureModel(TraceModel):
    """A measured pressure, and the cut-off of its low-pass; without one see `record_filter.low_pass`."""

    low_pass: Annotated[float, Unit("Hz"), Field(ge=CUT_OFFS.low, le=CUT_OFFS.high)] | None = None


class DriveModel(TraceModel):
    """A measured drive; `zero_at_rest`: its mean before the first energising is the zero of the sensor."""

    zero_at_rest: bool = False


# A pressure: constant [Pa], or a course.
Course = Annotated[
    Annotated[float, Unit("Pa"), Tag("<value>")] | Annotated[PressureModel, Tag("<trace>")],
    Discriminator(lambda item: "<trace>" if isinstance(item, (dict, TraceModel)) else "<value>"),
]


class DataModel(FormModel):
    """Keys shared by the blocks of all kinds; `selects_rows`: data sets of the kind may share a table."""

    selects_rows: ClassVar[bool] = False

    kind: str
    name: Name
    role: Literal["fit", "validation"]
    file: str
    weight: float = Field(default=1.0, gt=0.0)
    meter: str | None = None
    noise: NoiseModel = NoiseModel()
    source: str = "no source stated"
    synthetic: str = ""
