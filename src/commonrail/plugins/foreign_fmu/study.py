"""Study of a foreign FMU: model, measured data, free parameters and optimiser."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PlainValidator

from commonrail.base.arguments import file_path, mapping, number, positive, settle
from commonrail.base.arrays import Floats
from commonrail.base.declare import Choice, Number, setting, settings
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.input import noting_files
from commonrail.base.units import parse, parse_difference, to_text
from commonrail.calibration.objective import Goal, Loss, Scores
from commonrail.calibration.optimisers.evolution import EvolutionSettings
from commonrail.calibration.parameter import Parameter, Priors
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method
from commonrail.calibration.study_file import method_of
from commonrail.calibration.study_keys import (
    MOST_CONSTRAINTS,
    MOST_PARAMETERS,
    MOST_SETS,
    Optimisers,
    read_optimisers,
)
from commonrail.data.base import Role
from commonrail.data.study_block import Name
from commonrail.plugins.foreign_fmu.data import FmuData, FmuInputs, StartValue, by_set, fmu_curve, fmu_rows
from commonrail.plugins.foreign_fmu.fmu import Fmu, FmuSimulator, FmuStatus, FmuVariable, read_fmu
from commonrail.readers.columns import Column
from commonrail.readers.location import Place, Reach, locate_errors
from commonrail.readers.tables import read_columns
from commonrail.readers.toml import FileModel, Text, Unit, read_model_file

# Notes on a study of an FMU: settings that are allowed but may give wrong results.

_NEAR = 1e-6  # tolerance for rounding of sample spacing, as a share of a step


def _notes_on(fmu: Fmu, data: FmuData, step: float) -> Iterator[str]:
    """Sentences on samples closer together than communication points, and on inputs beyond the FMU's limits."""
    inputs = data.runs[0].inputs  # all simulations of a data set share them
    if closer := _describe_spacing(data.runs[0].times, step):
        yield f"The samples of {data.name} {closer}: outputs are linear between them; lower the step."
    if inputs is None:
        return
    if closer := _describe_spacing(inputs.times, step):
        yield f"The inputs of {data.name} {closer}: inputs are constant between them; lower the step."
    yield from _find_inputs_beyond_limits(fmu, data.name, inputs)


def _describe_spacing(times: Floats, step: float) -> str:
    """Words on times closer together than communication points; empty if they are not."""
    spacing = float(np.median(np.diff(times))) if len(times) > 1 else math.inf
    if spacing >= step * (1.0 - _NEAR):
        return ""
    return f"are {to_text(spacing, 's')} apart, and the communication points {to_text(step, 's')}"


def _find_inputs_beyond_limits(fmu: Fmu, data: str, inputs: FmuInputs) -> Iterator[str]:
    """Sentence on each input whose course leaves the limits stated by the FMU, for example by noise."""
    for name, course in inputs.values.items():
        ends = ((np.min(course), "smallest"), (np.max(course), "largest"))
        sentences = (fmu.outside(name, float(value), f"{data}: the {word} value") for value, word in ends)
        yield from (f"{sentence}." for sentence in sentences if sentence)


TIME_LIMIT = 60.0  # of one simulation [s]; far longer than needed, even on a busy machine
POLISH = 3  # refinements: as many as must agree before a search counts as converged
EXAMPLE = '{"e": (0.5, 0.9)}'


@settings(kw_only=False)
class FmuStudy:
    """A calibration of a foreign FMU, ready to run.

    Raises
    ------
    ConfigurationError
        If an argument has the wrong type, no data set has role fit, two have one name, or a number is out of range.
    InputError
        If the FMU lacks a variable, a variable has the wrong type, or a bound or value is not allowed.
    """

    title: str = setting(words="title of the study")
    fmu: Fmu = setting(words="fmu of the study")
    data: tuple[FmuData, ...] = setting(text="At least one with role fit; different names.")
    space: Space = setting(words="space of the study", text="Free variables of the FMU, in units of the FMU.")
    method: Method = setting(words="method of the study")
    seed: int = setting()
    step: Number = setting(unit="s", read=positive("s"), text="Communication step.")
    time_limit: Number = setting(unit="s", default=TIME_LIMIT, read=positive("s"), text="A longer simulation is ended.")
    loss: Choice[Loss] = setting(default=Loss.SQUARES, text="squares or soft_l1 of the residuals in tolerances.")
    loss_scale: Number = setting(default=1.0, read=positive("1"), text="Residual above which soft L1 grows linearly.")
    files: Mapping[Path, str] = field(default_factory=dict)  # SHA-256 of each file read, the study file first
    text: str = setting(words="text of the study", default="", text="The study file as given.")
    note: str = setting(words="note of the study", default="", text="Free text for the report.")
    as_read: FmuStudy | None = None

    def __post_init__(self) -> None:
        settle(self, files=self.files)
        if self.loss is Loss.KINDS:
            raise ConfigurationError(f'The loss of a study of an FMU is "squares" or "soft_l1", not "{self.loss}".')
        names = [data_set.name for data_set in self.data]
        if len(set(names)) < len(names):
            raise ConfigurationError("Two data sets of the study have one name; rename one.")
        if all(data_set.role is not Role.FIT for data_set in self.data):
            raise ConfigurationError(f"{self.title}: no data set has role fit; give at least one the role fit.")
        self._check_variables()

    @property
    def same_bits(self) -> bool:
        """Return False: the bits of a result depend on the FMU and this machine."""
        return False

    @property
    def synthetic(self) -> str:
        """Synthetic parts of the data, empty if there are none."""
        return " ".join(dict.fromkeys(data_set.synthetic for data_set in self.data if data_set.synthetic))

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on a step coarser than the data, and on inputs beyond the limits of the FMU."""
        return tuple(sentence for data_set in self.data for sentence in _notes_on(self.fmu, data_set, self.step))

    def _refuse_outside(self, name: str, value: float, what: str) -> None:
        if fault := self.fmu.outside(name, value, what):
            raise InputError(f"{self.fmu.path}: {fault}; keep within what the FMU allows.")

    def _check_variables(self) -> None:
        for parameter in self.space.parameters:
            self.fmu.number(parameter.name)
            self.fmu.adjustable(parameter.name)
            self._refuse_outside(parameter.name, parameter.lower, "the lower bound")
            self._refuse_outside(parameter.name, parameter.upper, "the upper bound")
        for run in (run for data_set in self.data for run in data_set.runs):
            for output in run.outputs:
                self.fmu.number(output)
            for name, value in run.start.items():
                self.fmu.adjustable(name)
                if not isinstance(value, (bool, str)):
                    self._refuse_outside(name, value, "the value")
            for name in run.inputs.values if run.inputs else ():
                if self.fmu.number(name).causality != "input":
                    raise ConfigurationError(
                        f"{self.fmu.path}: {name} is not an input and cannot have a course in time."
                    )
            both = [name for name in self.space.names if name in run.start]
            if both:
                raise ConfigurationError(f"{both[0]} is both free and set by the data; keep one.")
            driven = [name for name in self.space.names if run.inputs and name in run.inputs.values]
            if driven:
                raise ConfigurationError(f"{driven[0]} is both free and driven by a measured course; keep one.")


def fmu_study(
    fmu: Fmu | str | Path,
    data: FmuData | Sequence[FmuData],
    *,
    free: Mapping[str, Any],
    step: float,
    method: Method | None = None,
    seed: int = 1,
    title: str = "",
    time_limit: float = TIME_LIMIT,
    loss: Loss = Loss.SQUARES,
) -> FmuStudy:
    """Study of an FMU and measured data, ready for `calibrate_fmu`.

    Parameters
    ----------
    fmu : Fmu or path
    data : FmuData or sequence of FmuData
        At least one with role fit.
    free : mapping of str to (lower, upper)
        Bounds of variables by name, in units of the FMU; the search starts at the FMU's values.
    step : float
        Communication step [s].
    method : Method, optional
        Default: differential evolution and three least-squares refinements, ended at convergence.
    seed : int
    title : str
        By default the model's name.
    time_limit : float
        Of one simulation [s].
    loss : Loss

    Raises
    ------
    ConfigurationError, InputError
        As `FmuStudy` and `read_fmu`.
    """
    model = fmu if isinstance(fmu, Fmu) else read_fmu(fmu)
    data_sets = (data,) if isinstance(data, FmuData) else tuple(data)
    space = Space([_free(model, name, bounds) for name, bounds in mapping(free, "free", EXAMPLE).items()])
    usual = Method(EvolutionSettings(), POLISH, stop_when_converged=True)
    return FmuStudy(title or model.name, model, data_sets, space, method or usual, seed, step, time_limit, loss)


def _free(fmu: Fmu, name: str, bounds: Any) -> Parameter:
    variable = fmu.number(name)
    if not isinstance(bounds, Sequence) or isinstance(bounds, str) or len(bounds) != 2:
        raise ConfigurationError(f"The bounds of {name} must be (lower, upper), not {bounds!r}.")
    lower, upper = (number(value, variable.known_unit, f"bound of {name}") for value in bounds)
    return free_parameter(variable, lower, upper)


def free_parameter(variable: FmuVariable, lower: float, upper: float, start: float | None = None) -> Parameter:
    """Free parameter of a variable, with bounds in the unit of the FMU.

    Default start: the FMU's value, or the middle of the bounds if that is missing or outside.
    """
    fmu_start = _fmu_start(variable)
    inside = fmu_start is not None and lower <= fmu_start <= upper
    source = "start value of the FMU" if inside and start is None else "start value of the study"
    middle = 0.5 * (lower + upper)
    value = start if start is not None else fmu_start if fmu_start is not None and inside else middle
    return Parameter(variable.name, value, lower, upper, variable.unit, mark="E", source=source, signed=True)


def _fmu_start(variable: FmuVariable) -> float | None:
    try:
        start = float(variable.start or "nan")
    except ValueError:
        return None
    return start if math.isfinite(start) else None


# Objective of a study of a foreign FMU.

EXACT = 1e-6  # relative error of a simulation: a floor for solvers of FMUs


class FmuObjective:
    """Σ weight · loss of the residuals in tolerances, over the data with role fit.

    A `FitObjective` whose simulations run in separate processes; numbers are in units of the FMU.
    """

    statuses = FmuStatus

    def __init__(self, study: FmuStudy, simulator: FmuSimulator) -> None:
        self.goal = Goal(study.loss, Priors.of(study.space.parameters), scale=study.loss_scale)
        self.data = tuple(data for data in study.data if data.role is Role.FIT)
        self._fmu = simulator

    @property
    def least_cost(self) -> float:
        """Objective caused by simulation errors alone: smaller differences of the cost have no meaning."""
        sizes = ((d.weight, EXACT * d.measured / d.tolerances) for d in self.data)
        return float(sum(weight * np.sum(size**2) for weight, size in sizes))

    @property
    def injections(self) -> int:
        """Number of simulations for a candidate."""
        return sum(len(data.runs) for data in self.data)

    def why_failed(self, status: FmuStatus) -> str:
        """Sentence on a status, with the first message of the FMU."""
        message = self._fmu.messages.get(status)
        return f"{status.sentence} It said: {message}" if message else status.sentence

    def costs(self, values: Floats) -> Scores:
        """Objective of candidates (n, names); +inf with a status if a simulation failed."""
        residuals, statuses = self._weighted_residuals(values)
        costs = np.sum(residuals**2, axis=1)
        if len(self.goal.priors):
            costs = costs + self.goal.priors.costs(values)
        failed = (statuses != FmuStatus.FMU_OK) | ~np.isfinite(costs)
        statuses = np.where(failed & (statuses == FmuStatus.FMU_OK), FmuStatus.FMU_NOT_FINITE, statuses)
        return Scores(np.where(failed, np.inf, costs), statuses.astype(np.int8), len(values) * self.injections)

    def residuals(self, values: Floats) -> Floats:
        """Residuals (n, all values, then priors); NaN for failed simulations."""
        return np.concatenate([self._weighted_residuals(values)[0], self.goal.priors.residuals(values)], axis=1)

    def screened(self, values: Floats) -> Floats:
        """Residuals as `residuals` returns them: an FMU has no coarser simulation."""
        return self.residuals(values)

    def linearised(self, values: Floats) -> Floats:
        """Residuals for derivatives at the first candidate, see `Objective.linearised`."""
        residuals = self._residuals_of_sets(self._fmu.simulate(self.data, values).values)
        weights = [
            self.goal.roots_of_weights(of_set[0]) if self.goal.bent(of_set) is not of_set else 1.0
            for of_set in residuals
        ]
        parts = [np.sqrt(d.weight) * w * r for d, w, r in zip(self.data, weights, residuals, strict=True)]
        return np.concatenate([*parts, self.goal.priors.residuals(values)], axis=1)

    def _weighted_residuals(self, values: Floats) -> tuple[Floats, NDArray[np.int8]]:
        """Residuals (n, all values) whose squares sum to the loss, and statuses (n,)."""
        simulated = self._fmu.simulate(self.data, values)
        residuals = zip(self.data, self._residuals_of_sets(simulated.values), strict=True)
        return np.concatenate([np.sqrt(d.weight) * self.goal.bent(r) for d, r in residuals], axis=1), simulated.statuses

    def _residuals_of_sets(self, values: Floats) -> list[Floats]:
        """Residuals in tolerances of each data set."""
        return [d.residuals(simulated) for d, simulated in zip(self.data, by_set(self.data, values), strict=True)]


# Studies of foreign FMUs from TOML: model, measured data, free parameters and optimiser.

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
    """FMU, values set for all data, and folder of the files."""

    fmu: Fmu
    settings: Mapping[str, StartValue]
    reach: Reach


def load_fmu_study(path: str | Path) -> FmuStudy:
    """Read a study of an FMU with all its data.

    Parameters
    ----------
    path : str or Path
        TOML file; its paths are relative to its folder.

    Raises
    ------
    InputError
        If a file cannot be read, or something in it is unknown, missing or of the wrong kind.
    ConfigurationError
        If values contradict one another.
    """
    with noting_files() as files:
        study = _study(file_path(path, "path of a study"))
    return replace(study, files=files, as_read=study)


def _study(file: Path) -> FmuStudy:
    model, at, reach, text = read_model_file(_StudyModel, file)
    fmu = read_fmu(reach.path(file.parent, model.fmu, at / "fmu"))
    reading = _Reading(fmu, _settings(model.set, fmu, at / "set"), reach)
    free = [_parameter(block, fmu, (at / "parameter")[i]) for i, block in enumerate(model.parameter)]
    with locate_errors(at):
        space = Space(free, model.constraints)
    data = tuple(_data(block, reading, (at / "data")[i]) for i, block in enumerate(model.data))
    method = method_of(model.optimiser, space, at / "optimiser")
    settings = model.seed, model.step, model.time_limit, model.loss, model.loss_scale
    with locate_errors(at):
        return FmuStudy(model.title, fmu, data, space, method, *settings, text=text, note=model.note)


def _parameter(model: _ParameterModel, fmu: Fmu, at: Place) -> Parameter:
    with locate_errors(at):
        variable = fmu.number(model.name)
        lower, upper = _number(model.lower, variable), _number(model.upper, variable)
        start = None if model.start is None else _number(model.start, variable)
        return replace(free_parameter(variable, lower, upper, start), scale=model.scale)


def _number(item: str | float, variable: FmuVariable, read: Callable[[str, str], float] = parse) -> float:
    """Number in the unit of a variable, from a number or a text with a unit.

    `read`: `parse_difference` for a tolerance, where 2 °C means 2 K.
    """
    return read(item, variable.known_unit) if isinstance(item, str) else float(item)


def _settings(stated: Mapping[str, _Value], fmu: Fmu, at: Place) -> dict[str, StartValue]:
    start_values: dict[str, StartValue] = {}
    for name, item in stated.items():
        with locate_errors(at / name):
            variable = fmu.adjustable(name)
            is_number = variable.type not in ("Boolean", "String") and not isinstance(item, bool)
            start_values[name] = _number(item, variable) if is_number else item
    return start_values


def _data(model: _DataModel, reading: _Reading, at: Place) -> FmuData:
    variables = {}
    for i, output in enumerate(model.output):
        with locate_errors((at / "output")[i]):
            if output.variable in variables:
                raise InputError(f"{output.variable} is compared twice; keep one.")
            variables[output.variable] = reading.fmu.number(output.variable)
    columns = {
        output.variable: _column(output.column or output.variable, variables[output.variable])
        for output in model.output
    }
    more: dict[str, Any] = {
        "tolerance": _tolerances(model, variables, at),
        "inputs": _inputs(model.inputs, reading, at / "inputs"),
        "role": model.role,
        "weight": model.weight,
        "source": model.source,
        "synthetic": model.synthetic,
    }
    reading = reading._replace(settings={**reading.settings, **_settings(model.set, reading.fmu, at / "set")})
    path = reading.reach.path(reading.reach.file.parent, model.file, at / "file")
    if model.rows or model.stop is not None:
        return _rows(model, path, columns, reading, more, at)
    time = _time(model.time)
    table = read_columns(path, [time, *columns.values()], 1)
    measured = {name: table.columns[column.name] for name, column in columns.items()}
    with locate_errors(at):
        return fmu_curve(model.name, table.columns[model.time], measured, start=reading.settings, **more)


def _rows(
    model: _DataModel,
    path: Path,
    columns: Mapping[str, Column],
    reading: _Reading,
    more: Mapping[str, Any],
    at: Place,
) -> FmuData:
    """Data of values at the end of one simulation per row."""
    if model.stop is None:
        raise (at / "stop").error('this key is missing; with rows, state the end of each simulation, such as "3 ms"')
    set_columns = {}
    for name, column in model.rows.items():
        with locate_errors(at / "rows" / name):
            reading.fmu.adjustable(name)
            set_columns[name] = _column(column, reading.fmu.number(name))
    table = read_columns(path, [*columns.values(), *set_columns.values()], 1)
    count = len(table.rows)
    each: list[dict[str, StartValue]] = [
        {**reading.settings, **{name: float(table.columns[column.name][i]) for name, column in set_columns.items()}}
        for i in range(count)
    ]
    measured = {name: table.columns[column.name] for name, column in columns.items()}
    with locate_errors(at):
        return fmu_rows(model.name, each, measured, model.stop, **more)


def _column(name: str, variable: FmuVariable) -> Column:
    """Column with values of a variable; the default unit is the FMU's."""
    return Column(name, variable.known_unit, otherwise=variable.known_unit)


def _time(name: str) -> Column:
    """Column of times; the default unit is the second, as in FMUs."""
    return Column(name, "s", increasing=True, otherwise="s")


def _tolerances(model: _DataModel, variables: Mapping[str, FmuVariable], at: Place) -> dict[str, float]:
    tolerances = {}
    for i, output in enumerate(model.output):
        if output.tolerance is not None:
            with locate_errors((at / "output")[i] / "tolerance"):
                tolerances[output.variable] = _number(output.tolerance, variables[output.variable], parse_difference)
                if not tolerances[output.variable] > 0.0:
                    raise InputError("a tolerance must be greater than zero.")
    return tolerances


def _inputs(model: _InputsModel | None, reading: _Reading, at: Place) -> FmuInputs | None:
    if model is None:
        return None
    path = reading.reach.path(reading.reach.file.parent, model.file, at / "file")
    columns = {}
    for name, column in model.columns.items():
        with locate_errors(at / "columns" / name):
            columns[name] = _column(column, reading.fmu.number(name))
    table = read_columns(path, [_time(model.time), *columns.values()], 2)
    return FmuInputs(
        table.columns[model.time], {name: table.columns[input_column.name] for name, input_column in columns.items()}
    )
