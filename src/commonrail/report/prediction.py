"""Predictions with bands as tables."""

from __future__ import annotations

from commonrail.display.table import Part, Table, table_of
from commonrail.display.text import MISSING, fixed, significant
from commonrail.kinds.records import Record

__all__ = ["coverage_table", "points_table"]

_MM3 = 1e9


def coverage_table(record: Record) -> Table:
    """Share of the measured values of each data set that lie inside the bands.

    Parameters
    ----------
    record : mapping
        Of `Prediction.record`.
    """
    rows = [(data, band) for data in record["data"] for band in data["bands"]]
    parts = (
        Part(("data set", "use"), lambda r: (r[0]["name"], r[0]["role"] or MISSING)),
        Part(
            ("band, %", "measured values inside", "of", "median half width, % of the prediction"),
            lambda r: (
                fixed(r[1]["level"], 0, 100.0),
                MISSING if r[1]["covered"] is None else str(r[1]["covered"]),
                str(r[0]["judged"]),
                significant(r[1]["median_half_width_percent"], 3),
            ),
        ),
    )
    note = f"Bands: {record['estimator']}."
    if any(data["role"] == "fit" for data in record["data"]):
        note += " Fitted values are seen by the fit: only the others test its bands."
    return table_of("Measured values inside the bands", rows, parts, note, 2)


def points_table(record: Record) -> Table:
    """Predicted quantities and their bands.

    Parameters
    ----------
    record : mapping
        Of `Prediction.record`, of operating points.
    """
    (data,) = record["data"]
    heads = ["rail pressure, MPa", "energising time, us", "quantity, mm3"]
    heads += [f"{fixed(level, 0, 100.0)} % band, mm3" for level in record["levels"]]

    def cells(i: int) -> tuple[str, ...]:
        point = data["points"][i]
        edges = [(band["lower"][i], band["upper"][i]) for band in data["bands"]]
        return (
            significant(point["rail_pressure"], 6, 1e-6),
            significant(point["energising_time"], 6, 1e6),
            significant(data["values"][i], 4, _MM3),
            *(f"{significant(low, 4, _MM3)} to {significant(high, 4, _MM3)}" for low, high in edges),
        )

    parts = (Part(tuple(heads), cells),)
    return table_of("Predicted quantities", range(len(data["values"])), parts, f"Bands: {record['estimator']}.", 0)
