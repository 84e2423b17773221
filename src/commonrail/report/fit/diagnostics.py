"""Charts that say how far a calibration can be trusted: parity, residuals, combinations, profiles, draws, search."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.chart import MARKERS, Band, Figure, HeatMap, Panel, Series, points
from commonrail.base.text import shown_unit, significant, to_signed
from commonrail.calibration.record import CalibrationRecord, ParameterRecord
from commonrail.data.base import DataSet
from commonrail.data.records import JUDGED, MEASURED, MICROSECOND, MM3, Record, Traces, origin_word
from commonrail.report.fit.record import DASHES, by_kind, short_names
from commonrail.report.fit.verdict import scatter_unit

LAGS = 60  # samples over which residuals are compared with themselves
WITHIN = 0.05  # error that the lines of the parity plot mark
ROWS = 12  # combinations in the matrix, the best known first
DRAWS = 300  # points of a pair plot
PAIRED = 4  # parameters of the pair plots: six pairs
FALL = 8.0  # of 2 ln L, up to which profiles are drawn: twice the 95 % limit
COURSES = 7  # parameters whose course is drawn, each in a colour of its own


def names_of(parameters: Sequence[ParameterRecord]) -> dict[str, str]:
    """Short names of the parameters of a calibration."""
    return short_names([p.name for p in parameters])


def parity_figure(data: Sequence[Record]) -> Figure | None:
    """Calibrated over measured quantities of all data sets, with lines at ± 5 %; None of fewer than three."""
    sets = [(d, view.quantities(d)) for view, records in by_kind(data) for d in records]
    series: list[Series] = []
    ends: list[float] = []
    for family, (d, pairs) in enumerate(pair for pair in sets if pair[1]):
        pairs_simulated = [(MM3 * measured, MM3 * q) for measured, q in pairs if q is not None]
        x, y = (tuple(values) for values in zip(*pairs_simulated, strict=True)) if pairs_simulated else ((), ())
        series.append(Series(f"{d['name']} ({d['role']})", MEASURED, x, y, MARKERS, family))
        ends += x
    if len(ends) < 3:
        return None
    line = (0.0, 1.04 * max(ends))
    series += [Series("", "level", line, tuple(f * v for v in line)) for f in (1.0 - WITHIN, 1.0, 1.0 + WITHIN)]
    title = f"Quantities, lines at ± {100.0 * WITHIN:.0f} %"
    caption = "Quantities per stroke; of a curve its volume within the samples."
    origins = dict.fromkeys(map(origin_word, data))
    return Figure(title, caption, f"{' and '.join(origins)}, mm³", (Panel("calibrated, mm³", tuple(series)),))


def autocorrelation_figure(data: Sequence[Record], traces: Traces) -> Figure | None:
    """Autocorrelation of the residuals of each curve over the lag [µs]; None without curves."""
    series: list[Series] = []
    fewest, longest = math.inf, 0.0
    for d in data:
        trace = traces.get(d["name"], {})
        correlation = _autocorrelation(trace[JUDGED] - trace[MEASURED]) if JUDGED in trace else None
        if correlation is None:
            continue
        lags = MICROSECOND * float(np.median(np.diff(trace["time_s"]))) * np.arange(LAGS + 1)
        family = len(series)
        series.append(Series(d["name"], DASHES[family % 4], points(lags), points(correlation), family=family))
        fewest, longest = min(fewest, len(trace["time_s"])), max(longest, float(lags[-1]))
    if not series:
        return None
    limit = 1.96 / math.sqrt(fewest)
    band = Band("level", (0.0, longest), (-limit, -limit), (limit, limit))
    caption = "Of calibrated − data. Shaded: 95 % of white noise; a course beyond it is an error that persists."
    panel = Panel("correlation", tuple(series), zero_line=True, bands=(band,))
    return Figure("Autocorrelation of the residuals", caption, "lag, µs", (panel,))


def _autocorrelation(residuals: Floats) -> Floats | None:
    """Correlation of residuals with those so many samples later, (LAGS + 1,); None of too few, or of none but zero."""
    deviations = residuals[np.isfinite(residuals)]
    deviations = deviations - deviations.mean() if len(deviations) else deviations
    power = float(deviations @ deviations)
    if len(deviations) < 2 * LAGS or not power > 0.0:
        return None
    return np.array([deviations[: len(deviations) - k] @ deviations[k:] / power for k in range(LAGS + 1)])


def loading_matrix(record: CalibrationRecord) -> HeatMap | None:
    """Combinations of parameters that the data determine, best known first; None of a record without them."""
    influence = record.identifiability
    if influence is None:
        return None
    least = 1.0 if scatter_unit(record) == DataSet.residual_unit else 0.0  # a tolerance is as it is stated, or larger
    scatter = max(influence.scatter, least)
    determined = [c for c in influence.combinations if c.singular_value > scatter]
    if not determined:
        return None
    shown, names = determined[:ROWS], names_of(record.parameters)
    used = [name for name in names if any(name in c.weights for c in shown)] or list(names)
    rows = [[c.weights.get(name) for name in used] for c in reversed(shown)]
    more, rest = len(determined) - len(shown), len(names) - len(determined)
    caption = (
        "Each row is a move of parameters, in widths of their bounds, with its standard error by the data alone; "
        f"weights below 0.2 are left out.{f' {more} more are known worse than these.' if more else ''}"
    )
    if rest:
        caption += f" {rest} further combinations are known by priors and bounds alone."
    return HeatMap(
        "Combinations that the data determine",
        caption,
        "parameter",
        "± % of bounds",
        tuple(names[name] for name in used),
        tuple(significant(100.0 * scatter / c.singular_value, 2) for c in reversed(shown)),
        tuple(tuple(row) for row in rows),
        tuple(tuple("" if v is None else to_signed(v, 1) for v in row) for row in rows),
        "1",
        True,
        1.0,
    )


def _axis(name: str, unit: str) -> str:
    """Title of an axis."""
    return f"{name}, {unit}" if unit else name


def pair_figures(
    parameters: Sequence[ParameterRecord], draws: Mapping[str, Floats], best: str = "calibrated"
) -> list[Figure]:
    """Draws of a posterior, a figure for each pair of the parameters that the data see most; `best` labels its best."""
    drawn = {p.name: p for p in by_effect(parameters) if p.name in draws}
    names = names_of(parameters)
    return [_pair((drawn[a], drawn[b]), draws, names, best) for a, b in combinations(list(drawn)[:PAIRED], 2)]


def _pair(
    pair: tuple[ParameterRecord, ParameterRecord], draws: Mapping[str, Floats], names: Mapping[str, str], best: str
) -> Figure:
    every = max(len(draws[pair[0].name]) // DRAWS, 1)
    axes = [shown_unit(p.upper, p.unit) for p in pair]  # the unit in which the upper bound is written
    x, y = (points(factor * draws[p.name][::every]) for p, (_, factor) in zip(pair, axes, strict=True))
    across, up = ((factor * p.best,) for p, (_, factor) in zip(pair, axes, strict=True))
    first, second = (_axis(names[p.name], unit) for p, (unit, _) in zip(pair, axes, strict=True))
    series = Series("draws", "start", x, y, MARKERS), Series(best, "best", across, up, MARKERS)
    return Figure(f"{names[pair[0].name]} and {names[pair[1].name]}", "", first, (Panel(second, series),))


def by_effect(parameters: Sequence[ParameterRecord]) -> list[ParameterRecord]:
    """Parameters, largest effect on the fitted data first."""
    return sorted(parameters, key=lambda p: p.effect or 0.0, reverse=True)


COURSE_CAPTION = f"Below, the best values of the {COURSES} parameters at most that the data see most."


def course_panel(parameters: Sequence[ParameterRecord], course: Floats) -> Iterator[Panel]:
    """Place of the best values between their bounds after each generation (generations, d), of a few parameters."""
    if len(course) < 2 or course.shape[1] != len(parameters):
        return
    names, x = names_of(parameters), tuple(float(i) for i in range(len(course)))
    series = []
    for family, p in enumerate(by_effect(parameters)[:COURSES]):
        places = points(100.0 * (course[:, parameters.index(p)] - p.lower) / (p.upper - p.lower))
        series.append(Series(names[p.name], DASHES[family % 4], x, places, family=family))
    yield Panel("best, % of its bounds", tuple(series))
