"""Report of a sensitivity study: sentences, ranked tables, indices and tornado as bars."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from commonrail.base.chart import Bars, Figure, Panel, Points, Series
from commonrail.base.declare import list_facts
from commonrail.base.record import Interval, from_record
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import count_noun, field_unit, percent, quantity, significant
from commonrail.data.records import Record
from commonrail.plugins.sensitivity.file import Effect, OutputSensitivity, Sensitivity
from commonrail.plugins.sensitivity.settings import Design, OnFailure, SensitivitySettings
from commonrail.report.analysis import MARKS, SHOWN, analysis_html, bar_height, interval_bars
from commonrail.report.figure import figure_html
from commonrail.report.fit.rules import Tile
from commonrail.report.parameter_names import describe_parameters
from commonrail.report.presenter import Presenter
from commonrail.report.result_kind import ResultKind

TILES = 5  # outputs on the first screen
LEADING = 3  # parameters that the first sentence names


def sensitivity_html(record: Record, folder: Path = Path("DIR")) -> str:
    """Report of a sensitivity study; `folder` is its name in the command lines shown."""
    result, sections = from_record(Sensitivity, record), []
    for k, (output, table) in enumerate(zip(result.outputs, sensitivity_tables(result), strict=True)):
        drawn = []
        for i, figure in enumerate(_figures(result, output)):
            drawn.append((figure, figure_html(figure, f"figure-{k}-{i}", bar_height(len(figure.panels[0].rows)))))
        sections.append((_heading(output), _output_lines(result, output), replace(table, title="By effect"), drawn))
    first = sections[0][-1].pop(0) if sections and sections[0][-1] else None
    return analysis_html(
        "sensitivity.html",
        __package__,
        record,
        folder,
        _facts(result.settings, result.injector),
        kind="Sensitivity",
        lines=sensitivity_lines(result),
        notes=sensitivity_notes(result),
        tiles=_tiles(result),
        first=first and (replace(first[0], title=f"{first[0].title}: {_heading(result.outputs[0])}"), first[1]),
        sections=sections,
        ranges=table_from_columns("Ranges of the parameters", result.parameters, RANGES, MARKS),
    )


def sensitivity_lines(result: Sensitivity) -> list[str]:
    """Sentences: the parameters with the largest effect on each output, and failed simulations."""
    ranked = [(output, _largest_effects(output)) for output in result.outputs]
    leading = [f"{_heading(output)}: {', '.join(effects[:LEADING])}." for output, effects in ranked[:1] if effects]
    others = [f"{_heading(output, with_point=False)}: {effects[0]}" for output, effects in ranked[1:] if effects]
    lines = [f"Largest effects. {line}" for line in leading] or ["No effect could be estimated."]
    lines += [f"{'; '.join(others)}."] if others else []
    failed = [output for output in result.outputs if output.failed.number]
    if failed:
        lines.append(
            f"Some simulations failed for {count_noun(len(failed), 'output')}: the figures apply to the part of the "
            "ranges in which the simulation succeeds."
        )
    return lines


def sensitivity_notes(result: Sensitivity) -> list[str]:
    """Sentences on the method."""
    sobol = result.settings.design is Design.SOBOL
    kind, base = ("Sobol' indices", "base points") if sobol else ("Elementary effects (Morris)", "trajectories")
    return [
        f"{kind} of {count_noun(len(result.parameters), 'parameter')} on {count_noun(len(result.outputs), 'output')}, "
        f"from {result.settings.samples:,} {base}: {result.injections:,} simulations. Each parameter varies evenly "
        "over its range, independently of the others.",
        *result.notes,
    ]


def _largest_effects(output: OutputSensitivity) -> list[str]:
    """Parameters in words with the sizes of their effects, the largest first; those without an estimate are omitted."""
    texts = describe_parameters(row.name for row in output.parameters)
    sizes = [(texts[row.name], _effect_size(output, row)) for row in output.parameters]
    return [f"{text} {size}" for text, size in sizes if size]


def _effect_size(output: OutputSensitivity, row: Effect) -> str:
    """Share of the variance, or mean size of the effect with its unit; empty without an estimate."""
    _, unit, scale = field_unit(output.output.unit)
    if row.total is not None:
        return f"{percent(row.total.value, 0)} % of the variance"
    return "" if row.magnitude is None else f"{significant(row.magnitude.value, 3, scale)} {unit}".strip()


def _tiles(result: Sensitivity) -> list[Tile]:
    """Parameter with the largest effect on each of the first outputs."""
    tiles = []
    for output in result.outputs[:TILES]:
        best = output.parameters[0]
        text = describe_parameters(row.name for row in output.parameters)[best.name]
        if size := _effect_size(output, best):
            words = size if best.total is not None else f"{size} mean size of its effect"
            tiles.append(Tile(_heading(output), text[:1].upper() + text[1:], words))
    return tiles


def sensitivity_tables(result: Sensitivity) -> list[Table]:
    """Ranked parameters of each output."""
    return [_table(result, output) for output in result.outputs]


def sensitivity_figures(result: Sensitivity) -> list[Figure]:
    """Figures of all outputs, by output."""
    return [
        replace(figure, title=f"{figure.title}: {_heading(output)}")
        for output in result.outputs
        for figure in _figures(result, output)
    ]


def _heading(sensitivity: OutputSensitivity, with_point: bool = True) -> str:
    output = sensitivity.output
    text = output.name.replace("_", " ").capitalize()
    return f"{text}, {output.point.replace(' us', ' µs')}" if output.point and with_point else text


def _table(result: Sensitivity, output: OutputSensitivity) -> Table:
    _, unit, scale = field_unit(output.output.unit)
    suffix = f", {unit}" if unit else ""
    columns: list[Column] = [("parameter", lambda row: row.name)]
    if output.estimated and result.settings.design is Design.SOBOL:
        columns += [
            ("total, %", lambda row: _interval(row.total, 100.0)),
            ("alone, %", lambda row: _interval(row.first, 100.0)),
        ]
    elif output.estimated:
        columns += [
            (f"mean size µ*{suffix}", lambda row: _interval(row.magnitude, scale)),
            (f"mean µ{suffix}", lambda row: _interval(row.effect, scale)),
            (f"spread σ{suffix}", lambda row: significant(row.spread, 3, scale)),
        ]
    columns += [
        (f"at lower bound{suffix}", lambda row: significant(row.low, 5, scale)),
        (f"at upper bound{suffix}", lambda row: significant(row.high, 5, scale)),
    ]
    more = len(output.parameters) - SHOWN
    note = f"{more} more are in sensitivity.csv." if more > 0 else ""
    return table_from_columns(_heading(output), output.parameters[:SHOWN], columns, note)


def _interval(interval: Interval, scale: float) -> str:
    """Value with its interval; shares (scale 100) in tenths of a percent, without a sign at zero."""
    value, low, high = (
        f"{round(scale * x, 1) + 0.0:.1f}" if scale == 100.0 else significant(scale * x, 3) for x in interval
    )
    return f"{value} ({low} to {high})".replace("-", "−")


def _output_lines(result: Sensitivity, output: OutputSensitivity) -> list[str]:
    meaning, unit = output.output.meaning, output.output.unit
    lines = [f"{meaning[:1].upper()}{meaning[1:]}."]
    if output.base is not None:
        lines.append(f"At the reference values: {quantity(output.base, unit)}.")
    if output.variance is not None:
        spread = quantity(output.variance**0.5, unit, 3)
        lines.append(f"Over the ranges: mean {quantity(output.mean, unit)}, standard deviation {spread}.")
    first = output.parameters[0]
    if first.total is not None and first.first is not None:
        rest = 1.0 - sum(row.first.value for row in output.parameters if row.first is not None)
        lines.append(
            f"{first.name} takes part in {percent(first.total.value, 0)} % of the variance and explains "
            f"{percent(first.first.value, 0)} % alone. Interactions of all parameters: "
            f"{percent(max(rest, 0.0), 0)} %."
        )
    failed = output.failed
    if failed.number:
        reasons = " ".join(f"{number:,} × {text}" for text, number in failed.reasons.items())
        lines.append(
            f"{failed.number:,} simulations ({percent(failed.share)} %) have no value, most of them at "
            f"{failed.where}: {reasons}"
        )
    return [*lines, *filter(None, [output.why_not, output.missing])]


def _figures(result: Sensitivity, output: OutputSensitivity) -> list[Figure]:
    return [*filter(None, [_indices(result, output), _tornado(output)])]


def _indices(result: Sensitivity, output: OutputSensitivity) -> Figure | None:
    if not output.estimated:
        return None
    rows = output.parameters[:SHOWN]
    names = tuple(row.name for row in rows)
    if result.settings.design is Design.SOBOL:
        bars = (
            interval_bars("takes part in", "start", [row.total for row in rows], 100.0),
            interval_bars("alone", "best", [row.first for row in rows], 100.0, slot=1),  # next to the total ones
        )
        caption = "Total and first-order Sobol' indices with their bootstrap intervals."
        return Figure(
            "Share of the variance", caption, "share of the variance, %", (Panel("", (), bars=bars, rows=names),)
        )
    _, unit, scale = field_unit(output.output.unit)
    bar = interval_bars("mean size of the effects", "start", [row.magnitude for row in rows], scale)
    return Figure(
        "Elementary effects",
        "Mean size µ* of the change of the output when a parameter moves over its whole range.",
        f"effect, {unit}" if unit else "effect",
        (Panel("", (), bars=(bar,), rows=names),),
    )


def _tornado(output: OutputSensitivity) -> Figure | None:
    base = output.base
    if base is None:
        return None
    _, unit, scale = field_unit(output.output.unit)

    def reach(row: Effect) -> float:
        return max(abs(end - base) for end in (row.low, row.high, base) if end is not None)

    rows = sorted(output.parameters, key=reach, reverse=True)[:SHOWN]
    start: Points = (scale * base,) * len(rows)
    low, high = (
        tuple(None if end is None else scale * end for end in ends)
        for ends in ([row.low for row in rows], [row.high for row in rows])
    )
    bars = (
        Bars("at the lower bound", "start", start, low),
        Bars("at the upper bound", "best", start, high),
    )
    line = Series("at the reference values", "level", start[:1] * 2, (-0.5, len(rows) - 0.5))
    return Figure(
        "Tornado",
        "One parameter at a time at the ends of its range, all others at their reference values.",
        f"{output.output.name.replace('_', ' ')}{f', {unit}' if unit else ''}",
        (Panel("", (line,), bars=bars, rows=tuple(row.name for row in rows)),),
    )


RANGES: list[Column] = [
    ("parameter", lambda p: p.name),
    ("reference", lambda p: quantity(p.reference, p.unit)),
    ("lower", lambda p: quantity(p.lower, p.unit)),
    ("upper", lambda p: quantity(p.upper, p.unit)),
    ("scale", lambda p: p.scale),
    ("mark", lambda p: p.mark),
    ("source", lambda p: p.source),
]
_POLICY = {
    OnFailure.OMIT: "effects that compare a failed simulation are omitted and counted",
    OnFailure.REFUSE: "the study ends at the first output that lacks a simulation",
}


def _facts(settings: SensitivitySettings, injector: str) -> list[tuple[str, str]]:
    policy = f"{_POLICY[settings.on_failure]}; no index above {percent(settings.most_failed, 0)} %"
    intervals = f"{percent(settings.confidence, 0)} %, bootstrap with {settings.resamples:,} resamples"
    return [
        ("Injector", injector),
        ("Failed simulations", policy),
        ("Intervals", intervals),
        *list_facts(settings, ("seed", "precision")),
    ]


SENSITIVITY = Presenter(
    lambda s: [s.title, *sensitivity_lines(s), *sensitivity_notes(s)], sensitivity_tables, sensitivity_figures
)
RESULT = ResultKind("sensitivity.json", "sensitivity", "sensitivity", sensitivity_html)
