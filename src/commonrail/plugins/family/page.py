"""Page of a joint fit: the type with its spreads, errors of each part, differences between the parts."""

from __future__ import annotations

import shlex
from pathlib import Path

from commonrail.base.chart import MARKERS, Figure, Panel, Series
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import command, join_words, quantity, quantity_range, significant, to_fixed
from commonrail.calibration.record import FitRecord, read_as
from commonrail.data.records import Record
from commonrail.plugins.family.file import KIND, TEXTS
from commonrail.plugins.family.run import FAMILY, RECORD
from commonrail.report.figure import drawings, small_drawings
from commonrail.report.fit.figures import figures_of
from commonrail.report.fit.record import Advice, short_names
from commonrail.report.fit.search import convergence_section, search_facts
from commonrail.report.fit.tables import tables_of
from commonrail.report.fit.verdict import baseline_lines, merits
from commonrail.report.html import render
from commonrail.report.result_kind import ResultKind
from commonrail.runs.folder import TRACES
from commonrail.runs.traces import read_traces

FAR = 2.0  # the page names values of parts farther from the type than this many spreads


def _page(record: Record, folder: Path) -> str:
    """Page of a joint fit, with the curves in its folder."""
    data = [
        {**d, "name": f"{part_record['name']}: {d['name']}"}
        for part_record in record["parts"]
        for d in part_record["data"]
    ]
    figures = figures_of(data, TEXTS, read_traces(folder / TRACES))
    type_figures = list(drawings(family_figures(record)))
    fit = read_as(FitRecord, record)
    return render(
        "family.html",
        package=__package__,
        kind="Family",
        record=record,
        synthetic=[record["synthetic"]] if record["synthetic"] else [],
        lines=family_lines(record),
        tables=family_tables(record),
        errors=tables_of(data, TEXTS),
        tiles=[
            tile for part_record in record["parts"] for tile in merits(part_record["data"], f"{part_record['name']}: ")
        ],
        first=type_figures[0] if type_figures else None,
        maps=small_drawings(figures, "map"),
        convergence=convergence_section(fit.generations),
        data=data,
        commands=_commands(record, folder.as_posix()),
        facts=search_facts(fit),
    )


KEYS = ("title", "seed", "status", "synthetic", "objective", "parts", "parameters", "generations")
RESULT = ResultKind(RECORD, KIND, "type", _page, KEYS)


def family_lines(record: Record) -> list[str]:
    """Sentences on the parts, their errors and baselines, and values far from the type."""
    names, members = [part_record["name"] for part_record in record["parts"]], record["members"]
    lines = [f"{len(names)} parts were fitted together: {join_words(names)}."]
    if len(members) > 1:
        costs = join_words([significant(cost, 3) for cost in members])
        lines.append(
            f"{len(members)} parallel searches ended with objectives of {costs}. Between the measured points they "
            "differ more than at these points: the tables show their mean prediction, the type is from the best."
        )
    for part_record in record["parts"]:
        for line in baseline_lines(part_record["data"]):
            lines.append(f"Part {part_record['name']}: {line[:1].lower()}{line[1:]}")
    far = [
        f"{p['name']} of part {part_name} ({pull:+.1f} spreads)"
        for p in record["parameters"]
        for part_name, pull in _pulls(p).items()
        if abs(pull) > FAR
    ]
    if far:
        lines.append(f"More than {FAR:g} spreads from the type: {join_words(far)}.")
    return lines


def _pulls(p: Record) -> dict[str, float]:
    """Distance of each part's value from the type's in spreads."""
    return {
        part_name: (part_value - p["value"]) / p["spread"]
        for part_name, part_value in p["parts"].items()
        if part_value is not None
    }


def family_tables(record: Record) -> list[Table]:
    """Tables of the parameters of type and parts, and of the flow of each part."""
    names = [part_record["name"] for part_record in record["parts"]]
    columns: list[Column] = [
        ("parameter", "name"),
        ("between parts", "relation"),
        ("type", lambda p: quantity(p["value"], p["unit"])),
        ("spread of the next part", lambda p: quantity(p["spread"], p["unit"], 3)),
        ("bounds", lambda p: quantity_range(p["lower"], p["upper"], p["unit"], 3)),
        *((f"part {name}", lambda p, name=name: quantity(p["parts"].get(name), p["unit"])) for name in names),
    ]
    note = (
        "Spread: standard deviation of the next part's value about the type's value. It contains the error of the "
        "type's value and the scatter between parts. Values are lumped parameters of the model, not drawing dimensions."
    )
    tables = [table_from_columns("The type", record["parameters"], columns, note, 2)]
    flows = [part_record for part_record in record["parts"] if part_record["flow_factor"] is not None]
    flow: list[Column] = [
        ("part", "name"),
        ("flow factor", lambda part_record: to_fixed(part_record["flow_factor"], 4)),
    ]
    text = "Effective area of the nozzle's holes relative to the drawing. It belongs to the part, not to the type."
    return [*tables, table_from_columns("Flow of the parts", flows, flow, text)] if flows else tables


def family_figures(record: Record) -> list[Figure]:
    """Distances of the parts' values from the type, for parameters that differ between parts."""
    scattering = [p for p in record["parameters"] if len(set(p["parts"].values())) > 1]
    if not scattering:
        return []
    series = []
    for i, part_record in enumerate(record["parts"]):
        pulls = [_pulls(p).get(part_record["name"]) for p in scattering]
        places = tuple(float(n) for n in range(len(scattering)))
        series.append(Series(f"part {part_record['name']}", "solid", tuple(pulls), places, MARKERS, family=i))
    panel = Panel("", tuple(series), rows=tuple(short_names([p["name"] for p in scattering]).values()))
    caption = "Value of the part minus value of the type, in spreads of the next part. Common parameters are left out."
    return [Figure("Differences between the parts", caption, "distance from the type, spreads", (panel,))]


def _commands(record: Record, run: str) -> list[tuple[str, str]]:
    advice, type_file = Advice.of(run, FAMILY), shlex.quote(f"{run}/type.toml")
    return [
        ("Fit again", command("type", advice.study, "--out", "type.toml")),
        (
            "Best reference points for the next part",
            f"commonrail adapt {type_file} --advise --injector PART.toml",
        ),
        (
            "Model of the next part",
            f"commonrail adapt {type_file} --from POINTS.csv --injector PART.toml --out MODEL.toml",
        ),
        ("Make this report again", advice.of_run("report")),
    ]
