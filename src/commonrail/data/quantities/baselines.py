"""Interpolations as baselines of a validation map, and whether a calibrated model predicts better."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated, Any, NamedTuple

import numpy as np

from commonrail.base.arguments import Limits, amount, array, plain_text, settle
from commonrail.base.arrays import Bools, Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.text import join_words, number, significant, to_fixed
from commonrail.data.records import MM3
from commonrail.data.study_block import Context
from commonrail.physics.law import Domain
from commonrail.readers.columns import Column, FormModel
from commonrail.readers.toml import Unit

# Interpolation of a quantity map: the trivial model that a calibrated one has to beat.

# Exponents of the rail pressure in which an interpolation is linear: p, and √p, which the flow of an orifice follows.
SCALES: Mapping[str, float] = {"p": 1.0, "√p": 0.5}
SAME = 1e-9  # relative difference within which two pressures or times are one
ROUNDING = 1e-18  # sum of squared errors, in tolerances, below which a rule is exact


class Rule(StrEnum):
    """Rule by which quantities are interpolated, in energising time and between rail pressures."""

    LINEAR = "linear"
    PCHIP = "PCHIP"
    """Piecewise cubic with continuous slope that is monotone where the points are (Fritsch and Butland 1984)."""


class Interpolation(NamedTuple):
    """Interpolated values (n,), and which of them are extrapolated (n,)."""

    values: Floats
    extrapolated: Bools


def interpolate(
    measured: Floats, at: Floats, exponent: float = 1.0, rules: tuple[Rule, Rule] = (Rule.LINEAR, Rule.LINEAR)
) -> Interpolation:
    """Quantities by interpolation of known ones: in energising time at each rail pressure, then in pressure.

    For a map that is bilinear in energising time and in the power of the rail pressure all rules are exact. Beyond the
    known points the nearest two are continued as a line, and no quantity is less than zero.

    `measured` (m, 3): rail pressure [Pa], energising time [s] and quantity [m³]; one or more rows. Values at the same
    place are averaged. `at` (n, 2): rail pressures [Pa] and energising times [s] that are asked for. `exponent`: power
    of the rail pressure, see `SCALES`. `rules` (Rule, Rule): in energising time and in pressure.
    """
    in_time, in_pressure = (_RULES[rule] for rule in rules)
    lines = {rail: _line(measured[_near(measured[:, 0], rail), 1:]) for rail in _distinct(measured[:, 0])}
    rails = np.array(sorted(lines))
    values, extrapolated = np.empty(len(at)), np.empty(len(at), bool)
    for i, (rail, time) in enumerate(at.tolist()):
        estimates = [in_time(*lines[float(measured_rail)], time) for measured_rail in rails]
        value, beyond = in_pressure(rails**exponent, np.array([v for v, _ in estimates]), rail**exponent)
        around = [estimates[k][1] for k in _around(rails, rail)]
        values[i], extrapolated[i] = max(value, 0.0), beyond or any(around)
    return Interpolation(values, extrapolated)


def interpolate_line(x: Floats, y: Floats, at: float) -> tuple[float, bool]:
    """Value between the two nearest points, and True if it is extrapolated; one point alone is taken as constant.

    `x` (m,): places, rising. `y` (m,): values there. `at`: place that is asked for.
    """
    outside = not x[0] * (1.0 - SAME) <= at <= x[-1] * (1.0 + SAME)
    if len(x) == 1:
        return float(y[0]), outside
    low, high = _around(x, at)
    return float(y[low] + (at - x[low]) / (x[high] - x[low]) * (y[high] - y[low])), outside


def _interpolate_curve(x: Floats, y: Floats, at: float) -> tuple[float, bool]:
    """As `interpolate_line`, on the monotone cubic between the first and the last of three points or more."""
    from scipy.interpolate import PchipInterpolator  # slow to import

    line, outside = interpolate_line(x, y, at)
    return (line, outside) if outside or len(x) < 3 else (float(PchipInterpolator(x, y)(at)), outside)


def _around(x: Floats, at: float) -> Sequence[int]:
    """Places in x of the two neighbours of a value, or of the nearest two beyond the ends."""
    if len(x) == 1:
        return [0]
    high = int(np.clip(np.searchsorted(x, at), 1, len(x) - 1))
    return [high - 1, high]


def _line(pairs: Floats) -> tuple[Floats, Floats]:
    """Rising places of pairs (m, 2), and the mean value at each."""
    x = _distinct(pairs[:, 0])
    return x, np.array([pairs[_near(pairs[:, 0], place), 1].mean() for place in x])


_RULES: Mapping[Rule, Callable[[Floats, Floats, float], tuple[float, bool]]] = {
    Rule.LINEAR: interpolate_line,
    Rule.PCHIP: _interpolate_curve,
}


def _near(values: Floats, value: float) -> Bools:
    return np.isclose(values, value, rtol=SAME, atol=0.0)


def _distinct(values: Floats) -> Floats:
    """Values in rising order, those within rounding of one another once."""
    rising = np.sort(values)
    return np.asarray(rising[np.concatenate([[True], np.diff(rising) > SAME * rising[1:]])])


# Map of a sister part: the trivial model that knows another part of the type and the ratio of catalogue flows.


class SisterModel(FormModel):
    """A file with the columns rail_pressure, energising_time and quantity of a sister part."""

    file: str
    flow_ratio: Annotated[float, Unit("1")] = 1.0
    source: str = "no source stated"


@dataclass(frozen=True, eq=False)
class Sister:
    """Measured map of another part of the type.

    Parameters
    ----------
    places : (m, 3)
        Rail pressure [Pa], energising time [s] and quantity [m³].
    flow_ratio : float
        Catalogue flow of the fitted part over the catalogue flow of the sister part.
    source : str
        Source of both.

    Raises
    ------
    ConfigurationError
        If the array has another shape or no row, or the ratio is not greater than zero.
    """

    places: Floats
    flow_ratio: float = 1.0
    source: str = "no source stated"

    def __post_init__(self) -> None:
        plain_text(self.source, "source of the sister part")
        places = array(self.places, "1", "places of the sister part", 2)
        if places.shape[1] != 3 or not len(places):
            raise ConfigurationError("The places of a sister part need rows of rail pressure, time and quantity.")
        ratio = amount(self.flow_ratio, "1", "flow_ratio of the sister part", Limits(1e-3, 1e3))
        settle(self, places=places, flow_ratio=ratio)


def read_sister(model: SisterModel, context: Context) -> Sister:
    """Read the map of a sister part.

    The context is `at` the data set that names the map. Raises `InputError` if the file cannot be read. Raises
    `ConfigurationError` if the ratio of the flows is not greater than zero.
    """
    units = {"rail_pressure": "Pa", "energising_time": "s", "quantity": "m3"}
    columns = [Column(name, unit, domain=Domain.NON_NEGATIVE) for name, unit in units.items()]
    at = context.at / "sister"
    table = context.columns(model.file, at, columns, 1, model.form)
    if not model.flow_ratio > 0.0:
        raise (at / "flow_ratio").error("the ratio of the flows must be greater than zero", code="out-of-range")
    return Sister(np.column_stack([table.columns[name] for name in units]), model.flow_ratio, model.source)


RULE = (
    "{in_time} in energising time at each fitted rail pressure, then {in_pressure} in {scale} between rail pressures "
    "(of linear and PCHIP, and of p and √p, those that are closest to this data set); dead times linear in p; beyond "
    "the fitted points the nearest two are continued"
)

_BOTH = tuple(itertools.product(Rule, Rule))  # in energising time and in pressure

# Figures that decide, with what they are called, decimals, factor and unit.
_DECISIVE = (
    ("rms_large_percent", "above {} mm³", 2, 1.0, "%"),
    ("rms_small", "up to {} mm³", 3, MM3, "mm³"),
)


Map = Any  # `QuantityData`, which is made with this module


class Interpolated(NamedTuple):
    """Interpolation: number of known points, rule in words, extrapolated values, quantities [m³] and dead times [s]."""

    fitted_points: int
    rule: str
    extrapolated: int
    values: Floats
    dead_time: Floats


def interpolation_record(model: Any, fitted: Sequence[Any]) -> dict[str, Any] | None:
    """Record of the interpolation of the maps that a model was fitted to; None where that is not possible.

    `model` is its `QuantityScore` on other data, `fitted` holds `QuantityData`.
    """
    interpolation = interpolate_map(model.data, fitted)
    if interpolation is None:
        return None
    return baseline_record(
        model,
        replace(model, values=interpolation.values, dead_time=interpolation.dead_time),
        name="interpolation",
        text=f"interpolating the {interpolation.fitted_points} fitted points",
        rule=interpolation.rule,
        extrapolated=interpolation.extrapolated,
    )


def sister_baseline(model: Any) -> dict[str, Any] | None:
    """Record of the map of a sister part, interpolated and scaled by the catalogue flow; None where none is named.

    `model` is the `QuantityScore` of the calibrated one.
    """
    data: Map = model.data
    if data.sister is None or not _is_plain(data) or not data.judged.any():
        return None
    ratio, places = data.sister.flow_ratio, point_places(data)
    by_rules = {rules: interpolate(data.sister.places, places, rules=rules) for rules in _BOTH}
    (in_time, in_pressure), interpolation = min(
        by_rules.items(), key=lambda item: _closeness(data, ratio * item[1].values)
    )
    return baseline_record(
        model,
        replace(model, values=ratio * interpolation.values, dead_time=np.full(int(data.dead_time.sum()), np.nan)),
        name="sister",
        text=f"the sister part's map times {ratio:.4g}",
        rule=f"{in_time.value} in energising time, then {in_pressure.value} in p, between its points (of linear and "
        f"PCHIP those that are closest to this data set); its source: {data.sister.source}",
        extrapolated=int(np.count_nonzero(interpolation.extrapolated & data.judged)),
    )


def interpolate_map(data: Map, fitted: Sequence[Map]) -> Interpolated | None:
    """Interpolation of fitted maps at the points of another, by the best rule and scale; None where not possible."""
    if not all(_is_plain(d) for d in (data, *fitted)):
        return None
    measured = np.concatenate([np.empty((0, 3)), *(_take_known(d, d.judged) for d in fitted)])
    if not len(measured) or not data.judged.any():
        return None
    dead_time = _dead_times(data, fitted)
    interpolations = []
    for rules, (scale, exponent) in itertools.product(_BOTH, SCALES.items()):
        values, beyond = interpolate(measured, point_places(data), exponent, rules)
        count = int(np.count_nonzero(beyond & data.judged))
        text = RULE.format(in_time=rules[0].value, in_pressure=rules[1].value, scale=scale)
        interpolations.append(Interpolated(len(measured), text, count, values, dead_time))
    return min(interpolations, key=lambda interpolation: _closeness(data, interpolation.values))


def baseline_record(model: Any, baseline: Any, *, text: str, **more: Any) -> dict[str, Any]:
    """Record of a baseline: its figures, whether the model beats it, and a sentence on both.

    Both are `QuantityScore` of one data set. `text` is the baseline as the subject of a sentence, such as
    "interpolating the 21 fitted points", `more` has further keys of the record: "name", "rule", "extrapolated".
    """
    data: Map = model.data
    figures, other = model.figures, baseline.figures
    limit = significant(figures["limit_quantity"], 3, MM3)
    keys = [item for item in _DECISIVE if number(other[item[0]]) is not None]
    worse = [item for item in keys if number(figures[item[0]]) is None or not figures[item[0]] < other[item[0]]]
    pairs = join_words(
        [
            f"{to_fixed(figures[key], decimals, scale)} against {to_fixed(other[key], decimals, scale)} {unit} rms "
            + words.format(limit)
            for key, words, decimals, scale, unit in keys
        ]
    )
    beyond = more.get("extrapolated", 0)
    pairs += f"; {beyond} of its {np.count_nonzero(data.judged)} values are extrapolated" if beyond else ""
    if not worse:
        sentence = f"The model predicts {data.name} better than {text}: {pairs}."
    else:
        those = "these" if len(worse) == len(keys) else f"those {worse[0][1].format(limit)}"
        sentence = f"The model does not beat its baseline on {data.name}: {text} predicts {those} better ({pairs})."
    return {**more, "text": text, "beaten": not worse, "sentence": sentence, "figures": other}


def point_places(data: Map) -> Floats:
    """Rail pressures [Pa] and energising times [s] of the rows, (n, 2)."""
    return np.array([(p.initial_pressures()[0], p.pulses[0].duration) for p in data.points])


def _is_plain(data: Map) -> bool:
    """True if every point has one energising at one rail pressure: what an interpolation knows."""
    return all(len(p.pulses) == 1 for p in data.points)


def _take_known(data: Map, rows: Bools) -> Floats:
    return np.column_stack([point_places(data), data.quantity])[rows]


def _dead_times(data: Map, fitted: Sequence[Map]) -> Floats:
    """Interpolated dead times [s] of the dead-time rows; NaN if no fitted row states the same quantity."""
    measured = np.concatenate([np.empty((0, 3)), *(_take_known(d, d.dead_time) for d in fitted)])
    dead_times = []
    for (rail, _), quantity in zip(point_places(data)[data.dead_time], data.quantity[data.dead_time], strict=True):
        same = measured[np.isclose(measured[:, 2], quantity, rtol=1e-6, atol=0.0)]
        rising = same[np.argsort(same[:, 0])]
        single = len(np.unique(rising[:, 0])) == len(rising) > 0
        dead_times.append(interpolate_line(rising[:, 0], rising[:, 1], rail)[0] if single else np.nan)
    return np.array(dead_times)


def _closeness(data: Map, values: Floats) -> float:
    """Sum of squared errors in tolerances, to nine digits: of rules that differ by rounding the first wins."""
    error = (values - data.quantity) / (data.absolute + data.relative * data.quantity)
    return float(f"{max(np.sum(error[data.judged] ** 2), ROUNDING):.9g}")
