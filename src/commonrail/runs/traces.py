"""traces.csv of a run folder: injection curves of the data and of every model, sample by sample."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.csv_output import write_csv
from commonrail.base.errors import InputError
from commonrail.base.input import check_sum
from commonrail.calibration.study_file import MOST_SAMPLES
from commonrail.data.records import MEASURED, MM3_PER_MS
from commonrail.readers.columns import Column
from commonrail.readers.table_sheet import WrittenTable

Trace = dict[str, Floats]
Traces = dict[str, Trace]

TIME = "time_s"
MOST_COLUMNS = 20  # eight models, the data, and columns that identify a row
MOST_SETS = 1000  # curves

_KEYS = ("data", "time [us]")
_UNIT = " [mm3/ms]"


class Curve(NamedTuple):
    """A data set: its name, bounds of the samples (n + 1,) [s], and rates (n,) [m³/s] by label, the data's included.

    `before` holds the texts of the columns that stand before the name.
    """

    data: str
    bounds: Floats
    rates: Mapping[str, Floats]
    before: Sequence[str] = ()

    @property
    def trace(self) -> Trace:
        """The curve with the same bits as `read_traces` returns, so that a regenerated report is identical."""
        rates = {label: rates * MM3_PER_MS / MM3_PER_MS for label, rates in self.rates.items()}
        finite = {label: values for label, values in rates.items() if np.isfinite(values).any()}
        return {TIME: 1e-6 * np.array(self.moments), **finite}

    @property
    def moments(self) -> list[float]:
        """Middles of the samples [us], rounded to 1e-6 us."""
        return [round(moment, 6) for moment in (0.5e6 * (self.bounds[1:] + self.bounds[:-1])).tolist()]


def write_traces(
    path: Path, notes: Iterable[str], labels: Sequence[str], curves: Iterable[Curve], before: Sequence[str] = ()
) -> None:
    """Write curves under comment lines; missing and non-finite values stay empty.

    `labels`: columns of rates; `before`: columns before the name of the data set. Numbers are written with all digits,
    so that J can be recomputed from the file.
    """
    header = [*before, *_KEYS, *(label + _UNIT for label in labels)]
    rows = (row for curve in curves for row in _rows(curve, labels))
    write_csv(path, notes, header, rows)


def _rows(curve: Curve, labels: Sequence[str]) -> Iterator[list[str]]:
    for i, moment in enumerate(curve.moments):
        rates = (float(curve.rates[label][i]) if label in curve.rates else math.nan for label in labels)
        texts = (repr(rate * MM3_PER_MS) if math.isfinite(rate) else "" for rate in rates)
        yield [*curve.before, curve.data, repr(moment), *texts]


def read_traces(path: Path) -> Traces:
    """Arrays "time_s" [s] and rates [m³/s] by label, for each data set; NaN where a simulation has no value.

    A label without any value for a data set is omitted there. `InputError` with the line for an invalid row.
    """
    return {
        name: {label: values for label, values in trace.items() if label == TIME or np.isfinite(values).any()}
        for (name,), trace in read_curves(path, MEASURED).items()
    }


def read_curves(path: Path, measured: str, before: Sequence[str] = ()) -> dict[tuple[str, ...], Trace]:
    """Curves [s, m³/s] by the texts in the columns `before` and the name of the data set.

    No number may be missing in the column `measured`. `InputError` as of `read_traces`.
    """
    check_sum(path)
    sheet = WrittenTable(path, most=MOST_SAMPLES)
    head, rest = (*before, *_KEYS), sheet.names[len(before) + len(_KEYS) :]
    labels = [cell.removesuffix(_UNIT) for cell in rest]
    is_valid = all(cell.endswith(_UNIT) for cell in rest) and len({*labels}) == len(labels)
    if (*sheet.names[: len(head)],) != head or measured not in labels or not is_valid:
        raise InputError(f'{path}: the header is not that of curves, "{",".join(head)},{measured}{_UNIT},…".')
    if len(sheet.names) > MOST_COLUMNS:
        raise InputError(f"{path}: the header has {len(sheet.names)} columns, and at most {MOST_COLUMNS} are read.")
    texts, moment = head[:-1], head[-1]
    needed = (moment, measured + _UNIT)
    table = sheet.take([*map(Column, texts), *(Column(name, "1", required=name in needed) for name in (moment, *rest))])
    groups: dict[tuple[str, ...], list[int]] = {}
    for i, key in enumerate(zip(*(table.texts[name] for name in texts), strict=True)):
        groups.setdefault(key, []).append(i)
        if len(groups) > MOST_SETS:
            raise InputError(
                f"{path}, line {table.rows[i]}: the file has more than the {MOST_SETS} data sets that are read."
            )
    rates = {label: table.columns[label + _UNIT] / MM3_PER_MS for label in labels}
    columns = {TIME: 1e-6 * table.columns[moment], **rates}
    return {key: {name: column[rows] for name, column in columns.items()} for key, rows in groups.items()}
