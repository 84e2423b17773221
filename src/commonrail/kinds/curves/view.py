"""Injection curves in reports: tables of J and of injected volume, figures of rate and error, sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.display.chart import Figure, Panel, Points, Series
from commonrail.display.table import BEST_LEGEND, Cell, Table, marked, rows_of
from commonrail.display.text import fixed, listed, megapascal, number, percent, pressure, signed
from commonrail.kinds.base import View
from commonrail.kinds.records import (
    JUDGED,
    MEASURED,
    MICROSECOND,
    MM3,
    MM3_PER_MS,
    Models,
    Record,
    Texts,
    Traces,
    origin_of,
    relative_error,
)

__all__ = ["ERROR", "RATE", "CurveView"]

RATE, ERROR = "rate, mm³/ms", "error, mm³/ms"
_J_TITLE = "Error J of the injection curves, mm³/ms"


class CurveView(View):
    """Tables, figures and sentences of injection curves."""

    def has(self, data: Record, label: str) -> bool:
        """True if the model's simulation succeeded."""
        return number(data["J"].get(label)) is not None

    def operating_point(self, data: Record) -> Record:
        """The curve's operating point."""
        return data

    def sentences(self, data: Sequence[Record]) -> list[str]:
        """J of all curves, calibrated against the other models."""
        return [f", {listed([_sentence(d) for d in data])}"]

    def leading(self, data: Sequence[Record]) -> tuple[str, list[Mapping[str, Any]]]:
        """J of each curve."""
        return "the least J", [d["J"] for d in data]

    def tables(self, data: Sequence[Record], texts: Texts) -> list[Table]:
        """J and injected volume of every curve, by label."""
        labels = [label for label in texts if any(self.has(d, label) for d in data)]
        return [_j_table(data, labels, texts), _volume_table(data, labels, texts)]

    def compared_tables(self, data: Sequence[Record], labels: Sequence[str]) -> list[Table]:
        """J, relative J and error of the injected volume of every curve, by model."""
        return [_j_compared(data, labels), _j_relative_compared(data, labels), _volume_compared(data, labels)]

    def figures(self, data: Record, traces: Traces, models: Models) -> list[Figure]:
        """Injection curve, data and simulation [mm³/ms], and the errors below, against time [us]."""
        trace = traces[data["name"]]
        time = _points(trace["time_s"] * MICROSECOND)
        measured = trace[MEASURED]
        curves = [Series(origin_of(data), MEASURED, time, _points(measured * MM3_PER_MS))]
        errors = []
        for label, model in models.items():
            if label not in trace:
                continue
            rate, error = (_points(y * MM3_PER_MS) for y in (trace[label], trace[label] - measured))
            curves.append(Series(model.text, model.look, time, rate, family=model.family))
            errors.append(Series("", model.look, time, error, family=model.family))
        caption = (
            f"Rate of injection, energising time {data['energising_time'] * MICROSECOND:.0f} µs; below, "
            f"simulated − {origin_of(data)}."
        )
        panels = Panel(RATE, tuple(curves), 0.66), Panel(ERROR, tuple(errors), 0.34, zero_line=True)
        title = f"{data['name']} ({data['role']}), {pressure(data['rail_pressure'])}"
        return [Figure(title, caption, "time, µs", panels)]

    def compared_figures(self, data: Record, traces: Traces, models: Models) -> list[Figure]:
        """The same figure; its title lacks the role, which does not matter where nothing is fitted."""
        rail = pressure(data["rail_pressure"])
        title = data["name"] if rail in data["name"] else f"{data['name']}, {rail}"
        return [replace(figure, title=title) for figure in self.figures(data, traces, models)]


def _sentence(data: Record) -> str:
    others = [
        f"{fixed(data['J'][key], 1)} {words}"
        for key, words in (("start", "with the start values"), ("rigid", "as a rigid body"))
        if number(data["J"].get(key)) is not None
    ]
    against = f" against {listed(others)}" if others else ""
    return f"{data['name']} has J = {fixed(data['J'].get(JUDGED), 1)} mm³/ms{against}"


def _j_table(data: Sequence[Record], labels: Sequence[str], texts: Texts) -> Table:
    """J of every injection curve, Σ |rate error| over its samples [mm³/ms], by label."""
    rows = [
        (
            *(d["name"], d["role"], *(fixed(d["J"].get(label), 1) for label in labels)),
            *(percent(d["J_relative"].get(JUDGED)), megapascal(d["rail_pressure"]), str(d["samples"])),
        )
        for d in data
    ]
    note = (
        "J is the sum over the samples of |simulated rate − data|; the share is that of J of "
        f"“{texts[JUDGED]}” in the sum of the data's rates."
    )
    columns = ("data set", "role", *(texts[label] for label in labels), "share, %", "rail, MPa", "samples")
    return Table(_J_TITLE, columns, rows_of(rows), note, 2)


def _volume_table(data: Sequence[Record], labels: Sequence[str], texts: Texts) -> Table:
    """Volume injected within the samples of every curve [mm³], by label."""
    rows = []
    for d in data:
        measured = d["volume"][MEASURED]
        cells = [d["name"], d["role"], fixed(measured, 2, MM3)]
        for label in labels:
            volume = number(d["volume"].get(label))
            cells += [fixed(volume, 2, MM3), signed(relative_error(volume, measured), 1)]
        rows.append(cells)
    heads = [head for label in labels for head in (texts[label], "error, %")]
    return Table("Injected volume, mm³", ("data set", "role", _origin(data), *heads), rows_of(rows), "", 2)


def _j_compared(data: Sequence[Record], labels: Sequence[str]) -> Table:
    rows: list[tuple[str | Cell, ...]] = []
    for d in data:
        errors = marked([number(d["J"].get(label)) for label in labels], lambda j: fixed(j, 1))
        rows.append((*_head(d), *errors, str(d["samples"])))
    note = f"J is the sum over the samples of |simulated rate − data|. {BEST_LEGEND}"
    return Table(_J_TITLE, ("data set", "rail, MPa", *labels, "samples"), rows_of(rows), note)


def _j_relative_compared(data: Sequence[Record], labels: Sequence[str]) -> Table:
    rows: list[tuple[str | Cell, ...]] = []
    for d in data:
        rows.append((*_head(d), *marked([number(d["J_relative"].get(label)) for label in labels], percent)))
    note = f"J over the sum of |data| over the same samples. {BEST_LEGEND}"
    return Table("J relative to the data, %", ("data set", "rail, MPa", *labels), rows_of(rows), note)


def _volume_compared(data: Sequence[Record], labels: Sequence[str]) -> Table:
    rows: list[tuple[str | Cell, ...]] = []
    for d in data:
        measured = d["volume"][MEASURED]
        errors = [relative_error(number(d["volume"].get(label)), measured) for label in labels]
        rows.append((*_head(d), fixed(measured, 2, MM3), *marked(errors, lambda e: signed(e, 1))))
    columns = ("data set", "rail, MPa", f"{_origin(data)}, mm³", *labels)
    return Table("Error of the injected volume, %", columns, rows_of(rows), f"Simulated against data. {BEST_LEGEND}")


def _head(data: Record) -> tuple[str, str]:
    return data["name"], megapascal(data["rail_pressure"])


def _origin(data: Sequence[Record]) -> str:
    origins = {origin_of(d) for d in data}
    return origins.pop() if len(origins) == 1 else "data"


def _points(values: NDArray[np.float64]) -> Points:
    return tuple(float(v) if np.isfinite(v) else None for v in values)
