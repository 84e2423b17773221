"""Bands in which measured values are expected, by the linear (Laplace) approximation about the best values."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.influence import Influence
from commonrail.analysis.neighbourhood import Neighbourhood
from commonrail.display.text import number
from commonrail.kinds import DataSet, Role, of_role
from commonrail.kinds.simulator import Simulator

__all__ = ["ESTIMATOR", "LEVEL", "band_record", "bands_of", "half_widths"]

Floats = NDArray[np.float64]

LEVEL = 0.9  # share of measured values that a band is to hold
ESTIMATOR = (
    "Laplace: linear about the best values, data and priors, scatter max(s, 1), plus the tolerance of the data as "
    "discrepancy of the model"
)


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


def bands_of(
    data: Sequence[DataSet], simulator: Simulator, place: Neighbourhood, influence: Influence
) -> dict[str, dict[str, Any]]:
    """Bands of all data sets by name; none if a fitted one is of a kind without a stated discrepancy.

    Parameters
    ----------
    data : sequence of DataSet
        Fitted and validated.
    simulator : Simulator
        Its parameters vary as in the neighbourhood.
    place : Neighbourhood
        Of the best values.
    influence : Influence
        Of the fitted data and the priors there.
    """
    if any(d.discrepancy(d.measured) is None for d in of_role(data, Role.FIT)):
        return {}
    found = {}
    for one in data:
        values = one.simulated(simulator, place.values)
        discrepancy = one.discrepancy(values[0])
        if discrepancy is not None:
            found[one.name] = band_record(one, values[0], influence.predicted(place.slopes(values)), discrepancy)
    return found


def band_record(data: DataSet, best: Floats, parameters: Floats, discrepancy: Floats) -> dict[str, Any]:
    """JSON-able record of the bands of one data set.

    Parameters
    ----------
    data : DataSet
    best : (n,)
        Predicted values.
    parameters : (n,)
        Standard errors from the parameters.
    discrepancy : (n,)
        Standard deviations besides them.

    Returns
    -------
    dict
        "half_widths" for each value, None where it is not judged; of those that are, how many of the measured lie
        inside ("covered"), how many by the parameters alone, and the median half width in percent of the prediction.
    """
    half, alone = half_widths(parameters, discrepancy), half_widths(parameters, np.zeros(len(best)))
    counted = data.judged & np.isfinite(half)
    error = np.abs(best - data.measured)
    relative = 100.0 * half[counted & (best > 0.0)] / best[counted & (best > 0.0)]
    return {
        "level": LEVEL,
        "estimator": ESTIMATOR,
        "half_widths": [number(h) if c else None for h, c in zip(half.tolist(), counted.tolist(), strict=True)],
        "values": int(np.count_nonzero(data.judged)),
        "covered": int(np.count_nonzero(error[counted] <= half[counted])),
        "covered_by_parameters_alone": int(np.count_nonzero(error[counted] <= alone[counted])),
        "median_half_width_percent": float(np.median(relative)) if len(relative) else None,
    }
