"""The page of a fleet: how the fit and the parameters spread, the worst injectors, the failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from commonrail.display.chart import Boxes, Figure, Panel, Series
from commonrail.display.table import Cell, Table
from commonrail.display.text import duration, fixed, listed, number, percent, quantity, significant
from commonrail.files.atomic import write_text
from commonrail.kinds.records import Record
from commonrail.report.draw import figure_html
from commonrail.report.html import render

__all__ = ["fleet_figures", "fleet_html", "fleet_lines", "fleet_tables", "fleet_warnings", "write_fleet_report"]

SHOWN = 100  # failures that the page lists
_QUARTILES = ("minimum", "q1", "median", "q3", "maximum")
_HEADS = ("least", "lower quartile", "median", "upper quartile", "greatest")


def write_fleet_report(folder: Path, record: Record, command: str) -> Path:
    """Write ``report.html`` of a fleet; `command` is the line that continues or repeats it.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    path = folder / "report.html"
    write_text(path, fleet_html(record, command))
    return path


def fleet_html(record: Record, command: str) -> str:
    """The page of a fleet."""
    drawn = enumerate(fleet_figures(record))
    return render(
        "fleet.html",
        record=record,
        lines=fleet_lines(record),
        warnings=fleet_warnings(record),
        tables=fleet_tables(record),
        figures=[(figure, figure_html(figure, f"figure-{i}", 380)) for i, figure in drawn],
        commands=[("Go on with this fleet, or write its results again", command)],
        facts=_facts(record),
    )


def fleet_lines(record: Record) -> list[str]:
    """How many injectors are calibrated, how well, and what the data say of the parameters, in sentences."""
    counts, best, start = record["counts"], record["J"]["best"], record["J"]["start"]
    lines = [f"{counts['finished']} of {_injectors(counts['injectors'])} calibrated, {counts['failed']} failed."]
    if counts["pending"]:
        lines.append(f"{_injectors(counts['pending'])} not done yet: the same command goes on.")
    if best and start:
        lines.append(
            f"J of the fitted data fell from {significant(start['median'])} to {significant(best['median'])} "
            f"(medians); of half the injectors it lies between {significant(best['q1'])} and {significant(best['q3'])}."
        )
    bounded = [p["name"] for p in record["parameters"] if p["at_bound"] > 0.05 * counts["finished"]]
    if bounded:
        lines.append(
            f"At a bound in more than 5 % of the injectors: {listed(bounded)}; widen it if the part allows it."
        )
    return lines


def fleet_warnings(record: Record) -> list[str]:
    """For each kind of warning, how many injectors have it, and the sentence of the first."""
    total = record["counts"]["finished"]
    return [
        f"{w['injectors']:,} of {_injectors(total)}: {w['code']}. The first, {w['first']}: {w['sentence']}"
        for w in record.get("warnings", [])
    ]


def _injectors(count: int) -> str:
    return f"{count:,} injector{'' if count == 1 else 's'}"


def fleet_tables(record: Record) -> list[Table]:
    """Fit of the data sets, parameters, what the data pin down, worst injectors and failures."""
    tables = [_data_table(record), _parameter_table(record), _verdict_table(record), _worst_table(record)]
    return [table for table in (*tables, _failure_table(record)) if table.rows]


def _data_table(record: Record) -> Table:
    rows = []
    for d in record["data"]:
        best = d["best"] or {}
        spread = [significant(best.get(key), 4) for key in _QUARTILES]
        start = significant((d["start"] or {}).get("median"), 4)
        rows.append(_row(d["name"], d["role"], f"{d['measure']}, {_sign(d['unit'])}", d["injectors"], start, *spread))
    columns = ("data set", "role", "error", "injectors", "start, median", *_HEADS)
    note = "Errors of the calibrated injectors; those of the start values in one column."
    return Table("Error of each data set over the fleet", columns, tuple(rows), note, 3)


def _sign(unit: str) -> str:
    return unit.replace("mm3", "mm³")


def _parameter_table(record: Record) -> Table:
    rows = []
    for p in record["parameters"]:
        spread, median = p["best"], p["best"]["median"]
        values = [quantity(spread[key], p["unit"]) for key in _QUARTILES]
        share = percent((spread["q3"] - spread["q1"]) / abs(median) if median else None)
        rows.append(_row(p["name"], *values, share, p["at_bound"]))
    columns = ("parameter", *_HEADS, "between quartiles, %", "at a bound")
    note = "The share is that of the distance between the quartiles in the median; “at a bound” counts injectors."
    return Table("Calibrated parameters over the fleet", columns, tuple(rows), note, 1)


def _verdict_table(record: Record) -> Table:
    total: Counter[str] = Counter()
    for p in record["parameters"]:
        total.update(p["verdicts"])
    verdicts = [verdict for verdict, _ in total.most_common()]
    rows = [_row(p["name"], *(p["verdicts"].get(v, 0) for v in verdicts)) for p in record["parameters"]]
    note = "Number of injectors. What is not pinned down must not be read as a measurement of the part."
    return Table("What the data pin down", ("parameter", *verdicts), tuple(rows), note, 1)


def _worst_table(record: Record) -> Table:
    median = (record["J"]["best"] or {}).get("median")
    rows = []
    for w in record["worst"]:
        best = number(w["J"]["best"])
        times = fixed(best / median if best is not None and median else None, 2)
        rows.append(
            _row(w["injector"], significant(w["J"]["start"]), significant(best), times, listed(w["at_bound"]) or "none")
        )
    columns = ("injector", "J, start", "J, calibrated", "times the median", "parameters at a bound")
    note = "Each has a study of its own in the folder “injectors”, which commonrail calibrate runs to the same result."
    return Table("Worst fits", columns, tuple(rows), note, 1)


def _failure_table(record: Record) -> Table:
    failures = record["failures"]
    rows = tuple(_row(f["injector"], f["reason"]) for f in failures[:SHOWN])
    more = len(failures) - SHOWN
    note = f"{more:,} more are in results.csv." if more > 0 else ""
    return Table("Failures", ("injector", "reason"), rows, note, 2)


def _row(*texts: object) -> tuple[Cell, ...]:
    return tuple(Cell(str(text)) for text in texts)


def fleet_figures(record: Record) -> list[Figure]:
    """J over the share of the fleet, and where between their bounds the parameters lie."""
    return [_cost_figure(record), _position_figure(record)] if record["parameters"] else []


def _cost_figure(record: Record) -> Figure:
    texts = {"start": "start values", "best": "calibrated"}
    series = [_sorted_series(text, look, record["curve"][look]) for look, text in texts.items()]
    values = [v for look in texts for v in record["curve"][look]]
    wide = min(values) > 0.0 and max(values) > 20.0 * min(values)
    return Figure(
        "Objective over the fleet",
        "Injectors sorted by J, for start and calibrated values apart: nine of ten are below the J at 90 %.",
        "share of the injectors, %",
        (Panel("J of the fitted data", tuple(series), logarithmic=wide),),
    )


def _sorted_series(text: str, look: str, values: Sequence[float]) -> Series:
    last = max(len(values) - 1, 1)
    x = tuple(100.0 * i / last for i in range(len(values)))
    return Series(text, look, x, tuple(values), "lines" if len(values) > 1 else "markers")


def _position_figure(record: Record) -> Figure:
    parameters = record["parameters"]
    boxes = tuple(_box(p["position"]) for p in parameters)
    panel = Panel(
        "place between the bounds, %",
        (),
        boxes=(Boxes("calibrated", "best", boxes),),
        categories=tuple(_short_names([p["name"] for p in parameters])),
    )
    return Figure(
        "Calibrated parameters between their bounds",
        "Least, quartiles and greatest over the fleet; 0 % is the lower bound and 100 % the upper one.",
        "parameter",
        (panel,),
    )


def _box(position: Record) -> tuple[float, float, float, float, float]:
    low, q1, median, q3, high = (100.0 * float(position[key]) for key in _QUARTILES)
    return low, q1, median, q3, high


def _short_names(names: Sequence[str]) -> list[str]:
    """Names without their room, where that tells them apart."""
    counts = Counter(name.rpartition(".")[2] for name in names)
    return [short if counts[short := name.rpartition(".")[2]] == 1 else name for name in names]


def _facts(record: Record) -> list[tuple[str, str]]:
    clock = record["clock"]
    each = (clock["core_seconds_of_an_injector"] or {}).get("median")
    return [
        ("Study", f"{record['study']['title']} ({record['study']['file']})"),
        ("Table", record["table"]),
        ("Seed", str(record["seed"])),
        ("Processor time of an injector", f"{duration(each)} (median)"),
        ("Processor time of all injectors", duration(clock["core_seconds"])),
        ("Last run", _last_run(clock)),
        ("Software", ", ".join(f"{name} {version}" for name, version in record["software"].items())),
    ]


def _last_run(clock: Record) -> str:
    if not clock["calibrated_now"]:
        return "nothing was left to calibrate"
    speed = significant(clock["injectors_per_second"], 3)
    workers = f"{clock['workers']} worker{'' if clock['workers'] == 1 else 's'}"
    return f"{_injectors(clock['calibrated_now'])} in {duration(clock['seconds'])} with {workers}, {speed} injectors/s"
