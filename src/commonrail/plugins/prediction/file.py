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
    head += [f"{side} {100.0 * level:g} %" for level in prediction.levels for side in ("lower", "upper")]
    notes = ("predicted by commonrail, not measured", f"bands: {prediction.estimator}")
    rows = (row for band in prediction.bands for row in _rows(band, prediction.levels))
    write_csv(path, notes, [*head, "measured"], rows)


def _rows(band: Band, levels: Sequence[float]) -> Iterator[Sequence[str]]:
    unit, columns = field_unit(band.data.unit).name, band.columns(levels)
    places = [factor * columns.pop(name) for name, factor in ((RAIL, 1e-6), (TIME, 1e6), ("start", 1e6), ("end", 1e6))]
    values = [convert(column, band.data.unit, unit) for column in columns.values()]
    for i in np.flatnonzero(band.data.judged).tolist():
        place, value = ([_cell(column[i], digits) for column in group] for group, digits in ((places, 9), (values, 6)))
        yield [band.data.name, *place, unit, *value]


def _cell(value: float, digits: int) -> str:
    return f"{value:.{digits}g}" if np.isfinite(value) else ""
