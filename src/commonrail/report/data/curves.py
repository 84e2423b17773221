"""Injection curves in reports: tables of J and of injected volume, figures of rate and error, sentences."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.chart import Band, Figure, Panel, Points, Series, points
from commonrail.base.table import BEST_LEGEND, OPERATING_POINT, Part, Table, table_from_parts
from commonrail.base.text import megapascal, number, percent, pressure, to_fixed, to_signed
from commonrail.data.records import (
    JUDGED,
    MEASURED,
    MICROSECOND,
    MM3,
    MM3_PER_MS,
    Record,
    Texts,
    origin_word,
    relative_error,
)
from commonrail.report.data.bands import band_caption
from commonrail.report.data.view import (
    FitError,
    Merit,
    Plotted,
    View,
    by_label,
    column,
    errors_by_label,
    start_words,
    worst_of,
)

FLOWING = 0.1  # share of the largest rate above which fuel flows, whatever the noise [E]
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

    def merit(self, data: Sequence[Record], label: str = JUDGED) -> Merit:
        """Σ |error| over Σ |rate|, less the noise of the samples."""
        worst, of, others = worst_of(data, [_error(d, label) for d in data], lambda e: f"{to_fixed(e, 1, 100.0)} %")
        best, start = (to_fixed(_error(worst, key), 1, 100.0) for key in (label, "start"))
        return Merit(f"{best} %", f"of the rate, {of}{start_words(start, '%')}", others)

    def fit_error(self, data: Record) -> FitError | None:
        """Σ |error| over Σ |rate|, less the noise of the samples."""
        error = _error(data, JUDGED)
        return None if error is None else FitError(error)

    def quantity_merit(self, data: Sequence[Record]) -> Merit | None:
        """Error of the injected volume."""
        errors = [_volume_error(d, JUDGED) for d in data]
        worst, of, others = worst_of(data, errors, lambda error: f"{to_signed(error, 1)} %")
        return Merit(f"{to_signed(_volume_error(worst, JUDGED), 1)} %", f"injected volume, {of}", others)

    def quantities(self, data: Record) -> list[tuple[float, float | None]]:
        """Measured and calibrated volume within the samples [m³]."""
        return [(data["volume"][MEASURED], number(data["volume"].get(JUDGED)))]

    def leading(self, data: Sequence[Record]) -> tuple[str, list[Mapping[str, Any]]]:
        """J of each curve."""
        return "the least J", [d["J"] for d in data]

    def tables(self, data: Sequence[Record], texts: Texts) -> list[Table]:
        """J and injected volume of every curve, by label."""
        simulated_texts = {label: text for label, text in texts.items() if any(self.has(d, label) for d in data)}
        return [_j_table(data, simulated_texts), _volume_table(data, simulated_texts)]

    def compared_tables(self, data: Sequence[Record], labels: Sequence[str]) -> list[Table]:
        """J, relative J and error of the injected volume of every curve, by model."""
        head = Part(("data set", "rail, MPa"), lambda d: (d["name"], megapascal(d["rail_pressure"])))
        errors = errors_by_label(labels, lambda d, k: number(d["J"].get(k)), lambda j: to_fixed(j, 1))
        shares = errors_by_label(labels, lambda d, k: number(d["J_relative"].get(k)), percent)
        volumes = errors_by_label(labels, _volume_error, lambda error: to_signed(error, 1))
        note = f"J is the sum over the samples of |simulated rate − data|. {BEST_LEGEND}"
        relative = f"J over the sum of |data| over the same samples. {BEST_LEGEND}"
        of_volumes = f"Simulated against data. {BEST_LEGEND}"
        return [
            table_from_parts(_J_TITLE, data, (head, errors, _SAMPLES), note, inputs=_INPUTS),
            table_from_parts("J relative to the data, %", data, (head, shares), relative, inputs=_INPUTS),
            table_from_parts(
                "Error of the injected volume, %",
                data,
                (head, _measured_column(data, ", mm³"), volumes),
                of_volumes,
                inputs=_INPUTS,
            ),
        ]

    def figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """Injection curve, data and simulation [mm³/ms], and the errors below, against time [us]."""
        samples = plotted.traces[data["name"]]
        window = _injection_window(samples)
        trace = {label: values[window] for label, values in samples.items()}
        time = points(trace["time_s"] * MICROSECOND)
        measured = trace[MEASURED]
        curves = [Series(origin_word(data), MEASURED, time, points(measured * MM3_PER_MS))]
        errors = []
        for label, model in plotted.models.items():
            if label not in trace:
                continue
            rate, error = (points(y * MM3_PER_MS) for y in (trace[label], trace[label] - measured))
            curves.append(Series(model.text, model.look, time, rate, family=model.family))
            errors.append(Series("", model.look, time, error, family=model.family))
        seen = f" Simulated as the meter “{data['meter']}” shows it." if data.get("meter") else ""
        others = len(errors) > 1 and JUDGED in trace
        cut = " Errors of other models are cut at the range of the calibrated one." if others else ""
        caption = f"Rate of injection; below, simulated − {origin_word(data)}.{cut}{seen} {band_caption(data)}".rstrip()
        about = (np.zeros(len(measured)), measured)
        bands = [(_band(data, window, time, middle),) if "band" in data else () for middle in about]
        panels = (
            Panel(RATE, tuple(curves), 0.66, bands=bands[0]),
            Panel(ERROR, tuple(errors), 0.34, zero_line=True, bands=bands[1], scaled_by=JUDGED),
        )
        return [Figure(_title(data, f"{data['name']} ({data['role']})"), caption, "time, µs", panels)]

    def compared_figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """The same figure; its title lacks the role, which does not matter where nothing is fitted."""
        return [replace(figure, title=_title(data, data["name"])) for figure in self.figures(data, plotted)]


CURVES = CurveView()


def _injection_window(trace: Mapping[str, Floats]) -> slice:
    """Samples of the injection with a quarter of its length to both sides; before and after it no fuel flows."""
    rates = np.array([trace[label] for label in (MEASURED, JUDGED) if label in trace])
    sizes = np.abs(np.nan_to_num(rates)).max(axis=0)
    flowing = np.flatnonzero(sizes > FLOWING * sizes.max())
    if not len(flowing):
        return slice(None)
    room = (flowing[-1] - flowing[0]) // 4 + 1
    return slice(max(flowing[0] - room, 0), flowing[-1] + room + 1)


def _title(data: Record, words: str) -> str:
    """Title of a curve's figure: words, and the operating point as far as the curve's name does not say it.

    `words`: name of the curve, with its role or without.
    """
    name, place = data["name"], []
    if not re.search(r"\d\s*(MPa|bar)", name):
        place.append(pressure(data["rail_pressure"]))
    if not re.search(r"\d\s*(us|µs|ms)", name):
        place.append(f"{data['energising_time'] * MICROSECOND:.0f} µs")
    return ", ".join([words, *place])


_SETS = Part(("data set", "role"), lambda d: (d["name"], d["role"]))
_SAMPLES = column("samples", lambda d: str(d["samples"]))
_INPUTS = (*OPERATING_POINT, "samples")


def _measured_column(data: Sequence[Record], unit: str) -> Part:
    origins = {origin_word(d) for d in data}
    origin = origins.pop() if len(origins) == 1 else "data"
    return column(f"{origin}{unit}", lambda d: to_fixed(d["volume"][MEASURED], 2, MM3))


def _error(data: Record, label: str) -> float | None:
    """Σ |error| over Σ |rate|, less the share of the samples' noise in squares, as independent errors add."""
    share = number(data.get("J_relative", {}).get(label))
    return None if share is None else max(share**2 - data.get("noise_relative", 0.0) ** 2, 0.0) ** 0.5


def _volume_error(data: Record, label: str) -> float | None:
    return relative_error(number(data["volume"].get(label)), data["volume"][MEASURED])


def _j_table(data: Sequence[Record], texts: Texts) -> Table:
    """J of every injection curve, Σ |rate error| over its samples [mm³/ms], by label."""
    parts = (
        _SETS,
        by_label(texts, lambda d, label: to_fixed(d["J"].get(label), 1)),
        column("share, %", lambda d: percent(d["J_relative"].get(JUDGED))),
        column("rail, MPa", lambda d: megapascal(d["rail_pressure"])),
        _SAMPLES,
    )
    note = (
        "J is the sum over the samples of |simulated rate − data|; the share is that of J of "
        f"“{texts[JUDGED]}” in the sum of the data's rates."
    )
    return table_from_parts(_J_TITLE, data, parts, note, 2, _INPUTS)


def _volume_table(data: Sequence[Record], texts: Texts) -> Table:
    """Volume injected within the samples of every curve [mm³], by label."""
    shown = [*texts][::-1]  # calibrated first: a narrow terminal leaves out the last columns

    def simulated(d: Record) -> Iterator[str]:
        for label in shown:
            yield to_fixed(d["volume"].get(label), 2, MM3)
            yield to_signed(_volume_error(d, label), 1)

    parts = (
        _SETS,
        _measured_column(data, ""),
        Part([head for k in shown for head in (texts[k], "error, %")], simulated),
    )
    return table_from_parts("Injected volume, mm³", data, parts, "", 2)


def _band(data: Record, window: slice, time: Points, about: Floats) -> Band:
    """Area of a data set's band [mm³/ms] in a window of its samples, less a course [m³/s] that it is shown about."""
    low, high = (
        np.array([np.nan if v is None else v for v in data["band"][key][window]]) for key in ("lower", "upper")
    )
    return Band(JUDGED, time, points((low - about) * MM3_PER_MS), points((high - about) * MM3_PER_MS))
