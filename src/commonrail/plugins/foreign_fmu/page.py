"""Page of a calibration of an FMU: parameters, errors and courses of each data set, failures in the FMU's own words."""

from __future__ import annotations

from pathlib import Path

from commonrail.base.chart import BOTH, MARKERS, Figure, Panel, Series, points
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import number, quantity, quantity_range, significant
from commonrail.calibration.record import FitRecord, read_as
from commonrail.data.records import Record, origin_of
from commonrail.plugins.foreign_fmu.file import KIND
from commonrail.plugins.foreign_fmu.run import RECORD, STUDY
from commonrail.report.data.view import present
from commonrail.report.figure import drawings
from commonrail.report.fit.record import Advice
from commonrail.report.fit.rules import CARE, GOOD, Tile
from commonrail.report.fit.search import convergence_section, search_facts
from commonrail.report.html import render
from commonrail.report.result_kind import ResultKind

TOLD = 0.1  # tolerances that half the communication step moves a value by


def _page(record: Record, folder: Path) -> str:
    """Page of a calibration of an FMU; `folder` is its name for the command lines in it."""
    figures, advice = list(drawings(fmu_figures(record))), Advice.of(folder.as_posix(), STUDY)
    return render(
        "fmu.html",
        package=__package__,
        kind="FMU",
        record=record,
        synthetic=[record["synthetic"]] if record["synthetic"] else [],
        lines=fmu_lines(record),
        tables=fmu_tables(record),
        tiles=[_tile(data) for data in record["data"]],
        first=figures[0] if figures else None,
        figures=figures[1:],
        convergence=convergence_section(read_as(FitRecord, record).generations),
        data=record["data"],
        commands=[
            ("Run again", f"{advice.calibrate()} --seed {record['seed']}"),
            ("Make this report again", advice.of_run("report")),
        ],
        facts=_facts(record),
    )


KEYS = ("title", "seed", "status", "fmu", "parameters", "objective", "data", "evaluations", "generations")
RESULT = ResultKind(RECORD, KIND, "calibrate", _page, KEYS)


def _tile(data: Record) -> Tile:
    """Error of a data set in its tolerances; at most one is as good as was asked for."""
    best = number(data["rms"]["best"])
    level = "" if best is None else GOOD if best <= 1.0 else CARE
    return Tile(data["name"], f"{significant(best, 3)} tolerances", f"root mean square error, {data['role']}", level)


def fmu_lines(record: Record) -> list[str]:
    """Sentences on the fit of each data set, the search and its failures."""
    lines = []
    for data in record["data"]:
        best, start = (data["rms"][label] for label in ("best", "start"))
        before = "" if start is None else f", {significant(start, 3)} with the start values"
        lines.append(
            f"{data['name']} ({data['role']}): the errors of {data['values']} values have a root mean square of "
            f"{significant(best, 3)} tolerances{before}."
        )
        if start is None:
            lines.append(f"{data['name']}: the FMU failed with the start values.")
    verdict, counts = record.get("convergence"), record["evaluations"]
    if verdict is not None:
        lines.append(f"The search: {verdict['sentence']}.")
    if counts["failed"]:
        lines.append(
            f"{counts['failed']} of {counts['simulated']} candidates failed and could not win; the table of failures "
            "has the reasons."
        )
    lines += record["notes"]
    lines += _step_lines(record)
    bounds = [p["name"] for p in record["parameters"] if p["at_bound"]]
    if bounds:
        lines.append(f"At a bound: {', '.join(bounds)}; the data may ask for a wider range.")
    return lines


def _step_lines(record: Record) -> list[str]:
    """Sentence for each data set whose values depend on the communication step; none of an interrupted search."""
    lines = []
    for data in (data_record for data_record in record["data"] if "half_step" in data_record):
        moved = data["half_step"]
        if moved is None:
            lines.append(f"{data['name']}: with half the communication step the FMU could not be simulated.")
        elif moved >= TOLD:
            lines.append(
                f"{data['name']}: with half the communication step a value moves by {significant(moved, 2)} "
                "tolerances; the parameters have absorbed what the step does. Lower the step until this line is gone."
            )
    return lines


def fmu_tables(record: Record) -> list[Table]:
    """Parameters, errors of the data sets, and failures if there were any."""
    parameters: list[Column] = [
        ("parameter", "name"),
        ("start", lambda p: quantity(p["start"], p["unit"])),
        ("best", lambda p: quantity(p["best"], p["unit"], 6)),
        ("standard error", lambda p: quantity(p["standard_error"], p["unit"], 2)),
        ("bounds", lambda p: quantity_range(p["lower"], p["upper"], p["unit"], 3)),
        ("verdict", "verdict"),
    ]
    note = "Numbers are in the units of the FMU. Standard errors are local, and say nothing about other optima."
    errors: list[Column] = [
        ("data", "name"),
        ("role", "role"),
        ("values", lambda d: str(d["values"])),
        ("simulations", lambda d: str(d["simulations"])),
        ("rms, start", lambda d: significant(d["rms"]["start"], 3)),
        ("rms, best", lambda d: significant(d["rms"]["best"], 3)),
        ("largest, best", lambda d: significant(d["largest"]["best"], 3)),
    ]
    tables = [
        table_from_columns("Parameters", record["parameters"], parameters, note),
        table_from_columns("Errors in tolerances", record["data"], errors, "", 2),
    ]
    failures = record["evaluations"]["failures"]
    if failures:
        columns: list[Column] = [
            ("status", "status"),
            ("candidates", lambda f: str(f["count"])),  # before the texts, which a narrow page cuts
            ("meaning", "sentence"),
            ("first message", lambda f: record["messages"].get(f["status"], "")),
        ]
        tables.append(table_from_columns("Failures", failures, columns, "", 4))
    return tables


def fmu_figures(record: Record) -> list[Figure]:
    """Measured and simulated values of each data set, one panel for each output."""
    figures = []
    for data in record["data"]:
        panels = tuple(_panel(output, origin_of(data)) for output in data["outputs"])
        axis = "time, s" if data["outputs"][0]["axis"] == "time" else "row"
        figures.append(Figure(data["name"], f"Values of {data['name']} ({data['role']}).", axis, panels))
    return figures


def _panel(output: Record, origin: str) -> Panel:
    x = points(output["at"])
    simulated = BOTH if output["axis"] == "row" else "lines"
    series = (
        Series(origin, "measured", x, tuple(output["measured"]), MARKERS),
        Series("start values", "start", x, tuple(output["start"]), simulated),
        Series("calibrated", "best", x, tuple(output["best"]), simulated),
    )
    unit = "" if output["unit"] == "1" else f", {output['unit']}"
    return Panel(f"{output['variable']}{unit}", present(series))


def _facts(record: Record) -> list[tuple[str, str]]:
    moved = [d["half_step"] for d in record["data"] if d.get("half_step") is not None]
    halved = [("With half of it", f"values move by {significant(max(moved), 2)} tolerances at most")] if moved else []
    fmu = record["fmu"]
    return [
        ("FMU", f"{fmu['name']}, FMI {fmu['version']}, SHA-256 {fmu['sha256']}"),
        ("Communication step", f"{significant(record['step'], 6)} s"),
        *halved,
        *search_facts(read_as(FitRecord, record), "simulations"),
    ]
