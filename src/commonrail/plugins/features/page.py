"""Tables of features: of one trace, of repeated shots, and of measured and simulated traces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from commonrail.base.table import Column, Part, Table, table_from_columns, table_from_parts
from commonrail.base.text import MISSING, field_unit, join_words, quantity
from commonrail.plugins.features.file import ComparedFeatures
from commonrail.plugins.features.rate_trace import RATE_UNITS
from commonrail.plugins.features.result import Features, Injection, choose_decimals, feature_unit
from commonrail.plugins.features.shot_statistics import ShotStatistic
from commonrail.plugins.features.table import features_of_traces

Row = tuple[str, int]  # feature and number of the injection
_UNIT, _INJECTION = "unit", "injection"  # a narrow terminal leaves them out before the values


def feature_table(name: str, features: Features) -> Table:
    """Features of one trace, one column per injection."""
    numbers, names = _numbers([features]), features_of_traces()

    def cell(feature: str, number: int) -> str:
        injection, unit = features.of(number), feature_unit(feature, features.unit)
        text = _text(features.value(feature, number), unit)
        error = math.nan if injection is None else injection.standard_errors.get(feature, math.nan)
        return f"{text} ± {_text(error, unit)}" if error > 0.0 and text != MISSING else text

    parts = (
        _head(features.unit),
        Part([f"injection {i}" for i in numbers], lambda row: [cell(row[0], i) for i in numbers]),
    )
    shown = [(name, 0) for name in names if any(math.isfinite(features.value(name, i)) for i in numbers)]
    note = "± one standard error if the noise is independent from sample to sample." if features.noise > 0.0 else ""
    return table_from_parts(f"Features of {name}", shown, parts, note, 2)


def feature_sentences(name: str, features: Features) -> Iterator[str]:
    """Threshold and averaging, and the reasons for missing features."""
    noise = f", noise of a sample {quantity(features.noise, features.unit, 2)}" if features.noise > 0.0 else ""
    yield (
        f"{name}: threshold {quantity(features.levels.threshold, features.unit, 3)}, averaged over "
        f"{quantity(features.levels.width, 's', 3)}{noise}."
    )
    if not features.injections:
        yield f"{name}: {features.status.value}. {features.status.sentence}"
    elif features.silent:
        yield f"{name}: no injection after energising {join_words([str(i) for i in features.silent])}."
    for number, injection in enumerate(features.injections, start=1):
        for status in injection.statuses:
            yield f"{name}, {_which(injection, number, features)}: {status.value}. {status.sentence}"


def _which(injection: Injection, number: int, features: Features) -> str:
    """Name an injection; without an energising by its instant and quantity."""
    if injection.energising or not features.energisings:
        return f"injection {injection.energising or number}"
    unit = RATE_UNITS[features.unit]
    amount = f"{_text(injection['quantity'], unit)} {field_unit(unit).text}"
    return f"injection of {amount} at {_text(injection['opening'], 's')} µs"


def shot_table(statistics: Sequence[ShotStatistic], shots: int) -> Table:
    """Mean and scatter of every feature over repeated shots, with intervals."""

    def interval(statistic: ShotStatistic, edges: tuple[float, float]) -> str:
        return f"{_text(edges[0], statistic.unit)} … {_text(edges[1], statistic.unit)}"

    columns: list[Column] = [
        ("feature", lambda statistic: statistic.name),
        (_UNIT, lambda statistic: field_unit(statistic.unit).text),
        (_INJECTION, lambda statistic: str(statistic.injection)),
        ("mean", lambda statistic: _text(statistic.mean, statistic.unit)),
        ("95 %", lambda statistic: interval(statistic, statistic.mean_interval)),
        ("scatter", lambda statistic: _text(statistic.deviation, statistic.unit, 1)),
        ("95 %", lambda statistic: interval(statistic, statistic.deviation_interval)),
        ("shots", lambda statistic: str(statistic.count)),
        ("apart", lambda statistic: ", ".join(map(str, statistic.outliers)) or MISSING),
    ]
    note = (
        "Scatter: standard deviation of one shot. Intervals by Student's t and by chi-squared. Apart: shots beyond 3.5 "
        "robust standard deviations; they count in the other columns."
    )
    several = len({statistic.injection for statistic in statistics}) > 1
    inputs = (_UNIT if several else _INJECTION,)
    return table_from_columns(f"Features of {shots} shots", statistics, columns, note, 2, inputs)


def comparison_table(pair: ComparedFeatures) -> Table:
    """Features of a measured and of the simulated curve, and simulated − measured."""
    numbers = _numbers([pair.measured, pair.simulated])
    names = features_of_traces()
    rows = [(name, i) for i in numbers for name in names if math.isfinite(pair.measured.value(name, i))]
    word = "synthetic" if pair.synthetic else "measured"

    def cells(row: Row) -> Iterator[str]:
        unit = feature_unit(row[0], pair.measured.unit)
        measured, simulated = pair.measured.value(*row), pair.simulated.value(*row)
        yield from (_text(value, unit) for value in (measured, simulated))
        yield _text(simulated - measured, unit, sign=True)

    parts = (
        _head(pair.measured.unit),
        Part((_INJECTION,), lambda row: (str(row[1]),)),
        Part((word, "simulated", "difference"), cells),
    )
    inputs = (_UNIT,) if len(numbers) > 1 else (_UNIT, _INJECTION)
    return table_from_parts(f"Features of {pair.name} ({pair.role})", rows, parts, "", 2, inputs)


def _head(unit: str) -> Part:
    return Part(("feature", _UNIT), lambda row: (row[0], field_unit(feature_unit(row[0], unit)).text))


def _numbers(features: Sequence[Features]) -> list[int]:
    return list(range(1, max(len(item.energisings or item.injections) for item in features) + 1))


def _text(value: float, unit: str, more: int = 0, *, sign: bool = False) -> str:
    """Number in the unit shown, with `more` decimals than usual."""
    if not math.isfinite(value):
        return MISSING
    text = f"{abs(value * field_unit(unit).factor):.{choose_decimals(unit) + more}f}"
    negative = value < 0.0 and float(text) != 0.0
    return f"{'−' if negative else '+' if sign and float(text) else ''}{text}"
