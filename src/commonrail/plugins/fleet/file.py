"""Record of a fleet for JSON, with spreads, worst injectors and failures; tables of results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from commonrail.base.csv_output import write_csv
from commonrail.base.output import replacing, write_set
from commonrail.base.record import Key
from commonrail.calibration.record import StartAndBest
from commonrail.compiler.target import package_versions
from commonrail.data.records import make_record
from commonrail.data.registry import get_kind
from commonrail.physics.meters import known_quantity
from commonrail.plugins.certainty.linear import ESTIMATOR
from commonrail.plugins.fleet.journal import FAILED, FINISHED, Entry
from commonrail.plugins.fleet.member import FixedRecord, PriorRecord
from commonrail.plugins.fleet.population import Population, describe_population
from commonrail.plugins.fleet.study import Fleet
from commonrail.readers.meters import free_names
from commonrail.runs.folder import write_record

WORST = 10  # number of worst injectors listed
SAMPLE = 400  # values of a curve over the fleet


class TemplateRecord(NamedTuple):
    """Template of the studies."""

    title: str
    file: str


class Counts(NamedTuple):
    """Numbers of injectors."""

    injectors: int
    finished: int
    failed: int
    pending: int


@dataclass(frozen=True)
class Spread:
    """Minimum, quartiles, maximum and count of a value over the fleet."""

    minimum: float
    q1: float
    median: float
    q3: float
    maximum: float
    count: int


class StartAndBestSpread(NamedTuple):
    """Spreads of the start and the best values; None without a number."""

    start: Spread | None
    best: Spread | None


class StartAndBestCurve(NamedTuple):
    """Sorted values at even ranks, of the start and of the best values."""

    start: tuple[float, ...]
    best: tuple[float, ...]


class DataSpread(NamedTuple):
    """Error of a data set over the injectors that have it."""

    name: str
    role: str
    measure: str
    unit: str
    start: Spread | None
    best: Spread | None
    injectors: int


class ParameterSpread(NamedTuple):
    """Calibrated values of a parameter [SI] and their positions between the bounds, over the fleet.

    `at_bound`, and `verdicts` by their names: numbers of injectors.
    """

    name: str
    unit: str
    meaning: str
    best: Spread
    position: Spread
    at_bound: int
    verdicts: Mapping[str, int]
    lower: float
    upper: float
    prior: PriorRecord | None


class WorstFit(NamedTuple):
    """Objective of an injector, and its parameters at a bound."""

    injector: str
    cost: Annotated[StartAndBest, Key("J")]
    at_bound: tuple[str, ...]
    seed: int


class FleetWarning(NamedTuple):
    """Kind of warning: the number of injectors with it, and the first of them with its sentence."""

    code: str
    injectors: int
    first: str
    sentence: str


class Failure(NamedTuple):
    """Failed injector."""

    injector: str
    reason: str


class RunClock(NamedTuple):
    """This run: duration and time until the first injector was done [s], calibrated injectors, and workers."""

    seconds: float
    first: float | None
    calibrated_now: int
    workers: int


class FleetClock(NamedTuple):
    """All that depends on the clock; `later_speed`: injectors per second after the first; processor times [s]."""

    run: Annotated[RunClock, Key("")]
    speed: Annotated[float | None, Key("injectors_per_second")]
    later_speed: Annotated[float | None, Key("after_the_first")]
    core_seconds_of_an_injector: Spread | None
    core_seconds: float


@dataclass(frozen=True, kw_only=True)
class FleetRecord:
    """Record of a fleet, ``fleet.json``; `status`: "finished", "interrupted" or "failed"."""

    title: str
    synthetic: str
    software: Mapping[str, str]
    note: str
    seed: int
    study: TemplateRecord
    table: str
    status: str
    counts: Counts
    cost: Annotated[StartAndBestSpread, Key("J")]
    curve: StartAndBestCurve
    data: tuple[DataSpread, ...]
    fixed: tuple[FixedRecord, ...]
    parameters: tuple[ParameterSpread, ...]
    population: Population | None = None
    estimator: str
    worst: tuple[WorstFit, ...]
    warnings: tuple[FleetWarning, ...]
    failures: tuple[Failure, ...]
    clock: FleetClock


def parameter_units(fleet: Fleet) -> dict[str, str]:
    """Unit of each free parameter, in the order of the template."""
    model = fleet.template.model
    names = [*(p.name for p in model.parameter), *free_names(model.meters)]
    return {name: known_quantity(name).unit for name in names}


def summarise_fleet(
    fleet: Fleet, entries: Sequence[Entry], status: str, clock: RunClock, warnings: Sequence[FleetWarning] = ()
) -> FleetRecord:
    """Return the record of a fleet.

    `entries`: injectors that are done, in the table's order; `status`: see `FleetRecord`; `warnings`: about the fleet
    as a whole.
    """
    finished = [entry for entry in entries if entry.status == FINISHED]
    records = [entry.result for entry in finished]
    failed = [entry for entry in entries if entry.status == FAILED]
    total = len(fleet.supply.names)
    starts, bests = [record.cost.start for record in records], [record.cost.best for record in records]
    units = parameter_units(fleet)
    worst = sorted(finished, key=lambda entry: -entry.result.best_cost)[:WORST]
    return FleetRecord(
        title=fleet.title,
        synthetic=" ".join(dict.fromkeys(record.synthetic for record in records if record.synthetic)),
        software=package_versions(),
        note=fleet.note,
        seed=fleet.seed,
        study=TemplateRecord(fleet.template.model.title, fleet.template.path.name),
        table=fleet.supply.path.name,
        status=status,
        counts=Counts(total, len(finished), len(failed), total - len(entries)),
        cost=StartAndBestSpread(summarise_spread(starts), summarise_spread(bests)),
        curve=StartAndBestCurve(_sample_sorted(starts), _sample_sorted(bests)),
        data=_summarise_data(fleet, finished),
        fixed=records[0].fixed if records else (),
        parameters=tuple(_summarise_parameter(name, unit, finished) for name, unit in units.items())
        if finished
        else (),
        population=describe_population(finished, list(units)) if finished else None,
        estimator=ESTIMATOR,
        worst=tuple(WorstFit(e.name, e.result.cost, e.result.bounded, e.result.seed) for e in worst),
        warnings=(*warnings, *_count_warnings(finished)),
        failures=tuple(Failure(entry.name, entry.reason) for entry in failed),
        clock=_summarise_clock(clock, finished),
    )


def summarise_spread(values: Sequence[float | None]) -> Spread | None:
    """Summarise the numbers among values; None without a number."""
    finite_values = np.array([value for value in values if value is not None])
    if not len(finite_values):
        return None
    low, q1, median, q3, high = np.quantile(finite_values, [0.0, 0.25, 0.5, 0.75, 1.0]).tolist()
    return Spread(low, q1, median, q3, high, len(finite_values))


def _spread(values: Sequence[float]) -> Spread:
    spread = summarise_spread(values)
    assert spread is not None
    return spread


def _sample_sorted(values: Sequence[float | None]) -> tuple[float, ...]:
    """At most `SAMPLE` of the sorted values at even ranks, for the curve of a figure."""
    ordered = np.sort([value for value in values if value is not None])
    places = np.unique(np.linspace(0, len(ordered) - 1, min(len(ordered), SAMPLE)).round().astype(int))
    return tuple(ordered[places].tolist()) if len(ordered) else ()


def _summarise_data(fleet: Fleet, finished: Sequence[Entry]) -> tuple[DataSpread, ...]:
    spreads = []
    for data in fleet.template.model.data:
        rows = [d for entry in finished for d in entry.result.data if d.name == data.name]
        if rows:
            start, best = summarise_spread([row.start for row in rows]), summarise_spread([row.best for row in rows])
            spreads.append(DataSpread(data.name, data.role, rows[0].measure, rows[0].unit, start, best, len(rows)))
    return tuple(spreads)


def _summarise_parameter(name: str, unit: str, finished: Sequence[Entry]) -> ParameterSpread:
    parameters = [entry.result.parameters[name] for entry in finished]
    first = parameters[0]
    return ParameterSpread(
        name=name,
        unit=unit,
        meaning=known_quantity(name).meaning,
        best=_spread([p.best for p in parameters]),
        position=_spread([p.position for p in parameters]),
        at_bound=sum(p.at_bound for p in parameters),
        verdicts=dict(sorted(Counter(p.verdict.value for p in parameters).items())),
        lower=first.lower,
        upper=first.upper,
        prior=first.prior,
    )


def _count_warnings(finished: Sequence[Entry]) -> list[FleetWarning]:
    """Count the injectors with each kind of warning, the most frequent first."""
    by_code: dict[str, list[tuple[str, str]]] = {}
    for entry in finished:
        first = {warning.code: warning.sentence for warning in reversed(entry.result.warnings)}
        for code, sentence in first.items():
            by_code.setdefault(code, []).append((entry.name, sentence))
    rows = [FleetWarning(code, len(warned), *warned[0]) for code, warned in by_code.items()]
    return sorted(rows, key=lambda row: (-row.injectors, row.code))


def _summarise_clock(run: RunClock, finished: Sequence[Entry]) -> FleetClock:
    later = run.seconds - (run.first or 0.0)
    return FleetClock(
        run,
        run.calibrated_now / run.seconds if run.seconds > 0.0 else None,
        (run.calibrated_now - 1) / later if run.calibrated_now > 1 and later > 0.0 else None,
        summarise_spread([entry.seconds for entry in finished]),
        sum(entry.seconds for entry in finished),
    )


# Files of a fleet: results.csv, results.parquet if pyarrow is installed, and fleet.json.

RECORD, RESULTS, RESULTS_PARQUET = "fleet.json", "results.csv", "results.parquet"
PENDING = "pending"

Value = str | int | float | None


def write_results(
    folder: Path, fleet: Fleet, entries: Sequence[Entry], record: FleetRecord, why: str = ""
) -> dict[str, Any]:
    """Write the files, each atomically; return the content of ``fleet.json``.

    `entries`: as in `summarise_fleet`, which returns `record`; `why`: reason of injectors that are not done.
    """
    columns = result_columns(fleet, entries, why)
    notes = [f"SYNTHETIC: {' '.join(record.synthetic.split())}"] if record.synthetic else []
    rows = zip(*(map(_text, column) for column in columns.values()), strict=True)
    with write_set(folder):
        write_csv(folder / RESULTS, notes, list(columns), rows)
        _write_parquet(folder / RESULTS_PARQUET, columns, record.synthetic)
        content = make_record("fleet", record)
        write_record(folder / RECORD, content)
    return content


def result_columns(fleet: Fleet, entries: Sequence[Entry], why: str = "") -> dict[str, list[Value]]:
    """Columns of the table of results, with a row for each injector; missing numbers are None.

    Values are SI unless the header gives another unit. Only the last column, the processor time, depends on the clock.
    `why`: reason of injectors that are not done.
    """
    by_name = {entry.name: entry for entry in entries}
    rows = [by_name.get(name) for name in fleet.supply.names]
    records = [None if entry is None else entry.record for entry in rows]
    columns: dict[str, list[Value]] = {
        "injector": list(fleet.supply.names),
        "status": [PENDING if entry is None else entry.status for entry in rows],
        "reason": [why if entry is None else entry.reason for entry in rows],
        "J start": [record and record.cost.start for record in records],
        "J best": [record and record.cost.best for record in records],
    }
    for data in fleet.template.model.data:
        if data.name not in fleet.template.left_out:
            measure, unit = get_kind(data.kind).error_head
            errors = [{d.name: d.best for d in record.data} if record else {} for record in records]
            columns[f"{measure} {data.name} [{unit}]"] = [best.get(data.name) for best in errors]
    for name, unit in parameter_units(fleet).items():
        parameters = [record.parameters[name] if record else None for record in records]
        head = f" [{unit}]" if unit != "1" else ""
        columns[name + head] = [p and p.best for p in parameters]
        columns[f"{name} standard error{head}"] = [p and p.standard_error for p in parameters]
        columns[f"{name} verdict"] = [p.verdict.value if p else "" for p in parameters]
    columns["warnings"] = [len(record.warnings) if record else None for record in records]
    columns["seed"] = [record and record.seed for record in records]
    columns["processor time [s]"] = [entry and entry.seconds for entry in rows]
    return columns


def _text(value: Value) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else repr(value)  # repr: reads back as the same float


def _write_parquet(path: Path, columns: Mapping[str, list[Value]], synthetic: str) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        return
    arrays = {}
    for name, values in columns.items():
        numbers = all(value is None or isinstance(value, float) for value in values)
        arrays[name] = pyarrow.array(values, pyarrow.float64() if numbers else None)
    table = pyarrow.table(arrays)
    if synthetic:
        table = table.replace_schema_metadata({"SYNTHETIC": synthetic})
    with replacing(path, "wb") as stream:
        parquet.write_table(table, stream)
