"""Page of a fleet: spread of fit and parameters, worst injectors, failures."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from commonrail.base.chart import Boxes, Figure, Panel, Series
from commonrail.base.errors import InputError
from commonrail.base.output import write_text
from commonrail.base.record import to_record
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import (
    count_noun,
    duration,
    in_print,
    join_words,
    percent,
    quantity,
    shown_unit,
    significant,
    to_fixed,
)
from commonrail.calibration.record import read_as
from commonrail.data.base import Role
from commonrail.data.records import Record
from commonrail.plugins.fleet.file import (
    RECORD,
    DataSpread,
    Failure,
    FleetClock,
    FleetRecord,
    ParameterSpread,
    Spread,
    WorstFit,
)
from commonrail.plugins.fleet.population import correlation_map, histograms, outlier_table
from commonrail.report.figure import drawings, figure_html, small_drawings
from commonrail.report.fit.record import short_names
from commonrail.report.fit.rules import BAD, CARE, GOOD, Tile
from commonrail.report.html import render
from commonrail.report.result_kind import ResultKind

SHOWN = 100  # failures that the page lists
LEADING = ("Outliers", "Worst fits")  # tables on the first screen
ERRORS = 3  # data sets whose error is on the first screen
# Keys of a spread, and what a table calls them.
_QUARTILES = {
    "minimum": "least",
    "q1": "lower quartile",
    "median": "median",
    "q3": "upper quartile",
    "maximum": "greatest",
}


def _page(record: Record, folder: Path) -> str:
    """Refuse, because the page needs the name of the fleet's file, which is not in the folder."""
    again = f"commonrail fleet FLEET --out {shlex.quote(str(folder))}"
    raise InputError(f"{folder}: this is the folder of a fleet; `{again}` makes its report.")


RESULT = ResultKind(RECORD, "fleet", "fleet", _page)


def write_fleet_report(folder: Path, record: Record, command: str) -> Path:
    """Write ``report.html`` of a fleet; `command`: command line that continues or repeats the fleet."""
    path = folder / "report.html"
    write_text(path, fleet_html(record, command))
    return path


def fleet_html(record: Record, command: str) -> str:
    """Return the page of a fleet from its record in JSON."""
    result = read_as(FleetRecord, record)
    names = short_names([p.name for p in result.parameters])
    heat = correlation_map(result.population, names)
    tables = fleet_tables(result)
    leading = [table for title in LEADING for table in tables if table.title == title]
    return render(
        "fleet.html",
        package=__package__,
        kind="Fleet",
        record=record,
        synthetic=[result.synthetic] if result.synthetic else [],
        lines=fleet_lines(result),
        warnings=fleet_warnings(result),
        tables=[table for table in tables if table not in leading],
        tiles=_tiles(result),
        leading=leading,
        figures=drawings(fleet_figures(result), 330),
        heat=heat and (heat, figure_html(heat, "correlations")),
        classes=small_drawings(histograms(result.population, names), "class"),
        each=_injector_values(result),
        commands=[("Resume this fleet, or write its results again", command)],
        facts=_facts(result),
    )


def fleet_lines(result: FleetRecord) -> list[str]:
    """Sentences on the number of calibrated injectors, their errors, and the parameters that the data determine."""
    counts, best, start = result.counts, result.cost.best, result.cost.start
    total = count_noun(counts.injectors, "injector")
    lines = [f"{counts.finished} of {total} calibrated, {counts.failed} failed."]
    if counts.pending:
        lines.append(f"{count_noun(counts.pending, 'injector')} not done yet: repeat the command to resume.")
    if best and start:
        lines.append(
            f"J of the fitted data fell from {significant(start.median)} to {significant(best.median)} "
            f"(medians); interquartile range {significant(best.q1)} to {significant(best.q3)}."
        )
    bounded = [p.name for p in result.parameters if p.at_bound > 0.05 * counts.finished]
    if bounded:
        lines.append(
            f"At a bound in more than 5 % of the injectors: {join_words(bounded)}; widen the bounds if possible."
        )
    return lines


def _tiles(result: FleetRecord) -> list[Tile]:
    counts, warnings = result.counts, result.warnings
    outliers = result.population.outliers if result.population else ()
    calibrated = f"{counts.finished:,} of {counts.injectors:,}"
    return [
        *(_error_tile(d, d.best, d.start) for d in result.data[:ERRORS] if d.best),
        Tile("calibrated", calibrated, f"{counts.failed:,} failed", BAD if counts.failed else GOOD),
        Tile("outliers", f"{len(outliers):,}", "values far from those of the fleet", CARE if outliers else GOOD),
        Tile("warnings", f"{len(warnings):,}", "kinds, below", CARE if warnings else GOOD),
    ]


def _error_tile(d: DataSpread, best: Spread, start: Spread | None) -> Tile:
    """Error of a data set of the median injector."""
    unit = in_print(d.unit)
    before = f" (start {significant(start.median, 2)} {unit})" if start else ""
    head = "unseen" if d.role == Role.VALIDATION.value else "fit"
    words = f"{d.measure} of {d.name}, median injector{before}"
    return Tile(head, f"{significant(best.median, 2)} {unit}", words)


def fleet_warnings(result: FleetRecord) -> list[str]:
    """For each kind of warning the number of injectors with it, and the sentence of the first."""
    total = count_noun(result.counts.finished, "injector")
    return [f"{w.injectors:,} of {total}: {w.code}. The first, {w.first}: {w.sentence}" for w in result.warnings]


def fleet_tables(result: FleetRecord) -> list[Table]:
    """Tables: errors of the data sets, parameters, verdicts, worst injectors, outliers and failures."""
    units = {p.name: p.unit for p in result.parameters}
    tables = (
        _data_table(result.data),
        _parameter_table(result.parameters),
        _verdict_table(result),
        _worst_table(result),
        outlier_table(result.population, units),
        _failure_table(result.failures),
    )
    return [table for table in tables if table.rows]


def _data_table(data: Sequence[DataSpread]) -> Table:
    def of(spread: Spread | None, key: str) -> str:
        return significant(spread and getattr(spread, key), 4)

    columns: list[Column] = [
        ("data set", lambda d: d.name),
        ("role", lambda d: d.role),
        ("error", lambda d: f"{d.measure}, {in_print(d.unit)}"),
        ("injectors", lambda d: str(d.injectors)),
        ("start, median", lambda d: of(d.start, "median")),
        *((head, lambda d, key=key: of(d.best, key)) for key, head in _QUARTILES.items()),
    ]
    note = "Errors of the calibrated injectors, and the median error of the start values."
    return table_from_columns("Error of each data set over the fleet", data, columns, note, 3)


def _parameter_table(parameters: Sequence[ParameterSpread]) -> Table:
    def quartile_distance(spread: Spread) -> str:
        return percent((spread.q3 - spread.q1) / abs(spread.median) if spread.median else None)

    columns: list[Column] = [
        ("parameter", lambda p: p.name),
        *((head, lambda p, key=key: quantity(getattr(p.best, key), p.unit)) for key, head in _QUARTILES.items()),
        ("between quartiles, %", lambda p: quartile_distance(p.best)),
        ("at a bound", lambda p: str(p.at_bound)),
    ]
    note = "Distance between the quartiles in percent of the median; “at a bound”: number of injectors."
    return table_from_columns("Calibrated parameters over the fleet", parameters, columns, note)


def _verdict_table(result: FleetRecord) -> Table:
    total: Counter[str] = Counter()
    for p in result.parameters:
        total.update(p.verdicts)
    columns: list[Column] = [
        ("parameter", lambda p: p.name),
        *((v, lambda p, v=v: str(p.verdicts.get(v, 0))) for v, _ in total.most_common()),
    ]
    note = (
        "Number of injectors. A parameter that is not determined is not a measurement of the part. Intervals: "
        f"{result.estimator}."
    )
    return table_from_columns("What the data determine", result.parameters, columns, note)


def _worst_table(result: FleetRecord) -> Table:
    median = result.cost.best.median if result.cost.best else None

    def times(w: WorstFit) -> str:
        return to_fixed(w.cost.best / median if w.cost.best is not None and median else None, 2)

    columns: list[Column] = [
        ("injector", lambda w: w.injector),
        ("J, start", lambda w: significant(w.cost.start)),
        ("J, calibrated", lambda w: significant(w.cost.best)),
        ("times the median", times),
        ("parameters at a bound", lambda w: join_words(w.at_bound) or "none"),
    ]
    note = "The folder “injectors” has the study of each; commonrail calibrate runs it to the same result."
    return table_from_columns("Worst fits", result.worst, columns, note)


def _failure_table(failures: Sequence[Failure]) -> Table:
    more = len(failures) - SHOWN
    note = f"{more:,} more are in results.csv." if more > 0 else ""
    columns: list[Column] = [("injector", lambda f: f.injector), ("reason", lambda f: f.reason)]
    return table_from_columns("Failures", failures[:SHOWN], columns, note, 2)


def fleet_figures(result: FleetRecord) -> list[Figure]:
    """Figures: J over the share of the fleet, and the parameters between their bounds."""
    return [_cost_figure(result), _position_figure(result.parameters)] if result.parameters else []


def _cost_figure(result: FleetRecord) -> Figure:
    start, best = result.curve.start, result.curve.best
    values = (*start, *best)
    wide = min(values) > 0.0 and max(values) > 20.0 * min(values)
    series = (_cumulative_series("start values", "start", start), _cumulative_series("calibrated", "best", best))
    return Figure(
        "Objective over the fleet",
        "Injectors sorted by J, separately for start and calibrated values: 90 % are below the J at 90 %.",
        "share of the injectors, %",
        (Panel("J of the fitted data", series, logarithmic=wide),),
    )


def _cumulative_series(text: str, look: str, values: Sequence[float]) -> Series:
    last = max(len(values) - 1, 1)
    x = tuple(100.0 * i / last for i in range(len(values)))
    return Series(text, look, x, tuple(values), "lines" if len(values) > 1 else "markers")


def _position_figure(parameters: Sequence[ParameterSpread]) -> Figure:
    boxes = tuple(_box(p.position) for p in parameters)
    panel = Panel(
        "position between the bounds, %",
        (),
        boxes=(Boxes("calibrated", "best", boxes),),
        categories=tuple(short_names([p.name for p in parameters]).values()),
    )
    return Figure(
        "Calibrated parameters between their bounds",
        "Minimum, quartiles and maximum over the fleet; 0 % is the lower bound, 100 % the upper bound.",
        "parameter",
        (panel,),
    )


def _box(position: Spread) -> tuple[float, float, float, float, float]:
    low, q1, median, q3, high = (100.0 * getattr(position, key) for key in _QUARTILES)
    return low, q1, median, q3, high


def _injector_values(result: FleetRecord) -> dict[str, Any]:
    """Names, units and values of the injectors that the page shows on demand; empty if no injector is calibrated."""
    if not result.population or not result.population.each:
        return {}
    units = [shown_unit(p.upper or p.best.median, p.unit) for p in result.parameters]
    parameters = [
        {"name": p.name, "unit": unit, "median": factor * p.best.median}
        | {"lower": factor * p.lower, "upper": factor * p.upper}
        for p, (unit, factor) in zip(result.parameters, units, strict=True)
    ]
    each = [
        injector._replace(values=tuple(factor * v for v, (_, factor) in zip(injector.values, units, strict=True)))
        for injector in result.population.each
    ]
    return {"parameters": parameters, "each": to_record(each), "more": result.population.more}


def _facts(result: FleetRecord) -> list[tuple[str, str]]:
    spread = result.clock.core_seconds_of_an_injector
    return [
        ("Study", f"{result.study.title} ({result.study.file})"),
        ("Table", result.table),
        ("Seed", str(result.seed)),
        ("Processor time of an injector", f"{duration(spread and spread.median)} (median)"),
        ("Processor time of all injectors", duration(result.clock.core_seconds)),
        ("Last run", _last_run(result.clock)),
        ("Software", ", ".join(f"{name} {version}" for name, version in result.software.items())),
    ]


def _last_run(clock: FleetClock) -> str:
    run = clock.run
    if not run.calibrated_now:
        return "nothing was left to calibrate"
    calibrated, workers = count_noun(run.calibrated_now, "injector"), count_noun(run.workers, "worker")
    return f"{calibrated} in {duration(run.seconds)} with {workers}, {significant(clock.speed, 3)} injectors/s"
