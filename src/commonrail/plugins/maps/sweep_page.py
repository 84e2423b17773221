"""Reports of a sweep, and of energising times that hold the quantity of the second injection."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.chart import BOTH, Figure, Panel, Series, points
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import count_noun, in_print, megapascal, pressure, quantity, significant, to_fixed
from commonrail.base.units import convert
from commonrail.data.records import MICROSECOND, MM3
from commonrail.physics.injector import FUEL_TEMPERATURE
from commonrail.plugins.maps.choices import CellState
from commonrail.plugins.maps.compensation import Compensation
from commonrail.plugins.maps.page import page
from commonrail.plugins.maps.sweep import OPERATING, Sweep, Variable, table_unit, without_number
from commonrail.plugins.maps.table import describe_conditions
from commonrail.report.presenter import Array, Arrays, Presenter, in_common_unit

MOST_FIGURES = 6
SHORT_NAMES = {FUEL_TEMPERATURE: "temperature"}
DWELL = "Dwell: from the end of the first energising to the start of the second."


def sweep_html(swept: Sweep) -> str:
    """Report of a sweep."""
    title = f"Sweep: {swept.injector.name}"
    lines, tables = sweep_lines(swept), sweep_tables(swept)
    return page(title, [swept.injector], lines, sweep_figures(swept), tables, facts=_facts(swept))


def _facts(swept: Sweep) -> list[tuple[str, str]]:
    """Model, and the fixed conditions."""
    base, injector = swept.base, swept.injector
    values = base._asdict() | base.conditions._asdict()
    facts = {name: _format_value(values[name], unit) for name, (unit, _) in OPERATING.items()}
    facts[FUEL_TEMPERATURE] = _format_value(injector.values[FUEL_TEMPERATURE], "K")
    for name in (*(v.name for v in swept.variables), *(() if swept.two else ("first_energising_time", "dwell"))):
        facts.pop(name, None)
    return [
        ("Model", f"{injector.title or injector.name} ({injector.variant.label})"),
        *((name.replace("_", " ").replace(".", " ").capitalize(), text) for name, text in facts.items()),
        ("Time step", _format_value(base.conditions.time_step, "s")),
    ]


def sweep_figures(swept: Sweep) -> list[Figure]:
    """Quantities over the first variable, with the second of two injections first."""
    figures = list(_figures(swept, swept.volume, "Injected quantity"))
    return [*_figures(swept, swept.second, "Quantity of the second injection"), *figures] if swept.two else figures


def sweep_lines(swept: Sweep) -> list[str]:
    """Sentences: varied names, range of the quantities, fused and failed injections."""
    names = [f"{_title(v)} ({count_noun(len(v.values), 'value')})" for v in swept.variables]
    sound = swept.volume[np.isfinite(swept.volume)]
    count = count_noun(swept.volume.size, "combination")
    lines = [f"{count} of {', '.join(names)}: {to_fixed(sound.min(), 2, MM3)} to {to_fixed(sound.max(), 2, MM3)} mm³."]
    if swept.two:
        second, fused = swept.second[np.isfinite(swept.second)], int(swept.fused.sum())
        lines.append(f"{fused} are fused: the needle does not close between the two injections.")
        if len(second):
            low, high = to_fixed(second.min(), 2, MM3), to_fixed(second.max(), 2, MM3)
            lines.append(f"The second injection, total less the first alone, has {low} to {high} mm³.")
    for group in without_number(swept):
        first = ", ".join(f"{_title(v)} {_format_value(group.first[v.name], v.unit)}" for v in swept.variables)
        lacking = "no number"
        if group.alone:
            lacking = "no quantity of the second injection, since the first one alone failed"
        have, which = ("has", "at") if group.combinations == 1 else ("have", "the first at")
        lines.append(f"{group.combinations} of {count} {have} {lacking}, {which} {first}: {group.sentence}")
    return lines


def sweep_tables(swept: Sweep) -> list[Table]:
    """Dwells below which two injections fuse, as far as searched."""
    columns: list[Column] = [
        ("rail pressure, MPa", lambda r: megapascal(r[0])),
        ("dwell, µs", lambda r: to_fixed(r[1], 0, MICROSECOND)),
    ]
    note = f"Found to 1 µs; a dash: fused at the longest dwell of the sweep too, or a simulation failed. {DWELL}"
    table = table_from_columns("Dwell below which the injections fuse", swept.fusion, columns, note, 0)
    return [table] if table.rows else []


def _title(variable: Variable) -> str:
    name = SHORT_NAMES.get(variable.name, variable.name)
    return name if "." in name else name.replace("_", " ")


def _figures(swept: Sweep, volume: Floats, title: str) -> Iterator[Figure]:
    """Curves over the first variable, a line per value of the second, a figure per value of the third."""
    first, others = swept.variables[0], swept.variables[1:]
    volume = volume.reshape(*volume.shape, *(1,) * (3 - volume.ndim))
    rows, parts = int(volume.shape[1]), int(np.prod(volume.shape[2:]))
    unit = table_unit(first.unit)
    x = points(convert(first.values, first.unit, unit))
    for k in range(min(parts, MOST_FIGURES)):
        label = f", {_title(others[1])} {_value(others[1], k)}" if len(others) > 1 else ""
        series = tuple(
            Series(_value(others[0], j) if others else "", "solid", x, points(volume[:, j, k] * MM3), BOTH, j, rows)
            for j in range(rows)
            if np.isfinite(volume[:, j, k]).any()
        )
        caption = f"Each line: {_title(others[0])}." if others else "At the reference density."
        axis = f"{_title(first)}, {in_print(unit)}"
        yield Figure(f"{title}{label}", caption, axis, (Panel("quantity, mm³", series),))


def _value(variable: Variable, index: int) -> str:
    return _format_value(float(variable.values[index]), variable.unit)


def _format_value(value: float, unit: str) -> str:
    """Value of a variable with its unit; temperatures in degrees Celsius, as on the axes."""
    if unit == "K":
        return f"{significant(convert(value, 'K', 'degC'), 4)} °C"
    return quantity(value, unit)


def compensation_html(compensated: Compensation) -> str:
    """Report of energising times that hold quantities over a condition."""
    injector, tables = compensated.alone.injector, [compensation_table(compensated)]
    title = f"{'Second injection' if compensated.first_energising_time else 'Energising times'}: {injector.name}"
    facts = [("Conditions", note) for note in describe_conditions(compensated.alone)]
    return page(
        title, [injector], _compensation_lines(compensated), _compensation_figures(compensated), tables, facts=facts
    )


def _compensation_lines(compensated: Compensation) -> list[str]:
    if compensated.first_energising_time:
        return [
            f"Energising time of the first injection: {to_fixed(compensated.first_energising_time, 0, 1e6)} µs. {DWELL}"
        ]
    return [f"Energising times that deliver each quantity over {_condition(compensated)}."]


def _compensation_figures(compensated: Compensation) -> list[Figure]:
    axes, two = compensated.alone.axes, compensated.first_energising_time > 0.0
    figures = []
    for i in range(min(len(axes.rail_pressure), MOST_FIGURES)):
        times = compensated.energising_time[:, i] - (compensated.alone.inverse.energising_time[i] if two else 0.0)
        series = tuple(
            Series(
                f"{significant(q, 4, MM3)} mm³", "solid", points(compensated.values), points(times[:, j] * 1e6), BOTH, j
            )
            for j, q in enumerate(axes.quantity.tolist())
        )
        what = "Correction of the energising time" if two else "Energising time"
        caption = "Energising time that holds the second quantity, minus that of a single injection." if two else ""
        panel = Panel("correction, µs" if two else "energising time, µs", series, zero_line=two)
        at = pressure(float(axes.rail_pressure[i]))
        figures.append(Figure(f"{what} at {at}", caption, _condition(compensated), (panel,)))
    return figures


def _condition(compensated: Compensation) -> str:
    return f"{_title(compensated.condition)}, {in_print(compensated.unit)}"


def compensation_table(compensated: Compensation) -> Table:
    """Energising times, one row per value of the condition, rail pressure and quantity."""
    axes, two = compensated.alone.axes, compensated.first_energising_time > 0.0
    return table_from_columns(
        f"Energising time of {'the second' if two else 'an'} injection that holds its quantity",
        list(np.ndindex(compensated.energising_time.shape)),
        [
            ("state", lambda p: CellState(int(compensated.inverses[p[0]].state[p[1:]])).name.lower()),
            (_condition(compensated), lambda p: f"{compensated.values[p[0]]:.6g}"),
            ("rail pressure, MPa", lambda p: megapascal(float(axes.rail_pressure[p[1]]))),
            ("quantity, mm³", lambda p: significant(float(axes.quantity[p[2]]), 4, MM3)),
            ("energising time, µs", lambda p: to_fixed(compensated.energising_time[p], 1, MICROSECOND)),
            ("alone, µs", lambda p: to_fixed(compensated.alone.inverse.energising_time[p[1:]], 1, MICROSECOND)),
        ],
        DWELL if two else "Alone: at the model's own value.",
    )


def _arrays(swept: Sweep) -> Arrays:
    axes = tuple(v.name for v in swept.variables)
    values = {
        "injected_volume": in_common_unit(axes, swept.volume, "m3"),
        "opening": in_common_unit(axes, swept.opening, "s"),
    }
    if swept.two:
        values |= {"second_volume": in_common_unit(axes, swept.second, "m3"), "fused": Array(axes, swept.fused)}
    return Arrays({v.name: in_common_unit((v.name,), v.values, v.unit) for v in swept.variables}, values, "Sweep")


SWEEP = Presenter(sweep_lines, sweep_tables, sweep_figures, _arrays)
COMPENSATION = Presenter(
    _compensation_lines, lambda compensated: [compensation_table(compensated)], _compensation_figures
)
