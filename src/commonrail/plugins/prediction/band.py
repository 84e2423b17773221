"""Band in which measured values are expected, and number of measured values inside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arrays import Bools, Floats
from commonrail.base.record import to_record
from commonrail.data.base import DataSet
from commonrail.data.records import point_record

Edges = tuple[Floats, Floats]

DIGITS = 5  # significant digits of the edges of curves in result.json
REPLICATES = 4  # values of the scatter for each draw of the parameters
LEAST_SOUND = 0.5  # share of the draws that must be finite for a value to have edges


class Band(NamedTuple):
    """Prediction of a data set."""

    data: DataSet
    values: Floats  # (n,), predictions in the unit of the data; NaN where a simulation failed
    edges: Mapping[float, tuple[Floats, Floats]]  # lower and upper edges by level
    measured: bool  # the data set has measured values, not operating points alone
    alone: Mapping[float, tuple[Floats, Floats]]  # edges from parameter uncertainty only

    @property
    def counted(self) -> Bools:
        """Values (n,) that are judged and have a band."""
        finite = self.data.judged & np.isfinite(self.values)
        for low, high in self.edges.values():
            finite = finite & np.isfinite(low) & np.isfinite(high)
        return np.asarray(finite)

    def covered(self, level: float) -> int:
        """Number of measured values inside the band of a level."""
        return self._inside(self.edges[level])

    def _inside(self, edges: Edges) -> int:
        inside = (self.data.measured >= edges[0]) & (self.data.measured <= edges[1])
        return int(np.count_nonzero(inside & self.counted))

    def half_width(self, level: float) -> float:
        """Median half width over the predicted value, for positive predictions; NaN if there are none.

        For a curve over time, the half width is divided by the largest predicted value.
        """
        low, high = self.edges[level]
        which = self.counted & (self.values > 0.0)
        if not which.any():
            return float("nan")
        scale = self.values[which] if self.data.bounds is None else float(self.values[which].max())
        return float(np.median(0.5 * (high - low)[which] / scale))

    def columns(self, levels: Sequence[float]) -> dict[str, Floats]:
        """Place, prediction, edges and measured value (n,) of each value [SI]; NaN if missing."""
        data, size = self.data, len(self.values)
        points = data.points if data.bounds is None else [data.points[0]] * size
        nothing = np.full(size, np.nan)
        columns = {
            "rail_pressure": np.array([point.initial_pressures()[0] for point in points]),
            "energising_time": np.array([point.pulses[0].duration if point.pulses else 0.0 for point in points]),
            "start": nothing if data.bounds is None else np.asarray(data.bounds[:-1]),
            "end": nothing if data.bounds is None else np.asarray(data.bounds[1:]),
            "predicted": np.where(data.judged, self.values, nothing),  # a dead time is not a quantity
        }
        for level in levels:
            sides = zip(("lower", "upper"), self.edges[level], strict=True)
            columns |= {f"{side}_{100.0 * level:g}": edge for side, edge in sides}
        return columns | {"measured": np.where(data.judged, data.measured, nothing) if self.measured else nothing}

    def judgement(self, level: float, estimator: str) -> dict[str, Any]:
        """Record of the band of one level, as result.json keeps it for a data set.

        "half_widths" of a map are to the farther edge, None where a value is not judged.
        """
        low, high = self.edges[level]
        half = np.where(self.counted, np.maximum(high - self.values, self.values - low), np.nan)
        lower, upper = ([float(f"{v:.{DIGITS}g}") for v in edge.tolist()] for edge in (low, high))
        record = {
            "level": level,
            "estimator": estimator,
            **({} if self.data.bounds is not None else {"half_widths": half}),
            "lower": lower,
            "upper": upper,
            "values": np.count_nonzero(self.data.judged),
            "covered": self.covered(level),
            "covered_by_parameters_alone": self._inside(self.alone[level]),
            "median_half_width_percent": 100.0 * self.half_width(level),
        }
        return dict(to_record(record))

    def record(self) -> dict[str, Any]:
        """JSON-able form."""
        data = self.data
        record = {
            "name": data.name,
            "kind": data.kind,
            "role": data.role if self.measured else None,
            "unit": data.unit,
            "points": [point_record(p) for p in (data.points if data.bounds is None else data.points[:1])],
            "bounds": data.bounds,
            "values": self.values,
            "measured": np.asarray(data.measured) if self.measured else None,
            "judged": np.count_nonzero(data.judged),
            "bands": [
                {
                    "level": level,
                    "lower": low,
                    "upper": high,
                    "covered": self.covered(level) if self.measured else None,
                    "median_half_width_percent": 100.0 * self.half_width(level),
                }
                for level, (low, high) in self.edges.items()
            ],
        }
        return dict(to_record(record))


def band_from_draws(drawn: Floats, deviations: Floats, freedom: float, levels: Sequence[float]) -> dict[float, Edges]:
    """Edges of bands from predictions (m, n) of drawn parameters, NaN where a simulation failed.

    `deviations` (n,), `freedom`: standard deviations of the scatter, and its degrees of freedom. A value that fails for
    half of the draws or more has no edges.
    """
    # a draw that fails at one operating point is still used at the others
    sound = (np.isfinite(drawn).mean(axis=0) > LEAST_SOUND) & np.isfinite(deviations)
    wide: Floats = np.ascontiguousarray(drawn[:, sound].T)
    if deviations[sound].any():
        wide = _scattered(wide, deviations[sound], freedom, np.random.default_rng(0))
    edges = np.full((2 * len(levels), drawn.shape[1]), np.nan)
    if sound.any():
        edges[:, sound] = _quantiles(wide, [0.5 * (1.0 + side * level) for level in levels for side in (-1.0, 1.0)])
    return {level: (edges[2 * i], edges[2 * i + 1]) for i, level in enumerate(levels)}


def _quantiles(rows: Floats, shares: Sequence[float]) -> Floats:
    """Quantiles (shares, n) of rows (n, m), linear between neighbours as `numpy.quantile` has them; NaN is left out."""
    if not np.isfinite(rows).all():
        return np.asarray(np.nanquantile(rows, shares, axis=1))
    places = np.multiply(shares, rows.shape[1] - 1)
    below = places.astype(int)
    above = np.minimum(below + 1, rows.shape[1] - 1)
    sorted_there = np.partition(rows, np.unique([below, above]), axis=1)
    low, high = sorted_there[:, below], sorted_there[:, above]
    return np.asarray(low + (places - below) * (high - low)).T


def _scattered(drawn: Floats, deviations: Floats, freedom: float, rng: np.random.Generator) -> Floats:
    """Predictions (n, replicates · m) of drawn parameters (n, m) with scatter.

    All values share the scatter samples: each value has its own edges, and sampling error then shifts all edges
    together. Normal samples are quantiles of equal probability, so few replicates suffice.
    """
    many = drawn.shape[1]
    size = REPLICATES * many
    scatter = rng.permutation(special.ndtri((np.arange(size) + 0.5) / size)).reshape(REPLICATES, many)
    if np.isfinite(freedom):
        scatter /= np.sqrt(rng.chisquare(freedom, scatter.shape) / freedom)
    return (drawn[:, None] + scatter * deviations[:, None, None]).reshape(len(drawn), -1)
