"""Page of a fleet: spread of fit and parameters, worst injectors, failures."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from commonrail.base.chart import Boxes, Figure, Panel, Series
from commonrail.base.errors import InputError
from commonrail.base.output import write_text
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import count_noun, duration, join_words, number, percent, quantity, significant, to_fixed
from commonrail.data.records import Record
from commonrail.plugins.fleet.file import RECORD
from commonrail.plugins.fleet.population import correlation_map, histograms, injector_values, outlier_table
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
    """Refuse: the page names the file of the fleet, which is not in the folder."""
    again = f"commonrail fleet FLEET --out {shlex.quote(str(folder))}"
    raise InputError(f"{folder}: this is the folder of a fleet; `{again}` makes its report.")


RESULT = ResultKind(RECORD, "fleet", "fleet", _page)


def write_fleet_report(folder: Path, record: Record, command: str) -> Path:
    """Write ``report.html`` of a fleet; `command`: command line that continues or repeats the fleet."""
    path = folder / "report.html"
    write_text(path, fleet_html(record, command))
    return path


def fleet_html(record: Record, command: str) -> str:
    """Return the page of a fleet."""
    heat = correlation_map(record, _names(record))
    tables = fleet_tables(record)
    leading = [table for title in LEADING for table in tables if table.title == title]
    return render(
        "fleet.html",
        package=__package__,
        kind="Fleet",
        record=record,
        synthetic=[record["synthetic"]] if record["synthetic"] else [],
        lines=fleet_lines(record),
        warnings=fleet_warnings(record),
        tables=[table for table in tables if table not in leading],
        tiles=_tiles(record),
        leading=leading,
        figures=drawings(fleet_figures(record), 330),
        heat=heat and (heat, figure_html(heat, "correlations")),
        classes=small_drawings(histograms(record, _names(record)), "class"),
        each=injector_values(record),
        commands=[("Resume this fleet, or write its results again", command)],
        facts=_facts(record),
    )


def fleet_lines(record: Record) -> list[str]:
    """Sentences on the number of calibrated injectors, their errors, and the parameters that the data determine."""
    counts = record["counts"]
    best, start = record["J"]["best"], record["J"]["start"]
    total = count_noun(counts["injectors"], "injector")
    lines = [f"{counts['finished']} of {total} calibrated, {counts['failed']} failed."]
    if counts["pending"]:
        lines.append(f"{count_noun(counts['pending'], 'injector')} not done yet: repeat the command to resume.")
    if best and start:
        lines.append(
            f"J of the fitted data fell from {significant(start['median'])} to {significant(best['median'])} "
            f"(medians); interquartile range {significant(best['q1'])} to {significant(best['q3'])}."
        )
    bounded = [p["name"] for p in record["parameters"] if p["at_bound"] > 0.05 * counts["finished"]]
    if bounded:
        lines.append(
            f"At a bound in more than 5 % of the injectors: {join_words(bounded)}; widen the bounds if possible."
        )
    return lines


def _tiles(record: Record) -> list[Tile]:
    counts = record["counts"]
    total, failed = counts["injectors"], counts["failed"]
    outliers = record.get("population", {}).get("outliers", [])
    return [
        *(_error_tile(d) for d in record["data"][:ERRORS] if d["best"]),
        Tile("calibrated", f"{counts['finished']:,} of {total:,}", f"{failed:,} failed", BAD if failed else GOOD),
        Tile("outliers", f"{len(outliers):,}", "values far from those of the fleet", CARE if outliers else GOOD),
        Tile("warnings", f"{len(record['warnings']):,}", "kinds, below", CARE if record["warnings"] else GOOD),
    ]


def _error_tile(d: Record) -> Tile:
    """Error of a data set of the median injector."""
    unit, (best, start) = _unit(d), (d["best"], d["start"])
    before = f" (start {significant(start['median'], 2)} {unit})" if start else ""
    head = "unseen" if d["role"] == "validation" else "fit"
    words = f"{d['measure']} of {d['name']}, median injector{before}"
    return Tile(head, f"{significant(best['median'], 2)} {unit}", words)


def _unit(d: Record) -> str:
    return str(d["unit"]).replace("mm3", "mm³")


def fleet_warnings(record: Record) -> list[str]:
    """For each kind of warning the number of injectors with it, and the sentence of the first."""
    total = record["counts"]["finished"]
    return [
        f"{w['injectors']:,} of {count_noun(total, 'injector')}: {w['code']}. The first, {w['first']}: {w['sentence']}"
        for w in record["warnings"]
    ]


def fleet_tables(record: Record) -> list[Table]:
    """Tables: errors of the data sets, parameters, verdicts, worst injectors, outliers and failures."""
    tables = [_data_table(record), _parameter_table(record), _verdict_table(record), _worst_table(record)]
    return [table for table in (*tables, outlier_table(record), _failure_table(record)) if table.rows]


def _names(record: Record) -> dict[str, str]:
    return short_names([p["name"] for p in record["parameters"]])


def _data_table(record: Record) -> Table:
    columns: list[Column] = [
        ("data set", "name"),
        ("role", "role"),
        ("error", lambda d: f"{d['measure']}, {_unit(d)}"),
        ("injectors", "injectors"),
        ("start, median", lambda d: significant((d["start"] or {}).get("median"), 4)),
        *((head, lambda d, key=key: significant((d["best"] or {}).get(key), 4)) for key, head in _QUARTILES.items()),
    ]
    note = "Errors of the calibrated injectors, and the median error of the start values."
    return table_from_columns("Error of each data set over the fleet", record["data"], columns, note, 3)


def _parameter_table(record: Record) -> Table:
    def quartile_distance(p: Record) -> str:
        spread, median = p["best"], p["best"]["median"]
        return percent((spread["q3"] - spread["q1"]) / abs(median) if median else None)

    columns: list[Column] = [
        ("parameter", "name"),
        *((head, lambda p, key=key: quantity(p["best"][key], p["unit"])) for key, head in _QUARTILES.items()),
        ("between quartiles, %", quartile_distance),
        ("at a bound", "at_bound"),
    ]
    note = "Distance between the quartiles in percent of the median; “at a bound” counts injectors."
    return table_from_columns("Calibrated parameters over the fleet", record["parameters"], columns, note)


def _verdict_table(record: Record) -> Table:
    total: Counter[str] = Counter()
    for p in record["parameters"]:
        total.update(p["verdicts"])
    columns: list[Column] = [
        ("parameter", "name"),
        *((v, lambda p, v=v: str(p["verdicts"].get(v, 0))) for v, _ in total.most_common()),
    ]
    note = (
        "Number of injectors. A parameter that is not determined is not a measurement of the part. Intervals: "
        f"{record['estimator']}."
    )
    return table_from_columns("What the data determine", record["parameters"], columns, note)


def _worst_table(record: Record) -> Table:
    median = (record["J"]["best"] or {}).get("median")

    def times(w: Record) -> str:
        best = number(w["J"]["best"])
        return to_fixed(best / median if best is not None and median else None, 2)

    columns: list[Column] = [
        ("injector", "injector"),
        ("J, start", lambda w: significant(w["J"]["start"])),
        ("J, calibrated", lambda w: significant(number(w["J"]["best"]))),
        ("times the median", times),
        ("parameters at a bound", lambda w: join_words(w["at_bound"]) or "none"),
    ]
    note = "The folder “injectors” has the study of each; commonrail calibrate runs it to the same result."
    return table_from_columns("Worst fits", record["worst"], columns, note)


def _failure_table(record: Record) -> Table:
    failures = record["failures"]
    more = len(failures) - SHOWN
    note = f"{more:,} more are in results.csv." if more > 0 else ""
    columns: list[Column] = [("injector", "injector"), ("reason", "reason")]
    return table_from_columns("Failures", failures[:SHOWN], columns, note, 2)


def fleet_figures(record: Record) -> list[Figure]:
    """Figures: J over the share of the fleet, and the parameters between their bounds."""
    return [_cost_figure(record), _position_figure(record)] if record["parameters"] else []


def _cost_figure(record: Record) -> Figure:
    texts = {"start": "start values", "best": "calibrated"}
    series = [_cumulative_series(text, look, record["curve"][look]) for look, text in texts.items()]
    values = [v for look in texts for v in record["curve"][look]]
    wide = min(values) > 0.0 and max(values) > 20.0 * min(values)
    return Figure(
        "Objective over the fleet",
        "Injectors sorted by J, separately for start and calibrated values: 90 % are below the J at 90 %.",
        "share of the injectors, %",
        (Panel("J of the fitted data", tuple(series), logarithmic=wide),),
    )


def _cumulative_series(text: str, look: str, values: Sequence[float]) -> Series:
    last = max(len(values) - 1, 1)
    x = tuple(100.0 * i / last for i in range(len(values)))
    return Series(text, look, x, tuple(values), "lines" if len(values) > 1 else "markers")


def _position_figure(record: Record) -> Figure:
    parameters = record["parameters"]
    boxes = tuple(_box(p["position"]) for p in parameters)
    panel = Panel(
        "position between the bounds, %",
        (),
        boxes=(Boxes("calibrated", "best", boxes),),
        categories=tuple(short_names([p["name"] for p in parameters]).values()),
    )
    return Figure(
        "Calibrated parameters between their bounds",
        "Minimum, quartiles and maximum over the fleet; 0 % is the lower bound, 100 % the upper bound.",
        "parameter",
        (panel,),
    )


def _box(position: Record) -> tuple[float, float, float, float, float]:
    low, q1, median, q3, high = (100.0 * float(position[key]) for key in _QUARTILES)
    return low, q1, median, q3, high


def _facts(record: Record) -> list[tuple[str, str]]:
    clock = record["clock"]
    median_time = (clock["core_seconds_of_an_injector"] or {}).get("median")
    return [
        ("Study", f"{record['study']['title']} ({record['study']['file']})"),
        ("Table", record["table"]),
        ("Seed", str(record["seed"])),
        ("Processor time of an injector", f"{duration(median_time)} (median)"),
        ("Processor time of all injectors", duration(clock["core_seconds"])),
        ("Last run", _last_run(clock)),
        ("Software", ", ".join(f"{name} {version}" for name, version in record["software"].items())),
    ]


def _last_run(clock: Record) -> str:
    if not clock["calibrated_now"]:
        return "nothing was left to calibrate"
    speed = significant(clock["injectors_per_second"], 3)
    calibrated, workers = count_noun(clock["calibrated_now"], "injector"), count_noun(clock["workers"], "worker")
    return f"{calibrated} in {duration(clock['seconds'])} with {workers}, {speed} injectors/s"
