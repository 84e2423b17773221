"""Values of judgements of a fit as named arrays over one axis: a row for each parameter, value, draw or measurement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.certainty.certify import Certainty
from commonrail.analysis.design.candidates import place_of
from commonrail.analysis.design.next import Plan
from commonrail.analysis.posterior.sample import Posterior
from commonrail.analysis.prediction.band import Band
from commonrail.analysis.prediction.predict import Prediction
from commonrail.arrays import Floats
from commonrail.report.named import Array, Arrays, in_edge_units

__all__ = ["arrays_of_certainty", "arrays_of_plan", "arrays_of_posterior", "arrays_of_prediction"]


def arrays_of_certainty(found: Certainty) -> Arrays:
    """Values and intervals of the parameters in SI units, which a column names."""
    own = found.estimate.likelihood
    columns = {
        "value": np.asarray(found.estimate.point),
        "lower": found.low,
        "upper": found.high,
        "unit": np.array(own.units),
        "verdict": np.array([judged.verdict.value for judged in found.verdicts]),
        "estimator": np.array(found.estimators),
    }
    return _table("parameter", own.names, columns, "Certainty of a fit")


def arrays_of_posterior(found: Posterior) -> Arrays:
    """Draws, a column for each parameter in SI units."""
    points = found.points()
    names = zip(found.names, found.estimate.likelihood.units, strict=True)
    values = {name: Array(("draw",), points[:, i], unit.removesuffix("1")) for i, (name, unit) in enumerate(names)}
    return Arrays({"draw": Array(("draw",), np.arange(len(points)))}, values, "Draws from the posterior")


def arrays_of_plan(found: Plan) -> Arrays:
    """Measurements in their order."""
    ones = found.measurements
    places = np.array([place_of(one.candidate.point) for one in ones]).reshape(-1, 3)
    axis = ("measurement",)
    values = {
        "kind": Array(axis, np.array([one.candidate.kind for one in ones])),
        "rail_pressure": in_edge_units(axis, places[:, 0], "Pa"),
        "energising_time": in_edge_units(axis, places[:, 1], "s"),
        "dwell": in_edge_units(axis, places[:, 2], "s"),
        "cost": Array(axis, np.array([one.candidate.cost for one in ones])),
        "expected": in_edge_units(axis, [one.value for one in ones], "m3"),
        "deviation": in_edge_units(axis, [one.deviation for one in ones], "m3"),
        "factor": Array(axis, np.array([one.factor for one in ones])),
    }
    return Arrays({"measurement": Array(axis, np.arange(1, len(ones) + 1))}, values, "Next measurements")


def arrays_of_prediction(found: Prediction) -> Arrays:
    """Predicted values with the edges of their bands; a column names the unit where it is not that of all."""
    units = {band.data.unit for band in found.bands}
    axis = ("value",)
    parts = [_columns(band, found.levels) for band in found.bands]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    unit = units.pop() if len(units) == 1 else ""
    values = {
        "data_set": Array(axis, np.repeat([b.data.name for b in found.bands], [len(b.values) for b in found.bands]))
    }
    for name, column in joined.items():
        own = {"rail_pressure": "Pa", "energising_time": "s", "start": "s", "end": "s"}.get(name, unit)
        values[name] = in_edge_units(axis, column, own) if own else Array(axis, column)
    if not unit:
        names = np.repeat([band.data.unit for band in found.bands], [len(band.values) for band in found.bands])
        values["unit"] = Array(axis, names)
    return Arrays({"value": Array(axis, np.arange(len(joined["predicted"])))}, values, "Predictions with bands")


def _columns(band: Band, levels: Sequence[float]) -> dict[str, Floats]:
    """Place, prediction, edges and measured value of each value of a data set, SI."""
    data, size = band.data, len(band.values)
    own = data.points if data.bounds is None else [data.points[0]] * size
    nothing = np.full(size, np.nan)
    columns = {
        "rail_pressure": np.array([point.initial_pressures()[0] for point in own]),
        "energising_time": np.array([point.pulses[0].duration if point.pulses else 0.0 for point in own]),
        "start": nothing if data.bounds is None else np.asarray(data.bounds[:-1]),
        "end": nothing if data.bounds is None else np.asarray(data.bounds[1:]),
        "predicted": band.values,
    }
    for level in levels:
        sides = zip(("lower", "upper"), band.edges[level], strict=True)
        columns |= {f"{side}_{100.0 * level:g}": edge for side, edge in sides}
    return columns | {"measured": np.asarray(data.measured, float) if band.measured else nothing}


def _table(axis: str, names: Sequence[str], columns: dict[str, NDArray[Any]], title: str) -> Arrays:
    values = {name: Array((axis,), column) for name, column in columns.items()}
    return Arrays({axis: Array((axis,), np.array(names))}, values, title)
