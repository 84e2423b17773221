"""Fleets from TOML: a study that serves as template, and the table of the injectors with their data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from commonrail.errors import InputError, nearest
from commonrail.files.study_models import StudyModel
from commonrail.fleet.row_supply import RowSupply
from commonrail.fleet.supply import FileSupply, Layout, Supply
from commonrail.reading.faults import read_model
from commonrail.reading.fields import FileModel, Text, Unit
from commonrail.reading.place import Place, located
from commonrail.reading.toml_file import read_toml

__all__ = ["Fleet", "Template", "load_fleet"]


class _FleetModel(FileModel):
    format: Literal["commonrail-fleet/1"]
    title: Text
    note: str = ""
    study: Text
    seed: int = Field(default=1, ge=0)
    files: str | None = None
    rows: str | None = None
    dead_times: str | None = None
    leave_out: list[str] = Field(default=[])
    columns: dict[str, str] = Field(default={})
    attempts: int = Field(default=3, ge=1)
    time_limit: Annotated[float, Unit("s")] = 3600.0


@dataclass(frozen=True)
class Template:
    """The study from which each injector's own is made.

    Attributes
    ----------
    path : Path
    text : str
        The file as given.
    document : mapping
        Its tables.
    model : StudyModel
        The same, checked.
    left_out : tuple of str
        Data sets that are not used.
    """

    path: Path
    text: str
    document: Mapping[str, Any]
    model: StudyModel
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Fleet:
    """Many injectors, each to be calibrated to its own data.

    Attributes
    ----------
    path : Path
    title, note : str
    seed : int
        With an injector's name, the seed of its search.
    template : Template
    supply : Supply
        Names of the injectors and their data.
    attempts : int
        How often an injector is tried whose worker dies or hangs.
    time_limit : float
        Time after which a worker hangs [s].
    """

    path: Path
    title: str
    note: str
    seed: int
    template: Template
    supply: Supply
    attempts: int
    time_limit: float


def load_fleet(path: str | Path) -> Fleet:
    """Read a fleet with its template and its table; the injectors' own files are read later, one by one.

    Parameters
    ----------
    path : str or Path
        TOML file; the paths in it are relative to its folder, those in its table to the table's.

    Raises
    ------
    InputError
        If a file cannot be read, a key or column is unknown, missing or of the wrong kind, an injector stands twice in
        the table, or a data set of the template has no source.
    """
    file = Path(path)
    at = Place(str(file))
    model = read_model(_FleetModel, read_toml(file)[0], at)
    if not model.time_limit > 0.0:
        raise (at / "time_limit").error("this must be greater than zero")
    template = _template(file.parent / model.study, model.leave_out, at)
    return Fleet(
        file,
        model.title,
        model.note,
        model.seed,
        template,
        _supply(file.parent, template, model, at),
        model.attempts,
        model.time_limit,
    )


def _template(path: Path, left_out: Sequence[str], at: Place) -> Template:
    with located(at / "study"):
        tables, text = read_toml(path)
    model = read_model(StudyModel, tables, Place(str(path)))
    if not model.parameter:
        raise Place(str(path), "parameter").error("a template states its free parameters, also where it names a type")
    names = [data.name for data in model.data]
    for name in left_out:
        if name not in names:
            raise (at / "leave_out").error(f'{path} has no data set "{name}"{nearest(name, names)}')
    if not any(data.role == "fit" and data.name not in left_out for data in model.data):
        raise InputError(f"{at}: no data set of {path} with role fit is left; a fleet needs one to fit.")
    return Template(path, text, tables, model, tuple(left_out))


def _supply(folder: Path, template: Template, model: _FleetModel, at: Place) -> Supply:
    if (model.files is None) == (model.rows is None):
        raise at.error(
            'give either files = "injectors.csv", a row for each injector with the names of its files, or '
            'rows = "measurements.csv", in which every row is a sample and names its injector'
        )
    used = [data for data in template.model.data if data.name not in template.left_out]
    layout = Layout(tuple(used), template.left_out, model.columns, at, template.path)
    if model.files is not None:
        if model.dead_times is not None:
            raise (at / "dead_times").error('this key goes with rows; with files the table has a column "… dead times"')
        with located(at / "files"):
            return FileSupply(folder / model.files, layout)
    with located(at / "rows"):
        dead_times = None if model.dead_times is None else folder / model.dead_times
        return RowSupply(folder / (model.rows or ""), layout, dead_times)
