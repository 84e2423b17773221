"""Bands of measured quantities about the cells of a map, from the fit that the model was calibrated by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from commonrail.base.arrays import Bools, Floats
from commonrail.base.errors import ConfigurationError
from commonrail.plugins.maps.response import LONGEST_AFTER
from commonrail.plugins.maps.run import InjectionMap, MapBands

if TYPE_CHECKING:
    from commonrail.calibration.study import Study

SAME = 1e-6  # relative difference of a parameter from the fit's value that is rounding of the injector's file


def with_bands(
    found: InjectionMap, study: Study, best: Mapping[str, float], draws: Floats | None = None
) -> InjectionMap:
    """Map of an injector that a study has calibrated, with bands by `predict`; `best` are the values [SI] of the fit.

    The bands are predicted with the conditions and the time step of the map, and lie about its quantities: from `draws`
    (m, d), parameters [SI] of the posterior, or from the linear approximation about the best values.

    ConfigurationError if the injector of the map does not have the values of the fit, or the study fits no quantity
    map; SimulationError if the best values cannot be simulated.
    """
    from commonrail.plugins.prediction.run import LEVELS, predict

    _check_values(found, best)
    axes, conditions = found.axes, found.conditions
    forward, inverse = np.isfinite(found.volume), np.isfinite(found.inverse.delivered) & (axes.quantity > 0.0)
    pairs = _pairs(axes.rail_pressure, np.broadcast_to(axes.energising_time, forward.shape), forward)
    pairs += _pairs(axes.rail_pressure, found.inverse.energising_time, inverse)
    # a needle that closes late is no failure: simulations end with their injection anyway
    points = [replace(conditions.point(rail, time), horizon=time + LONGEST_AFTER) for rail, time in pairs]
    study = replace(study, time_step=conditions.time_step)
    predicted = predict(study, best, points, draws=draws, levels=LEVELS, threads=conditions.threads)
    (band,) = predicted.bands
    stated = float(np.asarray(band.data.mass_density))  # of the data; NaN for the injector's
    factor = stated / found.density if np.isfinite(stated) else 1.0
    count = int(forward.sum())
    quantity, delivered = {}, {}
    for level, edges in band.edges.items():
        apart = [factor * (edge - band.values) for edge in edges]
        quantity[level] = _tables(found.volume, forward, [one[:count] for one in apart])
        delivered[level] = _tables(found.inverse.delivered, inverse, [one[count:] for one in apart])
    return replace(found, bands=MapBands(predicted.estimator, quantity, delivered))


def _check_values(found: InjectionMap, best: Mapping[str, float]) -> None:
    values = found.injector.values
    for name, value in best.items():
        if name in values and not np.isclose(values[name], value, rtol=SAME, atol=0.0):
            raise ConfigurationError(
                f"{found.injector.name} has {name} = {values[name]:g} and the fit {value:g}: the bands of a fit are "
                "those of the injector that it has calibrated; omit the changes or the bands."
            )


def _pairs(rail_pressure: Floats, time: Floats, which: Bools) -> list[tuple[float, float]]:
    """Rail pressures and energising times of marked cells."""
    rail = np.broadcast_to(rail_pressure[:, None], time.shape)
    return list(zip(rail[which].tolist(), time[which].tolist(), strict=True))


def _tables(volume: Floats, which: Bools, apart: list[Floats]) -> tuple[Floats, Floats]:
    """Edges of all cells, from their distances from the quantities of marked ones; none is injected backwards."""
    low, high = np.full((2, *volume.shape), np.nan)
    centre = volume[which]
    low[which], high[which] = np.maximum(centre + apart[0], np.minimum(centre, 0.0)), centre + apart[1]
    return low, high
