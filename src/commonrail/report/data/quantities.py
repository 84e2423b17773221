"""Quantity maps in reports: tables of errors and of every point, figures over energising time, sentences."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

from commonrail.base.chart import BOTH, LINES, MARKERS, Band, Figure, Panel, Points, Series
from commonrail.base.table import (
    BEST_LEGEND,
    BEST_SIGN,
    SIGNS,
    Cell,
    Part,
    Table,
    judge_size,
    mark_least,
    table_from_parts,
)
from commonrail.base.text import (
    MISSING,
    join_words,
    megapascal,
    number,
    pressure,
    significant,
    to_fixed,
    to_signed,
)
from commonrail.data.records import JUDGED, MEASURED, MICROSECOND, MM3, MPA, Record, Texts, origin_word, relative_error
from commonrail.report.data.bands import band_caption, band_cells, band_name, band_note, error_band
from commonrail.report.data.view import (
    FitError,
    Merit,
    Models,
    Plotted,
    View,
    by_label,
    column,
    errors_by_label,
    present,
    scale_values,
    start_words,
    worst_of,
)

ENERGISING = "energising time, µs"
WIDE = 3  # models of which a row of a map holds quantities and errors; of more only errors
USUAL_LIMIT = 3e-9  # [m³] where a record says none

_STEPS = ((0.05, 0.1), (0.10, 0.3))  # relative, and [mm³] near zero
_LEGEND = "{small} within 5 % or 0.1 mm³, {medium} within 10 % or 0.3 mm³, {large} beyond.".format(**SIGNS)

# Keys of a record's figures, and their text.
_FIGURES: tuple[tuple[str, Callable[[Any], str]], ...] = (
    ("rms_large_percent", lambda value: to_fixed(value, 2)),
    ("rms_small", lambda value: to_fixed(value, 3, MM3)),
    ("dead_time_rms", lambda value: to_fixed(value, 1, MICROSECOND)),
)

Measure = Callable[[float, float], float]  # of an error and the measured quantity [m³]


@dataclass(frozen=True)
class MapView(View):
    """Tables, figures and sentences of maps of a quantity per stroke.

    `of`: word and space before "quantity" and "quantities"; empty for the injected one. `caption`: the
    quantity, as a figure's caption begins.
    """

    of: str = ""
    caption: str = "Injected quantity"

    def operating_point(self, data: Record) -> Record:
        """The last quantity's operating point."""
        last: Record = _quantities(data)[-1]
        return last

    def operating_points(self, data: Record) -> Sequence[Record]:
        """Those of all rows."""
        rows: Sequence[Record] = data["rows"]
        return rows

    def merit(self, data: Sequence[Record], label: str = JUDGED) -> Merit:
        """Root mean square error of the large quantities, or of the small ones where there are no others."""
        keys = ("rms_large_percent", "rms_small")
        merits = filter(None, (_rms(self, data, key, label) for key in keys))
        return next(merits, Merit(MISSING, "no quantity"))

    def fit_error(self, data: Record) -> FitError | None:
        """Root mean square error of the large quantities."""
        percent = number(data["figures"].get(JUDGED, {}).get("rms_large_percent"))
        return None if percent is None else FitError(percent / 100.0, tolerance=data.get("relative_tolerance", 0.0))

    def quantity_merit(self, data: Sequence[Record]) -> Merit | None:
        """Root mean square error of the small quantities, for which percentages say little."""
        return _rms(self, data, "rms_small") if _rms(self, data, "rms_large_percent") else None

    def quantities(self, data: Record) -> list[tuple[float, float | None]]:
        """Measured and calibrated quantities [m³]."""
        return [(row[MEASURED], number(row.get(JUDGED))) for row in _quantities(data)]

    def leading(self, data: Sequence[Record]) -> tuple[str, list[Mapping[str, Any]]]:
        """Errors of the large quantities of each map."""
        what = f"the least error of the {self.of}quantities above {limit_text(data)} mm³"
        return what, [{label: f.get("rms_large_percent") for label, f in d["figures"].items()} for d in data]

    def tables(self, data: Sequence[Record], texts: Texts) -> list[Table]:
        """Root mean squares of all maps, then quantities and dead times of each."""
        tables = [_figures_table(self, data, texts)]
        for d in data:
            simulated_texts = {label: text for label, text in texts.items() if self.has(d, label) and label != "rigid"}
            tables += [_quantity_table(self, d, simulated_texts, texts[JUDGED]), _dead_time_table(d, simulated_texts)]
        return [tables[0], *(table for table in tables[1:] if table.rows)]

    def compared_tables(self, data: Sequence[Record], labels: Sequence[str]) -> list[Table]:
        """Root mean squares of all maps, then quantities and dead times of each."""
        tables = [table for d in data for table in (_compared_table(self, d, labels), _compared_dead_times(d, labels))]
        return [_figures_compared(self, data, labels), *(table for table in tables if table.rows)]

    def figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """Quantities with their errors, and dead times; a rigid body is not shown."""
        shown = {label: model for label, model in plotted.models.items() if label in ("start", JUDGED)}
        return [_map_figure(self, data), *_dead_time_figure(data, shown)]

    def compared_figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """Quantities, their errors, and dead times, of each model."""
        models = plotted.models
        figures = [_map_compared(self, data, models), _errors_compared(self, data, models)] if _quantities(data) else []
        return [*figures, *_dead_time_figure(data, models)]


QUANTITIES, RETURNS = MapView(), MapView("return ", "Return quantity")


def _rms(view: MapView, data: Sequence[Record], key: str, model: str = JUDGED) -> Merit | None:
    """Figure of merit from the root mean squares of some maps; None if none has it."""
    unit, scale, decimals, side = ("%", 1.0, 1, "above") if key == "rms_large_percent" else ("mm³", MM3, 2, "up to")
    errors = {d["name"]: number(d["figures"].get(model, {}).get(key)) for d in data}
    judged = [d for d in data if errors[d["name"]] is not None]
    if not judged:
        return None
    worst, of, others = worst_of(
        judged, [errors[d["name"]] for d in judged], lambda error: f"{to_fixed(error, decimals, scale)} {unit}"
    )
    start = to_fixed(worst["figures"].get("start", {}).get(key), decimals, scale)
    words = f"rms of the {view.of}quantities {side} {limit_text(data)} mm³{start_words(start, unit)}"
    place = f", {of}" if others else ""
    return Merit(f"{to_fixed(errors[worst['name']], decimals, scale)} {unit}", f"{words}{place}", others)


def _figures_table(view: MapView, data: Sequence[Record], texts: Texts) -> Table:
    rows: list[tuple[Record, str, Record]] = []
    for d in data:
        rows += [(d, texts[label], d["figures"].get(label, {})) for label in texts if view.has(d, label)]
        rows += [(d, baseline["text"], baseline["figures"]) for baseline in d.get("baselines", ())]
    parts = (
        Part(("data set", "role", "model"), lambda row: (row[0]["name"], row[0]["role"], row[1])),
        column(f"{view.of}quantities", lambda row: str(len(_quantities(row[0])))),
        Part(_figure_heads(data), lambda row: [text(row[2].get(key)) for key, text in _FIGURES]),
    )
    return table_from_parts(f"Errors of the {view.of}quantity maps", rows, parts, _rules(data), 3)


def _figures_compared(view: MapView, data: Sequence[Record], labels: Sequence[str]) -> Table:
    rows = []
    for d in data:
        figures = [d["figures"].get(label, {}) for label in labels]
        columns = [mark_least([number(f.get(key)) for f in figures], text) for key, text in _FIGURES]
        rows += [(d, label, cells) for label, *cells in zip(labels, *columns, strict=True)]
    parts = (
        Part(("data set", "model"), lambda row: (row[0]["name"], row[1])),
        column(f"{view.of}quantities", lambda row: str(len(_quantities(row[0])))),
        Part(_figure_heads(data), lambda row: row[2]),
    )
    failing = "A model that fails at one point has no figure over the points."
    note = f"{BEST_SIGN} least error of the data set. {failing}"
    return table_from_parts(f"Errors of the {view.of}quantity maps", rows, parts, note, 2)


def _quantity_table(view: MapView, data: Record, texts: Texts, judged: str) -> Table:
    """Quantities point by point, start and calibrated against measured."""

    def errors(row: Record) -> tuple[str, Cell]:
        measured, best = row[MEASURED], number(row.get(JUDGED))
        error = None if best is None else (best - measured) * MM3
        share = to_signed(relative_error(best, measured), 1)
        return to_signed(error, 2), Cell(share, error_size(error, measured * MM3))

    shown = by_label(texts, lambda row, label: to_fixed(row.get(label), 2, MM3))
    parts = [*_head(origin_word(data)), shown, Part(("error", "error, %"), errors)]
    note = f"Errors are {judged} − {origin_word(data)}. {_LEGEND}"
    if "band" in data:
        parts.append(Part((f"{band_name(data)}, ±",), band_cells))
        note += f" {band_note(data)}"
    title = f"{_title(view)}, mm³: {data['name']} ({data['role']})"
    return table_from_parts(title, _quantities(data), parts, note, 0)


def _compared_table(view: MapView, data: Record, labels: Sequence[str]) -> Table:
    """Quantities point by point: quantities and errors of few models, errors of many."""
    wide = len(labels) <= WIDE

    def shown(row: Record) -> Iterator[Cell]:
        measured = float(row[MEASURED])
        values = [number(row.get(label)) for label in labels]
        errors = mark_least([relative_error(value, measured) for value in values], lambda e: to_signed(e, 1))
        for value, error in zip(values, errors, strict=True):
            if wide:
                yield Cell(to_fixed(value, 2, MM3))
            absolute = None if value is None else (value - measured) * MM3
            yield Cell(error.text, error_size(absolute, measured * MM3), error.best)

    heads = [head for label in labels for head in ((label, "error, %") if wide else (label,))]
    title = f"{_title(view)}, mm³" if wide else f"Errors of the {view.of}quantities, %"
    note = f"Errors are simulated − {origin_word(data)}. {_LEGEND} {BEST_LEGEND}"
    parts = (*_head(f"{origin_word(data)}, mm³"), Part(heads, shown))
    return table_from_parts(f"{title}: {data['name']}", _quantities(data), parts, note, 0)


def _map_figure(view: MapView, data: Record) -> Figure:
    """Quantities [mm³] and errors of the calibrated ones, a family for each rail pressure, over energising time [us].

    Errors are in percent above a quantity, and in mm³ up to it.
    """
    limit = float(data["figures"].get(JUDGED, {}).get("limit_quantity", USUAL_LIMIT))
    series: list[Series] = []
    errors: tuple[list[Series], list[Series]] = ([], [])
    bands: tuple[list[Band], list[Band], list[Band]] = ([], [], [])
    parts = _by_pressure(data)
    for family, (rail, rows) in enumerate(parts.items()):
        x, step = scale_values(rows, "energising_time", MICROSECOND), (family, len(parts))
        series += [Series("", label, x, scale_values(rows, label, MM3), LINES, *step) for label in ("start", JUDGED)]
        series.append(Series(pressure(rail), MEASURED, x, scale_values(rows, MEASURED, MM3), MARKERS, *step))
        over, under = _split_at(limit, rows)
        for error_series, judged_rows, measure in zip(errors, (over, under), (_percent, _absolute), strict=True):
            error_series.append(Series("", JUDGED, *_errors(judged_rows, JUDGED, measure), MARKERS, *step))
        if "band" in data:
            bands[0].append(error_band(rows, family, lambda value, _: value * MM3, JUDGED, len(parts)))
            bands[1].append(error_band(over, family, _percent, ordered=len(parts)))
            bands[2].append(error_band(under, family, _absolute, ordered=len(parts)))
    shown = [Panel(f"{view.of}quantity, mm³", tuple(series), 0.5, bands=tuple(bands[0]))]
    for error_series, share, unit, around in zip(errors, (0.3, 0.2), ("%", "mm³"), bands[1:], strict=True):
        if any(item.x for item in error_series):
            shown.append(Panel(f"error, {unit}", tuple(error_series), share, zero_line=True, bands=tuple(around)))
    text = f"{limit * MM3:.3g} mm³"
    caption = (
        f"{view.caption}: markers {origin_word(data)}, solid lines calibrated, dotted lines start values. Errors, "
        f"calibrated − {origin_word(data)}: in percent above {text}, in mm³ up to it. {band_caption(data)}"
    )
    return Figure(f"{data['name']} ({data['role']})", caption.rstrip(), ENERGISING, tuple(shown))


def _map_compared(view: MapView, data: Record, models: Models) -> Figure:
    """Quantity [mm³] against energising time [us]; each model draws a line for each rail pressure."""
    parts = _by_pressure(data)
    rails = list(dict.fromkeys(map(megapascal, parts)))
    x = _with_gaps(parts, "energising_time", MICROSECOND)
    series = [
        Series(model.text, model.look, x, _with_gaps(parts, label, MM3), family=model.family)
        for label, model in models.items()
    ]
    measured = Series(origin_word(data), MEASURED, x, _with_gaps(parts, MEASURED, MM3), MARKERS)
    return Figure(
        data["name"],
        f"{view.caption}: markers {origin_word(data)}; each model has a line for each rail pressure "
        f"({join_words(rails)} MPa).",
        ENERGISING,
        (Panel(f"{view.of}quantity, mm³", (*present(series), measured)),),
    )


def _errors_compared(view: MapView, data: Record, models: Models) -> Figure:
    """Errors of the quantities, in percent for large ones and in mm³ for small ones."""
    limit = float(next((f["limit_quantity"] for f in data["figures"].values()), USUAL_LIMIT))
    over, under = _split_at(limit, _sort_quantities(data))
    large, small = (
        present([Series(m.text, m.look, *_errors(rows, k, measure), MARKERS, m.family) for k, m in models.items()])
        for rows, measure in ((over, _percent), (under, _absolute))
    )
    panels = [Panel("error, %", large, 0.6, zero_line=True)] if over else []
    panels += [Panel("error, mm³", _drop_labels(small, large), 0.4, zero_line=True)] if under else []
    return Figure(
        f"Errors of {data['name']}",
        f"Simulated − {origin_word(data)}: in percent above {limit * MM3:.3g} mm³, in mm³ up to it; "
        "all rail pressures.",
        ENERGISING,
        tuple(panels),
    )


def _title(view: MapView) -> str:
    words = f"{view.of}quantities"
    return words[0].upper() + words[1:]


def error_size(error: float | None, measured: float) -> str:
    """Size of an error of a quantity [mm³]: relative, or absolute near zero."""
    return judge_size(error, [max(rel * abs(measured), ab) for rel, ab in _STEPS])


def limit_text(data: Sequence[Record]) -> str:
    """Quantity [mm³] above which errors are judged in percent."""
    limits = [f["limit_quantity"] for d in data for f in d["figures"].values()]
    return significant(limits[0], 3, MM3) if limits else "3"


def _figure_heads(data: Sequence[Record]) -> tuple[str, str, str]:
    limit = limit_text(data)
    return f"above {limit} mm³, % rms", f"up to {limit} mm³, mm³ rms", "dead time, µs rms"


def _rules(data: Sequence[Record]) -> str:
    """Sentences on the rules of the baselines."""
    rules = (f"{baseline['text']}: {baseline['rule']}" for d in data for baseline in d.get("baselines", ()))
    return " ".join(f"{rule[0].upper()}{rule[1:]}." for rule in dict.fromkeys(rules))


def _quantities(data: Record) -> list[Record]:
    """Rows that are quantities, with the half width of their band if there is one."""
    rows = data["rows"]
    halves = data["band"]["half_widths"] if "band" in data else [None] * len(rows)
    return [{**row, "band": half} for row, half in zip(rows, halves, strict=True) if not row["dead_time"]]


def _head(origin: str) -> tuple[Part, ...]:
    return (
        column("rail, MPa", lambda row: megapascal(row["rail_pressure"])),
        column(ENERGISING, lambda row: to_fixed(row["energising_time"], 0, MICROSECOND)),
        column(origin, lambda row: to_fixed(row[MEASURED], 2, MM3)),
    )


def _sort_quantities(data: Record) -> list[Record]:
    """Rows that are quantities, by rail pressure and energising time."""
    return sorted(_quantities(data), key=lambda row: (float(row["rail_pressure"]), float(row["energising_time"])))


def _by_pressure(data: Record) -> dict[float, list[Record]]:
    """Rows that are quantities, by rail pressure [Pa], each in the order of energising time."""
    return {
        float(rail): list(rows) for rail, rows in groupby(_sort_quantities(data), key=lambda row: row["rail_pressure"])
    }


def _with_gaps(parts: Mapping[float, list[Record]], key: str, scale: float) -> Points:
    """Values with a gap between rail pressures."""
    return tuple(value for rows in parts.values() for value in (*scale_values(rows, key, scale), None))[:-1]


def _split_at(limit: float, rows: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Rows above a quantity [m³], and those up to it."""
    return [row for row in rows if row[MEASURED] > limit], [row for row in rows if row[MEASURED] <= limit]


def _errors(rows: list[Record], label: str, measure: Measure) -> tuple[Points, Points]:
    """Energising times [us], and a measure of simulated − measured at each."""
    pairs = ((number(row.get(label)), float(row[MEASURED])) for row in rows)
    errors = tuple(None if value is None else measure(value - m, m) for value, m in pairs)
    return scale_values(rows, "energising_time", MICROSECOND), errors


def _percent(error: float, measured: float) -> float:
    return 100.0 * error / measured


def _absolute(error: float, measured: float) -> float:
    return error * MM3


def _drop_labels(series: Sequence[Series], labelled: Sequence[Series]) -> tuple[Series, ...]:
    """Series of a second panel: one entry in the legend for each model is enough."""
    labels = {s.label for s in labelled}
    return tuple(replace(s, label="") if s.label in labels else s for s in series)


# Dead times: energising times at which a small quantity is reached.

_DEAD_TIME_STEPS = (10.0, 20.0)  # [us]
_DEAD_TIME_LEGEND = "{small} within 10 µs, {medium} within 20 µs, {large} beyond.".format(**SIGNS)


def _dead_times(data: Record) -> list[Record]:
    """Rows of a map that are dead times."""
    return [row for row in data["rows"] if row["dead_time"]]


def _dead_time_table(data: Record, texts: Texts) -> Table:
    """Dead times of one map and the error of the calibrated model."""

    def error(row: Record) -> list[Cell]:
        error = _dead_time_error(row, JUDGED)
        return [Cell(to_signed(error, 1), judge_size(error, _DEAD_TIME_STEPS))]

    shown = by_label(texts, lambda row, label: to_fixed(row.get(label), 1, MICROSECOND))
    title = f"Dead times, µs: {data['name']} ({data['role']})"
    note = f"Energising time at which the quantity is reached. {_DEAD_TIME_LEGEND}"
    parts = (*_dead_time_head(origin_word(data)), shown, Part(("error",), error))
    return table_from_parts(title, _dead_times(data), parts, note, 0)


def _compared_dead_times(data: Record, labels: Sequence[str]) -> Table:
    """Errors of the dead times of one map, by model."""
    note = (
        "The dead time is the energising time at which the quantity is reached; errors are simulated − "
        f"{origin_word(data)}. {_DEAD_TIME_LEGEND} {BEST_LEGEND}"
    )
    errors = errors_by_label(labels, _dead_time_error, lambda error: to_signed(error, 1), _DEAD_TIME_STEPS)
    parts = (*_dead_time_head(f"{origin_word(data)}, µs"), errors)
    return table_from_parts(f"Errors of the dead times, µs: {data['name']}", _dead_times(data), parts, note, 0)


def _dead_time_figure(data: Record, models: Models) -> list[Figure]:
    """Dead times [us] against rail pressure [MPa], if there are two or more."""
    rows = sorted(_dead_times(data), key=lambda row: float(row["rail_pressure"]))
    if len(rows) < 2:
        return []
    x = scale_values(rows, "rail_pressure", MPA)
    lines = [
        Series(model.text, model.look, x, scale_values(rows, label, MICROSECOND), BOTH, model.family)
        for label, model in models.items()
    ]
    marks = Series(origin_word(data), MEASURED, x, scale_values(rows, MEASURED, MICROSECOND), MARKERS)
    title, caption = (
        f"Dead times of {data['name']}",
        "Energising time at which the injector delivers the stated small quantity.",
    )
    return [Figure(title, caption, "rail pressure, MPa", (Panel("dead time, µs", (*present(lines), marks)),))]


def _dead_time_head(origin: str) -> tuple[Part, ...]:
    return (
        column("rail, MPa", lambda row: megapascal(row["rail_pressure"])),
        column("quantity, mm³", lambda row: significant(row.get("quantity"), 3, MM3)),
        column(origin, lambda row: to_fixed(row[MEASURED], 0, MICROSECOND)),
    )


def _dead_time_error(row: Record, label: str) -> float | None:
    """Error [us] of a model."""
    value = number(row.get(label))
    return None if value is None else (value - row[MEASURED]) * MICROSECOND
