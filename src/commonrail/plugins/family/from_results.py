"""Types from results: of one calibrated part, of several, or of a fleet."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import file_path, number, plain_text, sequence
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.hooks import note
from commonrail.base.input import check_sum, fingerprint
from commonrail.base.units import to_text
from commonrail.calibration.parameter import Prior
from commonrail.calibration.record import read_as
from commonrail.calibration.study_file import load_study
from commonrail.physics.injector import Injector, Source, parameter_quantities
from commonrail.physics.meters import is_of_meter
from commonrail.plugins.family.injector_type import FixedValue, InjectorType, TypeParameter, TypePart
from commonrail.readers.columns import name_and_unit
from commonrail.readers.table_sheet import WrittenTable
from commonrail.readers.toml import UNSTATED
from commonrail.runs.folder import RESULT, STUDY, note_stopped, read_record, read_result

# Values fixed in the studies of a type's parts, as values of the type.

OF_PART = ("nozzle.hole_diameter", "nozzle.holes")  # the nozzle belongs to the part


class PartValues(NamedTuple):
    """Values [SI] of a fitted part, with their sources; `stated`: names of the values that its study fits or fixes."""

    name: str
    values: Mapping[str, float]
    sources: Mapping[str, Source]
    stated: Collection[str]


def collect_fixed_values(parts: Sequence[PartValues], taken: Collection[str]) -> tuple[FixedValue, ...]:
    """Collect the values that studies of the parts state, except the type's parameters (`taken`).

    If the parts differ, the type has the mean, and a note says so. Different nozzles are left out.
    """
    names = dict.fromkeys(name for part_values in parts for name in part_values.stated if name not in taken)
    fixed = []
    for name in names:
        having = [part_values for part_values in parts if name in part_values.values]
        values = [part_values.values[name] for part_values in having]
        if min(values) == max(values):
            mark, text = next(part_values for part_values in having if name in part_values.stated).sources.get(
                name, UNSTATED
            )
            fixed.append(FixedValue(name, values[0], mark, text))  # type: ignore[arg-type]
        elif name not in OF_PART:
            fixed.append(_mean_value(name, values, [part_values.name for part_values in having]))
    return tuple(fixed)


def _mean_value(name: str, values: Sequence[float], parts: Sequence[str]) -> FixedValue:
    unit = parameter_quantities()[name].unit
    mean = float(np.mean(values))
    stated_values = ", ".join(f"{to_text(v, unit)} ({part_name})" for v, part_name in zip(values, parts, strict=True))
    note(
        f"{name} differs between the parts: {stated_values}; the type has the mean, {to_text(mean, unit)}. "
        'If it is measured on the next part, give it the mark "M" in the injector\'s file.'
    )
    return FixedValue(name, mean, "F", f"mean of the parts: {stated_values}")


# Mean and spread of a parameter over parts whose values have standard errors (random effects).

FEWEST = 2  # parts whose data determine the parameter, needed for a spread
_FAINT = 0.1  # data with less than this share of the prior's information count as uninformative


class Estimate(NamedTuple):
    """Weighted mean over parts, and the standard deviation of the next part's value about it.

    `between`: standard deviation between parts that their errors do not explain; `spread`: sqrt(between² + error of the
    mean²).
    """

    value: float
    spread: float
    between: float


def estimate_over_parts(values: ArrayLike, errors: ArrayLike) -> Estimate:
    """Estimate the distribution of a parameter over parts (Paule and Mandel 1982).

    The variance between parts τ² solves

        Σ (x_i − μ)²/(e_i² + τ²) = n − 1

    x_i: value of a part, fitted separately; e_i: its standard error from the data alone (see `remove_prior`), NaN if
    the data do not determine the parameter: such parts are left out. μ: mean with the weights 1/(e_i² + τ²). At least
    two parts need an error.
    """
    from scipy.optimize import brentq  # slow to import

    has_error = np.isfinite(np.asarray(errors, float))
    x, variance = np.asarray(values, float)[has_error], np.asarray(errors, float)[has_error] ** 2
    between, most = 0.0, 2.0 * float(np.sum((x - np.mean(x)) ** 2))
    if _excess(x, variance) > 0.0:  # the errors alone do not explain the differences
        between = brentq(lambda more: _excess(x, variance + more), 0.0, most, xtol=1e-12 * most)
    mean, error = _mean(x, variance + between)
    return Estimate(mean, float(np.sqrt(between + error**2)), float(np.sqrt(between)))


def remove_prior(values: ArrayLike, errors: ArrayLike, prior: tuple[float, float] | None) -> tuple[Floats, Floats]:
    """Remove the prior (value, sigma) from fits: values and errors (n,) from the data alone.

    All parts share the prior; if counted once per part, it would reduce the scatter between parts. The weight of the
    data is 1/e² − 1/σ², with e of the posterior and σ of the prior. Value and error are NaN if the data have less than
    a tenth of the prior's information, or the error is NaN.
    """
    x, e = np.asarray(values, float), np.asarray(errors, float)
    if prior is None:
        return x, e
    mean, prior_weight = prior[0], prior[1] ** -2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        total = e**-2.0
        weight = np.where(total - prior_weight > _FAINT * prior_weight, total - prior_weight, np.nan)
        return np.where(np.isinf(total), x, (x * total - mean * prior_weight) / weight), weight**-0.5


def _mean(x: Floats, variance: Floats) -> tuple[float, float]:
    """Weighted mean and its standard error."""
    if not np.all(variance > 0.0):  # parts without scatter, or without error
        return float(np.mean(x)), 0.0
    weights = 1.0 / variance
    return float(np.sum(weights * x) / np.sum(weights)), float(1.0 / np.sqrt(np.sum(weights)))


def _excess(x: Floats, variance: Floats) -> float:
    """Return Σ (x − μ)²/variance − (n − 1)."""
    if not np.all(variance > 0.0):
        return float(np.ptp(x) > 0.0)
    mean, _ = _mean(x, variance)
    return float(np.sum((x - mean) ** 2 / variance)) - (len(x) - 1)


# Records of calibrated parts and of a fleet, with the keys that a type needs.


class _Spread(NamedTuple):
    """Bounds and prior of a parameter over a fleet [SI]."""

    name: str
    lower: float
    upper: float
    prior: Prior | None


class _FleetRecord(NamedTuple):
    """Record of a fleet."""

    title: str
    synthetic: str
    parameters: tuple[_Spread, ...]
    fixed: tuple[FixedValue, ...]


class _Fitted(NamedTuple):
    """Fitted parameter [SI]."""

    name: str
    lower: float
    upper: float
    best: float
    standard_error: float | None = None
    prior: Prior | None = None


class _Data(NamedTuple):
    """A data set."""

    role: str
    source: str


class _PartRecord(NamedTuple):
    """Record of a calibrated part."""

    title: str
    synthetic: str
    parameters: tuple[_Fitted, ...]
    data: tuple[_Data, ...]


FLEET, TABLE = "fleet.json", "results.csv"
FEWEST_MEMBERS = 2
MOST_ROWS = 10_000_000
ERROR = " standard error"


class _Run(NamedTuple):
    """A calibrated part: record of its result, and its injector unless the study was made in Python."""

    folder: Path
    record: _PartRecord
    injector: Injector | None
    type_part: TypePart
    fixed: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, _Fitted]:
        """Records of the injector's free parameters by name."""
        return {p.name: p for p in self.record.parameters if not is_of_meter(p.name)}

    @property
    def values(self) -> PartValues:
        """Values of the fitted part; only the free ones if the study was made in Python."""
        best = {name: p.best for name, p in self.parameters.items()}
        fitted = {name: Source("F", f"fitted to {self.record.title}") for name in best}
        injector = self.injector
        values, sources = ({}, {}) if injector is None else (dict(injector.values), dict(injector.sources))
        return PartValues(self.record.title, values | best, sources | fitted, (*self.fixed, *best))


def type_from_runs(folders: Sequence[str | Path], name: str, *, part_spread: float | None = None) -> InjectorType:
    """Type of injector from the run folders of calibrated parts.

    Parameters
    ----------
    folders : sequence of path
        Run folders of ``commonrail calibrate``, one for each part.
    name : str
        Of the type.
    part_spread : float, optional
        Assumed relative standard deviation between parts, such as 0.03; for a length at most its machining tolerance
        (ISO 286-1, IT7). It is used for a type of one part, and marked as an estimate.

    Returns
    -------
    InjectorType
        Its parameters are free in every run. Several parts give mean and spread. One part gives its values; the spread
        is sqrt(standard error² + between²) with `part_spread`, else the spread of the prior in its study, else
        range/√12 of the bounds. Parameters that are fixed in a study or not free in all runs become fixed values of the
        type, see `collect_fixed_values`.

    Raises
    ------
    InputError
        If a folder is not a run folder, or no parameter is free in all runs.
    ConfigurationError
        If an argument has the wrong type.
    """
    name = plain_text(name, "name of a type")
    runs = [_read_run(file_path(folder, "folder")) for folder in sequence(folders, "folders", '["runs/a", "runs/b"]')]
    if part_spread is not None:
        part_spread = number(part_spread, "1", "part_spread")
    if not runs:
        raise InputError("A type needs at least one calibrated part; give a run folder.")
    shared = [key for key in runs[0].parameters if all(key in run.parameters for run in runs)]
    if not shared:
        raise InputError(f"{runs[0].folder}: no parameter is free in all runs; a type needs a common free parameter.")
    source = f"fitted to {', '.join(run.record.title for run in runs)}"
    parameters = tuple(
        _parameter_over_runs(key, [run.parameters[key] for run in runs], source, part_spread) for key in shared
    )
    return InjectorType(
        name,
        f"{name}: {len(runs)} calibrated part{'s' if len(runs) > 1 else ''}",
        parameters,
        tuple(run.type_part for run in runs),
        runs[0].injector,
        synthetic=" ".join(dict.fromkeys(run.record.synthetic for run in runs if run.record.synthetic)),
        fixed=collect_fixed_values([run.values for run in runs], shared),
    )


def _read_run(folder: Path) -> _Run:
    content = read_result(folder)
    note_stopped(folder, content)
    record = read_as(_PartRecord, content, folder / RESULT)
    result_file = {RESULT: fingerprint(folder / RESULT)}
    sources = "; ".join(dict.fromkeys(d.source for d in record.data if d.role == "fit"))
    if not (folder / STUDY).is_file() or not (folder / STUDY).stat().st_size:
        return _Run(folder, record, None, TypePart(record.title, sources, result_file))  # a study made in Python
    study = load_study(folder / STUDY)
    root = folder.absolute()
    files = {path.relative_to(root).as_posix(): digest for path, digest in study.files.items()}
    return _Run(folder, record, study.injector, TypePart(record.title, sources, files | result_file), study.fixed)


def _parameter_over_runs(
    name: str, records: Sequence[_Fitted], source: str, part_spread: float | None
) -> TypeParameter:
    """Estimate a parameter from the records of the parts."""
    lower, upper = min(p.lower for p in records), max(p.upper for p in records)
    if len(records) == 1:
        value, spread, why = _estimate_from_one_run(name, records[0], part_spread)
        between = None if part_spread is None else min(_part_spread(name, value, part_spread), spread)
        return TypeParameter(name, value, spread, lower, upper, "F", f"{source}; spread: {why}", between)
    errors = [math.nan if p.standard_error is None else p.standard_error for p in records]
    data_estimates = [remove_prior(p.best, e, _prior(p)) for p, e in zip(records, errors, strict=True)]
    sigma = min((p.prior.sigma for p in records if p.prior is not None), default=math.inf)
    best = float(np.mean([p.best for p in records]))
    return _estimate_parameter(name, np.array(data_estimates, dtype=float).T, (lower, upper), source, (best, sigma))


def _prior(p: _Fitted | _Spread) -> tuple[float, float] | None:
    return None if p.prior is None else (p.prior.value, p.prior.sigma)


def _part_spread(name: str, value: float, share: float) -> float:
    """Assumed standard deviation between parts [SI]: a share of the value; for a length at most its tolerance IT7.

        IT7 = 16 i,  i = 0.45 D^(1/3) + 0.001 D

    IT7 and i in µm, D in mm (ISO 286-1, extrapolated below 1 mm): 12 µm at 4.3 mm, 4 µm at 0.19 mm. Bores, lifts and
    diameters are machined and gauged to IT7 or better.
    """
    spread = share * abs(value)
    if parameter_quantities()[name].unit != "m":
        return spread
    millimetres = 1e3 * abs(value)
    return float(min(spread, 16e-6 * (0.45 * np.cbrt(millimetres) + 0.001 * millimetres)))


def _estimate_from_one_run(name: str, p: _Fitted, part_spread: float | None) -> tuple[float, float, str]:
    """Return value and spread of a parameter of one part, and the origin of the spread."""
    value = p.best
    error = p.standard_error
    if part_spread is not None:
        between = _part_spread(name, value, part_spread)
        spread = math.hypot(_sigma_of_bounds(p) if error is None else error, between)
        if spread > 0.0:
            share = f"{100 * part_spread:g} %" if between == part_spread * abs(value) else "tolerance IT7"
            return value, spread, f"standard error and {share} between parts [E, assumed]"
    if p.prior is not None:
        return value, p.prior.sigma, "prior of the study"
    return value, _sigma_of_bounds(p), "uniform within the bounds"


def _sigma_of_bounds(p: _Fitted) -> float:
    """Standard deviation of a value uniform within the bounds."""
    return float((p.upper - p.lower) / math.sqrt(12.0))


def _estimate_parameter(
    name: str, data_estimates: Floats, bounds: tuple[float, float], source: str, otherwise: tuple[float, float]
) -> TypeParameter:
    """Estimate a parameter from the parts' values and errors (2, parts) by the data alone.

    `otherwise`: value and sigma (of a prior, or infinite), used if the data of fewer than two parts determine the
    parameter.
    """
    informative_parts, between = int(np.isfinite(data_estimates).all(axis=0).sum()), None
    widest = (bounds[1] - bounds[0]) / math.sqrt(12.0)
    if informative_parts < FEWEST:
        part_count = data_estimates.shape[1]
        why = f"determined by the data of {informative_parts} of {part_count} parts; spread of the prior or the bounds"
        value, spread = otherwise[0], min(otherwise[1], widest)
    else:
        estimate = estimate_over_parts(*data_estimates)
        why = f"spread over {informative_parts} parts"
        value, spread = estimate.value, min(estimate.spread or 1e-6 * widest, widest)  # 0 if parts are equal
        between = min(estimate.between, spread)
    value = min(max(value, bounds[0]), bounds[1])
    return TypeParameter(name, value, spread, *bounds, "F", f"{source}; {why}", between)


def type_from_fleet(folder: str | Path, name: str) -> InjectorType:
    """Type of injector from the tables of ``commonrail fleet``.

    Parameters
    ----------
    folder : str or Path
        Folder with fleet.json and results.csv.
    name : str
        Of the type.

    Returns
    -------
    InjectorType
        Mean and spread of every free parameter over the calibrated injectors, see `estimate_over_parts`, with the
        bounds of their study.

    Raises
    ------
    InputError
        If a table cannot be read or has been changed, or fewer than two injectors are finished.
    ConfigurationError
        If an argument has the wrong type.
    """
    folder, name = file_path(folder, "folder"), plain_text(name, "name of a type")
    record = read_as(_FleetRecord, read_record(folder / FLEET, "commonrail fleet", "fleet"), folder / FLEET)
    check_sum(folder / TABLE)
    columns, count = _read_columns(folder / TABLE)
    source = f"fleet: {record.title}"
    parameters = []
    for p in record.parameters:
        if p.name not in columns:  # a parameter of a meter
            continue
        values, errors = columns[p.name], columns[p.name + ERROR]
        calibrated, prior = np.isfinite(values), _prior(p)
        otherwise = float(np.mean(values[calibrated])), prior[1] if prior else math.inf
        of_data = np.array(remove_prior(values[calibrated], errors[calibrated], prior))
        parameters.append(_estimate_parameter(p.name, of_data, (p.lower, p.upper), source, otherwise))
    files = {FLEET: fingerprint(folder / FLEET), TABLE: fingerprint(folder / TABLE)}
    fleet_part = TypePart(record.title, source, files, count)
    return InjectorType(
        name,
        f"{name}: fleet of {count} injectors",
        tuple(parameters),
        (fleet_part,),
        synthetic=record.synthetic,
        fixed=record.fixed,
    )


def _read_columns(path: Path) -> tuple[dict[str, Floats], int]:
    """Read the columns of parameters and standard errors of the finished injectors, and count these."""
    table = WrittenTable(path, most=MOST_ROWS)
    names = [name_and_unit(cell)[0] for cell in table.header]
    if "status" not in names:
        raise InputError(f'{path}: the column "status" is missing; give the folder of a fleet.')
    rows = [[str(cell) for cell in row] for _, row in table.rows if row[names.index("status")] == "finished"]
    if len(rows) < FEWEST_MEMBERS:
        raise InputError(
            f"{path}: {len(rows)} injectors are finished, but a spread needs at least {FEWEST_MEMBERS}; "
            "for a type of one part give its run folder."
        )
    quantities = parameter_quantities()
    used_columns = {i: name for i, name in enumerate(names) if name.removesuffix(ERROR) in quantities}
    values_by_name = {name: np.array([_parse_cell(row[i], path) for row in rows]) for i, name in used_columns.items()}
    return values_by_name, len(rows)


def _parse_cell(text: str, path: Path) -> float:
    try:
        return float(text) if text.strip() else math.nan
    except ValueError as error:
        raise InputError(f'{path}: "{text[:40]}" is not a number; the table has been changed.') from error
