"""The page of a sensitivity study: sentences, ranked tables, indices and tornado as bars."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from commonrail.base.chart import Bars, Figure, Panel, Points, Series
from commonrail.base.table import Column, Table, tabulated
from commonrail.base.text import counted, field_unit, percent, quantity, significant
from commonrail.data.records import Record
from commonrail.report.analysis import MARKS, SHOWN, analysis_html, bar_height, interval_bars
from commonrail.report.figure import figure_html
from commonrail.report.fit.rules import Tile
from commonrail.report.presenter import Presenter
from commonrail.report.result_kind import ResultKind

TILES = 5  # outputs named on the first screen
KEYS = ("title", "design", "samples", "ranges", "outputs", "injections", "clock")


def sensitivity_html(record: Record, folder: Path = Path("DIR")) -> str:
    """The page of a sensitivity study; `folder` is its name for the command lines in it."""
    sections = []
    for k, (output, table) in enumerate(zip(record["outputs"], sensitivity_tables(record), strict=True)):
        drawn = []
        for i, figure in enumerate(_figures(record, output)):
            drawn.append((figure, figure_html(figure, f"figure-{k}-{i}", bar_height(len(figure.panels[0].rows)))))
        sections.append((_heading(output), _output_lines(record, output), replace(table, title="By effect"), drawn))
    first = sections[0][-1].pop(0) if sections and sections[0][-1] else None
    return analysis_html(
        "sensitivity.html",
        __package__,
        record,
        folder,
        _facts(record),
        kind="Sensitivity",
        lines=sensitivity_lines(record),
        tiles=_tiles(record),
        first=first and (replace(first[0], title=f"{first[0].title}: {_heading(record['outputs'][0])}"), first[1]),
        sections=sections,
        ranges=_range_table(record),
    )


RESULT = ResultKind("sensitivity.json", "sensitivity", "sensitivity", sensitivity_html, KEYS)


def sensitivity_lines(record: Record) -> list[str]:
    """Sentences on the study as a whole."""
    kind = "Sobol' indices" if record["design"] == "sobol" else "Elementary effects (Morris)"
    base = "base points" if record["design"] == "sobol" else "trajectories"
    lines = [
        f"{kind} of {counted(len(record['ranges']), 'parameter')} on {counted(len(record['outputs']), 'output')}, from "
        f"{record['samples']:,} {base}: {record['injections']:,} simulations. Each parameter varies evenly over its "
        "range, independently of the others.",
        *record["notes"],
    ]
    failed = [o for o in record["outputs"] if o["failed"]["number"]]
    if failed:
        lines.append(
            f"{len(failed)} of the outputs lack simulations; see there. Effects that compare one of them are omitted, "
            "so their figures are those of the part of the ranges in which the simulation succeeds."
        )
    return lines


def _tiles(record: Record) -> list[Tile]:
    """The parameter with the largest effect on each of the first outputs."""
    tiles = []
    for output in record["outputs"][:TILES]:
        best, (_, unit, scale) = output["parameters"][0], field_unit(output["unit"])
        if output["estimated"]:
            is_share = record["design"] == "sobol"
            if is_share:
                words = f"{percent(best['total']['value'], 0)} % of the variance"
            else:
                words = f"{significant(best['magnitude']['value'], 3, scale)} {unit} mean size of its effect"
            heading = _heading({**output, "meaning": output["name"].replace("_", " ")})
            tiles.append(Tile(heading, best["name"], words))
    return tiles


def sensitivity_tables(record: Record) -> list[Table]:
    """Ranked parameters of each output."""
    return [_table(record, output) for output in record["outputs"]]


def sensitivity_figures(record: Record) -> list[Figure]:
    """Figures of all outputs, named by them."""
    return [
        replace(figure, title=f"{figure.title}: {_heading(output)}")
        for output in record["outputs"]
        for figure in _figures(record, output)
    ]


def _heading(output: Record) -> str:
    text = f"{output['meaning'][:1].upper()}{output['meaning'][1:]}"
    return f"{text}, {output['point'].replace(' us', ' µs')}" if output["point"] else text


def _table(record: Record, output: Record) -> Table:
    _, unit, scale = field_unit(output["unit"])
    suffix = f", {unit}" if unit else ""

    def at(key: str) -> Column:
        return (f"at {key}er bound{suffix}".replace("higher", "upper"), lambda row: significant(row[key], 5, scale))

    columns: list[Column] = [("parameter", "name")]
    if output["estimated"] and record["design"] == "sobol":
        columns += [
            ("total, %", lambda row: _interval(row["total"], 100.0)),
            ("alone, %", lambda row: _interval(row["first"], 100.0)),
        ]
    elif output["estimated"]:
        columns += [
            (f"mean size µ*{suffix}", lambda row: _interval(row["magnitude"], scale)),
            (f"mean µ{suffix}", lambda row: _interval(row["effect"], scale)),
            (f"spread σ{suffix}", lambda row: significant(row["spread"], 3, scale)),
        ]
    columns += [at("low"), at("high")]
    rows = output["parameters"][:SHOWN]
    more = len(output["parameters"]) - len(rows)
    note = f"{more} more are in sensitivity.csv." if more else ""
    return tabulated(_heading(output), rows, columns, note)


def _interval(found: Record, scale: float) -> str:
    """Value with its interval; shares, whose scale is 100, in whole tenths of a percent without a sign at zero."""
    numbers = (scale * found[key] for key in ("value", "low", "high"))
    value, low, high = (f"{round(x, 1) + 0.0:.1f}" if scale == 100.0 else significant(x, 3) for x in numbers)
    return f"{value} ({low} to {high})".replace("-", "−")


def _output_lines(record: Record, output: Record) -> list[str]:
    lines = []
    base = output["base"]
    if base is not None:
        lines.append(f"At the reference values: {quantity(base, output['unit'])}.")
    if output["variance"] is not None:
        spread = quantity(output["variance"] ** 0.5, output["unit"], 3)
        lines.append(f"Over the ranges: mean {quantity(output['mean'], output['unit'])}, standard deviation {spread}.")
    first = output["parameters"][0]
    if output["estimated"] and record["design"] == "sobol":
        rest = 1.0 - sum(row["first"]["value"] for row in output["parameters"])
        lines.append(
            f"{first['name']} takes part in {percent(first['total']['value'], 0)} % of the variance and explains "
            f"{percent(first['first']['value'], 0)} % alone. Interactions of all parameters: "
            f"{percent(max(rest, 0.0), 0)} %."
        )
    failed = output["failed"]
    if failed["number"]:
        reasons = " ".join(f"{number:,} × {text}" for text, number in failed["reasons"].items())
        lines.append(
            f"{failed['number']:,} simulations ({percent(failed['share'])} %) have no value, most of them at "
            f"{failed['where']}: {reasons}"
        )
    return [*lines, *filter(None, [output["why_not"], output["missing"]])]


def _figures(record: Record, output: Record) -> list[Figure]:
    return [*filter(None, [_indices(record, output), _tornado(output)])]


def _indices(record: Record, output: Record) -> Figure | None:
    if not output["estimated"]:
        return None
    rows = output["parameters"][:SHOWN]
    names = tuple(row["name"] for row in rows)
    if record["design"] == "sobol":
        bars = (
            interval_bars("takes part in", "start", rows, "total", 100.0),
            interval_bars("alone", "best", rows, "first", 100.0, slot=1),  # beside the total ones
        )
        caption = "Total and first-order Sobol' indices with their bootstrap intervals."
        return Figure(
            "Share of the variance", caption, "share of the variance, %", (Panel("", (), bars=bars, rows=names),)
        )
    _, unit, scale = field_unit(output["unit"])
    bar = interval_bars("mean size of the effects", "start", rows, "magnitude", scale)
    return Figure(
        "Elementary effects",
        "Mean size µ* of the change of the output when a parameter moves over its whole range.",
        f"effect, {unit}" if unit else "effect",
        (Panel("", (), bars=(bar,), rows=names),),
    )


def _tornado(output: Record) -> Figure | None:
    base = output["base"]
    if base is None:
        return None
    _, unit, scale = field_unit(output["unit"])

    def reach(row: Record) -> float:
        return max(0.0 if row[key] is None else abs(row[key] - base) for key in ("low", "high"))

    rows = sorted(output["parameters"], key=reach, reverse=True)[:SHOWN]
    start: Points = (scale * base,) * len(rows)

    def ends(key: str) -> Points:
        return tuple(None if row[key] is None else scale * row[key] for row in rows)

    bars = (
        Bars("at the lower bound", "start", start, ends("low")),
        Bars("at the upper bound", "best", start, ends("high")),
    )
    line = Series("at the reference values", "level", start[:1] * 2, (-0.5, len(rows) - 0.5))
    return Figure(
        "Tornado",
        "One parameter at a time at the ends of its range, all others at their reference values.",
        f"{output['name'].replace('_', ' ')}{f', {unit}' if unit else ''}",
        (Panel("", (line,), bars=bars, rows=tuple(row["name"] for row in rows)),),
    )


def _range_table(record: Record) -> Table:
    columns: list[Column] = [
        ("parameter", "name"),
        ("reference", lambda p: quantity(p["reference"], p["unit"])),
        ("lower", lambda p: quantity(p["lower"], p["unit"])),
        ("upper", lambda p: quantity(p["upper"], p["unit"])),
        ("scale", "scale"),
        ("mark", "mark"),
        ("source", "source"),
    ]
    return tabulated("Ranges of the parameters", record["ranges"], columns, MARKS)


_POLICY = {
    "omit": "effects that compare a failed simulation are omitted and counted",
    "refuse": "the study ends at the first output that lacks a simulation",
}


def _facts(record: Record) -> list[tuple[str, str]]:
    return [
        ("Injector", record["injector"]),
        (
            "Failed simulations",
            f"{_POLICY[record['on_failure']]}; no index above {percent(record['most_failed'], 0)} %",
        ),
        ("Intervals", f"{percent(record['confidence'], 0)} %, bootstrap with {record['resamples']:,} resamples"),
        ("Seed", str(record["seed"])),
        ("Precision", record["precision"]),
    ]


SENSITIVITY = Presenter.of_record(
    lambda record: [record["title"], *sensitivity_lines(record)], sensitivity_tables, sensitivity_figures
)
