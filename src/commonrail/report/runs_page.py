"""Page of all runs below a folder: courses of J, parameters, curves, and what their studies differ in."""

from __future__ import annotations

import math
import os
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from markupsafe import Markup

from commonrail.base.chart import MARKERS, Figure, Panel, Series, points
from commonrail.base.errors import CommonrailError
from commonrail.base.table import Table, table_from_columns
from commonrail.base.text import MISSING, duration, join_words, quantity_range, significant
from commonrail.calibration.record import CalibrationRecord, read_as
from commonrail.data.records import MICROSECOND, MM3_PER_MS, Traces
from commonrail.report.data.curves import RATE
from commonrail.report.figure import drawings
from commonrail.report.fit.record import of_role, short_names
from commonrail.report.fit.verdict import merits
from commonrail.report.html import render
from commonrail.runs.folder import RESULT, read_run
from commonrail.runs.listing import Run

MOST = 8  # runs in the charts and in the table of differences
WIDTH, HEIGHT = 90.0, 20.0  # of the course of J in the table [px]


class _Read(NamedTuple):
    """Run with its record and curves."""

    run: Run
    record: CalibrationRecord
    traces: Traces


def runs_html(folder: Path, runs: Sequence[Run], path: Path) -> str:
    """Page of runs below a folder, to be written at a path, from which their reports are linked.

    Charts and differences show the first `MOST` finished calibrations.
    """
    tried = {run.folder: _read(run) for run in runs}
    read = {folder: result for folder, result in tried.items() if isinstance(result, _Read)}
    faults = {
        run.folder: fault for run in runs if run.state == "finished" and isinstance(fault := tried[run.folder], str)
    }
    shown = list(read.values())[:MOST]
    drawn = _draw(shown)
    return render(
        "runs.html",
        title=f"Runs in {folder}",
        kind="Overview",
        synthetic=[],
        lines=[_line(runs, len(read), len(shown), len(faults))],
        rows=[_row(run, read.get(run.folder), path, faults.get(run.folder, "")) for run in runs],
        figures=drawn,
        differences=_differences(shown),
        commands=[("Make this page again", shlex.join(["commonrail", "runs", str(folder), "--html", str(path)]))],
        facts=[],
    )


def _draw(shown: Sequence[_Read]) -> list[Any]:
    coordinates = filter(None, [_coordinates(shown)])
    return [*drawings(coordinates, name="parameters"), *drawings(_overlays(shown), 360)]


def _read(run: Run) -> _Read | str:
    """Record and curves of a finished calibration; a sentence with the reason if it cannot be read."""
    try:
        record, traces = read_run(run.folder)
        result = _Read(run, read_as(CalibrationRecord, record), traces)
        _row(run, result, run.folder)  # try the part of this run alone: a fault must not affect other runs
        _draw([result, result])
        _differences([result])
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):  # a record that was changed
        return f"{run.folder / RESULT} is not as a calibration writes it; make it again with `commonrail resume`."
    except CommonrailError as error:
        return str(error)
    return result


def _line(runs: Sequence[Run], read: int, shown: int, faults: int) -> str:
    states = {state: sum(run.state == state for run in runs) for state in dict.fromkeys(run.state for run in runs)}
    counts = join_words([f"{count} {state}" for state, count in states.items()])
    more = f"; charts are of the first {shown} of {read} calibrations with a result" if shown < read else ""
    lost = f"; the results of {faults} cannot be read" if faults else ""
    return f"{len(runs)} runs: {counts}{more}{lost}."


def _row(run: Run, read: _Read | None, path: Path, fault: str = "") -> dict[str, Any]:
    record = None if read is None else read.record
    report = run.folder / "report.html"
    # "./" prevents a folder name such as "a:b" from being read as a URL scheme
    link = f"./{quote(Path(os.path.relpath(report, path.parent)).as_posix())}" if report.is_file() else ""
    tiles = [] if record is None else merits(record.data)
    return {
        "folder": str(run.folder),
        "link": link,
        "state": run.state,
        "generation": f"{run.generation}/{run.generations}",
        "best": significant(run.best, 5) if math.isfinite(run.best) else MISSING,
        "course": _sparkline([g.best for g in record.generations] if record else []),
        "errors": [next((t.figure for t in tiles if t.head == head), MISSING) for head in ("fit", "unseen")],
        "parameters": len(record.parameters) if record else MISSING,
        "time": duration(run.seconds),
        "title": fault or run.title or run.reason,
    }


def _sparkline(values: Sequence[float | None]) -> Markup:
    """Course of the best J, logarithmic, from the left to the right."""
    logs = [math.log10(v) for v in values if v is not None and math.isfinite(v) and v > 0.0]
    if len(logs) < 2:
        return Markup("")
    low, span = min(logs), (max(logs) - min(logs)) or 1.0
    places = (
        f"{WIDTH * i / (len(logs) - 1):.1f} {1.0 + (HEIGHT - 2.0) * (1.0 - (v - low) / span):.1f}"
        for i, v in enumerate(logs)
    )
    return Markup(
        '<svg class="spark" width="{w:g}" height="{h:g}" viewBox="0 0 {w:g} {h:g}" aria-hidden="true">'
        '<path d="M{d}"/></svg>'
    ).format(w=WIDTH, h=HEIGHT, d="L".join(places))


def _coordinates(read: Sequence[_Read]) -> Figure | None:
    """Place between the bounds of each parameter that several runs have, a line for each run."""
    counts = Counter(p.name for result in read for p in result.record.parameters)
    names = [name for name, count in counts.items() if count > 1]
    if not names:
        return None
    series = []
    for i, result in enumerate(read):
        places = {p.name: 100.0 * p.position for p in result.record.parameters}
        if not places.keys() & set(names):
            continue
        rows = tuple(float(n) for n in range(len(names)))
        series.append(Series(_name(result), "solid", tuple(places.get(name) for name in names), rows, MARKERS, i))
    panel = Panel("", tuple(series), rows=tuple(short_names(names).values()))
    caption = "A row for each parameter that several runs have, a marker for each run."
    return Figure("Parameters of the runs", caption, "place between the bounds, %", (panel,))


def _overlays(read: Sequence[_Read]) -> Iterator[Figure]:
    """Calibrated curves of the runs over the measured one, for each data set with a curve that several have."""
    names = dict.fromkeys(name for result in read for name, trace in result.traces.items() if "measured" in trace)
    for name in names:
        having = [
            (i, result) for i, result in enumerate(read) if name in result.traces and "best" in result.traces[name]
        ]
        if len(having) < 2:
            continue
        first = having[0][1].traces[name]
        series = [_curve(first, "measured", "measured", None)]
        series += [_curve(result.traces[name], "best", _name(result), i) for i, result in having]
        caption = f"Calibrated curves; the data are those of {_name(having[0][1])}."
        yield Figure(name, caption, "time, µs", (Panel(RATE, tuple(series)),))


def _curve(trace: Mapping[str, Any], key: str, label: str, family: int | None) -> Series:
    time, rate = points(trace["time_s"] * MICROSECOND), points(trace[key] * MM3_PER_MS)
    mode = MARKERS if len(time) == 1 else "lines"
    return Series(label, "measured" if family is None else "solid", time, rate, mode, family)


def _name(result: _Read) -> str:
    return result.run.folder.name


def _differences(read: Sequence[_Read]) -> Table | None:
    """Settings in which the studies differ: a row for each, a column for each run."""
    stated = [dict(_settings(result.record)) for result in read]
    names = dict.fromkeys(key for settings in stated for key in settings)
    keys = [key for key in names if len({settings.get(key) for settings in stated}) > 1]
    if not keys:
        return None
    columns: list[Any] = [("setting", lambda key: key)]
    columns += [
        (_name(result), lambda key, settings=settings: settings.get(key, MISSING))
        for result, settings in zip(read, stated, strict=True)
    ]
    return table_from_columns("What the studies differ in", keys, columns, "Of parameters their bounds.")


def _settings(record: CalibrationRecord) -> Iterator[tuple[str, str]]:
    yield "injector", f"{record.injector.name}, {record.injector.variant}"
    yield "time step", f"{significant(record.time_step, 4, MICROSECOND)} µs"
    yield "seed", str(record.seed)
    yield "precision", record.precision
    for key, value in record.optimiser.items():
        yield f"optimiser: {key}", str(value)
    yield "data to fit", ", ".join(d["name"] for d in of_role(record.data, "fit"))
    yield "data unseen", ", ".join(d["name"] for d in of_role(record.data, "validation"))
    for p in record.parameters:
        yield p.name, quantity_range(p.lower, p.upper, p.unit, 3)
