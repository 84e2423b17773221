"""Trivial models beside a validation map, and whether a calibrated one predicts better."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from commonrail.arrays import Bools, Floats
from commonrail.display.text import fixed, listed, number, significant
from commonrail.engine.operating_point import OperatingPoint
from commonrail.kinds.maps.interpolation import SCALES, Rule, interpolate, interpolate_line
from commonrail.kinds.maps.sister import Sister
from commonrail.kinds.records import MM3

__all__ = ["baseline_record", "Interpolated", "interpolated", "interpolated_baseline", "places_of", "sister_baseline"]


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


class Map(Protocol):
    """Quantity map as a baseline reads it."""

    @property
    def name(self) -> str: ...

    @property
    def points(self) -> tuple[OperatingPoint, ...]: ...

    @property
    def quantity(self) -> Floats: ...

    @property
    def absolute(self) -> float: ...

    @property
    def relative(self) -> float: ...

    @property
    def dead_time(self) -> Bools: ...

    @property
    def sister(self) -> Sister | None: ...
    @property
    def judged(self) -> Bools: ...

    def scored(self, quantity: Floats, dead_time: Floats) -> Any: ...

    def figures_of(self, score: Any) -> dict[str, float | None]: ...


class Interpolated(NamedTuple):
    """An interpolation: number of known points, its rule in words, extrapolated values, and its score."""

    known: int
    rule: str
    extrapolated: int
    score: Any


def interpolated_baseline(data: Map, fitted: Sequence[Map], model: Any) -> dict[str, Any] | None:
    """Record of the interpolation of fitted maps at the points of another; None where that is not possible.

    Parameters
    ----------
    data : QuantityData
        Validation map.
    fitted : sequence of QuantityData
        Maps that the model was fitted to.
    model : QuantityScore
        Of the calibrated model.
    """
    found = interpolated(data, fitted)
    if found is None:
        return None
    return baseline_record(
        data,
        model,
        found.score,
        name="interpolation",
        text=f"interpolating the {found.known} fitted points",
        rule=found.rule,
        extrapolated=found.extrapolated,
    )


def sister_baseline(data: Map, model: Any) -> dict[str, Any] | None:
    """Record of the map of a sister part, interpolated and scaled by the catalogue flow; None where none is named.

    Parameters
    ----------
    data : QuantityData
        Validation map.
    model : QuantityScore
        Of the calibrated model.
    """
    if data.sister is None or not _is_plain(data) or not data.judged.any():
        return None
    ratio, places = data.sister.flow_ratio, places_of(data)
    by_rules = {rules: interpolate(data.sister.places, places, rules=rules) for rules in _BOTH}
    (in_time, in_pressure), found = min(by_rules.items(), key=lambda one: _closeness(data, ratio * one[1].values))
    score = data.scored(ratio * found.values, np.full(int(data.dead_time.sum()), np.nan))
    return baseline_record(
        data,
        model,
        score,
        name="sister",
        text=f"the sister part's map times {ratio:.4g}",
        rule=f"{in_time.value} in energising time, then {in_pressure.value} in p, between its points (of linear and "
        f"PCHIP those that are closest to this data set); its source: {data.sister.source}",
        extrapolated=int(np.count_nonzero(found.extrapolated & data.judged)),
    )


def interpolated(data: Map, fitted: Sequence[Map]) -> Interpolated | None:
    """Interpolation of fitted maps at the points of another, by the best rule and scale; None where not possible.

    Parameters
    ----------
    data : QuantityData
    fitted : sequence of QuantityData
    """
    if not all(_is_plain(d) for d in (data, *fitted)):
        return None
    known = np.concatenate([np.empty((0, 3)), *(_known(d, d.judged) for d in fitted)])
    if not len(known) or not data.judged.any():
        return None
    dead_time = _dead_times(data, fitted)
    found = []
    for rules, (scale, exponent) in itertools.product(_BOTH, SCALES.items()):
        values, beyond = interpolate(known, places_of(data), exponent, rules)
        count = int(np.count_nonzero(beyond & data.judged))
        text = RULE.format(in_time=rules[0].value, in_pressure=rules[1].value, scale=scale)
        found.append(Interpolated(len(known), text, count, data.scored(values, dead_time)))
    return min(found, key=lambda one: _closeness(data, one.score.quantity))


def baseline_record(data: Map, model: Any, baseline: Any, *, text: str, **more: Any) -> dict[str, Any]:
    """Record of a baseline: its figures, whether the model beats it, and a sentence on both.

    Parameters
    ----------
    data : QuantityData
    model, baseline : QuantityScore
        Of the calibrated model and of the baseline.
    text : str
        The baseline as the subject of a sentence, such as "interpolating the 21 fitted points".
    more : mapping
        Further keys of the record: "name", "rule", "extrapolated".
    """
    own, other = data.figures_of(model), data.figures_of(baseline)
    limit = significant(own["limit_quantity"], 3, MM3)
    keys = [item for item in _DECISIVE if number(other[item[0]]) is not None]
    worse = [item for item in keys if not _is_less(own[item[0]], other[item[0]])]
    pairs = listed(
        [
            f"{fixed(own[key], decimals, scale)} against {fixed(other[key], decimals, scale)} {unit} rms "
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


def places_of(data: Map) -> Floats:
    """Rail pressures [Pa] and energising times [s] of the rows, (n, 2)."""
    return np.array([(p.initial_pressures()[0], p.pulses[0].duration) for p in data.points])


def _is_plain(data: Map) -> bool:
    """True if every point has one energising at one rail pressure: what an interpolation knows."""
    return all(len(p.pulses) == 1 for p in data.points)


def _known(data: Map, rows: Bools) -> Floats:
    return np.column_stack([places_of(data), data.quantity])[rows]


def _dead_times(data: Map, fitted: Sequence[Map]) -> Floats:
    """Interpolated dead times [s] of the rows that are; NaN where no fitted one is of the same quantity."""
    known = np.concatenate([np.empty((0, 3)), *(_known(d, d.dead_time) for d in fitted)])
    found = []
    for (rail, _), quantity in zip(places_of(data)[data.dead_time], data.quantity[data.dead_time], strict=True):
        same = known[np.isclose(known[:, 2], quantity, rtol=1e-6, atol=0.0)]
        rising = same[np.argsort(same[:, 0])]
        single = len(np.unique(rising[:, 0])) == len(rising) > 0
        found.append(interpolate_line(rising[:, 0], rising[:, 1], rail)[0] if single else np.nan)
    return np.array(found)


def _closeness(data: Map, values: Floats) -> float:
    """Sum of squared errors in units of the tolerances."""
    error = (values - data.quantity) / (data.absolute + data.relative * data.quantity)
    return float(np.sum(error[data.judged] ** 2))


def _is_less(own: Any, other: Any) -> bool:
    return number(own) is not None and own < other
