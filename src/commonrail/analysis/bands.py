"""Bands in which measured values are expected, by the linear (Laplace) approximation about the best values."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.influence import Influence
from commonrail.analysis.neighbourhood import Neighbourhood
from commonrail.display.text import number
from commonrail.kinds import DataSet, Role, of_role
from commonrail.kinds.simulator import Simulator

__all__ = ["CLOSE", "ESTIMATOR", "LEVEL", "Optimum", "Predicted", "band_record", "bands_of", "half_widths"]

Floats = NDArray[np.float64]

CLOSE = 4.0  # difference of the sum of squares up to which another optimum explains the data as well
LEVEL = 0.9  # share of measured values that a band is to hold
ESTIMATOR = (
    "Laplace: linear about the best values, data and priors, scatter max(s, 1), plus the tolerance of the data as "
    "discrepancy of the model"
)


class Optimum(NamedTuple):
    """Values that explain the data, with candidates about them, and the influence of data and priors there."""

    place: Neighbourhood
    influence: Influence


class Predicted(NamedTuple):
    """Prediction of one optimum.

    Attributes
    ----------
    values : (n,)
    parameters : (n,)
        Standard errors from the parameters.
    discrepancy : (n,)
        Standard deviations of model and measurement besides them.
    """

    values: Floats
    parameters: Floats
    discrepancy: Floats

    def edges(self, *, alone: bool = False) -> tuple[Floats, Floats]:
        """Lower and upper edges (n,) of the bands, of the parameters alone if so wanted."""
        half = half_widths(self.parameters, np.zeros(len(self.values)) if alone else self.discrepancy)
        return self.values - half, self.values + half


def half_widths(parameters: Floats, discrepancy: Floats, level: float = LEVEL) -> Floats:
    """Half widths of two-sided bands (n,) of normally distributed values.

    Parameters
    ----------
    parameters : (n,)
        Standard errors of predictions that come from the parameters, see `Influence.predicted`.
    discrepancy : (n,)
        Standard deviations of model and measurement about the best prediction.
    level : float
        Share of the values that the band is to hold.
    """
    quantile = NormalDist().inv_cdf(0.5 * (1.0 + level))
    return np.asarray(quantile * np.sqrt(parameters**2 + discrepancy**2))


def bands_of(data: Sequence[DataSet], simulator: Simulator, optima: Sequence[Optimum]) -> dict[str, dict[str, Any]]:
    """Bands of all data sets by name; none if a fitted one is of a kind without a stated discrepancy.

    Parameters
    ----------
    data : sequence of DataSet
        Fitted and validated.
    simulator : Simulator
        Its parameters vary as in the neighbourhoods.
    optima : sequence of Optimum
        The best first; the others are those whose sum of squares is larger by less than `CLOSE`. A band is the union of
        theirs, from the lowest to the highest edge.
    """
    if any(d.discrepancy(d.measured) is None for d in of_role(data, Role.FIT)):
        return {}
    found = {}
    for one in data:
        predicted = []
        for place, influence in optima:
            values = one.simulated(simulator, place.values)
            discrepancy = one.discrepancy(values[0])
            if discrepancy is not None:
                predicted.append(Predicted(values[0], influence.predicted(place.slopes(values)), discrepancy))
        if predicted:
            found[one.name] = band_record(one, predicted)
    return found


def band_record(data: DataSet, predicted: Sequence[Predicted]) -> dict[str, Any]:
    """JSON-able record of the bands of one data set.

    Parameters
    ----------
    data : DataSet
    predicted : sequence of Predicted
        The best first.

    Returns
    -------
    dict
        "half_widths" about the best prediction for each value, None where it is not judged; of those that are, how many
        of the measured lie inside ("covered"), how many by the parameters alone, and the median half width in percent
        of the prediction. Of several optima also their number, and "lower" and "upper" edges of the union; the half
        widths then reach the farther edge, and the median is of half the distance between the edges.
    """
    best = predicted[0].values
    (lower, upper), (inner, outer) = _union(predicted), _union(predicted, alone=True)
    half = np.maximum(upper - best, best - lower)
    counted = data.judged & np.isfinite(half)
    measured, positive = data.measured[counted], counted & (best > 0.0)
    relative = 50.0 * (upper - lower)[positive] / best[positive]
    several = {"optima": len(predicted), "lower": _shown(lower, counted), "upper": _shown(upper, counted)}
    return {
        "level": LEVEL,
        "estimator": ESTIMATOR if len(predicted) == 1 else f"{ESTIMATOR}; union over {len(predicted)} optima",
        "half_widths": _shown(half, counted),
        "values": int(np.count_nonzero(data.judged)),
        "covered": int(np.count_nonzero((measured >= lower[counted]) & (measured <= upper[counted]))),
        "covered_by_parameters_alone": int(
            np.count_nonzero((measured >= inner[counted]) & (measured <= outer[counted]))
        ),
        "median_half_width_percent": float(np.median(relative)) if len(relative) else None,
        **(several if len(predicted) > 1 else {}),
    }


def _union(predicted: Sequence[Predicted], *, alone: bool = False) -> tuple[Floats, Floats]:
    """Lowest and highest edges (n,) of several bands."""
    edges = [one.edges(alone=alone) for one in predicted]
    return np.min([low for low, _ in edges], axis=0), np.max([high for _, high in edges], axis=0)


def _shown(values: Floats, counted: NDArray[np.bool_]) -> list[float | None]:
    """Values, None where they are not counted."""
    return [number(v) if c else None for v, c in zip(values.tolist(), counted.tolist(), strict=True)]
