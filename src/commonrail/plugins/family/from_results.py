"""Types from results: of one calibrated part, of several, or of a fleet."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import file_path, number, plain_text, sequence
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.hooks import note
from commonrail.base.input import check_sum, fingerprint
from commonrail.base.units import to_text
from commonrail.calibration.study_file import load_study
from commonrail.physics.injector import Injector, Source, parameter_quantities
from commonrail.physics.meters import is_of_meter
from commonrail.plugins.family.injector_type import FixedValue, InjectorType, TypeParameter, TypePart
from commonrail.readers.columns import name_and_unit
from commonrail.readers.table_sheet import WrittenTable
from commonrail.readers.toml import UNSTATED
from commonrail.runs.folder import RESULT, STUDY, note_stopped, read_record

# Values that the studies of a type's parts fixed, as values of the type.

OF_PART = ("nozzle.hole_diameter", "nozzle.holes")  # the nozzle is a part's own


class PartValues(NamedTuple):
    """Values [SI] with which a part was fitted, the fitted ones being the best, and their sources.

    `stated` names the values that are not the injector file's.
    """

    name: str
    values: Mapping[str, float]
    sources: Mapping[str, Source]
    stated: Collection[str]


def fixed_values(parts: Sequence[PartValues], taken: Collection[str]) -> tuple[FixedValue, ...]:
    """Values of a type that are none of its parameters (`taken`), and that a part had in place of its injector's.

    Where the parts differ, the type takes the mean, and a note says so; nozzles that differ are the parts' own.
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
            fixed.append(_mean_of_parts(name, values, [part_values.name for part_values in having]))
    return tuple(fixed)


def _mean_of_parts(name: str, values: Sequence[float], parts: Sequence[str]) -> FixedValue:
    unit = parameter_quantities()[name].unit
    mean = float(np.mean(values))
    stated_values = ", ".join(f"{to_text(v, unit)} ({part_name})" for v, part_name in zip(values, parts, strict=True))
    note(
        f"{name} is not the same in all parts: {stated_values}; the type takes the mean, {to_text(mean, unit)}. "
        'Where it was measured on the next part, give it the mark "M" in that injector\'s file.'
    )
    return FixedValue(name, mean, "F", f"mean of the parts: {stated_values}")


# Mean and spread of a parameter over parts whose own values are known with errors (random effects).

FEWEST = 2  # parts that data hold, for a spread
_FAINT = 0.1  # data that tell less than this share of what the prior does tell nothing


class Estimate(NamedTuple):
    """Mean over parts, each weighed by its own error, and the standard deviation of the next part's value about it.

    `between` is the standard deviation between parts beyond what their errors explain, 0 if they explain it all;
    `spread` is sqrt(between² + error of the mean²).
    """

    value: float
    spread: float
    between: float


def over_parts(values: ArrayLike, errors: ArrayLike) -> Estimate:
    """Two-step estimate of the distribution of a parameter over parts, at least two of them with a known error.

    Each part's value x_i has been fitted by itself, with the standard error e_i by the data alone (see
    `without_prior`), NaN where not known. The variance between parts, τ², is that for which Σ (x_i − μ)²/(e_i² + τ²)
    equals n − 1 (Paule and Mandel 1982), with μ the mean weighed by 1/(e_i² + τ²). A part whose error is not known is
    left out: its data do not hold the parameter.
    """
    from scipy.optimize import brentq  # slow to import

    has_error = np.isfinite(np.asarray(errors, float))
    x, variance = np.asarray(values, float)[has_error], np.asarray(errors, float)[has_error] ** 2
    between, most = 0.0, 2.0 * float(np.sum((x - np.mean(x)) ** 2))
    if _excess(x, variance) > 0.0:  # the errors alone do not explain the differences
        between = brentq(lambda more: _excess(x, variance + more), 0.0, most, xtol=1e-12 * most)
    mean, error = _mean(x, variance + between)
    return Estimate(mean, float(np.sqrt(between + error**2)), float(np.sqrt(between)))


def without_prior(values: ArrayLike, errors: ArrayLike, prior: tuple[float, float] | None) -> tuple[Floats, Floats]:
    """Values and errors (n,) that the data alone give, of fits with a prior (value, sigma).

    Every part had the same prior: counted once a part, it would draw the parts together and to its value. With the
    posterior's x and e and the prior's μ and σ, the data's weight is 1/e² − 1/σ². Both are NaN where the data tell less
    than a tenth of what the prior tells, or where the error is.
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
    """Weighed mean and its standard error."""
    if not np.all(variance > 0.0):  # all parts alike, or exact
        return float(np.mean(x)), 0.0
    weights = 1.0 / variance
    return float(np.sum(weights * x) / np.sum(weights)), float(1.0 / np.sqrt(np.sum(weights)))


def _excess(x: Floats, variance: Floats) -> float:
    """Σ (x − μ)²/variance beyond n − 1."""
    if not np.all(variance > 0.0):
        return float(np.ptp(x) > 0.0)
    mean, _ = _mean(x, variance)
    return float(np.sum((x - mean) ** 2 / variance)) - (len(x) - 1)


FLEET, TABLE = "fleet.json", "results.csv"
FEWEST_MEMBERS = 2
MOST_ROWS = 10_000_000
ERROR = " standard error"


class _Run(NamedTuple):
    """A calibrated part: record of its result, its injector and data if the study can be read, and fingerprints."""

    folder: Path
    record: Mapping[str, Any]
    injector: Injector | None
    type_part: TypePart
    fixed: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, Mapping[str, Any]]:
        """Records of the injector's free parameters by name."""
        return {p["name"]: p for p in self.record["parameters"] if not is_of_meter(p["name"])}

    @property
    def values(self) -> PartValues:
        """Values with which the part was fitted; of a study made in Python only the free ones."""
        best = {name: p["best"] for name, p in self.parameters.items()}
        fitted = {name: Source("F", f"fitted to {self.record['title']}") for name in best}
        injector = self.injector
        values, sources = ({}, {}) if injector is None else (dict(injector.values), dict(injector.sources))
        return PartValues(self.record["title"], values | best, sources | fitted, (*self.fixed, *best))


def type_from_runs(folders: Sequence[str | Path], name: str, *, part_spread: float | None = None) -> InjectorType:
    """Type of injector from the run folders of calibrated parts.

    Parameters
    ----------
    folders : sequence of path
        Run folders of ``commonrail calibrate``, one for each part.
    name : str
        Of the type.
    part_spread : float, optional
        Standard deviation between parts as a share of the value, such as 0.03; of a length no more than its machining
        tolerance (ISO 286-1, IT7). It is needed for what one part cannot tell, and is marked as an estimate.

    Returns
    -------
    InjectorType
        Of the parameters that are free in every run. From several parts: mean and spread over the parts. From one part:
        its values; the spread is sqrt(standard error² + between²) if `part_spread` is given, else the prior's of its
        study, else that of a value anywhere within the bounds, range/√12. What a study fixes, or what is
        free in some runs only, is a fixed value of the type, see `fixed_values`.

    Raises
    ------
    InputError
        If a folder is no run folder, or no parameter is free in all of them.
    ConfigurationError
        If an argument is of another kind.
    """
    name = plain_text(name, "name of a type")
    runs = [_read(file_path(folder, "folder")) for folder in sequence(folders, "folders", '["runs/a", "runs/b"]')]
    if part_spread is not None:
        part_spread = number(part_spread, "1", "part_spread")
    if not runs:
        raise InputError("A type needs at least one calibrated part; name a run folder.")
    shared = [key for key in runs[0].parameters if all(key in run.parameters for run in runs)]
    if not shared:
        raise InputError(f"{runs[0].folder}: no parameter is free in all runs; a type is of what all parts fitted.")
    source = f"fitted to {', '.join(run.record['title'] for run in runs)}"
    parameters = tuple(_over_runs(key, [run.parameters[key] for run in runs], source, part_spread) for key in shared)
    return InjectorType(
        name,
        f"{name}: {len(runs)} calibrated part{'s' if len(runs) > 1 else ''}",
        parameters,
        tuple(run.type_part for run in runs),
        runs[0].injector,
        synthetic=" ".join(dict.fromkeys(run.record["synthetic"] for run in runs if run.record["synthetic"])),
        fixed=fixed_values([run.values for run in runs], shared),
    )


def _read(folder: Path) -> _Run:
    record = read_record(folder / RESULT, "commonrail calibrate")
    note_stopped(folder, record)
    if record.get("kind") != "calibration":
        raise InputError(f"{folder}: this is no run folder of commonrail calibrate; name one.")
    result_file = {RESULT: fingerprint(folder / RESULT)}
    sources = "; ".join(dict.fromkeys(d["source"] for d in record["data"] if d["role"] == "fit"))
    if not (folder / STUDY).is_file() or not (folder / STUDY).stat().st_size:
        return _Run(folder, record, None, TypePart(record["title"], sources, result_file))  # a study made in Python
    study = load_study(folder / STUDY)
    root = folder.absolute()
    files = {path.relative_to(root).as_posix(): digest for path, digest in study.files.items()}
    return _Run(folder, record, study.injector, TypePart(record["title"], sources, files | result_file), study.fixed)


def _over_runs(
    name: str, records: Sequence[Mapping[str, Any]], source: str, part_spread: float | None
) -> TypeParameter:
    """A parameter over the records of parts."""
    lower, upper = min(p["lower"] for p in records), max(p["upper"] for p in records)
    if len(records) == 1:
        value, spread, why = _of_one(name, records[0], part_spread)
        between = None if part_spread is None else min(_part_spread(name, value, part_spread), spread)
        return TypeParameter(name, value, spread, lower, upper, "F", f"{source}; spread: {why}", between)
    errors = [math.nan if p.get("standard_error") is None else p["standard_error"] for p in records]
    data_estimates = [without_prior(p["best"], e, _prior_of(p)) for p, e in zip(records, errors, strict=True)]
    sigma = min((p["prior"]["sigma"] for p in records if "prior" in p), default=math.inf)
    best = float(np.mean([p["best"] for p in records]))
    return _estimated(name, np.array(data_estimates, dtype=float).T, (lower, upper), source, (best, sigma))


def _prior_of(p: Mapping[str, Any]) -> tuple[float, float] | None:
    return (p["prior"]["value"], p["prior"]["sigma"]) if p.get("prior") else None


def _part_spread(name: str, value: float, share: float) -> float:
    """Assumed standard deviation between parts [SI]: a share of the value; of a length its tolerance IT7 where less.

    16 i with i = 0.45 D^(1/3) + 0.001 D, both in micrometres, D in mm (ISO 286-1, below 1 mm extrapolated): 12 µm at
    4.3 mm, 4 µm at 0.19 mm. Bores, lifts and diameters are machined and gauged to that or better.
    """
    spread = share * abs(value)
    if parameter_quantities()[name].unit != "m":
        return spread
    millimetres = 1e3 * abs(value)
    return float(min(spread, 16e-6 * (0.45 * np.cbrt(millimetres) + 0.001 * millimetres)))


def _of_one(name: str, p: Mapping[str, Any], part_spread: float | None) -> tuple[float, float, str]:
    """Value and spread of a parameter of one part, and the origin of the spread."""
    value = p["best"]
    error = p.get("standard_error")
    if part_spread is not None:
        between = _part_spread(name, value, part_spread)
        spread = math.hypot(_widest(p) if error is None else error, between)
        if spread > 0.0:
            share = f"{100 * part_spread:g} %" if between == part_spread * abs(value) else "tolerance IT7"
            return value, spread, f"standard error and {share} between parts [E, assumed]"
    if "prior" in p:
        return value, p["prior"]["sigma"], "that of the study's prior"
    return value, _widest(p), "of a value anywhere within the bounds"


def _widest(p: Mapping[str, Any]) -> float:
    """Standard deviation of a value anywhere within the bounds."""
    return float((p["upper"] - p["lower"]) / math.sqrt(12.0))


def _estimated(
    name: str, data_estimates: Floats, bounds: tuple[float, float], source: str, otherwise: tuple[float, float]
) -> TypeParameter:
    """A parameter over parts, from their values and errors (2, parts) by the data alone.

    Where the data of fewer than two parts hold it, value and sigma are those of `otherwise`; sigma is that of a prior,
    or infinite.
    """
    informative_parts, between = int(np.isfinite(data_estimates).all(axis=0).sum()), None
    widest = (bounds[1] - bounds[0]) / math.sqrt(12.0)
    if informative_parts < FEWEST:
        part_count = data_estimates.shape[1]
        why = f"held by the data of {informative_parts} of {part_count} parts; spread of the prior or the bounds"
        value, spread = otherwise[0], min(otherwise[1], widest)
    else:
        estimate = over_parts(*data_estimates)
        why = f"spread over {informative_parts} parts"
        value, spread = estimate.value, min(estimate.spread or 1e-6 * widest, widest)  # parts may be exactly alike
        between = min(estimate.between, spread)
    value = min(max(value, bounds[0]), bounds[1])
    return TypeParameter(name, value, spread, *bounds, "F", f"{source}; {why}", between)


def type_from_fleet(folder: str | Path, name: str) -> InjectorType:
    """Type of injector from the tables that ``commonrail fleet`` leaves.

    Parameters
    ----------
    folder : str or Path
        Folder with fleet.json and results.csv.
    name : str
        Of the type.

    Returns
    -------
    InjectorType
        Mean and spread of every free parameter over the injectors that were calibrated, see `over_parts`, with the
        bounds of their study.

    Raises
    ------
    InputError
        If a table cannot be read, is not the one that was written, or fewer than two injectors are in it.
    ConfigurationError
        If an argument is of another kind.
    """
    folder, name = file_path(folder, "folder"), plain_text(name, "name of a type")
    record = read_record(folder / FLEET, "commonrail fleet")
    check_sum(folder / TABLE)
    columns, count = _columns(folder / TABLE)
    source = f"fleet: {record['title']}"
    parameters = []
    for parameter_record in (
        p for p in record["parameters"] if p["name"] in columns
    ):  # those of meters are no injector's
        values, errors = columns[parameter_record["name"]], columns[parameter_record["name"] + ERROR]
        calibrated, prior = np.isfinite(values), _prior_of(parameter_record)
        otherwise = float(np.mean(values[calibrated])), prior[1] if prior else math.inf
        of_data = np.array(without_prior(values[calibrated], errors[calibrated], prior))
        parameters.append(
            _estimated(
                parameter_record["name"],
                of_data,
                (parameter_record["lower"], parameter_record["upper"]),
                source,
                otherwise,
            )
        )
    files = {FLEET: fingerprint(folder / FLEET), TABLE: fingerprint(folder / TABLE)}
    fleet_part = TypePart(record["title"], source, files, count)
    return InjectorType(
        name,
        f"{name}: fleet of {count} injectors",
        tuple(parameters),
        (fleet_part,),
        synthetic=record["synthetic"],
        fixed=tuple(FixedValue(**fixed_record) for fixed_record in record["fixed"]),
    )


def _columns(path: Path) -> tuple[dict[str, Floats], int]:
    """Columns of parameters, and of their standard errors, of the injectors that are finished; their number."""
    table = WrittenTable(path, most=MOST_ROWS)
    names = [name_and_unit(cell)[0] for cell in table.header]
    if "status" not in names:
        raise InputError(f"{path}: there is no column status; name the folder of commonrail fleet.")
    rows = [[str(cell) for cell in row] for _, row in table.rows if row[names.index("status")] == "finished"]
    if len(rows) < FEWEST_MEMBERS:
        raise InputError(
            f"{path}: {len(rows)} injectors are finished, and at least {FEWEST_MEMBERS} are needed for a spread; "
            "make a type of one part from its run folder."
        )
    quantities = parameter_quantities()
    used_columns = {i: name for i, name in enumerate(names) if name.removesuffix(ERROR) in quantities}
    values_by_name = {name: np.array([_cell(row[i], path) for row in rows]) for i, name in used_columns.items()}
    return values_by_name, len(rows)


def _cell(text: str, path: Path) -> float:
    try:
        return float(text) if text.strip() else math.nan
    except ValueError as error:
        raise InputError(f'{path}: "{text[:40]}" is no number; the table is not the one that was written.') from error
