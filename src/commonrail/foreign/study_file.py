"""Studies of foreign FMUs from TOML: model, measured data, free parameters and optimiser."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, PlainValidator

from commonrail.arguments import file_path
from commonrail.calibration.goal import Loss
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.errors import InputError
from commonrail.files.study_file import method_of
from commonrail.files.study_models import MOST_CONSTRAINTS, MOST_PARAMETERS, MOST_SETS, Optimisers, read_optimisers
from commonrail.foreign.data import FmuData, FmuInputs, Setting, fmu_curve, fmu_rows
from commonrail.foreign.fmu import Fmu, FmuVariable, read_fmu
from commonrail.foreign.study import TIME_LIMIT, FmuStudy, free_parameter
from commonrail.kinds import Role
from commonrail.kinds.reading import Name
from commonrail.reading.fields import FileModel, Text, Unit
from commonrail.reading.guarded_file import noting_files
from commonrail.reading.model_file import read_model_file
from commonrail.reading.place import Place, located
from commonrail.reading.reach import Reach
from commonrail.reading.sheet import Column
from commonrail.reading.tables import read_columns
from commonrail.units import parse, parse_difference

__all__ = ["FORMAT", "load_fmu_study"]

FORMAT = "commonrail-fmu-study/1"
MOST_OUTPUTS = 100

_Value = str | float | int | bool
_Settings = dict[str, _Value]
_Columns = dict[str, Text]


class _OutputModel(FileModel):
    variable: Text
    column: Text | None = None
    tolerance: str | float | None = None


class _InputsModel(FileModel):
    file: Text
    time: Text = "time"
    columns: _Columns


class _DataModel(FileModel):
    name: Name
    file: Text
    role: Role = Field(default=Role.FIT, strict=False)
    weight: float = Field(default=1.0, gt=0.0)
    source: str = ""
    synthetic: str = ""
    time: Text = "time"
    stop: Annotated[float, Unit("s")] | None = None
    rows: _Columns = Field(default_factory=dict)
    set: _Settings = Field(default_factory=dict)
    inputs: _InputsModel | None = None
    output: list[_OutputModel] = Field(min_length=1, max_length=MOST_OUTPUTS)


class _ParameterModel(FileModel):
    name: Text
    lower: str | float
    upper: str | float
    start: str | float | None = None
    scale: Literal["linear", "log"] = "linear"


class _StudyModel(FileModel):
    """The whole file."""

    format: Literal["commonrail-fmu-study/1"]
    title: Text
    fmu: Text
    step: Annotated[float, Unit("s")]
    time_limit: Annotated[float, Unit("s")] = TIME_LIMIT
    seed: int = Field(default=1, ge=0)
    note: str = ""
    allow_outside: bool = False
    loss: Loss = Field(default=Loss.SQUARES, strict=False)
    loss_scale: float = Field(default=1.0, gt=0.0)
    set: _Settings = Field(default_factory=dict)
    parameter: list[_ParameterModel] = Field(min_length=1, max_length=MOST_PARAMETERS)
    constraints: list[str] = Field(default=[], max_length=MOST_CONSTRAINTS)
    data: list[_DataModel] = Field(min_length=1, max_length=MOST_SETS)
    optimiser: Annotated[Optimisers, PlainValidator(read_optimisers)] = Field(
        default_factory=lambda: read_optimisers({"polish": 3, "stop_when_converged": True})
    )


class _Reading(NamedTuple):
    """FMU, values that all data set, and the folder that files may lie in."""

    fmu: Fmu
    settings: Mapping[str, Setting]
    reach: Reach


def load_fmu_study(path: str | Path) -> FmuStudy:
    """Read a study of an FMU with all its data.

    Parameters
    ----------
    path : str or Path
        TOML file; the paths in it are relative to its folder.

    Raises
    ------
    InputError
        If a file cannot be read, or something in it is unknown, missing or of the wrong kind.
    ConfigurationError
        If values contradict one another.
    """
    with noting_files() as files:
        study = _study(file_path(path, "path of a study"))
    return replace(study, files=files)


def _study(file: Path) -> FmuStudy:
    model, at, reach, text = read_model_file(_StudyModel, file)
    fmu = read_fmu(reach.path(file.parent, model.fmu, at / "fmu"))
    reading = _Reading(fmu, _settings(model.set, fmu, at / "set"), reach)
    free = [_parameter(one, fmu, (at / "parameter")[i]) for i, one in enumerate(model.parameter)]
    with located(at):
        space = Space(free, model.constraints)
    data = tuple(_data(one, reading, (at / "data")[i]) for i, one in enumerate(model.data))
    method = method_of(model.optimiser, space, at / "optimiser")
    how = model.seed, model.step, model.time_limit, model.loss, model.loss_scale
    with located(at):
        return FmuStudy(model.title, fmu, data, space, method, *how, text=text, note=model.note)


def _parameter(model: _ParameterModel, fmu: Fmu, at: Place) -> Parameter:
    with located(at):
        variable = fmu.number(model.name)
        lower, upper = _number(model.lower, variable), _number(model.upper, variable)
        start = None if model.start is None else _number(model.start, variable)
        return replace(free_parameter(variable, lower, upper, start), scale=model.scale)


def _number(item: str | float, variable: FmuVariable) -> float:
    """Number in the unit of a variable: as it stands, or of a text with its unit."""
    return parse(item, variable.known_unit) if isinstance(item, str) else float(item)


def _difference(item: str | float, variable: FmuVariable) -> float:
    """As `_number`, of a difference: a tolerance of 2 °C is one of 2 K."""
    return parse_difference(item, variable.known_unit) if isinstance(item, str) else float(item)


def _settings(stated: Mapping[str, _Value], fmu: Fmu, at: Place) -> dict[str, Setting]:
    found: dict[str, Setting] = {}
    for name, item in stated.items():
        with located(at / name):
            variable = fmu.adjustable(name)
            is_number = variable.type not in ("Boolean", "String") and not isinstance(item, bool)
            found[name] = _number(item, variable) if is_number else item
    return found


def _data(model: _DataModel, reading: _Reading, at: Place) -> FmuData:
    variables = {}
    for i, one in enumerate(model.output):
        with located((at / "output")[i]):
            if one.variable in variables:
                raise InputError(f"{one.variable} is compared twice; keep one.")
            variables[one.variable] = reading.fmu.number(one.variable)
    columns = {one.variable: _column(one.column or one.variable, variables[one.variable]) for one in model.output}
    more: dict[str, Any] = {
        "tolerance": _tolerances(model, variables, at),
        "inputs": _inputs(model.inputs, reading, at / "inputs"),
        "role": model.role,
        "weight": model.weight,
        "source": model.source,
        "synthetic": model.synthetic,
    }
    settings = {**reading.settings, **_settings(model.set, reading.fmu, at / "set")}
    path = reading.reach.path(reading.reach.file.parent, model.file, at / "file")
    if model.rows or model.stop is not None:
        return _rows(model, reading.fmu, path, columns, settings, more, at)
    time = _time(model.time)
    table = read_columns(path, [time, *columns.values()], 1)
    measured = {name: table.columns[column.name] for name, column in columns.items()}
    with located(at):
        return fmu_curve(model.name, table.columns[model.time], measured, start=settings, **more)


def _rows(
    model: _DataModel,
    fmu: Fmu,
    path: Path,
    columns: Mapping[str, Column],
    settings: Mapping[str, Setting],
    more: Mapping[str, Any],
    at: Place,
) -> FmuData:
    """Values at the end of one simulation for each row."""
    if model.stop is None:
        raise (at / "stop").error('this key is missing; with rows, state the end of each simulation, such as "3 ms"')
    given = {}
    for name, column in model.rows.items():
        with located(at / "rows" / name):
            fmu.adjustable(name)
            given[name] = _column(column, fmu.number(name))
    table = read_columns(path, [*columns.values(), *given.values()], 1)
    count = len(table.rows)
    each: list[dict[str, Setting]] = [
        {**settings, **{name: float(table.columns[column.name][i]) for name, column in given.items()}}
        for i in range(count)
    ]
    measured = {name: table.columns[column.name] for name, column in columns.items()}
    with located(at):
        return fmu_rows(model.name, each, measured, model.stop, **more)


def _column(name: str, variable: FmuVariable) -> Column:
    """Column whose numbers become those of a variable; without a unit they are in that of the FMU."""
    return Column(name, variable.known_unit, otherwise=variable.known_unit)


def _time(name: str) -> Column:
    """Column of times; without a unit they are in seconds, the unit of time in an FMU."""
    return Column(name, "s", increasing=True, otherwise="s")


def _tolerances(model: _DataModel, variables: Mapping[str, FmuVariable], at: Place) -> dict[str, float]:
    found = {}
    for i, one in enumerate(model.output):
        if one.tolerance is not None:
            with located((at / "output")[i] / "tolerance"):
                found[one.variable] = _difference(one.tolerance, variables[one.variable])
                if not found[one.variable] > 0.0:
                    raise InputError("a tolerance must be greater than zero.")
    return found


def _inputs(model: _InputsModel | None, reading: _Reading, at: Place) -> FmuInputs | None:
    if model is None:
        return None
    path = reading.reach.path(reading.reach.file.parent, model.file, at / "file")
    columns = {}
    for name, column in model.columns.items():
        with located(at / "columns" / name):
            columns[name] = _column(column, reading.fmu.number(name))
    table = read_columns(path, [_time(model.time), *columns.values()], 2)
    return FmuInputs(table.columns[model.time], {name: table.columns[one.name] for name, one in columns.items()})
