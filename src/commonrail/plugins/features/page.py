"""Features of traces as tables: of one trace, of repeated shots, and of measured beside simulated ones."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from commonrail.base.table import Column, Part, Table, table_of, tabulated
from commonrail.base.text import MISSING, field_unit, listed, quantity
from commonrail.plugins.features.file import ComparedFeatures
from commonrail.plugins.features.rate_trace import RATE_UNITS
from commonrail.plugins.features.result import Features, Injection, decimals_of, unit_of
from commonrail.plugins.features.shot_statistics import ShotStatistic
from commonrail.plugins.features.table import features_of_traces

Row = tuple[str, int]  # feature and number of the injection


def feature_table(name: str, found: Features) -> Table:
    """Features of one trace, a column for each injection."""
    numbers, names = _numbers([found]), features_of_traces()

    def cell(feature: str, number: int) -> str:
        injection, unit = found.of(number), unit_of(feature, found.unit)
        text = _text(found.value(feature, number), unit)
        error = math.nan if injection is None else injection.standard_errors.get(feature, math.nan)
        return f"{text} ± {_text(error, unit)}" if error > 0.0 and text != MISSING else text

    parts = (
        _head(found.unit),
        Part([f"injection {i}" for i in numbers], lambda row: [cell(row[0], i) for i in numbers]),
    )
    shown = [(name, 0) for name in names if any(math.isfinite(found.value(name, i)) for i in numbers)]
    note = "± one standard error if the noise is independent from sample to sample." if found.noise > 0.0 else ""
    return table_of(f"Features of {name}", shown, parts, note, 2)


def feature_sentences(name: str, found: Features) -> Iterator[str]:
    """Threshold and averaging, and what is missing for which reason."""
    noise = f", noise of a sample {quantity(found.noise, found.unit, 2)}" if found.noise > 0.0 else ""
    yield (
        f"{name}: threshold {quantity(found.levels.threshold, found.unit, 3)}, averaged over "
        f"{quantity(found.levels.width, 's', 3)}{noise}."
    )
    if not found.injections:
        yield f"{name}: {found.status.value}. {found.status.sentence}"
    elif found.silent:
        yield f"{name}: no injection after energising {listed([str(i) for i in found.silent])}."
    for number, one in enumerate(found.injections, start=1):
        for status in one.statuses:
            yield f"{name}, {_which(one, number, found)}: {status.value}. {status.sentence}"


def _which(one: Injection, number: int, found: Features) -> str:
    """Injection in words; one without an energising by its instant and quantity."""
    if one.energising or not found.energisings:
        return f"injection {one.energising or number}"
    unit = RATE_UNITS[found.unit]
    return f"injection of {_text(one['quantity'], unit)} {field_unit(unit).text} at {_text(one['opening'], 's')} µs"


def shot_table(found: Sequence[ShotStatistic], shots: int) -> Table:
    """Mean and scatter of every feature over repeated shots, with intervals."""

    def interval(one: ShotStatistic, edges: tuple[float, float]) -> str:
        return f"{_text(edges[0], one.unit)} … {_text(edges[1], one.unit)}"

    columns: list[Column] = [
        ("feature", lambda one: one.name),
        ("unit", lambda one: field_unit(one.unit).text),
        ("injection", lambda one: str(one.injection)),
        ("mean", lambda one: _text(one.mean, one.unit)),
        ("95 %", lambda one: interval(one, one.mean_interval)),
        ("scatter", lambda one: _text(one.deviation, one.unit, 1)),
        ("95 %", lambda one: interval(one, one.deviation_interval)),
        ("shots", lambda one: str(one.count)),
        ("apart", lambda one: ", ".join(map(str, one.outliers)) or MISSING),
    ]
    note = (
        "Scatter: standard deviation of one shot. Intervals by Student's t and by chi-squared. Apart: shots beyond 3.5 "
        "standard deviations by medians; they count in the other columns."
    )
    return tabulated(f"Features of {shots} shots", found, columns, note, 2)


def compared_table(one: ComparedFeatures) -> Table:
    """Features of a measured and of the simulated curve, and simulated − measured."""
    numbers = _numbers([one.measured, one.simulated])
    names = features_of_traces()
    rows = [(name, i) for i in numbers for name in names if math.isfinite(one.measured.value(name, i))]
    word = "synthetic" if one.synthetic else "measured"

    def cells(row: Row) -> Iterator[str]:
        unit = unit_of(row[0], one.measured.unit)
        measured, simulated = one.measured.value(*row), one.simulated.value(*row)
        yield from (_text(value, unit) for value in (measured, simulated))
        yield _text(simulated - measured, unit, sign=True)

    parts = (
        _head(one.measured.unit),
        Part(("injection",), lambda row: (str(row[1]),)),
        Part((word, "simulated", "difference"), cells),
    )
    return table_of(f"Features of {one.name} ({one.role})", rows, parts, "", 2)


def _head(unit: str) -> Part:
    return Part(("feature", "unit"), lambda row: (row[0], field_unit(unit_of(row[0], unit)).text))


def _numbers(found: Sequence[Features]) -> list[int]:
    return list(range(1, max(len(one.energisings or one.injections) for one in found) + 1))


def _text(value: float, unit: str, more: int = 0, *, sign: bool = False) -> str:
    """Number in the unit that is shown, with `more` decimals than usual."""
    if not math.isfinite(value):
        return MISSING
    text = f"{abs(value * field_unit(unit).factor):.{decimals_of(unit) + more}f}"
    negative = value < 0.0 and float(text) != 0.0
    return f"{'−' if negative else '+' if sign and float(text) else ''}{text}"
