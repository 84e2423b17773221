"""Bands of predictions as a CSV file, and operating points that predictions are wanted of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from commonrail.base.csv_output import write_csv
from commonrail.base.text import field_unit
from commonrail.base.units import convert
from commonrail.data.quantities.reading import map_columns
from commonrail.physics.law import Domain
from commonrail.plugins.prediction.band import Band
from commonrail.plugins.prediction.run import Prediction
from commonrail.readers.columns import Column

RAIL, TIME = "rail_pressure", "energising_time"


def read_points(path: Path) -> list[tuple[float, float]]:
    """Pairs of rail pressure [Pa] and energising time [s] of a file with these two columns.

    Raises `InputError` if the file cannot be read, a column or unit is missing, or a cell is no positive number.
    """
    expected = [Column(RAIL, "Pa", domain=Domain.POSITIVE), Column(TIME, "s", domain=Domain.POSITIVE)]
    columns = map_columns(path, expected).columns
    return list(zip(columns[RAIL].tolist(), columns[TIME].tolist(), strict=True))


def write_bands(path: Path, prediction: Prediction) -> None:
    """Write a row for each predicted value: place, prediction, edges of the bands, and the measured value if any.

    Raises `OutputError` if it cannot be written.
    """
    head = ["data set", f"{RAIL} [MPa]", f"{TIME} [us]", "start [us]", "end [us]", "unit", "predicted"]
    for level in prediction.levels:
        head += [f"lower {100.0 * level:g} %", f"upper {100.0 * level:g} %"]
    notes = ("predicted by commonrail, not measured", f"bands: {prediction.estimator}")
    rows = (row for band in prediction.bands for row in _rows(band))
    write_csv(path, notes, [*head, "measured"], rows)


def _rows(band: Band) -> Iterator[Sequence[str]]:
    data = band.data
    unit = field_unit(data.unit).name
    columns = [band.values, *(edge for pair in band.edges.values() for edge in pair)]
    columns.append(data.measured if band.measured else np.full(len(band.values), np.nan))
    shown = [convert(column, data.unit, unit) for column in columns]
    for i in np.flatnonzero(data.judged).tolist():
        point = data.points[i if data.bounds is None else 0]
        duration = point.pulses[0].duration if point.pulses else 0.0
        ends = ["", ""] if data.bounds is None else [f"{1e6 * data.bounds[i + k]:.9g}" for k in (0, 1)]
        where = [data.name, f"{1e-6 * point.initial_pressures()[0]:.9g}", f"{1e6 * duration:.9g}", *ends, unit]
        yield where + [f"{column[i]:.6g}" if np.isfinite(column[i]) else "" for column in shown]
