"""Band in which measured values are expected, and how many of those that were measured it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arrays import Bools, Floats
from commonrail.base.text import number
from commonrail.data.base import DataSet
from commonrail.data.records import point_record

Edges = tuple[Floats, Floats]

DIGITS = 5  # of the edges of courses in result.json
REPLICATES = 4  # values of the scatter for each draw of the parameters
LEAST_SOUND = 0.5  # share of the draws that must give a value for it to have edges


class Band(NamedTuple):
    """Prediction of a data set."""

    data: DataSet
    values: Floats  # (n,), predictions in the unit of the data; NaN where a simulation failed
    edges: Mapping[float, tuple[Floats, Floats]]  # lower and upper edges by level
    measured: bool  # the data set has measured values, not operating points alone
    alone: Mapping[float, tuple[Floats, Floats]]  # edges by what the parameters may be alone

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
        """Median half width over the predicted value, where that is positive; NaN if nowhere.

        Of a course in time it is over the largest predicted value.
        """
        low, high = self.edges[level]
        which = self.counted & (self.values > 0.0)
        if not which.any():
            return float("nan")
        scale = self.values[which] if self.data.bounds is None else float(self.values[which].max())
        return float(np.median(0.5 * (high - low)[which] / scale))

    def judgement(self, level: float, estimator: str) -> dict[str, Any]:
        """JSON-able record of the band of one level, as result.json keeps it for a data set.

        Returns half widths about the predicted values of a map ("half_widths", to the farther edge), None where a value
        is not judged; edges ("lower", "upper"); counts of measured values inside.
        """
        low, high = self.edges[level]
        half = np.where(self.counted, np.maximum(high - self.values, self.values - low), np.nan)
        return {
            "level": level,
            "estimator": estimator,
            **({} if self.data.bounds is not None else {"half_widths": _shown(half)}),
            "lower": _short(low),
            "upper": _short(high),
            "values": int(np.count_nonzero(self.data.judged)),
            "covered": self.covered(level),
            "covered_by_parameters_alone": self._inside(self.alone[level]),
            "median_half_width_percent": number(100.0 * self.half_width(level)),
        }

    def record(self) -> dict[str, Any]:
        """JSON-able form."""
        data = self.data
        where = [point_record(p) for p in data.points] if data.bounds is None else [point_record(data.points[0])]
        return {
            "name": data.name,
            "kind": data.kind,
            "role": data.role.value if self.measured else None,
            "unit": data.unit,
            "points": where,
            "bounds": None if data.bounds is None else data.bounds.tolist(),
            "values": _shown(self.values),
            "measured": _shown(data.measured) if self.measured else None,
            "judged": int(np.count_nonzero(data.judged)),
            "bands": [
                {
                    "level": level,
                    "lower": _shown(low),
                    "upper": _shown(high),
                    "covered": self.covered(level) if self.measured else None,
                    "median_half_width_percent": number(100.0 * self.half_width(level)),
                }
                for level, (low, high) in self.edges.items()
            ],
        }


def band_from_draws(
    drawn: Floats,
    deviations: Floats,
    freedom: float,
    levels: Sequence[float],
) -> dict[float, Edges]:
    """Edges of bands from predictions of drawn parameters.

    `drawn` (m, n): predictions; NaN where a simulation failed. A value that fails for half of the draws or more has no
    edges; `deviations` (n,): standard deviations of the scatter; `freedom`: degrees of freedom of the scatter.
    """
    # a draw that fails at one operating point still tells of the others
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
    """Predictions (n, replicates · m) of drawn parameters (n, m) with scatter; see `band_from_draws`.

    All values share the scatter, since edges are of each value alone: what is left of chance moves them together.
    Normal scatters are equally likely ones, so that few replicates will do.
    """
    many = drawn.shape[1]
    size = REPLICATES * many
    scatter = rng.permutation(special.ndtri((np.arange(size) + 0.5) / size)).reshape(REPLICATES, many)
    if np.isfinite(freedom):
        scatter /= np.sqrt(rng.chisquare(freedom, scatter.shape) / freedom)
    return (drawn[:, None] + scatter * deviations[:, None, None]).reshape(len(drawn), -1)


def _shown(values: Floats) -> list[float | None]:
    return [number(v) for v in values.tolist()]


def _short(values: Floats) -> list[float | None]:
    """Values with the digits that a figure shows."""
    return [number(float(f"{v:.{DIGITS}g}")) for v in values.tolist()]
