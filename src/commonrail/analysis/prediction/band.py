"""Band in which measured values are expected, and how many of those that were measured it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.certainty.covariance import student
from commonrail.display.text import number
from commonrail.kinds import DataSet
from commonrail.kinds.records import point_record

__all__ = ["Band", "Scatter", "band_from_draws", "band_from_slopes"]

Floats = NDArray[np.float64]

REPLICATES = 8  # draws of the scatter for each draw of the parameters


class Scatter(NamedTuple):
    """Scatter of measured values about the best prediction: noise and discrepancy of the model.

    Attributes
    ----------
    factor : float
        Multiple of the tolerance of a kind that states one; else a standard deviation in the unit of the values.
    freedom : float
        Degrees of freedom of the factor; infinite where it is stated.
    """

    factor: float
    freedom: float

    def deviations(self, data: DataSet, values: Floats) -> Floats:
        """Standard deviations (n,) about predicted values (n,)."""
        stated = data.discrepancy(values)
        return self.factor * (np.ones(len(values)) if stated is None else stated)


class Band(NamedTuple):
    """Prediction of a data set.

    Attributes
    ----------
    data : DataSet
    values : (n,)
        Predictions in the unit of the data; NaN where a simulation failed.
    edges : mapping of float to ((n,), (n,))
        Lower and upper edges by level.
    measured : bool
        The data set has measured values, not operating points alone.
    """

    data: DataSet
    values: Floats
    edges: Mapping[float, tuple[Floats, Floats]]
    measured: bool

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Values (n,) that are judged and have a band."""
        found = self.data.judged & np.isfinite(self.values)
        for low, high in self.edges.values():
            found = found & np.isfinite(low) & np.isfinite(high)
        return np.asarray(found)

    def covered(self, level: float) -> int:
        """Number of measured values inside the band of a level."""
        low, high = self.edges[level]
        inside = (self.data.measured >= low) & (self.data.measured <= high)
        return int(np.count_nonzero(inside & self.counted))

    def half_width(self, level: float) -> float:
        """Median half width over the predicted value, where that is positive; NaN if nowhere."""
        low, high = self.edges[level]
        which = self.counted & (self.values > 0.0)
        return float(np.median(0.5 * (high - low)[which] / self.values[which])) if which.any() else float("nan")

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


def band_from_slopes(
    values: Floats, slopes: Floats, covariance: Floats, deviations: Floats, freedom: float, levels: Sequence[float]
) -> dict[float, tuple[Floats, Floats]]:
    """Edges of bands by the linear (Laplace) approximation.

    Parameters
    ----------
    values : (n,)
    slopes : (n, d)
        Derivatives with respect to the positions between the bounds.
    covariance : (d, d)
        Of the positions.
    deviations : (n,)
        Standard deviations of the scatter.
    freedom : float
        Degrees of freedom of the scatter.
    levels : sequence of float
    """
    variance = np.einsum("ni,ij,nj->n", slopes, covariance, slopes)
    total = np.sqrt(np.maximum(variance, 0.0) + deviations**2)
    halves = {level: float(student(np.array([freedom]), level)[0]) * total for level in levels}
    return {level: (values - half, values + half) for level, half in halves.items()}


def band_from_draws(
    drawn: Floats, deviations: Floats, freedom: float, levels: Sequence[float], seed: int = 0
) -> dict[float, tuple[Floats, Floats]]:
    """Edges of bands from predictions of drawn parameters.

    Parameters
    ----------
    drawn : (m, n)
        Predictions; NaN where a simulation failed.
    deviations : (n,)
        Standard deviations of the scatter.
    freedom : float
        Degrees of freedom of the scatter.
    levels : sequence of float
    seed : int
        Of the scatter that is added to each draw.
    """
    rng = np.random.default_rng(seed)
    shape = (REPLICATES, *drawn.shape)
    normal = rng.standard_normal(shape)
    if np.isfinite(freedom):
        normal /= np.sqrt(rng.chisquare(freedom, (*shape[:2], 1)) / freedom)
    wide = (drawn + normal * deviations).reshape(-1, drawn.shape[1])
    wide = wide[np.isfinite(wide).all(axis=1)]
    if not len(wide):
        nothing = np.full(drawn.shape[1], np.nan)
        return dict.fromkeys(levels, (nothing, nothing))
    found = {}
    for level in levels:
        low, high = np.quantile(wide, [0.5 * (1.0 - level), 0.5 * (1.0 + level)], axis=0)
        found[level] = (low, high)
    return found


def _shown(values: Floats) -> list[float | None]:
    return [number(v) for v in values.tolist()]
