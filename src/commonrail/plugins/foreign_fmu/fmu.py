"""Foreign FMU: description, unpacked files, and simulation in separate processes."""

from __future__ import annotations

import functools
import io
import math
import os
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arguments import file_path, settle
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError, nearest
from commonrail.base.input import read_plain, sha256
from commonrail.base.units import compatible
from commonrail.plugins.foreign_fmu.data import FmuData, Run, StartValue
from commonrail.workers.pool import USUAL
from commonrail.workers.task import Answer, Lost, Task, pack
from commonrail.workers.workers import Workers

INSTALL = "FMUs are read with FMPy; install it with: pip install 'commonrail[fmi]'"
REAL = ("Real", "Float64", "Float32")  # types that can be calibrated and compared
LARGEST_CONTENT = 2_000_000_000  # [bytes] of an unpacked FMU
LARGEST_DESCRIPTION = 30_000_000  # [bytes] of a description with about 100,000 variables; reading it takes 0.6 GB
DESCRIPTION = "modelDescription.xml"


class FmuVariable(NamedTuple):
    """Scalar variable, in the words of the standard; `unit` ("1" if absent) and `start` as in the FMU.

    `settable`: a value can be set before the initialization; `lower` and `upper`: limits stated by the FMU, else
    infinite.
    """

    name: str
    causality: str
    variability: str
    type: str
    unit: str
    start: str | None
    settable: bool
    description: str
    lower: float = -math.inf
    upper: float = math.inf

    @property
    def known_unit(self) -> str:
        """Unit if commonrail can convert it, else "1": numbers are then used unchanged."""
        try:
            return self.unit if compatible(self.unit, self.unit) else "1"
        except InputError:
            return "1"


@dataclass(frozen=True)
class Fmu:
    """FMU for co-simulation, version 2.0 or 3.0: file with SHA-256, model and variables."""

    path: Path
    digest: str
    name: str
    version: str
    variables: Mapping[str, FmuVariable]
    content: bytes = field(repr=False)

    def __post_init__(self) -> None:
        settle(self, variables=self.variables)

    def variable(self, name: str) -> FmuVariable:
        """Variable of a name; `InputError` with the nearest name if it is unknown."""
        if name not in self.variables:
            raise InputError(f'{self.path}: the FMU has no variable "{name}"{nearest(name, self.variables)}.')
        return self.variables[name]

    def number(self, name: str) -> FmuVariable:
        """Variable of real type; `InputError` for another type."""
        variable = self.variable(name)
        if variable.type not in REAL:
            raise InputError(f"{self.path}: {name} is of type {variable.type}; a real number is expected.")
        return variable

    def outside(self, name: str, value: float, what: str) -> str:
        """Sentence on a value outside the limits stated by the FMU; empty if it is inside.

        `name`: of the variable; `value`: in the unit of the FMU; `what`: words for the value.
        """
        variable = self.variable(name)
        if variable.lower <= value <= variable.upper:
            return ""
        beyond, limit = (
            ("below the min", variable.lower) if value < variable.lower else ("above the max", variable.upper)
        )
        stated = _in_unit(limit, variable)
        return f"{what} of {name}, {_in_unit(value, variable)}, lies {beyond} stated by the FMU, {stated}"

    def adjustable(self, name: str) -> FmuVariable:
        """Variable that can be set before the initialization; `InputError` for another."""
        variable = self.variable(name)
        if not variable.settable:
            raise InputError(
                f"{self.path}: {name} cannot be set (causality {variable.causality}, "
                f"variability {variable.variability}); "
                "name a parameter or an input."
            )
        return variable


def read_fmu(path: str | Path) -> Fmu:
    """Read the description of an FMU without loading its binaries.

    `InputError` if it is not an FMU 2.0 or 3.0 for co-simulation, lacks a binary for this machine, has two variables of
    one name, or FMPy is not installed.
    """
    file = file_path(path, "path of an FMU")
    content = read_plain(file)
    fmpy = fmpy_or_error()
    try:
        names = _names(content)  # first: refuses a large archive before it is unpacked
        description = fmpy.read_model_description(io.BytesIO(content), validate=False)
    except Exception as error:  # FMPy and lxml raise many types
        raise InputError(f"{file}: this cannot be read as an FMU ({_short(error)}).") from error
    if not description.fmiVersion.startswith(("2.", "3.")):
        raise InputError(f"{file}: the FMU has version {description.fmiVersion}; 2.0 or 3.0 is expected.")
    if description.coSimulation is None:
        raise InputError(f"{file}: the FMU is not for co-simulation; export it for co-simulation.")
    _check_binary(file, names, description.coSimulation.modelIdentifier, fmpy)
    name_counts = Counter(variable.name for variable in description.modelVariables)
    if len(name_counts) < len(description.modelVariables):
        raise InputError(
            f"{file}: {name_counts.most_common(1)[0][0]} is the name of more than one variable, which the standard "
            "forbids; export the FMU again with different names."
        )
    variables = {
        variable.name: _variable(variable) for variable in description.modelVariables if not variable.dimensions
    }
    return Fmu(file, sha256(content), description.modelName, description.fmiVersion, variables, content)


def fmpy_or_error() -> Any:
    """FMPy; `InputError` if it is not installed."""
    try:
        import fmpy
    except ImportError as error:
        raise InputError(f"{INSTALL}.") from error
    return fmpy


def _names(content: bytes) -> list[str]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
        if size > LARGEST_CONTENT:
            raise ValueError(f"unpacked it has {size / 1e6:.0f} MB, more than {LARGEST_CONTENT / 1e6:g} MB")
        described = archive.getinfo(DESCRIPTION).file_size
        if described > LARGEST_DESCRIPTION:
            limit = LARGEST_DESCRIPTION / 1e6
            raise ValueError(f"unpacked its {DESCRIPTION} has {described / 1e6:.0f} MB, more than {limit:g} MB")
        return archive.namelist()


def _check_binary(file: Path, names: list[str], model: str, fmpy: Any) -> None:
    accepted_names = [
        f"binaries/{folder}/{model}{fmpy.sharedLibraryExtension}" for folder in (fmpy.platform, fmpy.platform_tuple)
    ]
    if not any(name in names for name in accepted_names):
        platforms = sorted(
            {name.split("/")[1] for name in names if name.startswith("binaries/") and name.count("/") > 1}
        )
        raise InputError(
            f"{file}: the FMU has no binary {model}{fmpy.sharedLibraryExtension} for this machine ({fmpy.platform}), "
            f"only folders for {', '.join(platforms) or 'none'}; "
            "export it for this platform too, or compile its sources with `fmpy compile`."
        )


def _variable(description: Any) -> FmuVariable:
    unit = description.unit or (description.declaredType.unit if description.declaredType is not None else None)
    settable = description.causality == "input" or (
        description.variability != "constant" and description.initial in ("exact", "approx")
    )
    start = None if description.start is None else str(description.start)
    return FmuVariable(
        name=description.name,
        causality=description.causality,
        variability=description.variability,
        type=description.type,
        unit=unit or "1",
        start=start,
        settable=settable,
        description=description.description or "",
        lower=_limit(description, "min", -math.inf),
        upper=_limit(description, "max", math.inf),
    )


def _limit(description: Any, which: str, otherwise: float) -> float:
    """Limit of a variable, as stated for it or for its type."""
    stated = getattr(description, which, None)
    if stated is None and description.declaredType is not None:
        stated = getattr(description.declaredType, which, None)
    try:
        return otherwise if stated is None else float(stated)
    except ValueError:
        return otherwise


def _in_unit(value: float, variable: FmuVariable) -> str:
    return f"{value:g}" if variable.unit == "1" else f"{value:g} {variable.unit}"


def _short(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


@contextmanager
def unpack(fmu: Fmu) -> Iterator[Path]:
    """Folder with the unpacked files of an FMU, removed at the end; `InputError` if unpacking fails."""
    with tempfile.TemporaryDirectory(prefix="commonrail-fmu-", ignore_cleanup_errors=True) as temporary:
        folder = Path(temporary)
        try:
            fmpy_or_error().extract(io.BytesIO(fmu.content), unzipdir=folder)
        except InputError:
            raise
        except Exception as error:  # of zipfile and FMPy
            raise InputError(f"{fmu.path}: the FMU cannot be unpacked ({_short(error)}).") from error
        yield folder


# Status of a simulation of a foreign FMU; its sentence says what to do.


class FmuStatus(IntEnum):
    """Outcome of one candidate. All but `FMU_OK` cost +inf: a failed candidate never wins.

    The numbers differ from `commonrail.engine.status.Status`, since journals hold both.
    """

    FMU_OK = 0
    FMU_NOT_STARTED = 64
    FMU_DISCARDED = 65
    FMU_ERROR = 66
    FMU_FATAL = 67
    FMU_NOT_FINITE = 68
    FMU_ENDED_EARLY = 69
    FMU_TOO_LONG = 70
    FMU_CRASHED = 71

    @property
    def sentence(self) -> str:
        """Event and cure in one sentence."""
        return _SENTENCES[self]


_SENTENCES = {
    FmuStatus.FMU_OK: "The simulation succeeded.",
    FmuStatus.FMU_NOT_STARTED: (
        "The FMU could not be loaded or instantiated; check its platform, its token and the libraries it needs."
    ),
    FmuStatus.FMU_DISCARDED: (
        'The FMU ended a call with the status "discard"; take a shorter communication step or narrow the bounds.'
    ),
    FmuStatus.FMU_ERROR: 'The FMU ended a call with the status "error"; narrow the bounds, or correct a start value.',
    FmuStatus.FMU_FATAL: 'The FMU ended a call with the status "fatal"; narrow the bounds, or ask the FMU\'s maker.',
    FmuStatus.FMU_NOT_FINITE: "An output of the FMU is not finite; narrow the bounds or shorten the step.",
    FmuStatus.FMU_ENDED_EARLY: "The FMU ended its simulation before the last measured time; narrow the bounds.",
    FmuStatus.FMU_TOO_LONG: (
        "The FMU did not answer within the time limit, and its process was ended; raise time_limit or narrow bounds."
    ),
    FmuStatus.FMU_CRASHED: (
        "The FMU's binary ended its process; narrow the bounds, or ask the FMU's maker. Other candidates went on."
    ),
}


# Simulation of a foreign FMU in a separate process, where it cannot harm the search.

FATAL_EXIT = 71  # exit code of a process whose FMU must not be called again
LONGEST = 300  # characters of a message
DISCARD, ERROR = 2, 3  # statuses of the standard
_STATUSES = {DISCARD: FmuStatus.FMU_DISCARDED, ERROR: FmuStatus.FMU_ERROR}
_Outcome = tuple[Floats | None, FmuStatus, str]
_NEAR = 1e-6  # tolerance of the end time for rounding, as a share of a communication step


class Asked(NamedTuple):
    """Task: number of the run, values of the calibrated variables, and number of substeps per communication step."""

    number: int
    values: tuple[float, ...]
    finer: int = 1


class Answered(NamedTuple):
    """Result of a run: values (n,), NaN if it failed, status, and message of the FMU."""

    values: Floats
    status: int
    message: str


@dataclass(frozen=True)
class FmuWork:
    """Work of the processes: one simulation of one candidate, with an FMU unpacked in a folder.

    `names`: calibrated variables; `step`: communication step [s].
    """

    folder: str
    digest: str
    names: tuple[str, ...]
    runs: tuple[Run, ...]
    step: float
    same_bits: bool = True  # commonrail's compiler does not affect the FMU's bits

    def probe(self) -> bytes:
        """Digest of the FMU, which is never loaded in the calling process."""
        return self.digest.encode()

    def __call__(self, argument: Asked) -> Answered:
        """Result of a run with values of the calibrated variables."""
        number, values, finer = argument
        run = self.runs[number]
        _keep_the_output_clean()
        start = {**run.start, **dict(zip(self.names, values, strict=True))}
        simulated, status, message = _simulate(self.folder, run, start, self.step / finer)
        return Answered(np.full(run.size, np.nan) if simulated is None else simulated, int(status), message)


@functools.cache
def _keep_the_output_clean() -> None:
    """Redirect output of the FMU to standard error, since standard output may hold a record."""
    os.dup2(2, 1)


@functools.cache
def _description(folder: str) -> Any:
    from fmpy import read_model_description

    return read_model_description(folder, validate=False)


def _simulate(folder: str, run: Run, start: Mapping[str, StartValue], step: float) -> _Outcome:
    from fmpy.fmi1 import FMICallException
    from fmpy.simulation import instantiate_fmu

    said: list[str] = []
    try:
        instance = instantiate_fmu(
            folder,
            _description(folder),
            "CoSimulation",
            logger=lambda *row: said.append(_text(row[-1])),
            require_functions=False,
        )
    except Exception as error:  # whatever loading a library may raise
        return None, FmuStatus.FMU_NOT_STARTED, _first_message(said, error)
    _end_at_discard(instance, FMICallException)
    try:
        courses = _courses(instance, folder, run, start, step)
    except _Discarded as error:
        return _free(instance, (None, FmuStatus.FMU_DISCARDED, _first_message(said, error)))
    except FMICallException as error:
        if error.status not in _STATUSES:
            os._exit(FATAL_EXIT)  # the standard forbids any further call of the FMU
        return _free(instance, (None, _STATUSES[error.status], _first_message(said, error)))
    except Exception as error:  # termination requested by the FMU, or a value that it rejects
        return _free(instance, (None, FmuStatus.FMU_ERROR, _first_message(said, error)))
    return _free(instance, _sample(courses, run, step))


def _courses(instance: Any, folder: str, run: Run, start: Mapping[str, StartValue], step: float) -> Any:
    from fmpy.simulation import simulate_fmu

    return simulate_fmu(
        folder,
        validate=False,
        start_time=0.0,
        stop_time=step * np.ceil(run.stop / step - _NEAR),
        output_interval=step,
        start_values=start,
        input=_signals(run),
        output=list(run.outputs),
        model_description=_description(folder),
        fmu_instance=instance,
    )


def _signals(run: Run) -> Any:
    if run.inputs is None:
        return None
    table = np.zeros(len(run.inputs.times), [("time", float), *((name, float) for name in run.inputs.values)])
    table["time"] = run.inputs.times
    for name, course in run.inputs.values.items():
        table[name] = course
    return table


def _sample(table: Any, run: Run, step: float) -> _Outcome:
    """Sample outputs at the times of a run, linear between communication points."""
    times = table["time"]
    if times[-1] < run.times[-1] - _NEAR * step:
        return None, FmuStatus.FMU_ENDED_EARLY, f"the simulation ended at {times[-1]:.6g} s"
    courses = [np.asarray(table[name], float) for name in run.outputs]
    for name, course in zip(run.outputs, courses, strict=True):
        if not np.isfinite(course).all():
            return None, FmuStatus.FMU_NOT_FINITE, f"{name} is not finite"
    return np.concatenate([np.interp(run.times, times, course) for course in courses]), FmuStatus.FMU_OK, ""


def _free(instance: Any, result: _Outcome) -> _Outcome:
    instance.freeInstance()
    return result


class _Discarded(Exception):
    """Step discarded by the FMU."""


def _end_at_discard(instance: Any, failure: Any) -> None:
    """End a simulation at a discarded step, which FMPy would repeat for ever."""
    step = instance.doStep

    def once(*args: Any, **kwargs: Any) -> Any:
        try:
            return step(*args, **kwargs)
        except failure as error:
            if error.status == DISCARD:
                raise _Discarded(str(error)) from error
            raise

    instance.doStep = once


def _text(message: Any) -> str:
    return message.decode("utf-8", "replace") if isinstance(message, bytes) else str(message)


def _first_message(said: list[str], error: BaseException) -> str:
    return " ".join(" ".join([str(error), *said[-1:]]).split())[:LONGEST]


# Candidates of a foreign FMU are simulated in separate processes, which may crash or hang.


class Simulated(NamedTuple):
    """Values (n, m) of candidates, NaN for failed runs, and status (n,) of the first failed run."""

    values: Floats
    statuses: NDArray[np.int8]


class FmuSimulator:
    """Simulator of an FMU in processes, with `time_limit` [s] for one simulation.

    `work` holds the runs of `data`, one set after the other.
    """

    def __init__(self, work: FmuWork, data: Sequence[FmuData], workers: Workers, time_limit: float) -> None:
        self._package, self._workers = pack(work), workers
        self._limit = time_limit
        self._runs = work.runs
        self._first: dict[str, int] = {}
        for data_set in data:
            self._first[data_set.name] = sum(len(before.runs) for before in data[: len(self._first)])
        self.check_stop: Callable[[], None] = lambda: None
        self.messages: dict[FmuStatus, str] = {}  # the first message with each status

    def simulate(self, data: Sequence[FmuData], values: Floats, finer: int = 1) -> Simulated:
        """Values of data sets, one after the other, for candidates (n, names) in the units of the FMU.

        `finer`: number of substeps per communication step.
        """
        numbers = [self._first[data_set.name] + i for data_set in data for i in range(len(data_set.runs))]
        edges = np.cumsum([0, *(self._runs[number].size for number in numbers)])
        simulated = np.full((len(values), edges[-1]), np.nan)
        statuses = np.zeros((len(values), len(numbers)), np.int8)
        rows = enumerate(tuple(row) for row in values.tolist())
        tasks = (self._task((i, k), Asked(n, row, finer)) for i, row in rows for k, n in enumerate(numbers))
        for task, outcome in self._workers.run(tasks, check_stop=self.check_stop):
            assert isinstance(task.name, tuple)
            i, k = task.name
            answered = self._answer(outcome, edges[k + 1] - edges[k])
            statuses[i, k] = answered.status
            simulated[i, edges[k] : edges[k + 1]] = answered.values
            if answered.status:
                self.messages.setdefault(FmuStatus(answered.status), answered.message)
        first = np.argmax(statuses > 0, axis=1)
        return Simulated(simulated, statuses[np.arange(len(values)), first])

    def _task(self, name: tuple[int, int], asked: Asked) -> Task:
        # a lost simulation is not repeated: the FMU would crash again
        return Task(name, self._package, asked, self._limit, losses=USUAL.failures - 1)

    def _answer(self, outcome: object, size: int) -> Answered:
        if isinstance(outcome, Answer):
            assert isinstance(outcome.result, Answered)
            return outcome.result
        assert isinstance(outcome, Lost)
        status = FmuStatus.FMU_CRASHED
        if outcome.reason.startswith("gave no answer"):
            status = FmuStatus.FMU_TOO_LONG
        elif outcome.reason == f"ended with exit code {FATAL_EXIT}":
            status = FmuStatus.FMU_FATAL
        return Answered(np.full(size, np.nan), int(status), f"the process {outcome.reason}")


@contextmanager
def open_simulator(
    fmu: Fmu, names: Sequence[str], data: Sequence[FmuData], step: float, time_limit: float, processes: int | None
) -> Iterator[FmuSimulator]:
    """Simulator of an FMU with its processes (default: all usable processors), ended with the block.

    Communication step and time limit of one simulation are in [s]. `InputError` if the FMU cannot be unpacked,
    `StudyError` if the processes cannot be started.
    """
    runs = tuple(run for data_set in data for run in data_set.runs)
    with unpack(fmu) as folder:
        work = FmuWork(str(folder), fmu.digest, tuple(names), runs, step)
        with Workers.processes(processes) as workers:
            yield FmuSimulator(work, data, workers, time_limit)
